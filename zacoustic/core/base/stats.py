"""Counters, and the airtime ledger: every byte on the link belongs to a stream and a cause.

The ledger shows an engineer that one topic takes most of the channel. Its sum equals the bytes
given to the link, exactly; a test checks that.
"""

import enum
from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

import msgspec


class Cause(enum.Enum):
    """Why a byte was transmitted."""

    PAYLOAD = "payload"
    """Payload of a sample, request or response."""
    HEADER = "header"
    """Stream id, prefixes, wildcards, call number, age, LEN."""
    ENVELOPE = "envelope"
    """Addresses, check and delimiting that the link lacks."""
    SEAL = "seal"
    """Head, tag and padding of a sealed frame."""
    HELLO = "hello"
    """HELLO and TAG: the sender and its table."""
    CONFIRM = "confirm"
    """Confirmation of a table."""
    ASK = "ask"
    """A question about a table."""
    TABLE = "table"
    """Rows of a table."""
    ACK = "ack"
    """Acknowledgement of reliable samples."""
    REPEAT = "repeat"
    """A record that was sent before."""
    REPAIR = "repair"
    """Repair fragments of objects, and receivers' feedback."""
    RANGE = "range"
    """Padding of a frame that is sent only for ranging."""
    ACCESS = "access"
    """Medium access: turns, pauses, the time."""
    SUBSCRIBE = "subscribe"
    """Subscriptions to on-demand topics, and their answers."""
    HEARTBEAT = "heartbeat"
    """A frame that only shows that the node is present."""
    EXTENSION = "extension"
    """Extensions of third-party transports."""
    RELAY = "relay"
    """Frames of routes and bonds: those of other nodes, repetitions, answers, and what is added to
    own ones."""


NO_STREAM: Final = 0
"""Key of the ledger for bytes that belong to no stream."""


_Row: TypeAlias = tuple[int, Cause, int]
"""``(stream, cause, bytes)``"""


class LedgerEntry(msgspec.Struct, frozen=True, kw_only=True):
    """One line of the ledger."""

    stream_id: int
    """The stream, or `NO_STREAM`."""
    cause: Cause
    """The cause."""
    transmitted_bytes: int
    """Bytes given to the link."""
    airtime_ns: int = 0
    """Their airtime, ns: of each of their frames as much as their share of its bytes."""


