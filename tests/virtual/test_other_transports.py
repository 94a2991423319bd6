"""A transport of somebody else beside all others: the example's, with strangers and enemies."""

import importlib.util
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import TransportEvent
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.transport import contract as ct
from zacoustic.errors import ConfigError, LocalError
from zacoustic.testing import VirtualNetwork

EXAMPLE = Path(__file__).parents[2] / "examples" / "10_write_your_own_transport.py"
PLACES = {1: (0.0, 0.0, 10.0), 2: (1500.0, 0.0, 40.0), 3: (0.0, 1500.0, 60.0)}


def example() -> Any:  # a program, whose name is not one of a module
    spec = importlib.util.spec_from_file_location("ping_example", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PING = example()
WITH_PING: MakeEngine = partial(Engine, transports=[PING.Ping])


def table(nodes: dict[int, str] | None = None) -> StreamTable:
    topics = [
        TopicSpec(stream_id=1, name="fast", qos=Qos(priority=Priority.REAL_TIME, depth=1)),
        TopicSpec(stream_id=2, name="full", qos=Qos(depth=40)),
    ]
    return StreamTable(topics, nodes=nodes or {1: "shore", 2: "a", 3: "b"})


def make(*, build: MakeEngine = WITH_PING, seed: int = 1, **settings: Any) -> VirtualNetwork:
    nodes = tuple(NodeSpec(address=each, position=place) for each, place in PLACES.items())
    return VirtualNetwork(Scenario(nodes=nodes), table(), seed=seed, build=build, **settings)


def ping(sea: VirtualNetwork, source: int, address: int) -> None:
    sea.apply(source, lambda engine, now: engine.transport(PING.Ping).ping(address, now))


def hear(frame: ReceivedFrame, engine: Engine, now: int) -> None:
    engine.handle_frame(frame, now)


def told(sea: VirtualNetwork) -> list[TransportEvent]:
    return [event for _, event in sea.events if isinstance(event, TransportEvent)]


def test_it_gets_its_answer_while_full_frames_and_urgent_ones_wait() -> None:
    sea = make()
    for number in range(40):
        sea.publish(1, 2, bytes([number]) * 60)
    sea.every(8, partial(sea.publish, 1, 1, b"now"))
    sea.at(5, partial(ping, sea, 1, 2))
    sea.at(5, partial(ping, sea, 2, 3))
    sea.run(until_s=600)
    assert {type(event) for event in told(sea)} == {PING.Answered}
    assert len(told(sea)) == 2
    assert len(sea.samples(2, 2)) > 10


def test_nodes_without_it_skip_what_it_says_and_read_the_rest() -> None:
    plain = make(build=Engine)
    with_it = make()
    for sea in (plain, with_it):
        sea.publish(1, 2, b"hello")
        sea.run()
    assert [each.value for each in with_it.samples(2)] == [each.value for each in plain.samples(2)]
    assert with_it.digest == plain.digest, "what has nothing to say changes no byte"

    def build(**arguments: Any) -> Engine:
        return (WITH_PING if arguments["address"] == 1 else Engine)(**arguments)

    sea = make(build=build)
    ping(sea, 1, 2)
    sea.every(40, partial(sea.publish, 1, 2, b"beside"))
    sea.run(until_s=400)
    assert [type(event) for event in told(sea)] == [PING.Missed]
    assert [each.value for each in sea.samples(2)] == [b"beside"] * len(sea.samples(2)) != []
    assert sea.engine(2).stats.dropped["reserved"] == PING.ATTEMPTS


def test_its_bytes_are_in_the_ledger_and_its_runs_repeat() -> None:
    runs = []
    for _ in range(2):
        sea = make(seed=7)
        for address in (2, 3):
            ping(sea, 1, address)
        sea.run()
        runs.append((sea.digest, told(sea)))
        causes = {entry.cause.value for entry in sea.engine(1).stats.ledger()}
        assert "extension" in causes
        assert sea.is_quiet
    assert runs[0] == runs[1]


def test_what_is_forged_late_or_for_all_does_no_harm() -> None:
    sea = make()
    ping(sea, 1, 2)
    sea.run()
    answered = told(sea)
    for body in (b"", b"\x81", b"\xff", b"\x81\x00", bytes(254)):
        for destination in (1, 255):
            frame = ct.Extension(PING.CODE, body).encode()
            received = ReceivedFrame(
                frame_bytes=frame,
                received_at=sea.local_ns(1),
                source=2,
                destination=destination,
            )
            sea.apply(1, partial(hear, received))
    sea.run()
    assert told(sea) == answered
    dropped = sea.engine(1).stats.dropped
    assert dropped["unexpected_answer"] + dropped["payload"] + dropped.get("echo", 0) == 10


def test_a_node_that_is_forgotten_or_restarts_leaves_nothing_of_it() -> None:
    sea = make()
    ping(sea, 1, 3)
    sea.apply(1, lambda engine, now: engine.forget(3, now))
    sea.run()
    assert told(sea) == []
    sea.crash(2)
    ping(sea, 1, 2)
    sea.at(12, partial(sea.start, 2))
    sea.run()
    assert [type(event) for event in told(sea)] == [PING.Answered]


def test_what_cannot_be_is_refused() -> None:
    sea = make(build=Engine)
    with pytest.raises(LocalError, match="no transport ping; this engine has: none"):
        ping(sea, 1, 2)
    with pytest.raises(ConfigError, match="a name of its own"):
        make(build=partial(Engine, transports=[ct.Transport]))
    desert = StreamTable([], nodes={1: "a", 2: "b"}, wire=WireProfile.RMW_DESERT)
    nodes = tuple(NodeSpec(address=each, position=place) for each, place in PLACES.items())
    with pytest.raises(ConfigError, match="rmw_desert has no extensions"):
        VirtualNetwork(Scenario(nodes=nodes), desert, build=WITH_PING)

    with pytest.raises(ValueError, match="that no other transport has"):
        make(build=partial(Engine, transports=[PING.Ping, PING.Ping]))
