"""Composes a frame at the moment when it can go: the most valuable payload, then what fits.

Order of decisions:

1. The most valuable payload decides the destination. It is in the frame, unless a HELLO, or what is
   owed for too long, has to go first and fills it; nothing goes before REAL_TIME.
2. The introduction that the hearers need (`zacoustic.core.handshake`).
3. What is owed to the hearers: confirmations, answers, questions.
4. Further payloads by value, as long as they fit and concern the hearers: in a broadcast frame
   all that is not meant for one node alone, in a unicast frame what that node needs.

Where a record ends is shown by its payload or by LEN, but the last record needs neither. So one
record whose payload does not delimit itself is moved to the end, and each other one costs two
bytes more. Behind a HELLO or TAG the receiver
may hold another table and cannot measure anything: there every record but the last is delimited
by LEN.
"""

from collections.abc import Iterator

import msgspec

from zacoustic.core.age import encode_age
from zacoustic.core.envelope import Envelope
from zacoustic.core.frame import (
    DELIMITER_BYTES,
    HELLO_BYTES,
    LONGEST_DELIMITED_BYTES,
    TAG_BYTES,
    Control,
)
from zacoustic.core.handshake import Handshake
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.qos import Priority
from zacoustic.core.queue import Lane, TransmitQueue, Waiting
from zacoustic.core.stats import NO_STREAM, Cause, EngineStats, count


class Composed(msgspec.Struct, frozen=True, kw_only=True):
    """A frame that is ready for the link."""

    destination: int
    """Address, or `BROADCAST`."""
    frame_bytes: bytes
    """With envelope."""
    streams: tuple[int, ...]
    """Streams of its records, in their order."""


