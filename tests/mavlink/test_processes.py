"""The bridges between an autopilot and a ground station, over two gateways and simulated water.

Both bridges are processes of their own, and so is the autopilot, which knows pymavlink alone
(`autopilot.py`). The ground station is a UDP port of this test.
"""

import asyncio
import json
import socket
import sys
import time
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator, Callable
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any, Final

import cbor2
import pytest

from tests.gateway.networks import (
    LIMIT_S,
    Channel,
    LocalNetwork,
    cbor,
    get,
    local_network,
    run,
)
from tests.gateway.test_command import notice, running
from tests.mavlink.messages import GROUND, STATION, VEHICLE, command_int, command_long
from tests.processes import killed_at_end
from zacoustic.app.cli import main as command_line
from zacoustic.core.values.encoding import CBOR
from zacoustic.mavlink.dialect import Message, PacketCodec
from zacoustic.mavlink.entries import entries

AUTOPILOT: Final = Path(__file__).with_name("autopilot.py")
OWN: Final = cbor2.dumps({"acoustic": 2, "call": "lost contact"})
"""The mark of a call that the vehicle's gateway makes."""
SECTION: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    **entries("auv1/mavlink", vehicle=2, shore=1, first_id=60),
}


class GroundStation(asyncio.DatagramProtocol):
    """A ground station that sends a heartbeat every half second while it is told to."""

    def __init__(self) -> None:
        self.packets = PacketCodec()
        self.heard: list[tuple[int, Message]] = []
        self.changed = asyncio.Event()
        self.transport: asyncio.DatagramTransport | None = None

    def connection_made(self, transport: Any) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, _: Any) -> None:
        for received in self.packets.feed(data, is_whole=True):
            self.heard.append((received.system, received.message))
        self.changed.set()

    def send(self, message: Message) -> None:
        assert self.transport is not None
        self.transport.sendto(self.packets.pack(message, system=GROUND[0], component=GROUND[1]))

    async def beat(self) -> None:
        while True:
            self.send(STATION)
            await asyncio.sleep(0.5)

    async def next(self, name: str, fits: Callable[[dict[str, Any]], bool] = lambda _: True) -> Any:
        """Wait for a message that is not from before this call."""
        self.heard.clear()
        async with asyncio.timeout(LIMIT_S):
            while True:
                for system, message in self.heard:
                    if message.name == name and fits(message.fields):
                        assert system == VEHICLE
                        return message.fields
                self.changed.clear()
                await self.changed.wait()


