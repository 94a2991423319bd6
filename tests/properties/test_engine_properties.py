"""Engines: what one sends another receives, and nothing off the channel does harm."""

import gc
import random
import types
from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.core.rig import End, Rig, link
from zacoustic.core.base.qos import Forward, Priority, Qos, Reliability, Stamp
from zacoustic.core.engine.events import RequestReceived, ResponseReceived, SampleReceived
from zacoustic.core.linktypes import BROADCAST, Transmission
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.core.wire.agreement import Ask, Confirm, Hello, TableRow, Tag

NODES = {1: "shore", 2: "auv", 3: "glider"}
TYPE = TypeSpec(
    name="T",
    fields=(
        FieldSpec(name="n", type="int32"),
        FieldSpec(name="x", type="float64", optional=True),
        FieldSpec(name="list", type="uint8", max_length=4),
    ),
)
DEEP = Qos(depth=1000)
LOG = Qos(depth=4, forward=Forward.ON_DEMAND, reliability=Reliability.RELIABLE)
VALUES = st.fixed_dictionaries(
    {
        "n": st.integers(-(2**31), 2**31 - 1),
        "x": st.none() | st.floats(allow_nan=False, allow_infinity=False),
        "list": st.lists(st.integers(0, 255), max_size=4),
    }
)


def fleet() -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=1, name="opaque", qos=DEEP),
            TopicSpec(stream_id=2, name="typed", type_name="T", qos=DEEP),
            TopicSpec(
                stream_id=3,
                name="w/{k}",
                wildcards=(Wildcard(name="k", values=("a", "b")),),
                qos=Qos(depth=1000, stamp=Stamp.AGE),
            ),
            TopicSpec(stream_id=4, name="one", subscribers=(2,), type_name="T", qos=DEEP),
            TopicSpec(stream_id=5, name="now", qos=Qos(depth=1000, priority=Priority.REAL_TIME)),
            TopicSpec(stream_id=6, name="view", qos=Qos(forward=Forward.ON_DEMAND)),
            TopicSpec(stream_id=7, name="log", qos=LOG),
            ServiceSpec(stream_id=20, name="arm", server=2, request_type="T"),
            ServiceSpec(stream_id=21, name="mine", server=1, response_type="T"),
        ],
        types=TypeTable([TYPE]),
        nodes=NODES,
    )


SAMPLES = st.one_of(
    st.tuples(st.just(1), st.binary(max_size=40), st.just(())),
    st.tuples(st.just(2), VALUES, st.just(())),
    st.tuples(st.just(3), st.binary(max_size=20), st.sampled_from([(0,), (1,)])),
    st.tuples(st.just(4), VALUES, st.just(())),
    st.tuples(st.just(5), st.binary(max_size=8), st.just(())),
)
LACKS = st.fixed_dictionaries({name: st.booleans() for name in ("addressed", "checked", "framed")})


@given(
    samples=st.lists(SAMPLES, max_size=30),
    lacks=LACKS,
    mtu_bytes=st.sampled_from([60, 64, 300, 512]),
    known=st.booleans(),
)
def test_everything_that_is_published_arrives_once_and_in_the_order_of_its_key(
    samples: list[tuple[int, Any, tuple[int, ...]]],
    lacks: dict[str, bool],
    mtu_bytes: int,
    known: bool,
) -> None:
    rig = Rig(dict.fromkeys(NODES, fleet()), capabilities=link(mtu_bytes=mtu_bytes, **lacks))
    if known:
        for address in NODES:
            rig.publish(address, 5, b"")
            rig.run(1)
        for end in rig.ends.values():
            end.events.clear()
    for stream_id, value, instance in samples:
        rig.publish(1, stream_id, value, instance=instance)

    def after_its_airtime(source: int, node: int, transmission: Transmission) -> bool:
        rig.now += rig[source].capabilities.airtime_ns(len(transmission.frame_bytes))
        return True  # an equal frame that came sooner would be an echo

    rig.exchange(after_its_airtime)
    for address in (2, 3):
        expected: dict[Any, list[Any]] = {}
        for stream_id, value, instance in samples:
            if stream_id != 4 or address == 2:
                expected.setdefault((stream_id, instance), []).append(value)
        arrived: dict[Any, list[Any]] = {}
        for event in rig[address].got(SampleReceived):
            assert event.source == 1
            arrived.setdefault((event.stream_id, event.instance), []).append(event.value)
        assert arrived == expected