class Composer:
    """Makes the frames of one node on one link.

    Args:
        queue: What waits.
        handshake: What has to be said beside it.
        stats: Counts every byte.
    """

    def __init__(self, queue: TransmitQueue, handshake: Handshake, stats: EngineStats) -> None:
        self._queue = queue
        self._handshake = handshake
        self._stats = stats

    def due_at(self, now: int) -> int | None:
        """Return the instant from which a frame is to go, ns; None: nothing is to be said."""
        payload_at = self._queue.due_at(now)
        speak = self._handshake.speak_next()
        instants = [at for at in (payload_at, speak and speak[0]) if at is not None]
        return min(instants, default=None)

    def compose(self, envelope: Envelope, now: int) -> Composed | None:
        """Make the frame that is worth most now, or return None when nothing is to be said."""
        first = next(
            ((lane, item) for lane, item in self._queue.candidates(now) if lane.due_at <= now), None
        )
        destination = first[1].destination if first else None
        urgent = first is not None and first[0].qos.priority is Priority.REAL_TIME
        # What is owed found no room in time: it goes before what else waits.
        while (overdue := self._overdue(now)) is not None and not urgent:
            if destination == BROADCAST:
                return self._fill(envelope, BROADCAST, now, owed_first=True)
            composed = self._fill(envelope, overdue, now, owed_first=True)
            if composed is not None:
                return composed
        if destination is None:
            return None
        return self._fill(envelope, destination, now, owed_first=False)

    def _overdue(self, now: int) -> int | None:
        """Return the peer for which a frame of its own is due, or None."""
        speak = self._handshake.speak_next()
        return speak[1] if speak is not None and speak[0] <= now else None

    def _fill(
        self, envelope: Envelope, destination: int, now: int, *, owed_first: bool
    ) -> Composed | None:
        room_bytes = envelope.room_bytes
        first = next(self._concerning(destination, now), None)
        first_bytes = first[1].size_bytes if first else 0
        urgent = bool(first and first[0].qos.priority is Priority.REAL_TIME)
        introduction = b""
        owed: list[tuple[Cause, bytes]] = []
        if owed_first and not self._handshake.introduces(destination):
            owed = self._handshake.owed(destination, room_bytes, now)
            room_bytes -= _size(owed)
            if room_bytes < TAG_BYTES + first_bytes:
                first = None
            urgent = urgent or room_bytes < HELLO_BYTES
        if first or self._handshake.introduces(destination):
            introduction = self._handshake.introduction(
                destination, room_bytes - first_bytes, now, urgent=urgent
            )
            room_bytes -= len(introduction)
            reserved_bytes = 0 if owed_first or first_bytes > room_bytes else first_bytes
            late = self._handshake.owed(destination, room_bytes - reserved_bytes, now)
            room_bytes -= _size(late)
            owed += late
        items = []
        if first:
            items = self._choose(destination, room_bytes, now, introduced=bool(introduction))
        if destination != BROADCAST:
            self._handshake.spoken(destination, now)
        if not introduction and not owed and not items:
            return None
        records = introduction + b"".join(control for _, control in owed)
        self._stats.attribute(NO_STREAM, Cause.HELLO, len(introduction))
        for cause, control in owed:
            self._stats.attribute(NO_STREAM, cause, len(control))
        records += self._encode(items, now, introduced=bool(introduction))
        frame_bytes = envelope.wrap(records, destination)
        self._stats.attribute(NO_STREAM, Cause.ENVELOPE, len(frame_bytes) - len(records))
        return Composed(
            destination=destination,
            frame_bytes=frame_bytes,
            streams=tuple(item.stream_id for item in items),
        )

    def _concerning(self, destination: int, now: int) -> Iterator[tuple[Lane, Waiting]]:
        """Yield the candidates that a frame to `destination` may carry."""
        for lane, item in self._queue.candidates(now):
            if item.destination == destination or (
                destination == BROADCAST and not item.for_one_node
            ):
                yield lane, item

    def _choose(
        self, destination: int, room_bytes: int, now: int, *, introduced: bool
    ) -> list[Waiting]:
        """Take payloads until no more fits, in an order in which the last needs no LEN."""
        chosen: list[Waiting] = []
        used_bytes = open_ended = 0
        last: Waiting | None = None
        for lane, item in self._concerning(destination, now):
            needs_end = introduced or not item.delimits_itself
            must_be_last = needs_end and item.size_bytes > LONGEST_DELIMITED_BYTES
            ends = open_ended + needs_end
            delimiters_bytes = DELIMITER_BYTES * max(0, ends - 1)
            fits = used_bytes + item.size_bytes + delimiters_bytes <= room_bytes
            displaces_last = last is not None and (must_be_last or item.stream_id == last.stream_id)
            if fits and not displaces_last:
                chosen.append(self._queue.take(lane, now))
                used_bytes += item.size_bytes
                open_ended = ends
                last = item if must_be_last else last
            elif room_bytes - used_bytes < DELIMITER_BYTES:
                break
        return _open_end_last(chosen, introduced=introduced)

    def _encode(self, items: list[Waiting], now: int, *, introduced: bool) -> bytes:
        records = bytearray()
        for item in items:
            record = bytearray(item.prefix)
            record.append(item.stream_id)
            record += item.head
            if item.stamped:
                record.append(encode_age(now - item.queued_at))
            header_bytes = len(record)
            record += item.payload
            if item is not items[-1] and (introduced or not item.delimits_itself):
                records += bytes((Control.LEN, len(record)))
                header_bytes += DELIMITER_BYTES
            records += record
            self._stats.attribute(item.stream_id, Cause.HEADER, header_bytes)
            self._stats.attribute(item.stream_id, Cause.PAYLOAD, len(item.payload))
            count(self._stats.transmitted, item.stream_id)
        return bytes(records)


def _size(controls: list[tuple[Cause, bytes]]) -> int:
    return sum(len(control) for _, control in controls)


def _open_end_last(chosen: list[Waiting], *, introduced: bool) -> list[Waiting]:
    """Move one record that needs an end to the last place; keep the order within a stream."""
    open_ended = [item for item in chosen if introduced or not item.delimits_itself]
    if not open_ended:
        return chosen
    too_long = [item for item in open_ended if item.size_bytes > LONGEST_DELIMITED_BYTES]
    last = too_long[0] if too_long else open_ended[-1]
    return [item for item in chosen if item is not last] + [last]
