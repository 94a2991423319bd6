"""Memory is bounded by the table, whatever is published and whoever talks."""

import gc
import random
import types
from collections.abc import Callable
from functools import partial

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.engine import Engine
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import WIRE_VERSION, Hello, Tag
from zacoustic.testing.virtual import VirtualNetwork

DEPTH = 10


def fleet() -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=1, name="flood", qos=Qos(depth=DEPTH)),
            TopicSpec(stream_id=2, name="other", qos=Qos(depth=DEPTH)),
            ServiceSpec(stream_id=20, name="arm", server=1, timeout_s=3600),
        ],
        nodes={1: "shore", 2: "auv"},
    )


def network() -> VirtualNetwork:
    return VirtualNetwork(
        line(0, 500, channel="none"), fleet(), deliver=lambda address, event: None
    )


def reachable(engine: Engine) -> int:
    """Count the objects that an engine holds."""
    seen: set[int] = set()
    todo: list[object] = [vars(engine)]
    while todo:
        each = todo.pop()
        code = type | types.ModuleType | types.FunctionType | types.MethodType | VirtualNetwork
        if id(each) in seen or isinstance(each, code):
            continue
        seen.add(id(each))
        todo += gc.get_referents(each)
    return len(seen)


def test_flood_of_samples_is_bounded_by_the_depth() -> None:
    medium = network()
    engine = medium.engine(1)
    for number in range(20_000):
        medium.publish(1, 1 + number % 2, b"%05d" % number)
        if number == 1_000:  # small integers are shared, and counts are no longer small
            before = reachable(engine)
    assert engine.pending(1) == engine.pending(2) == DEPTH
    assert reachable(engine) <= before + 10
    # One frame went before the rest was there.
    assert sum(engine.superseded.values()) == 20_000 - 2 * DEPTH - 1


def test_flood_while_the_link_is_down_is_bounded_too() -> None:
    medium = network()
    medium.set_link(1, up=False)
    for number in range(5_000):
        medium.publish(1, 1, b"%05d" % number)
    assert medium.engine(1).pending(1) == DEPTH
    medium.set_link(1, up=True)
    medium.run(until_s=100)
    assert medium.engine(2).stats.received == {1: DEPTH}


def test_strange_sources_with_ever_new_epochs_cost_bounded_memory(
    sized: Callable[..., int],
) -> None:
    frames = sized(10_000, share=5_000)
    medium = network()
    engine = medium.engine(1)
    rng = random.Random(1)
    sizes: list[int] = []
    own = fleet().digest

    def hear(number: int) -> None:
        source = rng.randrange(2, 255)
        digest = rng.choice((own, rng.randbytes(4)))
        hello = Hello(WIRE_VERSION, rng.randrange(65536), digest).encode()
        tag = Tag(rng.randrange(65536)).encode()
        call = b"\x14" + bytes((rng.randrange(64),)) + b"?"
        record = rng.choice((call, b"\x01x", bytes((rng.randrange(1, 176), 0))))
        frame = ReceivedFrame(
            frame_bytes=rng.choice((hello, tag, b"")) + record,
            received_at=medium.now,
            source=source,
        )
        medium.apply(1, lambda engine, now: engine.handle_frame(frame, now))
        if (number + 1) % (frames // 4) == 0:
            sizes.append(reachable(engine))

    for number in range(frames):
        medium.at(number * 0.5, partial(hear, number))
    medium.run(until_s=frames * 0.5 + 1000)
    # 253 sources with their rows and questions, and what each has asked for.
    assert max(sizes) < 120_000, sizes
    assert sizes[-1] < 1.5 * sizes[1] + 1000, sizes


def test_calls_that_nobody_answers_cost_bounded_memory_at_the_server(
    sized: Callable[..., int],
) -> None:
    lives = sized(300, share=100)
    medium = network()
    engine, own = medium.engine(1), fleet().digest
    for life in range(lives):
        hello = Hello(WIRE_VERSION, life, own).encode()
        for number in range(64):
            frame = ReceivedFrame(
                frame_bytes=hello + bytes((20, number)) + b"?",
                received_at=medium.now,
                source=2,
            )
            engine.handle_frame(frame, medium.now)
    assert engine.stats.received[20] <= 512
    assert sum(engine.stats.dropped.values()) >= lives * 64 - 512