@given(requests=st.lists(VALUES, max_size=12), lacks=LACKS)
def test_every_call_gets_its_own_answer(
    requests: list[dict[str, Any]], lacks: dict[str, bool]
) -> None:
    rig = Rig(dict.fromkeys(NODES, fleet()), capabilities=link(**lacks))
    asked = {rig[1].engine.call(20, value, 0): value for value in requests}
    rig.exchange()
    for event in reversed(rig[2].got(RequestReceived)):
        rig[2].engine.reply(event.call, str(event.value["n"]).encode(), 0)
    rig.exchange()
    answers = {event.call_id: event.value for event in rig[1].got(ResponseReceived)}
    assert answers == {call_id: str(value["n"]).encode() for call_id, value in asked.items()}


DIGESTS = st.sampled_from([fleet().digest, bytes(4), b"abcd", fleet().by_id(1).digest])
PIECES = st.one_of(
    st.binary(max_size=12),
    st.builds(
        lambda v, e, d: Hello(v, e, d).encode(), st.integers(1, 3), st.integers(0, 3), DIGESTS
    ),
    st.builds(lambda e: Tag(e).encode(), st.integers(0, 3)),
    st.builds(lambda a, e: Confirm(a, e).encode(), st.integers(0, 3), st.integers(0, 3)),
    st.builds(lambda a, s: Ask(a, s).encode(), st.integers(0, 3), st.integers(0, 255)),
    st.builds(
        lambda e, s, d: TableRow(e, s, d).encode(),
        st.integers(0, 3),
        st.integers(0, 255),
        DIGESTS,
    ),
    st.builds(lambda p, v, s: bytes((0xBC, p, v, s)), *(3 * [st.integers(0, 255)])),
    st.builds(lambda v, s: bytes((0xBC, 0, v, s)), *(2 * [st.integers(0, 255)])),
    st.builds(lambda s, c: bytes((s,)) + c, st.integers(1, 25), st.binary(max_size=9)),
    st.builds(
        lambda s, c: bytes((0xB2, len(c) + 1, s)) + c, st.integers(1, 25), st.binary(max_size=9)
    ),
    st.sampled_from([b"\xb3", b"\xb4\x05", b"\xb2", b"\xbf", b"\xc0", b"\x00"]),
)


@given(
    frames=st.lists(
        st.tuples(st.lists(PIECES, max_size=5).map(b"".join), st.integers(0, 5)), max_size=20
    ),
    lacks=LACKS,
)
def test_made_up_frames_are_counted_and_answered_within_bounds(
    frames: list[tuple[bytes, int]], lacks: dict[str, bool]
) -> None:
    end = End(1, fleet(), capabilities=link(**lacks))
    now = 0
    end.engine.subscriptions.want(6, now)
    for number, (frame, source) in enumerate(frames):
        now += 10_000_000
        end.hear(frame, now, source=source, destination=(1, BROADCAST)[number % 2])
        end.engine.publish(6, b"seen?", now)
        due_at = end.engine.poll_timeout()
        if due_at is not None and due_at <= now:
            end.engine.handle_timeout(now)
        for _ in range(100):
            if end.send(now) is None:
                break
        else:
            raise AssertionError("it never comes to rest")
        due_at = end.engine.poll_timeout()
        assert due_at is None or due_at > now
    assert end.engine.stats.frames_received == len(frames)


