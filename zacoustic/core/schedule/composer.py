"""Composes a frame at the moment when it can go: the most valuable payload, then what fits.

Order of decisions:

1. The most valuable payload decides the destination. It is in the frame, unless a HELLO, or what is
   owed for too long, has to go first and fills it; nothing goes before REAL_TIME.
   A range that is due (`zacoustic.core.peers.ranging`) decides it in its place, but not before
   REAL_TIME: its frame goes to one node, with what that needs or with nothing.
2. The introduction that the hearers need (`zacoustic.core.peers.handshake`).
3. What is owed to the hearers: confirmations, answers, questions.
4. Further payloads by value, as long as they fit and concern the hearers: in a broadcast frame
   all that is not meant for one node alone, in a unicast frame what that node needs.
5. What is to be acknowledged of dense strings, where there is room left for it.

How records share a frame is the affair of `zacoustic.core.schedule.filling`.
"""

from collections.abc import Iterator

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.qos import Priority
from zacoustic.core.base.stats import NO_STREAM, Cause, EngineStats, count
from zacoustic.core.peers.contact import Contact
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.introducing import HELLO_EVERY
from zacoustic.core.peers.ranging import Ranging
from zacoustic.core.schedule.copies import MOST_COPIES
from zacoustic.core.schedule.filling import Filling
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.queue import Lane, LaneKey, TransmitQueue, Waiting
from zacoustic.core.schedule.sources import DenseSource, ObjectSource, Offer
from zacoustic.core.wire.envelope import Envelope
from zacoustic.core.wire.frame import HELLO_BYTES, PADDING, TAG_BYTES


class Composed(msgspec.Struct, frozen=True, kw_only=True):
    """A frame that is ready for the link."""

    destination: int
    """Address, or `BROADCAST`."""
    frame_bytes: bytes
    """With envelope."""
    records: tuple[Waiting, ...]
    """Its records, in their order, fragments excepted."""
    object_stream: int | None = None
    """Stream of the fragment that is in it, or None."""
    is_pressing: bool = False
    """It carries what may go again before anything can have come back."""

    @property
    def streams(self) -> tuple[int, ...]:
        """Streams of its records, in their order."""
        if self.object_stream is not None:
            return (self.object_stream,)
        return tuple(record.stream_id for record in self.records)

    @property
    def stream_bytes(self) -> dict[int, int]:
        """Bytes of the records of each stream in it."""
        if self.object_stream is not None:
            return {self.object_stream: len(self.frame_bytes)}
        sizes: dict[int, int] = {}
        for record in self.records:
            sizes[record.stream_id] = sizes.get(record.stream_id, 0) + record.size_bytes
        return sizes


