"""A node of a sealed fleet that says what it may not: refused, counted and told by name."""

import asyncio
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Final

from tests.virtual.fleet import line
from tests.virtual.sealed import KEY, SealedFleet
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CommandHandled, SampleReceived, SealAlarm
from zacoustic.core.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.peers.sealing import SealRefusal
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.commands import COMMANDS_STREAM_ID, CommandKind, RemoteCommand
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.seal import LongHead, Way, associated_data, nonce
from zacoustic.run.audit import AuditLog, read_audit
from zacoustic.seal.ccm import FleetCipher
from zacoustic.testing.virtual import VirtualNetwork
from zacoustic.zenoh.gateway.events.said import said

STOP, NAV = 10, 11
NODES: Final = {1: "shore", 2: "auv", 3: "buoy"}
TABLE: Final = StreamTable(
    [
        TopicSpec(stream_id=STOP, name="auv/stop", publishers=(1,)),
        TopicSpec(stream_id=NAV, name="{node}/nav"),
    ],
    nodes=NODES,
)


def say(network: VirtualNetwork, stream_id: int, counter: int) -> None:
    """Let node 2 hear a sample that node 3 has sealed, with an engine that does not ask."""
    way, head = Way(3, BROADCAST), LongHead(KEY.generation, 7, counter).encode()
    associated = associated_data(head, way, TABLE.digest)
    body = FleetCipher(KEY).seal(
        way, nonce(way, 7, counter), bytes((stream_id,)) + b"now", associated
    )

    def hear(engine: Engine, now: int) -> None:
        frame = ReceivedFrame(
            frame_bytes=head + body, source=3, destination=BROADCAST, received_at=now
        )
        engine.handle_frame(frame, now)

    network.apply(2, hear)


def alarms(network: VirtualNetwork) -> list[tuple[int, int | None, int]]:
    """Return who was named by node 2, for which stream, and how often it did it."""
    told = [event for at, event in network.events if at == 2 and isinstance(event, SealAlarm)]
    assert {each.refusal for each in told} <= {SealRefusal.FORBIDDEN}
    return [(each.address, each.stream_id, each.frames) for each in told]


def test_a_node_that_is_no_publisher_is_named_with_the_stream_and_the_count(
    tmp_path: Path,
) -> None:
    log = AuditLog(tmp_path / "node-2.audit", 2, TABLE, lambda: 0, sealed=True)
    fleet = SealedFleet()

    def build(*, address: int, **settings: Any) -> Engine:
        engine = fleet(address=address, **settings)
        if address == 2:
            log.watch(engine)
        return engine

    network = VirtualNetwork(line(0, 800), TABLE, build=build)
    for number in range(100):
        network.at(10.0 * number, partial(say, network, STOP if number % 2 else NAV, number))
    network.run(until_s=2000.0)
    heard = {
        event.stream_id
        for at, event in network.events
        if at == 2 and isinstance(event, SampleReceived)
    }
    assert heard == {NAV}
    assert network.engine(2).stats.dropped["not_publisher"] == 50
    assert alarms(network) == [(3, STOP, 1), (3, STOP, 31)], "every ten minutes"
    asyncio.run(log.close())
    noted = [
        (each.by, each.what, each.outcome, each.about, each.text)
        for each in read_audit(tmp_path / "node-2.audit")
    ]
    assert noted == [
        (3, "seal", "forbidden", "auv/stop", "1 frames"),
        (3, "seal", "forbidden", "auv/stop", "31 frames"),
    ]
    told = [each for _, each in network.events if isinstance(each, SealAlarm)]
    context: Any = SimpleNamespace(engine=network.engine(2))
    notice = said(told[-1], context)
    assert notice is not None
    assert notice.lines() == ["seal      3 buoy: it sends what it may not send: auv/stop (31)"]


def test_a_node_whose_commands_are_not_executed_is_named() -> None:
    rules = {1: TransmitRules(), 2: TransmitRules(commands_from=frozenset({3}))}
    network = VirtualNetwork(line(0, 800), TABLE, build=SealedFleet(), rules=rules)
    command = RemoteCommand(kind=CommandKind.SILENCE, for_s=60.0)
    network.at(
        10.0, lambda: network.apply(1, lambda each, now: each.commands.send(2, command, now))
    )
    network.run(until_s=300.0)
    (handled,) = [event for _, event in network.events if isinstance(event, CommandHandled)]
    assert (handled.commanded_by, "accepts no commands from node 1" in handled.refusal) == (1, True)
    assert alarms(network) == [(1, COMMANDS_STREAM_ID, 1)]