class EngineStats:
    """The counters of one engine since it started, on all of its links."""

    def __init__(self) -> None:
        self.links: dict[str, LinkStats] = {}
        """The counters of each link, by its name."""
        self.frames_transmitted = 0
        self.bytes_transmitted = 0
        self.airtime_ns = 0
        self.frames_received = 0
        self.bytes_received = 0
        self.reports: dict[str, int] = {}
        """Transmit reports by outcome."""
        self.dropped: dict[str, int] = {}
        """Dropped receptions, by reason."""
        self.published: dict[int, int] = {}
        """Payloads accepted from the application, by stream."""
        self.unsubscribed: dict[int, int] = {}
        """Samples of on-demand topics that were not sent for lack of a subscriber, by stream."""
        self.transmitted: dict[int, int] = {}
        """Records transmitted, by stream."""
        self.received: dict[int, int] = {}
        """Records delivered to the application, by stream."""
        self.deadlines_missed: dict[int, int] = {}
        """Periods without a promised sample, over all keys, by stream."""
        self.round_trips_ns: dict[int, int] = {}
        """Smoothed time that a node takes to acknowledge a reliable sample, from the end of the
        frame to the end of the ACK's frame, ns, by address."""
        self._ledger: dict[tuple[int, Cause], int] = {}
        self._airtimes: dict[tuple[int, Cause], int] = {}
        self._unsent: list[tuple[tuple[int, Cause], int]] = []
        """Rows of the frame that is being made: frames of a service and of a link have airtimes
        of their own."""

    def on(self, link: str, *, is_tunnel: bool = False, quantum_bytes: int = 1) -> "LinkStats":
        """Add the counters of a link, or of one whose frames go inside those of other links."""
        self.links[link] = TunnelStats(self) if is_tunnel else LinkStats(self, quantum_bytes)
        return self.links[link]

    def sent(self, frame_bytes: int, airtime_ns: int) -> None:
        """Count a frame that is given to the link."""
        self._count(frame_bytes, airtime_ns)
        rows, self._unsent = self._unsent, []
        entered_bytes = entered_ns = 0
        for key, size_bytes in rows:
            entered_bytes += size_bytes
            share_ns = airtime_ns * entered_bytes // frame_bytes - entered_ns
            entered_ns += share_ns
            self._airtimes[key] = self._airtimes.get(key, 0) + share_ns

    def _count(self, frame_bytes: int, airtime_ns: int) -> None:
        self.frames_transmitted += 1
        self.bytes_transmitted += frame_bytes
        self.airtime_ns += airtime_ns

    def heard(self, frame_bytes: int) -> None:
        """Count a frame that has arrived."""
        self.frames_received += 1
        self.bytes_received += frame_bytes

    def reported(self, outcome: str) -> None:
        """Count a transmit report."""
        self.reports[outcome] = self.reports.get(outcome, 0) + 1

    def attribute(self, stream_id: int, cause: Cause, transmitted_bytes: int) -> None:
        """Enter bytes of a transmitted frame into the ledger."""
        if transmitted_bytes:
            self._enter(stream_id, cause, transmitted_bytes)
            self._unsent.append(((stream_id, cause), transmitted_bytes))

    def _enter(self, stream_id: int, cause: Cause, transmitted_bytes: int) -> None:
        if transmitted_bytes:
            key = (stream_id, cause)
            self._ledger[key] = self._ledger.get(key, 0) + transmitted_bytes

    def drop(self, reason: str) -> None:
        """Count a dropped reception."""
        self.dropped[reason] = self.dropped.get(reason, 0) + 1

    def ledger(self) -> list[LedgerEntry]:
        """Return the ledger, by stream and cause."""
        ordered = sorted(self._ledger.items(), key=lambda item: (item[0][0], item[0][1].value))
        return [
            LedgerEntry(
                stream_id=stream_id,
                cause=cause,
                transmitted_bytes=transmitted_bytes,
                airtime_ns=self._airtimes.get((stream_id, cause), 0),
            )
            for (stream_id, cause), transmitted_bytes in ordered
        ]


