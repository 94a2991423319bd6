"""Composes a frame at the moment when it can go: the best offer of all sources, then what fits.

Order of decisions:

1. The best offer decides the destination. A REAL_TIME payload goes first, then a heartbeat, then
   objects and payloads by their rank. What was owed to a node for too long, and a due ranging, go
   just before the best payload. While feedback about an object is awaited, only objects and
   REAL_TIME payloads go. Medium access gets a frame of its own when no other frame may go.
2. The introduction that the hearers need (`zacoustic.core.peers.handshake`).
3. What is owed to the hearers: confirmations, answers, questions.
4. Further payloads by value, as long as they fit and concern the hearers: in a broadcast frame all
   that is not meant for one node alone, in a unicast frame what that node needs.
5. Acknowledgements of dense blocks, where there is room left.

`zacoustic.core.schedule.filling` decides how records share a frame.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.parts import BESIDE_PAYLOAD, FIRST_BUT_URGENT, Offer, Part
from zacoustic.core.base.qos import Priority
from zacoustic.core.base.stats import NO_STREAM, Cause, EngineStats, count
from zacoustic.core.base.waits import Why
from zacoustic.core.peers.agreementpolicy import HELLO_EVERY
from zacoustic.core.peers.bootepoch import BootEpoch
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.heartbeats import Heartbeats
from zacoustic.core.peers.ranging import Ranging
from zacoustic.core.schedule.copies import MOST_COPIES
from zacoustic.core.schedule.filling import Filling
from zacoustic.core.schedule.frames import Composed, Frames
from zacoustic.core.schedule.linkseal import Closing, Unsealed
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.queue import Lane, LaneKey, QueuedRecord, TransmitQueue
from zacoustic.core.schedule.sources import (
    DenseSource,
    ExtensionSource,
    Forwarded,
    ForwardingSource,
    ObjectSource,
    Source,
)
from zacoustic.core.wire.agreement import HELLO_BYTES, TAG_BYTES
from zacoustic.core.wire.controls import EXTENSION_HEADER_BYTES, LONGEST_EXTENSION_BYTES
from zacoustic.core.wire.frame import PADDING

BULK_OVERHEAD_BYTES: Final = HELLO_BYTES
"""What a frame of the bulk service has room for beside its fragment: an introduction."""
_GIVE_WAY_PERIODS: Final = 2
"""For how many runs and pauses ranging gives way to a pressing payload, which is sent again in a
pause."""


class Ingredients(msgspec.Struct, frozen=True, kw_only=True):
    """The sources of the frames of one node on one link, beside the handshake."""

    queue: TransmitQueue
    """The waiting records."""
    dense: DenseSource
    """Encodes dense blocks."""
    ranging: Ranging
    """The wanted ranges."""
    objects: ObjectSource
    """Fragments, and feedback about incoming ones."""
    heartbeats: Heartbeats
    """Frames for a node that has sent nothing for long."""
    seal: Unsealed
    """Closes the frames."""
    begins: Callable[[int], None]
    """Called with the instant before a frame of records is composed."""
    extensions: Sequence[ExtensionSource] = ()
    """Third-party transports."""
    relay: ForwardingSource | None = None
    """Frames of routes over relays; None: this node is part of none on this link."""
    other_end: int | None = None
    """The one other node on this link, so that no frame is a broadcast; None: there are more."""


class _Draft:
    """A frame while it is filled: its content beside records, and the room left."""

    def __init__(self, destination: int, room_bytes: int, closing: Closing) -> None:
        self.destination = destination
        self.closing = closing
        self.room_bytes = room_bytes - closing.overhead_bytes
        self.introduction = b""
        self.parts: list[Part] = []
        self._said: list[tuple[Cause, bytes]] = []

    @property
    def is_empty(self) -> bool:
        """Whether it has no content yet."""
        return not self.introduction and not self._said

    def say(self, cause: Cause, said: bytes, part: Part | None = None) -> None:
        """Add content."""
        self._said.append((cause, said))
        self.room_bytes -= len(said)
        if part is not None:
            self.parts.append(part)

    def attribute(self, stats: EngineStats) -> None:
        """Attribute its bytes in the statistics."""
        stats.attribute(NO_STREAM, Cause.HELLO, len(self.introduction))
        for cause, said in self._said:
            stats.attribute(NO_STREAM, cause, len(said))

    def encode(self) -> bytes:
        """Return its bytes."""
        return self.introduction + b"".join(said for _, said in self._said)


class Composer(Frames):
    """Makes the frames of one node on one link.

    Args:
        link: Name of the link.
        handshake: Provides introductions and what is owed.
        epoch: The boot epoch of the node.
        made_of: The sources of the frames.
        stats: Counts every byte.
    """

    def __init__(
        self,
        link: str,
        handshake: Handshake,
        epoch: BootEpoch,
        made_of: Ingredients,
        stats: EngineStats,
    ) -> None:
        super().__init__(made_of.queue, epoch, made_of.relay)
        self._link = link
        self._owing = handshake.owing
        self._introductions = handshake.introductions
        self._dense = made_of.dense
        self._ranging = made_of.ranging
        self._objects = made_of.objects
        self._heartbeats = made_of.heartbeats
        self._seal = made_of.seal
        self._extensions = made_of.extensions
        self._begins = made_of.begins
        self._other_end = made_of.other_end
        self._sources: tuple[Source, ...] = (
            made_of.heartbeats, made_of.objects, self._owing.on(link), made_of.ranging,
            made_of.dense, *made_of.extensions, *filter(None, [made_of.relay]), made_of.queue,
        )  # fmt: skip
        """Of equal offers the first one wins; the last source is that of the best payload."""
        self._not_objects = tuple(each for each in self._sources if each is not made_of.objects)
        self._stats = stats
        self._since_introduction = 0

    # What waits

    def due_at(self, now: int) -> int | None:
        """Return the instant from which a frame should go, ns; None: nothing to send."""
        earliest: int | None = None
        for source in self._not_objects:  # a plain loop: simulations spend most of their time here
            at = source.due_at(now)
            if at is not None and (earliest is None or at < earliest):
                earliest = at
        held_until = self._objects.hold_until(now)
        if earliest is not None and held_until > now and not self.is_urgent(now):
            earliest = max(earliest, held_until)
        object_at = self._objects.due_at(now)
        if earliest is None or object_at is None:
            return earliest if object_at is None else object_at
        return min(earliest, object_at)

    def held(self, now: int) -> tuple[int, Why] | None:
        """Return until when waiting records are held, ns, and why: also for an awaited answer."""
        held, answered_at = super().held(now), self._objects.hold_until(now)
        if held is None or held[0] >= answered_at or self.is_urgent(now):
            return held
        return answered_at, Why.ANSWER

    def bulk_due_at(self, now: int) -> int | None:
        """Return the instant from which a fragment should go by the bulk service, ns, or None."""
        return self._objects.bulk_due_at(now)

    def rides_back(self, address: int, now: int) -> bool:
        """Return whether all that is urgent may go with what the device says to a node."""
        is_alone = self._introductions.is_only_other(address)
        return self.queue.is_urgent_only_to((address, BROADCAST) if is_alone else (address,), now)

    def owes_acknowledgement(self, now: int) -> bool:
        """Return whether an acknowledgement or feedback waits."""
        return self.queue.has_acknowledgement or self._objects.owes_answer(now)

    # What goes

    def speak(self, port: LinkPort, now: int) -> Composed | None:
        """Make a frame with only the controls of medium access."""
        room_bytes = port.envelope.room_bytes - self._seal.overhead_bytes
        said = port.access.controls(room_bytes, now, alone=True)
        if not said:
            return None
        return self._controls(port, port.access.answers_to, [(Cause.ACCESS, said)], now)

    def compose_only(self, port: LinkPort, lane: LaneKey, now: int) -> Composed | None:
        """Make a frame of one lane's payloads, with what their hearer needs beside them."""
        first = next(self.queue.candidates(now, lane), None)
        if first is None:
            return None
        offer = self._for_link(Offer(destination=first[1].destination, lane=lane))
        return self._fill(port, offer, now)

    def compose_granted(self, port: LinkPort, now: int) -> Composed | None:
        """Make the frame of another link that may go in silence, or return None."""
        if self.forwarding is None:
            return None
        granted = self.forwarding.take_granted(port.envelope.room_bytes, now)
        if granted is None:
            return None
        destination, taken = granted
        return self._forward(port, Offer(destination=destination), taken, now)

    def compose(self, port: LinkPort, now: int) -> Composed | None:
        """Make the frame that is worth most now; return None when there is nothing to send."""
        self._begins(now)
        in_vain: list[Offer] = []
        while (offer := self._best(now, in_vain)) is not None:
            composed = self._how(offer)(port, offer, now)
            if composed is not None:
                return composed
            in_vain.append(offer)
        return None

    def ride_back(self, address: int, port: LinkPort, now: int) -> Composed | None:
        """Make a frame that goes with the acknowledgement of a node's bulk frames, or return None.

        It has what is owed to that node and what waits for it, also what goes to all where there is
        no other. If nothing does, it is the shortest one, now and then: from that the node learns
        that this one wants a pause.
        """
        is_alone = self._introductions.is_only_other(address)
        offer = Offer(destination=address, takes_all=is_alone, owed_first=True)
        composed = self._fill(port, offer, now)
        if composed is None and port.may_ask_for_pause(now):
            port.ask_for_pause(now)
            composed = self._controls(port, address, [(Cause.ACCESS, PADDING)], now)
        return None if composed is None else msgspec.structs.replace(composed, rides_back=True)

    def compose_bulk(self, port: LinkPort, now: int) -> Composed | None:
        """Make the frame of the bulk service that is worth most now, or return None.

        It has a fragment, and before that the introduction that its hearer needs: such a frame has
        the room for it, and none of its own would get to the modem before it.
        """
        destination = self._objects.bulk_destination(now)
        if destination is None:
            return None
        is_due = self._introductions.is_due(self._link, destination)
        closing = self._seal.settle(destination, None, None, now, introduces=is_due)
        room_bytes = port.bulk_room_bytes - self._seal.overhead_bytes
        introduction = b""
        if is_due or self._introduces_fragment(destination, now):
            self._introductions.begin_frame(destination)
            introduction = self._introductions.introduction(
                self._link, destination, BULK_OVERHEAD_BYTES, now
            )
        taken = self._objects.take_bulk(room_bytes - BULK_OVERHEAD_BYTES, now)
        if taken is None:
            return None
        if taken.is_first:
            count(self._stats.transmitted, taken.stream_id)
        data_bytes = len(taken.record) - taken.header_bytes
        cause = Cause.REPAIR if taken.is_repair else Cause.PAYLOAD
        self._stats.attribute(NO_STREAM, Cause.HELLO, len(introduction))
        self._stats.attribute(taken.stream_id, Cause.HEADER, taken.header_bytes)
        self._stats.attribute(taken.stream_id, cause, data_bytes)
        closed = self._seal.close(
            introduction + taken.record,
            destination,
            closing,
            now,
            needs_no_table=bool(introduction),
        )
        frame_bytes = port.envelope.wrap(closed, destination)
        added_bytes = len(closed) - len(introduction) - len(taken.record)
        self._stats.attribute(NO_STREAM, Cause.SEAL, added_bytes)
        self._stats.attribute(NO_STREAM, Cause.ENVELOPE, len(frame_bytes) - len(closed))
        beat = Part(transmitted=partial(self._heartbeats.transmitted, destination))
        return Composed(
            destination=destination,
            frame_bytes=frame_bytes,
            object_stream=taken.stream_id,
            acknowledge=True,
            parts=(taken.part, beat),
        )

    def forward(self, source: ForwardingSource) -> None:
        """Begin to transmit the frames of other links that go over this one."""
        super().forward(source)
        self._sources = (*self._sources[:-1], source, self.queue)
        self._not_objects = (*self._not_objects[:-1], source, self.queue)

    def hold(self, stream_id: int, until: int) -> None:
        """Hold everything of a stream until an instant, ns: its airtime is used up."""
        super().hold(stream_id, until)
        self._objects.hold(stream_id, until)

    # Below the methods above

    def _best(self, now: int, in_vain: list[Offer]) -> Offer | None:
        """Return the best offer, except for those that made no frame."""
        *others, payload = (source.offer(now) for source in self._sources)
        rank = BESIDE_PAYLOAD if payload is None else max(payload.rank, FIRST_BUT_URGENT)
        to_all = payload is not None and payload.destination == BROADCAST
        is_held = self._objects.hold_until(now) > now
        best: Offer | None = None
        for offer in (*others, payload):
            if offer is None or (is_held and not offer.ignores_hold):
                continue
            if offer.rank == BESIDE_PAYLOAD:
                destination = BROADCAST if offer.rides and to_all else offer.destination
                offer = msgspec.structs.replace(offer, rank=rank, destination=destination)
            offer = self._for_link(offer)
            if offer not in in_vain and (best is None or offer.rank < best.rank):
                best = offer
        return best

    def _for_link(self, offer: Offer) -> Offer:
        """Return an offer as the link can carry it: where there is one other node, for that."""
        if self._other_end is None or offer.destination != BROADCAST:
            return offer
        return msgspec.structs.replace(offer, destination=self._other_end, takes_all=True)

    def _how(self, offer: Offer) -> Callable[[LinkPort, Offer, int], Composed | None]:
        """Return how the frame of an offer is made."""
        if offer.is_forwarded:
            return self._fill_forwarded
        return self._fill_fragment if offer.is_fragment else self._fill

    def _fill_forwarded(self, port: LinkPort, offer: Offer, now: int) -> Composed | None:
        """Make the frame of a route: inside it is as its first node has made it, or sealed it."""
        room_bytes = port.envelope.room_bytes
        if offer.sealed_bytes and self._seal.introduces_hop(offer.sealed_bytes, room_bytes, now):
            hello = self._introductions.introduction(self._link, BROADCAST, room_bytes, now)
            return self._controls(port, BROADCAST, [(Cause.HELLO, hello or PADDING)], now)
        if offer.sealed_bytes:
            room_bytes -= self._seal.hop_overhead_bytes
        taken = None if self.forwarding is None else self.forwarding.take(room_bytes, now)
        return None if taken is None else self._forward(port, offer, taken, now)

    def _forward(self, port: LinkPort, offer: Offer, taken: Forwarded, now: int) -> Composed:
        closed = taken.content
        if offer.sealed_bytes:
            room_bytes = port.envelope.room_bytes
            closed = self._seal.close_hop(closed, room_bytes, now, is_pressing=taken.is_pressing)
        frame_bytes = port.envelope.wrap(closed, offer.destination)
        self._stats.attribute(NO_STREAM, Cause.SEAL, len(closed) - len(taken.content))
        self._stats.attribute(NO_STREAM, Cause.ENVELOPE, len(frame_bytes) - len(closed))
        return Composed(
            destination=offer.destination,
            frame_bytes=frame_bytes,
            parts=(taken.part,),
            is_urgent=taken.is_urgent,
        )

    def _fill_fragment(self, port: LinkPort, offer: Offer, now: int) -> Composed | None:
        """Make the frame of a fragment, or the introduction that must precede it."""
        destination = offer.destination
        room_bytes = port.envelope.room_bytes - self._seal.fragment_overhead_bytes
        tells_all = self._has_others(destination) and port.reaches_all(port.envelope.room_bytes)
        for hearers in (destination, BROADCAST) if tells_all else (destination,):
            answered = offer.is_answered if hearers != BROADCAST else None
            if not self._seal.is_known(hearers, now, answered=answered):
                hello = self._introductions.introduction(self._link, hearers, room_bytes, now)
                said = [(Cause.HELLO, hello)]
                return self._controls(port, hearers, said, now, answered=answered)
        # The last fragment of a run announces the pause to all nodes, so it goes first.
        if not port.ends_run_now(now) and self._introduces_fragment(destination, now):
            hello = self._introductions.introduction(self._link, destination, room_bytes, now)
            return self._controls(port, destination, [(Cause.HELLO, hello)], now)
        taken = self._objects.take_fragment(room_bytes, now, port.frames_before_pause(now))
        if taken is None:
            return None
        if taken.ends_run:
            port.end_run()
            if self._has_others(destination) and port.reaches_all(
                len(taken.record) + self._seal.fragment_overhead_bytes
            ):
                destination = BROADCAST  # the pause that follows concerns all nodes
        if taken.is_first:
            count(self._stats.transmitted, taken.stream_id)
        cause = Cause.REPAIR if taken.is_repair else Cause.PAYLOAD
        self._stats.attribute(taken.stream_id, Cause.HEADER, taken.header_bytes)
        data_bytes = len(taken.record) - taken.header_bytes
        self._stats.attribute(taken.stream_id, cause, data_bytes)
        return self._composed(
            port,
            destination,
            taken.record,
            now,
            closing=self._seal.settle(
                destination,
                None,
                None,
                now,
                answered=offer.is_answered if destination != BROADCAST else None,
            ),
            object_stream=taken.stream_id,
            parts=[taken.part],
        )

    def _has_others(self, destination: int) -> bool:
        """Return whether other nodes on this link are concerned by a frame to one of them."""
        return self._other_end is None and self._introductions.concerns_others(destination)

    def _introduces_fragment(self, destination: int, now: int) -> bool:
        """Return whether this node must introduce itself before a fragment, of either service."""
        if not self._introductions.is_unconfirmed(destination, now):
            return False
        self._since_introduction += 1
        return self._since_introduction % HELLO_EVERY == 1 or self._introductions.introduces(
            self._link, destination
        )

    def _controls(
        self,
        port: LinkPort,
        destination: int,
        said: list[tuple[Cause, bytes]],
        now: int,
        *,
        answered: bool | None = None,
    ) -> Composed:
        """Make a frame of controls; `answered` is that of a fragment that they precede."""
        for cause, control in said:
            self._stats.attribute(NO_STREAM, cause, len(control))
        closing = self._seal.settle(destination, None, None, now, answered=answered)
        content = b"".join(control for _, control in said)
        return self._composed(port, destination, content, now, closing=closing, needs_no_table=True)

    def _composed(
        self,
        port: LinkPort,
        destination: int,
        content: bytes,
        now: int,
        *,
        closing: Closing,
        records: tuple[QueuedRecord, ...] = (),
        object_stream: int | None = None,
        parts: Sequence[Part] = (),
        is_pressing: bool = False,
        needs_no_table: bool = False,
        is_heartbeat: bool = False,
        is_reply: bool = False,
    ) -> Composed:
        """Close a frame, add its envelope, and collect the parts that follow its transmission.

        Args:
            port: The link.
            destination: Address, or `BROADCAST`.
            content: Its content.
            now: The instant.
            closing: How it is closed.
            records: Its records from the queue.
            object_stream: The stream of its fragment.
            parts: Further parts that follow its transmission.
            is_pressing: It carries a payload that may be repeated before any answer can come.
            needs_no_table: It has a HELLO, or no record of any stream.
            is_heartbeat: It has nothing but the sign that this node is there.
            is_reply: It goes because of its destination.
        """
        closed = self._seal.close(
            content,
            destination,
            closing,
            now,
            items=records,
            needs_no_table=needs_no_table,
            padded_to=port.broadcast_bytes if destination == BROADCAST else None,
        )
        frame_bytes = port.envelope.wrap(closed, destination)
        self._stats.attribute(NO_STREAM, Cause.SEAL, len(closed) - len(content))
        self._stats.attribute(NO_STREAM, Cause.ENVELOPE, len(frame_bytes) - len(closed))
        exchange = self._ranging.exchange(destination, now, gives_way=is_pressing)
        if is_pressing:
            until = now + _GIVE_WAY_PERIODS * port.listening.period_ns
            self._ranging.give_way(destination, until)
        beat = Part(transmitted=partial(self._heartbeats.transmitted, destination))
        told = (*(record.part for record in records), *parts, exchange, beat)
        return Composed(
            destination=destination,
            frame_bytes=frame_bytes,
            records=records,
            object_stream=object_stream,
            acknowledge=exchange is not None,
            parts=tuple(part for part in told if part is not None),
            is_heartbeat=is_heartbeat,
            caused_by=destination if is_reply and destination != BROADCAST else None,
        )

    def _fill(self, port: LinkPort, offer: Offer, now: int) -> Composed | None:
        """Make a frame of what is owed to its hearers and of payloads; None: it would be empty."""
        # A node that awaits an answer listens only for as long as a short frame takes.
        first = None if offer.is_answer else next(self._concerning(offer, now), None)
        lane, item = first or (None, None)
        priority = lane.qos.priority if lane else None
        is_due = self._introductions.is_due(self._link, offer.destination)
        closing = self._seal.settle(offer.destination, item, priority, now, introduces=is_due)
        draft = _Draft(offer.destination, port.room_bytes, closing)
        self._introductions.begin_frame(draft.destination)
        self._answer(draft, now)
        first_bytes = first[1].least_bytes if first else 0
        feedback_fills = not draft.is_empty and draft.room_bytes < HELLO_BYTES
        if feedback_fills or not self._agree(draft, offer, first, now):
            first = None
        self._extend(draft, first_bytes * (not offer.owed_first), now)
        if first or not draft.is_empty:
            self._arrange(draft, port, first_bytes, now)
        filling: Filling | None = None
        if first:
            introduced = bool(draft.introduction) or self._introductions.reaches_others(
                draft.destination
            )
            filling = self._choose(offer, draft, now, introduced=introduced)
        self._owing.spoken(self._link, draft.destination, now)
        items = filling.items if filling is not None else ()
        if lane and item and draft.introduction and not items and not self.queue.fits(item):
            # It never has room beside a TAG: it gives its turn to the TAG, as if it had been lost.
            self.queue.take(lane, now)
            draft.parts += filter(None, [item.part])
        elif lane and item and item.block_bytes and filling is not None and item not in items:
            self._drop_grown(lane, draft, now, is_alone=not items)
        is_empty = draft.is_empty and not items
        if is_empty:
            if offer.must_go is None:
                return None
            draft.say(offer.must_go, PADDING)
        records = filling.encode(self._stats) if filling is not None else b""
        left_bytes = draft.room_bytes - len(records)
        draft.say(Cause.ACK, self._dense.acks(draft.destination, left_bytes))
        draft.attribute(self._stats)
        return self._composed(
            port,
            draft.destination,
            draft.encode() + records,
            now,
            closing=draft.closing,
            records=items,
            parts=draft.parts,
            is_pressing=first is not None and first[0].qos.priority in MOST_COPIES,
            needs_no_table=bool(draft.introduction) or not items,
            is_heartbeat=is_empty and offer.must_go is Cause.HEARTBEAT,
            is_reply=offer.is_reply,
        )

    def _answer(self, draft: "_Draft", now: int) -> None:
        """Add the feedback that the hearer awaits while it sends an object."""
        if draft.destination == BROADCAST:
            return
        feedback = self._objects.take_feedback(draft.destination, draft.room_bytes, now)
        if feedback is not None:
            draft.say(Cause.REPAIR, feedback.record, feedback.part)

    def _drop_grown(self, lane: Lane, draft: "_Draft", now: int, *, is_alone: bool) -> None:
        """Drop a sample that fits no frame any more: the reference of its block is lost.

        Beside controls it may not have had room; then it stays, for a frame of its own.
        """
        if draft.is_empty or (draft.introduction and is_alone):
            self.queue.take(lane, now)
            self._stats.drop("oversized")

    def _agree(
        self, draft: "_Draft", offer: Offer, first: tuple[Lane, QueuedRecord] | None, now: int
    ) -> bool:
        """Add the introduction and what is owed, beside the first payload of the frame.

        Returns:
            Whether there is a first payload and room for it.
        """
        destination = draft.destination
        first_bytes = first[1].least_bytes if first else 0
        urgent = bool(first and first[0].qos.priority is Priority.REAL_TIME)
        goes = first is not None
        introduces = self._introductions.introduces(self._link, destination)
        if offer.owed_first and not introduces:
            self._owe(draft, 0, now)
            goes = goes and draft.room_bytes >= TAG_BYTES + first_bytes
            urgent = urgent or draft.room_bytes < HELLO_BYTES
        if goes or self._introductions.introduces(self._link, destination):
            self._introduce(draft, first_bytes, now, urgent=urgent)
            is_reserved = not offer.owed_first and first_bytes <= draft.room_bytes
            self._owe(draft, first_bytes if is_reserved else 0, now)
        elif offer.must_go:
            if offer.must_go is Cause.HEARTBEAT:
                self._introduce(draft, 0, now)
            # No introduction for ranging alone: it would require an answer, which is not wanted.
            self._owe(draft, 0, now)
        return goes

    def _introduce(
        self, draft: "_Draft", reserved_bytes: int, now: int, *, urgent: bool = False
    ) -> None:
        draft.introduction = self._introductions.introduction(
            self._link, draft.destination, draft.room_bytes - reserved_bytes, now, urgent=urgent
        )
        draft.room_bytes -= len(draft.introduction)

    def _owe(self, draft: "_Draft", reserved_bytes: int, now: int) -> None:
        room_bytes = draft.room_bytes - reserved_bytes
        for cause, control in self._owing.take(self._link, draft.destination, room_bytes, now):
            draft.say(cause, control)

    def _extend(self, draft: "_Draft", reserved_bytes: int, now: int) -> None:
        """Add the extensions of third-party transports, as far as they fit."""
        for source in self._extensions:
            room_bytes = draft.room_bytes - reserved_bytes - EXTENSION_HEADER_BYTES
            body_bytes = min(room_bytes, LONGEST_EXTENSION_BYTES)
            said = source.say(draft.destination, body_bytes, now) if body_bytes >= 0 else None
            if said is not None:
                if len(said.extension.body) > body_bytes:
                    raise ValueError(f"{said} is too long; allowed: {body_bytes} bytes")
                draft.say(Cause.EXTENSION, said.extension.encode(), said.part)

    def _arrange(self, draft: "_Draft", port: LinkPort, first_bytes: int, now: int) -> None:
        """Add the controls of medium access, and limit the room to the size that it prefers."""
        said = port.controls(
            draft.room_bytes - first_bytes,
            self._has_bytes,
            now,
            has_object=self._objects.has_fragment(now),
        )
        if said:
            draft.say(Cause.ACCESS, said)
        comfort_bytes = port.comfort_bytes(now, is_copy=self.queue.has_copy)
        if comfort_bytes is not None:
            spent_bytes = port.room_bytes - draft.room_bytes
            most_bytes = max(first_bytes, comfort_bytes - spent_bytes)
            draft.room_bytes = min(draft.room_bytes, most_bytes)

    def _has_bytes(self, least_bytes: int) -> bool:
        """Return whether so many bytes wait, or will: then a pause is worth its announcement."""
        return self._dense.fills_link or self.queue.has_bytes(least_bytes)

    def _concerning(self, offer: Offer, now: int) -> Iterator[tuple[Lane, QueuedRecord]]:
        """Yield the candidates that the frame may carry."""
        to_all = offer.takes_all or offer.destination == BROADCAST
        for lane, item in self.queue.candidates(now, offer.lane):
            if item.destination == offer.destination or (to_all and not item.for_one_node):
                yield lane, item

    def _choose(self, offer: Offer, draft: "_Draft", now: int, *, introduced: bool) -> Filling:
        """Take payloads until no more fit."""
        filling = Filling(
            offer.destination, draft.room_bytes, now, self._dense, introduced=introduced
        )
        for lane, item in self._concerning(offer, now):
            if not self._seal.admits(item, draft.closing):
                continue
            if filling.add(item):
                self.queue.take(lane, now)
            elif filling.is_full:
                break
        return filling