class Composer:
    """Makes the frames of one node on one link.

    Args:
        queue: What waits.
        handshake: What has to be said beside it.
        dense: Writes dense strings.
        ranging: The ranges that are wanted.
        stats: Counts every byte.
    """

    def __init__(
        self,
        queue: TransmitQueue,
        handshake: Handshake,
        dense: DenseSource,
        ranging: Ranging,
        stats: EngineStats,
    ) -> None:
        self._queue = queue
        self._handshake = handshake
        self._introductions = handshake.introductions
        self._dense = dense
        self._ranging = ranging
        self._stats = stats
        self.objects: ObjectSource | None = None
        """Fragments, and what is to be said of those that arrived."""
        self.contact: Contact | None = None
        """Heartbeats."""
        self._since_introduction = 0
        self.port: LinkPort | None = None
        """The link: what medium access wants to say rides in the frames."""

    def speak(self, port: LinkPort, now: int) -> Composed | None:
        """Make a frame of what medium access has to say, and nothing else."""
        said = port.access.controls(port.envelope.room_bytes, now, alone=True)
        if not said:
            return None
        destination = port.access.answers_to
        frame_bytes = port.envelope.wrap(said, destination)
        self._stats.attribute(NO_STREAM, Cause.ACCESS, len(said))
        self._stats.attribute(NO_STREAM, Cause.ENVELOPE, len(frame_bytes) - len(said))
        return Composed(destination=destination, frame_bytes=frame_bytes, records=())

    def due_at(self, now: int) -> int | None:
        """Return the instant from which a frame is to go, ns; None: nothing is to be said."""
        payload_at = self._queue.due_at(now)
        others = (self._handshake.speak_next(), self._ranging.due(now))
        heartbeat_at = self.contact.due_at if self.contact is not None else None
        instants = [payload_at, heartbeat_at, *(each and each[0] for each in others)]
        earliest = min((at for at in instants if at is not None), default=None)
        if self.objects is None:
            return earliest
        held_until = self.objects.hold_until(now)
        if earliest is not None and held_until > now and not self._queue.is_urgent:
            earliest = max(earliest, held_until)
        object_at = self.objects.due_at(now)
        return min((at for at in (earliest, object_at) if at is not None), default=None)

    def compose_only(self, envelope: Envelope, lane: LaneKey, now: int) -> Composed | None:
        """Make a frame of what waits in one lane, with what its hearer needs beside it."""
        first = next(self._queue.candidates(now, lane), None)
        if first is None:
            return None
        return self._fill(envelope, first[1].destination, now, owed_first=False, only=lane)

    def compose(self, envelope: Envelope, now: int) -> Composed | None:
        """Make the frame that is worth most now, or return None when nothing is to be said."""
        first = next(
            ((lane, item) for lane, item in self._queue.candidates(now) if lane.due_at <= now), None
        )
        destination = first[1].destination if first else None
        urgent = first is not None and first[0].qos.priority is Priority.REAL_TIME
        if not urgent and self._is_heartbeat_due(now):
            return self._fill(envelope, BROADCAST, now, owed_first=False, must_go=Cause.HEARTBEAT)
        if self.objects is not None and not urgent:
            offer = self.objects.offer(now)
            # While an answer about an object is awaited, only objects go.
            held = self.objects.hold_until(now) > now
            rank = first[0].rank if first and not held else None
            if offer is not None and (rank is None or offer.rank <= rank):
                composed = self._fill_object(envelope, offer, now)
                if composed is not None:
                    return composed
            if held:
                return None
        # What is owed found no room in time: it goes before what else waits.
        while (overdue := self._overdue(now)) is not None and not urgent:
            if destination == BROADCAST:
                return self._fill(envelope, BROADCAST, now, owed_first=True)
            composed = self._fill(envelope, overdue, now, owed_first=True)
            if composed is not None:
                return composed
        if not urgent and (wanted := self._ranging.due(now)) is not None and wanted[0] <= now:
            return self._fill(envelope, wanted[1], now, owed_first=False, must_go=Cause.RANGE)
        if destination is None:
            return None
        return self._fill(envelope, destination, now, owed_first=False)

    def _is_heartbeat_due(self, now: int) -> bool:
        """Tell whether this node has to be heard; not while an answer is awaited."""
        due_at = self.contact.due_at if self.contact is not None else None
        if due_at is None or due_at > now:
            return False
        return self.objects is None or self.objects.hold_until(now) <= now

    def _overdue(self, now: int) -> int | None:
        """Return the peer for which a frame of its own is due, or None."""
        speak = self._handshake.speak_next()
        return speak[1] if speak is not None and speak[0] <= now else None

    def _fill_object(self, envelope: Envelope, offer: Offer, now: int) -> Composed | None:
        """Make the frame of a fragment, or of what is to be said of an object."""
        assert self.objects is not None
        assert self.port is not None
        destination = offer.destination
        if not offer.is_fragment:
            return self._fill(envelope, destination, now, owed_first=True, answer=True)
        if self._introductions.is_unconfirmed(destination, now):
            # A fragment fills its frame: whoever does not know us is told in another one.
            self._since_introduction += 1
            if self._since_introduction % HELLO_EVERY == 1 or self._introductions.introduces(
                destination
            ):
                introduction = self._introductions.introduction(
                    destination, envelope.room_bytes, now
                )
                return self._wrap(envelope, destination, [(Cause.HELLO, introduction)])
        taken = self.objects.take_fragment(
            envelope.room_bytes, now, self.port.frames_before_pause(now)
        )
        if taken is None:
            return None
        if taken.ends_run:
            self.port.end_run()
            if self._introductions.concerns_others(destination) and self.port.reaches_all(
                len(taken.record)
            ):
                destination = BROADCAST  # that a pause follows concerns everybody
        if taken.is_first:
            count(self._stats.transmitted, taken.stream_id)
        cause = Cause.REPAIR if taken.is_repair else Cause.PAYLOAD
        self._stats.attribute(taken.stream_id, Cause.HEADER, taken.header_bytes)
        data_bytes = len(taken.record) - taken.header_bytes
        self._stats.attribute(taken.stream_id, cause, data_bytes)
        frame_bytes = envelope.wrap(taken.record, destination)
        self._stats.attribute(NO_STREAM, Cause.ENVELOPE, len(frame_bytes) - len(taken.record))
        return Composed(
            destination=destination,
            frame_bytes=frame_bytes,
            records=(),
            object_stream=taken.stream_id,
        )

    def _wrap(
        self, envelope: Envelope, destination: int, said: list[tuple[Cause, bytes]]
    ) -> Composed:
        """Make a frame of controls."""
        records = b"".join(control for _, control in said)
        for cause, control in said:
            self._stats.attribute(NO_STREAM, cause, len(control))
        frame_bytes = envelope.wrap(records, destination)
        self._stats.attribute(NO_STREAM, Cause.ENVELOPE, len(frame_bytes) - len(records))
        return Composed(destination=destination, frame_bytes=frame_bytes, records=())

    def _fill(
        self,
        envelope: Envelope,
        destination: int,
        now: int,
        *,
        owed_first: bool,
        must_go: Cause | None = None,
        answer: bool = False,
        only: LaneKey = (),
    ) -> Composed | None:
        room_bytes = envelope.room_bytes
        self._introductions.begin_frame(destination)
        answers: list[tuple[Cause, bytes]] = []
        if self.objects is not None and destination != BROADCAST:
            said_of_objects = self.objects.take_feedback(destination, room_bytes, now)
            if said_of_objects is not None:
                answers = [(Cause.REPAIR, said_of_objects.record)]
                room_bytes -= _size(answers)
        # Who waits for an answer listens for as long as a short frame takes.
        first = None if answer else next(self._concerning(destination, now, only), None)
        first_bytes = first[1].size_bytes if first else 0
        urgent = bool(first and first[0].qos.priority is Priority.REAL_TIME)
        introduction = b""
        owed: list[tuple[Cause, bytes]] = []
        if owed_first and not self._introductions.introduces(destination):
            owed = self._handshake.owed(destination, room_bytes, now)
            room_bytes -= _size(owed)
            if room_bytes < TAG_BYTES + first_bytes:
                first = None
            urgent = urgent or room_bytes < HELLO_BYTES
        if first or self._introductions.introduces(destination):
            introduction = self._introductions.introduction(
                destination, room_bytes - first_bytes, now, urgent=urgent
            )
            room_bytes -= len(introduction)
            reserved_bytes = 0 if owed_first or first_bytes > room_bytes else first_bytes
            late = self._handshake.owed(destination, room_bytes - reserved_bytes, now)
            room_bytes -= _size(late)
            owed += late
        elif must_go:
            if must_go is Cause.HEARTBEAT:
                introduction = self._introductions.introduction(destination, room_bytes, now)
                room_bytes -= len(introduction)
            # For a range no introduction: it would have to be answered, and that is not wanted.
            owed = self._handshake.owed(destination, room_bytes, now)
            room_bytes -= _size(owed)
        owed = answers + owed
        filling: Filling | None = None
        if self.port is not None and (first or introduction or owed):
            said = self.port.controls(
                room_bytes - first_bytes,
                self._queue.waiting_bytes,
                now,
                has_object=self.objects is not None and self.objects.has_fragment(now),
            )
            if said:
                owed.append((Cause.ACCESS, said))
                room_bytes -= len(said)
            comfort_bytes = self.port.comfort_bytes(now)
            if comfort_bytes is not None:
                spent_bytes = envelope.room_bytes - room_bytes
                room_bytes = min(room_bytes, max(first_bytes, comfort_bytes - spent_bytes))
        if first:
            introduced = bool(introduction)
            filling = self._choose(destination, room_bytes, now, only, introduced=introduced)
        if destination != BROADCAST:
            self._handshake.spoken(destination, now)
        items = filling.items if filling is not None else ()
        if not introduction and not owed and not items:
            if must_go is None:
                return None
            owed = [(must_go, PADDING)]
        records = filling.encode(self._stats) if filling is not None else b""
        left_bytes = room_bytes - len(records)
        owed.append((Cause.ACK, self._dense.acks(destination, left_bytes)))
        self._stats.attribute(NO_STREAM, Cause.HELLO, len(introduction))
        for cause, control in owed:
            self._stats.attribute(NO_STREAM, cause, len(control))
        records = introduction + b"".join(control for _, control in owed) + records
        frame_bytes = envelope.wrap(records, destination)
        self._stats.attribute(NO_STREAM, Cause.ENVELOPE, len(frame_bytes) - len(records))
        return Composed(
            destination=destination,
            frame_bytes=frame_bytes,
            records=items,
            is_pressing=first is not None and first[0].qos.priority in MOST_COPIES,
        )

    def _concerning(
        self, destination: int, now: int, only: LaneKey
    ) -> Iterator[tuple[Lane, Waiting]]:
        """Yield the candidates that a frame to `destination` may carry."""
        for lane, item in self._queue.candidates(now, only):
            if item.destination == destination or (
                destination == BROADCAST and not item.for_one_node
            ):
                yield lane, item

    def _choose(
        self, destination: int, room_bytes: int, now: int, only: LaneKey, *, introduced: bool
    ) -> Filling:
        """Take payloads until no more fits."""
        filling = Filling(destination, room_bytes, now, self._dense, introduced=introduced)
        for lane, item in self._concerning(destination, now, only):
            if filling.add(item):
                self._queue.take(lane, now)
            elif filling.is_full:
                break
        return filling


def _size(controls: list[tuple[Cause, bytes]]) -> int:
    return sum(len(control) for _, control in controls)