class LinkStats(EngineStats):
    """The counters of one link; each count is added to the engine's as well.

    Args:
        whole: Counters for all links. Counts by stream are kept there alone.
        quantum_bytes: A frame is paid for as the next multiple of so many bytes.
    """

    def __init__(self, whole: EngineStats, quantum_bytes: int = 1) -> None:
        super().__init__()
        self.paid_bytes = 0
        """Bytes that are paid for, where frames cost money."""
        self._quantum_bytes = quantum_bytes
        self._whole = whole
        self.published = whole.published
        self.unsubscribed = whole.unsubscribed
        self.transmitted = whole.transmitted
        self.received = whole.received
        self.deadlines_missed = whole.deadlines_missed
        if not whole.links:
            # Other links have their own: a node's round trip differs between links.
            self.round_trips_ns = whole.round_trips_ns

    def sent(self, frame_bytes: int, airtime_ns: int) -> None:
        """Count a frame that is given to the link."""
        super().sent(frame_bytes, airtime_ns)
        self._whole.sent(frame_bytes, airtime_ns)
        self.paid_bytes += -(-frame_bytes // self._quantum_bytes) * self._quantum_bytes

    def heard(self, frame_bytes: int) -> None:
        """Count a frame that has arrived."""
        super().heard(frame_bytes)
        self._whole.heard(frame_bytes)

    def reported(self, outcome: str) -> None:
        """Count a transmit report."""
        super().reported(outcome)
        self._whole.reported(outcome)

    def attribute(self, stream_id: int, cause: Cause, transmitted_bytes: int) -> None:
        """Enter bytes of a transmitted frame into the ledger."""
        if transmitted_bytes:
            super().attribute(stream_id, cause, transmitted_bytes)
            self._whole.attribute(stream_id, cause, transmitted_bytes)

    def carry(self, entries: "Entries") -> None:
        """Enter those of a frame of a tunnel that goes now."""
        entries.enter()

    def made(self) -> "Entries":
        """Return what the frame that has been made is still to enter: nothing on a link."""
        return Entries(self.attribute, (), [])

    def drop(self, reason: str) -> None:
        """Count a dropped reception."""
        super().drop(reason)
        self._whole.drop(reason)


class Entries:
    """What one frame of a tunnel is to enter into the ledger, once a link transmits it.

    Args:
        enter: Enters stream, cause and bytes.
        rows: The rows.
        inside: Those of the frames that it carries.
    """

    def __init__(
        self,
        enter: Callable[[int, Cause, int], None],
        rows: Sequence[_Row],
        inside: "list[Entries]",
    ) -> None:
        self._enter = enter
        self._rows = rows
        self._inside = inside
        self._size_bytes: int = sum(each for _, _, each in rows)
        self._size_bytes += sum(each._size_bytes for each in inside)
        self._is_claimed = False

    def claim(self, carrier: "LinkStats") -> int:
        """Hand the entries to the first link that takes the frame.

        Args:
            carrier: The counters of that link, or of the tunnel in which it goes.

        Returns:
            Bytes of the frame that have entries of their own: all, or 0 in a repetition or copy.
        """
        if self._is_claimed:
            return 0
        self._is_claimed = True
        carrier.carry(self)
        return self._size_bytes

    def enter(self) -> None:
        """Enter the rows: the frame is transmitted."""
        for row in self._rows:
            self._enter(*row)
        for each in self._inside:
            each.enter()


class TunnelStats(LinkStats):
    """The counters of a route, a bond or flooding: a link counts the frames around its own.

    Whatever a frame is made of is entered when a link transmits it, which may be never.
    """

    def __init__(self, whole: EngineStats) -> None:
        super().__init__(whole)
        self._rows: list[_Row] = []
        self._inside: list[Entries] = []

    def attribute(self, stream_id: int, cause: Cause, transmitted_bytes: int) -> None:
        """Note bytes of the frame that is being made."""
        self._rows.append((stream_id, cause, transmitted_bytes))

    def carry(self, entries: Entries) -> None:
        """Take those of a frame in the one that is being made."""
        self._inside.append(entries)

    def made(self) -> Entries:
        """Return the entries of the frame that has been made."""
        made = Entries(self._enter_sent, self._rows, self._inside)
        self._rows, self._inside = [], []
        return made

    def _enter_sent(self, stream_id: int, cause: Cause, transmitted_bytes: int) -> None:
        self._enter(stream_id, cause, transmitted_bytes)
        self._whole.attribute(stream_id, cause, transmitted_bytes)

    def ledger(self) -> list[LedgerEntry]:
        """Return the ledger; airtimes are those of the mean frame, since many may wait."""
        per_byte_ns = self.airtime_ns / self.bytes_transmitted if self.bytes_transmitted else 0.0
        return [
            msgspec.structs.replace(each, airtime_ns=int(per_byte_ns * each.transmitted_bytes))
            for each in super().ledger()
        ]

    def sent(self, frame_bytes: int, airtime_ns: int) -> None:
        """Count a frame that is given to the tunnel."""
        self._count(frame_bytes, airtime_ns)

    def heard(self, frame_bytes: int) -> None:
        """Count a frame that has arrived."""
        EngineStats.heard(self, frame_bytes)

    def reported(self, outcome: str) -> None:
        """Count a transmit report."""
        EngineStats.reported(self, outcome)


def count(counter: dict[int, int], key: int, times: int = 1) -> None:
    """Add to a counter by key."""
    counter[key] = counter.get(key, 0) + times
