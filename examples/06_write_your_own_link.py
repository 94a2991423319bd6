"""A link of your own: modems that talk by UDP on this computer. It passes the conformance battery.

Run it: python examples/06_write_your_own_link.py
By locator, bench/127.0.0.1:9000, with this in the pyproject.toml of your package:
[project.entry-points."zacoustic.links"]   bench = "your_package:BenchLink"
"""

import asyncio
import time
from typing import Self

from zacoustic import LinkClosedError, LinkOpenError, Node
from zacoustic.core import linktypes as lt
from zacoustic.core.clock import ns_to_seconds
from zacoustic.link import Link, LinkConfig, LinkReceiver


class BenchLink(Link, asyncio.DatagramProtocol):
    """Modems that talk by UDP; node N listens at the port behind the base port by N."""

    capabilities = lt.LinkCapabilities(
        mtu_bytes=64, bit_rate_bps=4800.0, preamble_s=0.02, propagation_s=0.0,
        half_duplex=False, controls_access=True, address_range=(1, 8),
    )  # fmt: skip

    def __init__(self, host: str, port: int, node_address: int) -> None:
        self.host, self.port, self.address = host, port, node_address
        self.receiver: LinkReceiver | None = None
        self.on_air: tuple[lt.Transmission, int, asyncio.TimerHandle] | None = None

    @classmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        """Take the locator apart."""
        host, _, port = address.rpartition(":")
        return cls(host, int(port), node_address)

    async def open(self, receiver: LinkReceiver) -> None:
        """Open the port."""
        here, loop = (self.host, self.port + self.address), asyncio.get_running_loop()
        try:
            self.transport, _ = await loop.create_datagram_endpoint(lambda: self, local_addr=here)
        except OSError as error:
            raise LinkOpenError(f"{here}: {error}") from error
        self.receiver = receiver
        receiver.state_changed(lt.LinkState.UP)

    async def close(self) -> None:
        """Close it; report the frame on the air as ABORTED."""
        if self.receiver is not None:
            self.finish(lt.TransmitOutcome.ABORTED)
            await asyncio.sleep(0)  # reports that wait for the next turn of the loop go first
            self.receiver = None
            self.transport.close()
            await asyncio.sleep(0)  # and in the one after it the port is free

    def transmit(self, transmission: lt.Transmission) -> None:
        """Begin a transmission; one report follows, never from here."""
        if self.receiver is None:
            raise LinkClosedError("the link is not open")
        now, loop = time.monotonic_ns(), asyncio.get_running_loop()
        size = len(transmission.frame_bytes)
        if self.on_air is not None or not 1 <= size <= self.capabilities.mtu_bytes:
            rejected = lt.TransmitOutcome.REJECTED
            loop.call_soon(self.report, transmission, now, rejected, "busy, or too large")
        else:
            airtime_s = ns_to_seconds(self.capabilities.airtime_ns(size))
            self.on_air = (transmission, now, loop.call_later(airtime_s, self.finish))

    def finish(self, outcome: lt.TransmitOutcome = lt.TransmitOutcome.SENT) -> None:
        """End the transmission: now all of it is out."""
        if self.on_air is None:
            return
        (sent, started_at, timer), self.on_air = self.on_air, None
        timer.cancel()
        head = b"~" + bytes((self.address, sent.destination))
        for node in set(range(1, 9)) - {self.address} if outcome is lt.TransmitOutcome.SENT else ():
            self.transport.sendto(head + sent.frame_bytes, (self.host, self.port + node))
        self.report(sent, started_at, outcome, "")

    def report(self, sent: lt.Transmission, at: int, how: lt.TransmitOutcome, why: str) -> None:
        """Report how a transmission ended."""
        assert self.receiver is not None
        report = lt.TransmitReport(
            transmission_id=sent.transmission_id, outcome=how, started_at=at,
            finished_at=time.monotonic_ns(), detail=why,
        )  # fmt: skip
        self.receiver.transmit_finished(report)

    def datagram_received(self, data: bytes, addr: object) -> None:
        """Take a frame; ignore anything else."""
        is_ours = len(data) > 3 and data[:1] == b"~" and data[2] in (self.address, lt.BROADCAST)
        if self.receiver is not None and is_ours:
            frame = lt.ReceivedFrame(
                frame_bytes=data[3:], received_at=time.monotonic_ns(),
                source=data[1], destination=data[2],
            )  # fmt: skip
            self.receiver.frame_received(frame)


async def main() -> None:
    near, far = (BenchLink("127.0.0.1", 9310, address) for address in (1, 2))
    async with Node(1, link=near) as talker, Node(2, link=far) as listener:
        subscription = listener.subscribe(bytes, "hello", stream_id=1)
        talker.create_publisher(bytes, "hello", stream_id=1).publish(b"through the air")
        sample = await subscription.receive()
        print(f"node {sample.source} says {sample.value.decode()!r} on {sample.key}")


if __name__ == "__main__":
    asyncio.run(main())
