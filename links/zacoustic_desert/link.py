"""The link to DESERT Underwater: a TCP client of the socket of its application module.

DESERT listens, some seconds after its start, and serves one client on each port. The bytes of one
read become a packet of its network; it writes arriving packets to the client. There are no
addresses, no boundaries, no reports. `pacing` ensures that each frame becomes one packet.

What the link can know about the other side:

- Nothing listens: DESERT has not started. The link waits and reports that.
- The connection ends: DESERT has ended or crashed (load in both directions can crash its socket
  threads). The link reconnects, for ever.
- An attempt to connect times out: DESERT's backlog is full of clients.
- A connection may be *deaf*: the kernel accepts it while DESERT serves another client. Then nothing
  arrives, and written bytes are sent when the other client leaves. That looks like a silent sea.
  After `SUSPECT_FRAMES` frames without a reception on a connection, the detail of the state names
  the suspicion; when DESERT has not read until the buffers are full, the link reconnects.
- Another program may listen there. DESERT says nothing but frames: whatever answers in lines of
  text, or in many bytes without a delimiter, is named, and the link is down.
"""

import asyncio
import time
from collections.abc import Mapping
from typing import Any, Final, Self

from zacoustic.bytestream import ByteStream, holders
from zacoustic.core.clock import Clock, ns_to_seconds
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkState,
    Measurement,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.values.rmw_desert.packets import PacketDecoder, encode_packet
from zacoustic.errors import ConfigError, LinkClosedError, LinkOpenError
from zacoustic.link import Finding, Link, LinkConfig, LinkReceiver
from zacoustic.link.alarm import Alarm
from zacoustic_desert.config import READ_LIMIT_BYTES, DesertConfig
from zacoustic_desert.pacing import Pacer

LAST_DELAY_S: Final = 2.0
"""Longest pause between two attempts to connect, s: DESERT needs five to start."""
LEAST_CUT_PIECES: Final = 4
"""Least number of packets shorter than a frame that are no accident …"""
LEAST_CUT_SHARE: Final = 0.1
"""… and their least share of all packets."""
ANSWER_FRAMES: Final = 2
"""Frame times within which a sample is usually answered, besides the latency both ways: its
receiver waits for another sample, and then transmits its answer."""
DELIMITER: Final = b"\0"
"""The core puts this before and after each frame."""
_FOREIGN_BYTES: Final = 4096
"""So many bytes without a delimiter are no frames of whatever read length."""
_FOREIGN_WAIT_S: Final = 1.0
"""Time in which a program that is not DESERT greets, s."""
_SHOWN_BYTES: Final = 40
SUSPECT_FRAMES: Final = 20
"""Frames sent without a reception, after which a connection is suspected to be deaf."""

_TEXT: Final = frozenset(range(0x20, 0x7F)) | {*b"\t\r\n"}

# Silence after which a packet of rmw_desert is given up, in frames of full size: one of 512 bytes
# comes in up to nine packets.
_PATIENCE_FRAMES: Final = 4


_MEASURED_PARTS: Final = 1.05
"""A measured round trip is a smoothed one: it may be a little longer than the longest."""


class _Greeted:
    """Takes what a link says while somebody looks whether it is DESERT."""

    def frame_received(self, frame: ReceivedFrame) -> None:
        """Ignore it."""

    def transmit_finished(self, report: TransmitReport) -> None:
        """Ignore it."""

    def state_changed(self, state: LinkState, detail: str = "") -> None:
        """Ignore it."""

    def carrier_changed(self, busy: bool) -> None:
        """Ignore it."""

    def measured(self, measurement: Measurement) -> None:
        """Ignore it."""