class AutopilotProcess:
    """The autopilot, and what it got."""

    def __init__(self, process: Process) -> None:
        self.process = process

    def order(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{line}\n".encode())

    async def next(self, name: str, command: int | None = None) -> dict[str, Any]:
        """Read the next message of a name that it got."""
        assert self.process.stdout is not None
        async with asyncio.timeout(LIMIT_S):
            while line := await self.process.stdout.readline():
                found: dict[str, Any] = json.loads(line)
                if found["mavpackettype"] == name and command in (None, found.get("command")):
                    return found
        raise AssertionError("the autopilot has ended")


@asynccontextmanager
async def autopilot(port: int) -> AsyncIterator[AutopilotProcess]:
    process = await asyncio.create_subprocess_exec(
        sys.executable, str(AUTOPILOT), str(port), stdin=PIPE, stdout=PIPE
    )
    async with killed_at_end(process):
        yield AutopilotProcess(process)


async def events(process: Process, count: int) -> list[str]:
    """Read the next notices."""
    assert process.stdout is not None
    async with asyncio.timeout(LIMIT_S):
        lines = [await process.stdout.readline() for _ in range(count)]
    return [json.loads(line)["event"] for line in lines]


async def all_of(process: Process, events: set[str]) -> None:
    """Wait for notices, in any order."""
    assert process.stdout is not None
    async with asyncio.timeout(LIMIT_S):
        while events:
            line = await process.stdout.readline()
            assert line, "the bridge has ended"
            events.discard(json.loads(line)["event"])


def write_fleet(path: Path) -> Path:
    section = {"__required__": False, **SECTION}
    settings = {"plugins_loading": {"enabled": False}, "plugins": {"acoustic": section}}
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


async def bridge(
    stack: AsyncExitStack, side: str, file: Path, network: LocalNetwork, *arguments: object
) -> tuple[Process, int]:
    """Start a bridge; returns it and its MAVLink port."""
    process = await stack.enter_async_context(
        running("mavlink", side, file, "--mavlink", "udpin:127.0.0.1:0", "--lost-after", 3,
                "--connect", f"tcp/127.0.0.1:{network.port}", "--json", *arguments)
    )  # fmt: skip
    started = await notice(process, "started")
    return process, int(started["text"].rpartition(":")[2])


def test_a_ground_station_commands_an_autopilot_and_learns_of_every_loss(tmp_path: Path) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel, file = Channel(), write_fleet(tmp_path / "fleet.json5")
            networks = [
                await stack.enter_async_context(local_network(address, channel, section=SECTION))
                for address in (1, 2)
            ]
            (shore, shore_port), (vehicle, vehicle_port) = await asyncio.gather(
                bridge(stack, "shore", file, networks[0], "--every", 0.5),
                bridge(stack, "vehicle", file, networks[1], "--interval", 0.5),
            )
            pilot = await stack.enter_async_context(autopilot(vehicle_port))
            await notice(vehicle, "autopilot")
            loop = asyncio.get_running_loop()
            transport, station = await loop.create_datagram_endpoint(
                GroundStation, remote_addr=("127.0.0.1", shore_port)
            )
            stack.callback(transport.close)
            beating = asyncio.create_task(station.beat())

            # What the vehicle says of itself, and that shore is there, crosses.
            seen = await station.next("HIGH_LATENCY2")
            assert (seen["latitude"], seen["longitude"]) == (-37_812_340, 1_449_631_230)
            assert (seen["altitude"], seen["battery"], seen["failure_flags"]) == (-21, 87, 0x1000)
            beat = await station.next("HEARTBEAT")
            assert (beat["base_mode"], beat["custom_mode"]) == (1, 19)
            assert (await pilot.next("HEARTBEAT"))["from"] == GROUND[0]

            # Others at the bridge's port take nothing from the autopilot.
            foreign = stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            for data in (b"probe", station.packets.pack(STATION, system=3, component=1)):
                foreign.sendto(data, ("127.0.0.1", vehicle_port))
            assert (await notice(vehicle, "other"))["is_trouble"]
            known_at = time.monotonic()
            while (await pilot.next("HEARTBEAT"))["at"] < known_at:
                pass

            # A command that is repeated is executed once, and its answer is the autopilot's.
            for confirmation in (0, 1, 2):
                station.send(command_long(400, 1, confirmation=confirmation))
            acknowledged = await station.next("COMMAND_ACK", lambda each: each["result"] != 5)
            assert (acknowledged["command"], acknowledged["result"]) == (400, 0)
            await station.next("HEARTBEAT", lambda each: each["base_mode"] == 129)
            beating.cancel()
            pilot.order("refuse Arm: Leak detected")
            station.send(command_int(192, -1, 1, 0, 0.0, -379_000_000, 1_449_700_000, -5.0))
            text = await station.next("STATUSTEXT")
            assert text["text"] == "waypoint: Arm: Leak detected"
            arm = await pilot.next("COMMAND_LONG", 400)
            assert (arm["param1"], arm["confirmation"]) == (1, 0)
            goto = await pilot.next("COMMAND_INT")
            assert (goto["x"], goto["y"], goto["z"]) == (-379_000_000, 1_449_700_000, -5.0)

            # No autopilot: the ground station sees nothing more, and is told why. Nobody on shore:
            # the bridge ends its heartbeats, so the failsafe of an autopilot decides.
            pilot.process.kill()
            text = await station.next("STATUSTEXT", lambda each: each["severity"] == 2)
            assert text["text"] == "auv1: no report for 3 s"
            assert (await notice(shore, "vehicle_lost"))["is_trouble"]
            await all_of(vehicle, {"ground_station_lost", "autopilot_lost"})
            # Nothing but an abort is passed on to a vehicle that is not heard.
            station.send(command_long(400, 1))
            refused = await station.next("COMMAND_ACK")
            assert (refused["command"], refused["result"]) == (400, 1)
            # The gateway of the vehicle itself is no sign of shore.
            session = stack.enter_context(networks[1].client())
            replies = await get(
                session, "auv1/mavlink/abort", cbor(action="land"), encoding=CBOR, attachment=OWN
            )
            answer = cbor2.loads(replies.payload("auv1/mavlink/abort"))
            assert (answer["success"], answer["result"]) == (False, "no_autopilot")
            assert await events(vehicle, 2) == ["command", "answer"]
            station.send(command_long(21))
            refused = await station.next("COMMAND_ACK")
            assert (refused["command"], refused["result"]) == (21, 1)
            assert [message.name for _, message in station.heard] == ["STATUSTEXT", "COMMAND_ACK"]

    run(main())


def test_streams_are_entries_that_check_accepts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command_line(["mavlink", "streams", "--prefix", "boat/mav", "--vehicle", "9"]) == 0
    entries_text = capsys.readouterr().out
    nodes = '[{ address: 1, name: "shore" }, { address: 9, name: "boat" }]'
    file = tmp_path / "fleet.json5"
    file.write_text(f"{{ plugins: {{ acoustic: {{ nodes: {nodes},\n{entries_text} }} }} }}")
    assert command_line(["config", "check", str(file), "--address", "9"]) == 0
    assert "boat/mav/high_latency2" in capsys.readouterr().out
    assert command_line(["mavlink", "streams", "--first-id", "172"]) == 2
    assert "id: 176" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("place", "told"),
    [
        ("udp:127.0.0.1:14550", "allowed: udpin:HOST:PORT"),
        ("udpin:127.0.0.1", "allowed: udpin:HOST:PORT"),
        ("tcp:127.0.0.1:0", "allowed: 1..65535"),
    ],
)
def test_a_wrong_place_is_refused_before_anything_is_tried(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], place: str, told: str
) -> None:
    file = write_fleet(tmp_path / "fleet.json5")
    assert command_line(["mavlink", "shore", str(file), "--mavlink", place]) == 2
    assert told in capsys.readouterr().err


def test_a_file_without_the_streams_says_where_they_come_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "fleet.json5"
    file.write_text('{ plugins: { acoustic: { streams: [ { id: 1, topic: "hello" } ] } } }')
    assert command_line(["mavlink", "vehicle", str(file), "--mavlink", "udpin:127.0.0.1:0"]) == 2
    told = capsys.readouterr().err
    assert "no topic …/high_latency2 (zacoustic mavlink streams prints the entries" in told


def test_without_pymavlink_the_extra_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [each for each in sys.modules if each.partition(".")[0] == "pymavlink"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "pymavlink", None)
    file = write_fleet(tmp_path / "fleet.json5")
    assert command_line(["mavlink", "shore", str(file), "--mavlink", "udpin:127.0.0.1:0"]) == 1
    assert "pip install '.[mavlink]'" in capsys.readouterr().err