def mutated(rng: random.Random, frames: list[bytes]) -> bytes:
    """Return random bytes, or a real frame that was cut, flipped, spliced or repeated."""
    frame = bytearray(rng.choice(frames))
    for _ in range(rng.randrange(4)):
        match rng.randrange(6):
            case 0:
                frame = bytearray(rng.randbytes(rng.randrange(65)))
            case 1 if frame:
                frame[rng.randrange(len(frame))] ^= 1 << rng.randrange(8)
            case 2:
                del frame[rng.randrange(len(frame) + 1) :]
            case 3:
                frame += rng.choice(frames)
            case 4 if frame:
                frame[rng.randrange(len(frame))] = rng.randrange(256)
            case _:
                del frame[: rng.randrange(len(frame) + 1)]
    return bytes(frame[:512])


def real_frames(**lacks: bool) -> list[bytes]:
    """Return what three engines say to each other, with equal tables and with another."""
    other = StreamTable([TopicSpec(stream_id=1, name="other")], nodes=NODES)
    frames: set[bytes] = {b""}
    for tables in ((fleet(), fleet(), fleet()), (fleet(), other, fleet())):
        rig = Rig(dict(zip(NODES, tables, strict=True)), capabilities=link(**lacks))
        for number in range(5):
            rig.publish(2, 1, b"opaque%d" % number)
            if tables[1] is not other:
                rig.publish(2, 2, {"n": number, "x": 0.5, "list": [1]})
                rig.publish(2, 3, b"x", instance=(1,), encoding="application/json")
                rig[2].engine.call(21, b"please", rig.now)
            rig.publish(1, 1, b"mine")
            if tables[1] is not other:
                rig[1].engine.subscriptions.want(6, rig.now, (2,) if number % 2 else ())
                rig[1].engine.subscriptions.want(7, rig.now, (2,))
                rig.publish(2, 6, b"view")
                rig.publish(2, 7, b"log")
            rig.run(1)
            for event in rig[1].got(RequestReceived)[number:]:
                rig[1].engine.reply(event.call, {"n": 1, "x": None, "list": []}, rig.now)
        frames |= {sent.frame_bytes for _, sent in rig.frames}
    return sorted(frames)


def reachable(thing: object) -> int:
    """Count the objects that a thing holds."""
    seen: set[int] = set()
    todo = [thing]
    while todo:
        each = todo.pop()
        if id(each) in seen or isinstance(each, type | types.ModuleType | types.FunctionType):
            continue
        seen.add(id(each))
        todo += gc.get_referents(each)
    return len(seen)


@pytest.mark.parametrize("lacks", [(), ("checked",), ("addressed", "checked", "framed")])
def test_a_million_strange_frames_do_no_harm(
    count: Callable[[int], int], lacks: tuple[str, ...]
) -> None:
    settings = dict.fromkeys(lacks, False)
    rng = random.Random(f"strange {lacks}")
    frames = real_frames(**settings)
    end = End(1, fleet(), capabilities=link(**settings))
    now = 0
    total = count(1_000_000) // 3
    for number in range(total):
        now += rng.randrange(20_000_000)
        frame = mutated(rng, frames)
        source = rng.choice((0, 1, 2, 2, 2, 3, rng.randrange(256)))
        try:
            destination = 1 if rng.random() < 0.5 else BROADCAST
            end.hear(frame, now, source=source, destination=destination)
            if number % 10 == 0:
                sources = [each for each in NODES if rng.random() < 0.5]
                end.engine.subscriptions.want(rng.choice((6, 7)), now, sources)
                end.engine.publish(6, b"seen?", now)
            due_at = end.engine.poll_timeout()
            if due_at is not None and due_at <= now:
                end.engine.handle_timeout(now)
            if end.send(now) is None:
                due_at = end.engine.poll_timeout()
                assert due_at is None or due_at > now, "it spins"
        except Exception as error:
            raise AssertionError(f"frame {number} from {source}: {frame.hex()}") from error
        if number % 1000 == 0:
            end.events.clear()
    end.events.clear()
    assert end.engine.stats.frames_received == total
    assert sum(end.engine.stats.dropped.values()) > total // 10
    # 254 peers with a row and a question for each of 175 streams, and 128 calls of each.
    assert reachable(end.engine) < 400_000
