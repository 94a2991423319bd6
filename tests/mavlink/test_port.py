"""The MAVLink port at UDP: whose packets count, and who gets ours."""

import asyncio
import socket
from collections.abc import Callable
from contextlib import ExitStack

import pytest

from tests.gateway.networks import LIMIT_S, run
from tests.mavlink.messages import (
    ARMED_GUIDED,
    STATION,
    command_long,
    of_ground,
    of_vehicle,
    report,
)
from zacoustic.mavlink.autopilot import AutopilotSide
from zacoustic.mavlink.dialect import Message, PacketCodec
from zacoustic.mavlink.port import PEER_SILENCE_NS, Port
from zacoustic.mavlink.station import StationSide


class Listening:
    """A port at `udpin`, and what it took and said; its clock stands still."""

    def __init__(self) -> None:
        self.now = 0
        self.received: list[bytes] = []
        self.told: list[str] = []
        self.port = Port(
            "udpin:127.0.0.1:0",
            receive=self._receive,
            accept=lambda data: data.startswith(b"autopilot"),
            tell=lambda event, text, _: self.told.append(event),
            clock=lambda: self.now,
        )

        self.changed = asyncio.Event()

    def _receive(self, data: bytes, _: int) -> None:
        self.received.append(data)
        self.changed.set()

    async def takes(self, *datagrams: tuple[socket.socket, bytes]) -> list[bytes]:
        """Send datagrams, the last one of the peer; return those that count."""
        self.received.clear()
        place = ("127.0.0.1", int(self.port.name.rpartition(":")[2]))
        for sender, data in datagrams:
            sender.sendto(data, place)  # the system keeps the order
        async with asyncio.timeout(LIMIT_S):
            while datagrams[-1][1] not in self.received:
                self.changed.clear()
                await self.changed.wait()
        return self.received


def with_senders(use: Callable[[Listening, socket.socket, socket.socket], object]) -> None:
    async def main() -> None:
        listening = Listening()
        with ExitStack() as stack:
            senders = [
                stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
                for _ in range(2)
            ]
            for each in senders:
                each.bind(("127.0.0.1", 0))
                each.settimeout(LIMIT_S)
            await listening.port.open()
            try:
                await use(listening, *senders)  # type: ignore[misc]
            finally:
                await listening.port.close()

    run(main())


def test_a_peer_is_kept_until_it_is_silent() -> None:
    async def use(port: Listening, first: socket.socket, other: socket.socket) -> None:
        assert await port.takes((other, b"probe"), (first, b"autopilot 1")) == [b"autopilot 1"]
        port.now = PEER_SILENCE_NS - 1
        foreign = [(other, data) for data in (b"", b"probe", b"autopilot 2")]
        assert await port.takes(*foreign, (first, b"anything")) == [b"anything"]
        port.port.write(b"for the peer")
        assert await asyncio.to_thread(first.recv, 100) == b"for the peer"
        port.now += PEER_SILENCE_NS - 1
        assert await port.takes((other, b"autopilot 3"), (first, b"x")) == [b"x"], "from the last"
        assert port.told == ["peer", "other"], "said once"
        port.now += PEER_SILENCE_NS
        assert await port.takes((other, b"probe"), (other, b"autopilot 4")) == [b"autopilot 4"]
        port.port.write(b"for the next")
        assert await asyncio.to_thread(other.recv, 100) == b"for the next"
        assert port.told == ["peer", "other", "peer"]

    with_senders(use)


def test_nobody_gets_anything_before_the_other_end_is_there() -> None:
    async def use(port: Listening, first: socket.socket, other: socket.socket) -> None:
        port.port.write(b"too early")
        await port.takes((other, b"probe"), (first, b"autopilot"))
        port.port.write(b"a heartbeat")
        assert await asyncio.to_thread(first.recv, 100) == b"a heartbeat"
        other.setblocking(False)
        with pytest.raises(BlockingIOError):
            other.recv(100)

    with_senders(use)


def test_a_peer_says_what_the_other_end_would_say() -> None:
    packets = PacketCodec()
    vehicle = AutopilotSide(interval_s=10, lost_after_s=90, now=0)
    assert vehicle.is_of_other_end(of_vehicle(ARMED_GUIDED))
    for received in (
        of_vehicle(report()),
        of_vehicle(ARMED_GUIDED, component=100),
        of_vehicle(STATION, system=255),
        of_ground(command_long(400, 1)),
    ):
        assert not vehicle.is_of_other_end(received)
    vehicle.handle_message(of_vehicle(ARMED_GUIDED), 0)
    assert not vehicle.is_of_other_end(of_vehicle(ARMED_GUIDED, system=9))

    station = StationSide("auv1", ground_every_s=20, lost_after_s=90, now=0)
    assert station.is_of_other_end(of_ground(STATION))
    assert station.is_of_other_end(of_ground(command_long(400, 1)))
    assert not station.is_of_other_end(of_vehicle(ARMED_GUIDED))
    assert not station.is_of_other_end(of_ground(Message("PARAM_REQUEST_LIST", {})))
    assert packets.feed(b"GET / HTTP/1.1\r\n\r\n", is_whole=True) == []