class DesertLink(Link):
    """DESERT Underwater's application socket; the locator is desert/HOST:PORT.

    Args:
        address: `HOST:PORT` of the application module.
        config: The settings of its script.
        clock: Source of instants.

    Raises:
        ConfigError: The address is not valid.
    """

    config_type = DesertConfig

    def __init__(
        self,
        address: str,
        config: DesertConfig | None = None,
        *,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        try:
            self._stream = ByteStream(f"tcp:{address}", clock=clock, last_delay_s=LAST_DELAY_S)
        except ConfigError as error:
            raise ConfigError(
                f"address {address!r}; allowed: HOST:PORT, such as 127.0.0.1:4000"
            ) from error
        self._address = address
        self._config = config or DesertConfig()
        self._clock = clock
        self.capabilities = self._config.capabilities()
        full_ns = self.capabilities.airtime_ns(self.capabilities.mtu_bytes)
        self._patience_ns = _PATIENCE_FRAMES * full_ns
        self._pacer = Pacer(self.capabilities)
        self._decoder = PacketDecoder() if self._config.framing == "rmw_desert" else None
        self._flush_at: int | None = None
        self._receiver: LinkReceiver | None = None
        self._state = LinkState.OPENING
        self._detail = ""
        self._alarm = Alarm(clock, lambda _: self._service())
        self._stream_reason = "no answer"
        self._frames_sent = 0
        # Frames written on this connection before the first reception.
        self._unheard = 0
        self._is_heard = False
        self._discarded_before = 0
        # A piece is the bytes of one read: on a local network, one packet of DESERT's.
        self._pieces = 0
        self._cut_pieces = 0
        self._cut_after_bytes = 0
        # Bytes of this connection before the first delimiter, and what they say if they are text.
        self._undelimited = 0
        self._foreign = ""

    @classmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        """Build the link to the application module at `HOST:PORT`.

        Raises:
            ConfigError: The address is not valid, or the node address is outside 1…254.
        """
        assert isinstance(config, DesertConfig)
        if not 1 <= node_address <= 254:
            raise ConfigError(f"node address is {node_address}; allowed: 1..254")
        return cls(address, config)

    async def open(self, receiver: LinkReceiver) -> None:
        """Start to connect and return; DESERT may start later.

        Raises:
            LinkOpenError: The link is already open.
        """
        if self._receiver is not None:
            raise LinkOpenError(f"the link to DESERT at {self._address} is open already")
        self._receiver = receiver
        self._state, self._detail = LinkState.OPENING, ""
        self._change_state(LinkState.OPENING, self._waiting())
        self._stream.open(self)

    async def close(self) -> None:
        """Disconnect; before that report an outstanding frame as ABORTED."""
        # First without a receiver: a report may cause another `transmit`, which must fail.
        receiver, self._receiver = self._receiver, None
        self._alarm.stop()
        now = self._clock()
        self._pacer.abort("link closed", now)
        while (report := self._pacer.poll_report(now)) is not None:
            if receiver is not None:
                receiver.transmit_finished(report)
        self._state, self._detail = LinkState.DOWN, "closed"
        await self._stream.close()

    def transmit(self, transmission: Transmission) -> None:
        """Write a frame as soon as the pacing allows.

        Raises:
            LinkClosedError: Not open.
        """
        if self._receiver is None:
            raise LinkClosedError(f"the link to DESERT at {self._address} is not open")
        now = self._clock()
        if self._state is not LinkState.UP:
            reason = f"no connection: {self._detail}"
            self._pacer.refuse(transmission, TransmitOutcome.ABORTED, reason, now)
        elif reason := self._objection(transmission):
            self._pacer.refuse(transmission, TransmitOutcome.REJECTED, reason, now)
        else:
            self._pacer.submit(transmission, now)
        self._arm()

    def diagnostics(self) -> dict[str, int | float | str]:
        """Return counters, the state, and what the link waits for."""
        readings: dict[str, int | float | str] = {
            "frames_sent": self._frames_sent,
            "pieces": self._pieces,
            "pieces_cut": self._cut_pieces,
            "cut_after_bytes": self._cut_after_bytes,
            "frames_unheard": 0 if self._is_heard else self._unheard,
            "bytes_read": self._stream.bytes_read,
            "bytes_written": self._stream.bytes_written,
            "connections": self._stream.connections,
            "foreign": self._foreign,
            "state": self._state.value,
            "detail": self._detail,
        }
        if self._decoder is not None:
            readings["bytes_discarded"] = self._discarded_before + self._decoder.discarded_bytes
        return readings

    async def examine(self, patience_s: float) -> list[Finding]:
        """Check whether DESERT listens, and whom it serves; write nothing. It reports no more."""
        others = holders(self._stream.address)
        if others:
            return [
                Finding(
                    what=f"another program is connected to DESERT at {self._address}: "
                    f"{', '.join(others)}",
                    why="DESERT serves one program per port: the gateway is accepted and hears "
                    "nothing, and what it sends goes when the other one leaves",
                    cure="stop the other program; if it is the gateway, name its router by "
                    "--connect",
                )
            ]
        watcher = _Greeted()
        found = await super().examine(patience_s)
        if not found:
            # What is not DESERT often says so at once.
            await self.open(watcher)
            await asyncio.sleep(min(patience_s, _FOREIGN_WAIT_S))
            await self.close()
            return [self._not_desert(self._foreign)] if self._foreign else []
        return [
            Finding(
                what=f"DESERT does not answer at {self._address}: {self._stream_reason}",
                why="the gateway waits for it, for ever, and nothing crosses meanwhile",
                cure="start it; it listens some five seconds later; compare Socket_Port_ in its "
                "script, and see that it has setSocketProtocol TCP",
            )
        ]

    def assess(self, health: Mapping[str, Any]) -> list[Finding]:
        """Check whether whole frames arrive, and answers about as soon as the settings say."""
        readings = health.get("link", {}).get("diagnostics", {})
        if foreign := readings.get("foreign"):
            return [self._not_desert(foreign)]
        unheard = readings.get("frames_unheard", 0)
        if unheard >= SUSPECT_FRAMES:
            return [self._deaf(unheard)]
        return [*self._assess_pieces(health), *self._assess_answers(health)]

    def _assess_answers(self, health: Mapping[str, Any]) -> list[Finding]:
        measured_s = {
            address: row["round_trip_s"]
            for address, row in health.get("peers", {}).items()
            if row.get("round_trip_s") is not None
        }
        if not measured_s:
            return []
        frame_s = ns_to_seconds(self.capabilities.airtime_ns(self.capabilities.mtu_bytes))
        expected_s = 2 * self._config.latency_s + ANSWER_FRAMES * frame_s
        # All peers are behind this end of DESERT: the fastest of them shows its latency.
        address, least_s = min(measured_s.items(), key=lambda each: each[1])
        if least_s <= _MEASURED_PARTS * expected_s:
            return []
        return [
            Finding(
                what=f"DESERT is slower than the link is told: node {address} answers after "
                f"{least_s:.1f} s; by the settings, {expected_s:.1f} s at the most",
                why="frames wait in DESERT, more and more of them, and what is in them comes late",
                cure="period_s in the locators of both ends as period_ in DESERT's script (it is "
                f"{self._config.period_s:g} here; DESERT's own default is 10), or a smaller "
                "period_ there; or publish less",
            )
        ]

    def _assess_pieces(self, health: Mapping[str, Any]) -> list[Finding]:
        readings = health.get("link", {}).get("diagnostics", {})
        pieces, cut = readings.get("pieces", 0), readings.get("pieces_cut", 0)
        if cut < LEAST_CUT_PIECES or cut < pieces * LEAST_CUT_SHARE:
            return []
        read_bytes = readings.get("cut_after_bytes")
        least = self._config.least_read_length
        if not isinstance(read_bytes, int) or not least <= read_bytes <= READ_LIMIT_BYTES:
            return [
                self._not_desert(f"pieces of {read_bytes} bytes, and DESERT reads {least} or more")
            ]
        return [
            Finding(
                what=f"frames come in pieces: {cut} of {pieces} packets hold a part of one; "
                f"max_read_length of the link is {self._config.max_read_length}, and they are cut "
                f"after {read_bytes} bytes",
                why="DESERT reads less at once than the frames have: each goes as two packets, and "
                "is lost with either",
                cure=f"max_read_length={read_bytes} in the locators of both ends, or the same "
                "max_read_length in DESERT's script",
            )
        ]

    def _not_desert(self, says: str) -> Finding:
        return Finding(
            what=f"what answers at {self._address} is not DESERT: {says}",
            why="nothing of it crosses, and nothing comes",
            cure="compare the port in the locator with Socket_Port_ in DESERT's script",
        )

    def _deaf(self, frames: int) -> Finding:
        """Return the finding for a connection without a reception."""
        return Finding(
            what=f"DESERT at {self._address} has taken {frames} frames on this connection, and has "
            "handed over nothing",
            why="it looks like a silent sea; nothing of the others will ever come",
            cure="see that no other program holds its port, since it serves one at a time; give "
            "its script drop_out_of_order_ 0, or the LL header (Module/UW/LL): with 1 and without "
            "it all packets are dropped; see that the other end runs",
        )

    def stream_opened(self) -> None:
        """Note a connection, accepted by DESERT or only by its kernel; called by the stream."""
        self._unheard = 0
        self._is_heard = False
        self._undelimited = 0
        if self._decoder is not None:
            self._discarded_before += self._decoder.discarded_bytes
            self._decoder = PacketDecoder()
            self._flush_at = None
        self._change_state(LinkState.UP, self._connected())

    def bytes_received(self, data: bytes, received_at: int) -> None:
        """Pass on received bytes; called by the stream."""
        if self._decoder is None and self._is_foreign(data):
            return
        self._is_heard = True
        if self._state is LinkState.UP:
            self._change_state(LinkState.UP, self._connected())
        if self._decoder is None:
            # The core's delimiters show the beginning and end of a frame.
            self._count_piece(data, data[:1] == DELIMITER, data[-1:] == DELIMITER)
            self._hear(data, received_at)
            return
        is_begun = self._decoder.is_waiting
        for payload in self._decoder.feed(data):
            self._hear(payload, received_at)
        self._count_piece(data, not is_begun, not self._decoder.is_waiting)
        # Each piece gives the packet in the decoder new time.
        self._flush_at = received_at + self._patience_ns if self._decoder.is_waiting else None
        self._arm()

    def _is_foreign(self, data: bytes) -> bool:
        """Tell whether no frame begins here, and give the connection up; DESERT says only frames.

        A frame has no lines of text before its first delimiter, and a piece of one has an end soon.
        """
        if self._undelimited < 0 or DELIMITER in data:
            self._undelimited, self._foreign = -1, ""
            return False
        self._undelimited += len(data)
        is_text = b"\n" in data and all(each in _TEXT for each in data)
        if not is_text and self._undelimited < _FOREIGN_BYTES:
            return False
        shown = data[:_SHOWN_BYTES].split(b"\n")[0].decode("ascii", "replace").strip()
        self._foreign = f"it says {shown!r}" if is_text else "it sends bytes that are no frames"
        reason = f"what answers there is not DESERT: {self._foreign}"
        self._go_down(reason)
        self._stream.reset(reason)
        return True

    def _count_piece(self, data: bytes, begins: bool, ends: bool) -> None:
        """Count a piece, and whether it was shorter than a frame."""
        self._pieces += 1
        if begins != ends:
            self._cut_pieces += 1
            if begins:
                # Pieces may merge: the shortest beginning is one read.
                self._cut_after_bytes = min(self._cut_after_bytes or len(data), len(data))

    def stream_lost(self, reason: str) -> None:
        """Note that DESERT was lost or not reached; called by the stream."""
        reason = self._stream_reason = reason.removeprefix(f"{self._stream.address}: ")
        if self._state is LinkState.UP:
            self._go_down(reason)
            self._service()
        else:
            self._change_state(self._state, self._waiting(reason))

    def _go_down(self, reason: str) -> None:
        self._change_state(
            LinkState.DOWN, f"DESERT at {self._address}: {reason}; waits for it to come back"
        )
        self._pacer.abort(reason, self._clock())

    def _service(self) -> None:
        """Make due writes and reports, then arm the timer."""
        self._alarm.stop()
        now = self._clock()
        frame_bytes = self._pacer.poll_write(now) if self._state is LinkState.UP else None
        if frame_bytes is not None:
            self._write(frame_bytes, now)
        while (report := self._pacer.poll_report(now)) is not None:
            if self._receiver is not None:
                self._receiver.transmit_finished(report)
        if self._decoder is not None and self._flush_at is not None and self._flush_at <= now:
            self._flush_at = None
            for payload in self._decoder.flush():
                self._hear(payload, now)
        self._arm()

    def _write(self, frame_bytes: bytes, now: int) -> None:
        written = frame_bytes if self._decoder is None else encode_packet(frame_bytes)
        if not self._stream.write(written):
            # At this pace frames fill no buffer whose owner reads.
            reason = "it takes no more bytes; it is gone, or serves another program on this port"
            self._go_down(reason)
            self._stream.reset(reason)
            return
        self._frames_sent += 1
        if not self._is_heard:
            self._unheard += 1
            if self._unheard == SUSPECT_FRAMES:
                self._change_state(
                    LinkState.UP,
                    f"{self._connected()}, but nothing heard there after {SUSPECT_FRAMES} frames: "
                    "DESERT serves one program per port, see that no other one holds it",
                )

    def _hear(self, frame_bytes: bytes, at: int) -> None:
        if self._receiver is not None:
            self._receiver.frame_received(ReceivedFrame(frame_bytes=frame_bytes, received_at=at))

    def _objection(self, transmission: Transmission) -> str:
        """Return why this transmission cannot be one packet; empty if it can."""
        size, limit = len(transmission.frame_bytes), self.capabilities.mtu_bytes
        if not 1 <= size <= limit:
            return f"frame of {size} bytes; allowed: 1..{limit}"
        if not 1 <= transmission.destination <= BROADCAST:
            return f"destination {transmission.destination}; allowed: 1..{BROADCAST}"
        return ""

    def _change_state(self, state: LinkState, detail: str) -> None:
        if (state, detail) == (self._state, self._detail):
            return
        self._state, self._detail = state, detail
        if self._receiver is not None:
            self._receiver.state_changed(state, detail)

    def _connected(self) -> str:
        return f"connected to DESERT at {self._address}"

    def _waiting(self, reason: str = "") -> str:
        reason = f": {reason}" if reason else ""
        return (
            f"waits for DESERT at {self._address}{reason} "
            "(it listens a few seconds after its start, and serves one program per port)"
        )

    def _arm(self) -> None:
        """Set the one timer for the next due instant."""
        if self._receiver is not None:
            instants = (self._flush_at, self._pacer.poll_timeout())
            self._alarm.set(min((at for at in instants if at is not None), default=None))
