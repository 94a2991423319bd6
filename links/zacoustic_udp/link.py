"""UDP as a link: each frame is one datagram, to a multicast group or to the listed peers.

A datagram names no node and may come from anyone, so the core adds addresses and a check.
"""

import asyncio
import ipaddress
import socket
import time
from typing import Annotated, Final, Self

from msgspec import Meta

from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.linktypes import (
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.errors import ConfigError, LinkClosedError, LinkOpenError
from zacoustic.link import Link, LinkConfig, LinkReceiver

MTU_BYTES: Final = 1200
"""Largest frame: with the headers of IP and of a tunnel it fits one packet of any network."""
Place = tuple[str, int]
"""Host and port."""


class UdpConfig(LinkConfig, frozen=True, kw_only=True):
    """Settings of the link."""

    peers: str = ""
    """Destinations of frames: HOST:PORT, separated by commas; empty for a multicast group."""
    interface: str = ""
    """IPv4 address of the interface for a multicast group; empty: the system chooses."""
    bit_rate_bps: Annotated[float, Meta(gt=0)] = 1_000_000.0
    """Rate at which frames are sent, bit/s."""
    latency_s: Annotated[float, Meta(ge=0, title="seconds")] = 0.25
    """Longest delay of a datagram, s; the basis of time-outs."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A value is outside its range.
        """
        super().__post_init__()
        try:
            ipaddress.IPv4Address(self.interface or "0.0.0.0")
        except ValueError as error:
            raise ValueError(
                f"interface is {self.interface!r}; allowed: an IPv4 address"
            ) from error


class UdpLink(Link, asyncio.DatagramProtocol):
    """Datagrams between a port here and listed peers, or within a multicast group."""

    config_type = UdpConfig

    def __init__(self, here: Place, peers: list[Place], config: UdpConfig) -> None:
        self.capabilities = LinkCapabilities(
            mtu_bytes=MTU_BYTES, bit_rate_bps=config.bit_rate_bps, propagation_s=config.latency_s,
            half_duplex=False, addressed=False, checked=False, controls_access=True,
        )  # fmt: skip
        self._here, self._peers, self._interface = here, peers, config.interface
        self._receiver: LinkReceiver | None = None
        self._transport: asyncio.BaseTransport | None = None
        self._on_air: tuple[int, int, asyncio.TimerHandle] | None = None
        self._error = ""
        self._counts = dict.fromkeys(("sent", "received", "errors"), 0)

    @classmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        """Build the link of a multicast group, or of a port here with its peers.

        Raises:
            ConfigError: An address is not HOST:PORT, or frames have no destination.
        """
        assert isinstance(config, UdpConfig)
        here, peers = _place(address), [_place(each) for each in config.peers.split(",") if each]
        kind = ipaddress.ip_address(here[0])
        if kind.is_multicast == bool(peers) or (kind.is_multicast and kind.version == 6):
            raise ConfigError(
                f"udp/{address}: peers are {config.peers or 'none'}; allowed: an address of this "
                "machine with peers, or an IPv4 multicast group without",
                hint="write udp/IP:PORT#peers=IP:PORT,IP:PORT or udp/239.1.2.3:PORT",
            )
        return cls(here, peers or [here], config)

    async def open(self, receiver: LinkReceiver) -> None:
        """Open the port; raises LinkOpenError if it is in use or not of this machine."""
        if self._receiver is not None:
            raise LinkOpenError(f"udp/{self._here[0]}:{self._here[1]} is open already")
        receiver.state_changed(LinkState.OPENING, f"opens {self._here[0]}:{self._here[1]}")
        self._ear = self._mouth = socket.socket(_family(self._here), socket.SOCK_DGRAM)
        try:
            if self._peers == [self._here]:
                self._mouth = _join(self._ear, self._here, self._interface)
            else:
                self._ear.bind(self._here)
            self._ear.setblocking(False)
            loop = asyncio.get_running_loop()
            self._transport, _ = await loop.create_datagram_endpoint(lambda: self, sock=self._ear)
        except BaseException as error:
            self._ear.close()
            self._mouth.close()
            if isinstance(error, OSError):
                raise LinkOpenError(f"udp/{self._here[0]}:{self._here[1]}: {error}") from error
            raise
        self._receiver = receiver
        receiver.state_changed(LinkState.UP)

    async def close(self) -> None:
        """Close the port; report a frame being sent as ABORTED."""
        if self._receiver is not None and self._transport is not None:
            if self._on_air is not None:
                self._finish(TransmitOutcome.ABORTED, "the link was closed")
            await asyncio.sleep(0)  # waiting reports go first, in the next turn of the loop
            self._receiver = None
            self._transport.close()
            self._mouth.close()
            await asyncio.sleep(0)  # and one turn later the port is free

    def transmit(self, transmission: Transmission) -> None:
        """Send a frame; raises LinkClosedError if the link is not open."""
        if self._receiver is None:
            raise LinkClosedError(f"udp/{self._here[0]}:{self._here[1]} is not open")
        loop, now, frame = asyncio.get_running_loop(), time.monotonic_ns(), transmission.frame_bytes
        if self._on_air is not None or not 1 <= len(frame) <= MTU_BYTES:
            why = f"frame of {len(frame)} bytes; allowed: 1..{MTU_BYTES}, one at a time"
            told = transmission.transmission_id, now, TransmitOutcome.REJECTED, why
            loop.call_soon(self._report, *told)
            return
        outcome, detail = TransmitOutcome.SENT, ""
        for peer in self._peers:
            try:
                mouth = self._mouth
                _ = mouth.send(frame) if peer == self._here else mouth.sendto(frame, peer)
            except OSError as error:
                outcome, detail = TransmitOutcome.ABORTED, f"{peer[0]}:{peer[1]}: {error}"
                self.error_received(error)
        lasts_s = ns_to_seconds(self.capabilities.airtime_ns(len(frame)))
        timer = loop.call_later(lasts_s, self._finish, outcome, detail)
        self._on_air = transmission.transmission_id, now, timer

    def diagnostics(self) -> dict[str, int | float | str]:
        """Frames sent, datagrams received, errors of the network and the last one."""
        return {**self._counts, "error": self._error}

    def datagram_received(self, data: bytes, addr: Place) -> None:
        """Take a datagram; ignore our own, returned by a multicast group."""
        is_own = addr[:2] == self._mouth.getsockname()[:2]
        if self._receiver is not None and not is_own and 1 <= len(data) <= MTU_BYTES:
            self._counts["received"] += 1
            frame = ReceivedFrame(frame_bytes=data, received_at=time.monotonic_ns())
            self._receiver.frame_received(frame)

    def error_received(self, exc: Exception) -> None:
        """Count an error of the network; the link stays up, since others may be reached."""
        self._counts["errors"] += 1
        self._error = str(exc)

    def _finish(self, outcome: TransmitOutcome, detail: str) -> None:
        assert self._on_air is not None
        (transmission_id, started_at, timer), self._on_air = self._on_air, None
        timer.cancel()
        self._counts["sent"] += outcome is TransmitOutcome.SENT
        self._report(transmission_id, started_at, outcome, detail)

    def _report(self, told_id: int, started_at: int, outcome: TransmitOutcome, why: str) -> None:
        if self._receiver is not None:
            self._receiver.transmit_finished(
                TransmitReport(
                    transmission_id=told_id, outcome=outcome, started_at=started_at,
                    finished_at=time.monotonic_ns(), detail=why,
                )
            )  # fmt: skip


def _place(text: str) -> Place:
    host, _, port = text.strip().rpartition(":")
    try:
        place = str(ipaddress.ip_address(host.strip("[]"))), int(port)
    except ValueError as error:
        raise ConfigError(f"udp: {text!r} is no address; allowed: IP:PORT, [IPv6]:PORT") from error
    if not 1 <= place[1] <= 65535:
        raise ConfigError(f"udp: the port of {text!r}; allowed: 1..65535")
    return place


def _family(place: Place) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in place[0] else socket.AF_INET


def _join(ear: socket.socket, group: Place, interface: str) -> socket.socket:
    """Join an IPv4 group with one socket; return another one that sends to it."""
    membership = socket.inet_aton(group[0]) + socket.inet_aton(interface or "0.0.0.0")
    ear.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # several nodes on one machine
    ear.bind(group)
    ear.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, membership)
    mouth = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        if interface:
            mouth.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(interface))
        mouth.setblocking(False)
        mouth.connect(group)
    except OSError:  # for example because the network is not up yet
        mouth.close()
        raise
    return mouth
