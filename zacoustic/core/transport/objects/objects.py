"""`Objects`: payloads larger than a frame, in both directions, as the engine sees them.

The engine uses it as follows::

 publish, withdraw, cancel_incoming                    commands
 due_at ─► offer ─► take_feedback, take_fragment       what goes into the next frame
 hold_until                                            until then nothing else should start
 fragment, feedback                                    what has arrived
 restore                                               once, with entries of earlier boot epochs

A fragment has a frame of its own; a feedback joins a frame to its destination. Medium access
provides the pauses of the listen windows, and learns when a transfer is exclusive.
"""

from collections.abc import Callable, Mapping, Set
from functools import partial

from zacoustic.core.base.generators import Generators
from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.linktypes import LinkCapabilities, ReceivedFrame, TransmitReport
from zacoustic.core.base.moments import Made, Moments
from zacoustic.core.base.parts import Offer, Part
from zacoustic.core.base.qos import PATIENCE_NS, Priority
from zacoustic.core.base.sizes import SIZES, Sizes
from zacoustic.core.base.timers import Timers
from zacoustic.core.schedule.pacers import Pacers
from zacoustic.core.schedule.sources import Taken
from zacoustic.core.streams.keys import Instance
from zacoustic.core.transport.objects.admission import AdmissionControl
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.core.transport.objects.manifest import Manifest, decode_manifest
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.transport.objects.receiving.receiving import IncomingObjects
from zacoustic.core.transport.objects.receiving.replies import TransferKey
from zacoustic.core.transport.objects.sending.bulkobject import BulkObject
from zacoustic.core.transport.objects.sending.bulkpaths import BulkChanged
from zacoustic.core.transport.objects.sending.sending import OutgoingObjects, Owner, Sending
from zacoustic.core.transport.objects.stored import (
    StoredObject,
    StoredProgress,
    stored_ages,
    stored_ends,
    stored_groups,
    stored_out,
)
from zacoustic.core.transport.objects.timing import Timing
from zacoustic.core.values.age import NO_AGE, Age
from zacoustic.core.wire.objects import (
    FEEDBACK_BYTES,
    FRAGMENT_HEADER_BYTES,
    Feedback,
    Fragment,
    ListenHint,
)
from zacoustic.errors import PayloadTooLargeError


class Objects:
    """The objects of one node.

    Args:
        epoch: Boot epoch of the node.
        limits: How much memory they may take.
        pacers: Decide when to repeat to other nodes.
        timers: Withdraw expired objects.
        generators: Provide one random generator for each component.
        admission: Knows the table and whose turn it is; takes complete objects, once each.
        owner: Gets events of outgoing objects, and knows whose turn it is.
        emit: Takes events about their progress and their way.
        journal: Holds what must survive a restart.
        moments: Find instants again after a restart.
        sizes: How many numbers there are, and how many ended objects are remembered.
    """

    def __init__(
        self,
        *,
        epoch: int,
        limits: ObjectLimits,
        pacers: Pacers,
        timers: Timers,
        generators: Generators,
        admission: AdmissionControl,
        owner: Owner,
        emit: Callable[[ObjectProgress | BulkChanged], None],
        journal: JournalPort,
        moments: Moments,
        sizes: Sizes = SIZES,
    ) -> None:
        self._moments = moments
        self._limits = limits
        self._outgoing = OutgoingObjects(
            epoch=epoch,
            numbers=sizes.transfers,
            most=min(limits.most_outgoing, sizes.transfers),
            pacers=pacers,
            timers=timers,
            rng=generators.of("outgoing objects"),
            emit=emit,
            owner=owner,
            journal=journal,
            moments=moments,
        )
        self._incoming = IncomingObjects(
            limits=limits,
            rng=generators.of("incoming objects"),
            admission=admission,
            emit=emit,
            journal=journal,
            moments=moments,
            most_ended=sizes.ended_transfers,
        )
        self._sendings = self._outgoing.sendings
        self._replies = self._incoming.replies
        self._timing: Timing | None = None
        self._fragment_bytes = 0
        self._last_fragment_at = 0

    def use_link(
        self,
        capabilities: LinkCapabilities,
        room_bytes: int,
        pause_ns: int,
        now: int,
        *,
        bulk_bytes: int = 0,
        hears_meanwhile: bool = False,
        longest_answer_ns: int | None = None,
        lacks: Callable[[int, int], None] | None = None,
    ) -> None:
        """Derive the durations from the link.

        Args:
            capabilities: What the link can do.
            room_bytes: Room for records in a frame, bytes.
            pause_ns: Length of a listen window, ns.
            now: The instant.
            bulk_bytes: Room for records in a frame of the bulk service, bytes; 0 or less: none.
            hears_meanwhile: This node hears all others while it sends such frames.
            longest_answer_ns: See `Timing`.
            lacks: Told ``(source, now)`` of an answer that asks a source for more.
        """
        self._incoming.lacks = lacks
        envelope_bytes = capabilities.mtu_bytes - room_bytes
        self._timing = Timing.of(capabilities, envelope_bytes, pause_ns, longest_answer_ns)
        self._fragment_bytes = room_bytes - FRAGMENT_HEADER_BYTES
        if self._fragment_bytes >= 1:
            bulk_fragment_bytes = bulk_bytes - FRAGMENT_HEADER_BYTES
            if bulk_fragment_bytes <= self._fragment_bytes:
                bulk_fragment_bytes = 0
            self._outgoing.use_link(
                self._fragment_bytes, bulk_fragment_bytes, now, hears_meanwhile=hears_meanwhile
            )

    def restore(
        self,
        stored: Mapping[str, bytes],
        refuse: Callable[[StoredObject], str],
        given_up: Callable[[StoredObject, str, int], None],
    ) -> list[tuple[int, Manifest]]:
        """Restore the entries of earlier boot epochs, before anything else.

        Args:
            stored: The content of the journal.
            refuse: Returns why an outgoing object cannot be resumed, empty: it can.
            given_up: Told ``(object, why, now)`` once a refused one is deleted in the journal.

        Returns:
            Source and manifest of each object that was delivered.
        """
        handed_on: list[tuple[int, Manifest]] = []
        for source, transfer, end in stored_ends(stored):
            self._incoming.restore_end(source, transfer, end)
            manifest = decode_manifest(b"".join(end.head))
            if manifest is not None:
                handed_on.append((source, manifest))
        for source, transfer, group, fragments in stored_groups(stored):
            self._incoming.restore_group(source, transfer, group, fragments)
        for source, transfer, age in stored_ages(stored):
            self._incoming.restore_age(source, transfer, age)
        self._incoming.restored()
        for transfer, order, place in stored_out(stored):
            if why := refuse(order):
                self._outgoing.forget(transfer, partial(given_up, order, why))
            else:
                self._outgoing.restore(transfer, order, place or StoredProgress(0, 0))
        return handed_on

    def link_up(self, now: int) -> None:
        """Deliver what an earlier boot epoch was about to deliver: the link is up."""
        self._incoming.link_up(now)

    # Commands

    def publish(
        self,
        object_id: int,
        stream_id: int,
        payload: bytes,
        now: int,
        *,
        instance: Instance,
        encoding: str | None,
        lineage: int,
        number: int,
        receivers: tuple[int, ...],
        stream_digest: bytes = b"",
        keep: bool = True,
        priority: Priority = Priority.DATA,
        exclusive: bool = False,
        lifespan_s: float | None = None,
        expires_at: int | None = None,
        has_age: bool = False,
        made_at: Made = None,
    ) -> None:
        """Send a payload as an object.

        Args:
            object_id: The id in its progress events; of two objects the smaller id goes first.
            stream_id: Its topic.
            payload: The encoded payload.
            now: The instant.
            instance: The key within the topic.
            encoding: The Zenoh encoding, where it is not the stream's.
            lineage: Its lineage in the count of its key.
            number: Its number there.
            receivers: Addresses of the receivers, at least one.
            stream_digest: The stream's digest: a later boot epoch resumes only if it is the same.
            keep: Whether the object survives a restart.
            priority: Which of several objects goes first.
            exclusive: Whether it is sent without listen windows.
            lifespan_s: Time after which it is withdrawn in a later boot epoch, s.
            expires_at: Instant at which it is withdrawn in this boot epoch, ns; None: never.
            has_age: Whether its first fragment says how old it is.
            made_at: When it was made, for that.

        Raises:
            PayloadTooLargeError: It has more fragments than an index can name on this link.
            QueueFullError: Too many objects are under way.
        """
        if self._fragment_bytes < 1:
            raise PayloadTooLargeError("a frame of this link has no room for a fragment")
        order = StoredObject(
            object_id,
            stream_id,
            instance,
            encoding,
            payload,
            self._outgoing.fragment_bytes(receivers, now),
            receivers,
            priority,
            exclusive,
            lifespan_s,
            lineage,
            number,
            stream_digest,
            has_age,
            self._moments.keep(made_at) if has_age else None,
        )
        self._outgoing.add(order, now, keep=keep, expires_at=expires_at, made_at=made_at)

    def check_size(self, name: str, payload_bytes: int, most_bytes: int | None = None) -> None:
        """Refuse a payload that is larger than an object may be.

        Args:
            name: The topic's name.
            payload_bytes: Its size, bytes.
            most_bytes: The largest payload of this topic; None: the node's limit.

        Raises:
            PayloadTooLargeError: States its size and the largest allowed size.
        """
        most_bytes = self._limits.largest_bytes if most_bytes is None else most_bytes
        if payload_bytes > most_bytes:
            raise PayloadTooLargeError(
                f"{name}: the payload is {payload_bytes} bytes; an object has at most {most_bytes}",
                hint="raise the limit at both ends, or publish it in pieces",
            )

    def withdraw(self, object_id: int, state: ObjectState, detail: str, now: int) -> bool:
        """Withdraw an outgoing object; return False when it is not under way."""
        return self._outgoing.withdraw(object_id, state, detail, now)

    def is_crossing(self, object_id: int) -> bool:
        """Return whether some of an object was transmitted, and a receiver is there."""
        return self._outgoing.is_crossing(object_id)

    def handed_on(self, object_id: int, address: int) -> None:
        """Note that an ACK of the topic shows that a receiver has delivered an outgoing object."""
        self._outgoing.handed_on(object_id, address)

    def keep_only(self, stream_id: int, receivers: Set[int], detail: str, now: int) -> None:
        """Keep only these receivers of a stream's objects; `detail` is for those left without."""
        self._outgoing.keep_only(stream_id, receivers, detail, now)

    def cancel_incoming(self, source: int, transfer: int) -> bool:
        """Refuse the rest of an incoming object; return False when it is not under way."""
        return self._incoming.cancel(source, transfer)

    def stream_coming(self, source: int, transfer: int) -> int:
        """Return the stream of an incoming object, 0 while unknown."""
        return self._incoming.stream_of(source, transfer)

    def drop_unwanted(self, stream_id: int, sources: Set[int]) -> None:
        """Drop a stream's incoming objects from these sources: this node has unsubscribed."""
        self._incoming.drop_unwanted(stream_id, sources)

    def peer_forgotten(self, address: int, now: int) -> None:
        """Forget a node."""
        self._incoming.peer_forgotten(address, now)
        self._outgoing.peer_forgotten(address, now)

    def look_again(self, source: int) -> None:
        """Check the complete objects of a source again after it delivered a sample."""
        self._incoming.look_again(source)

    # Frames of this node

    def due_at(self, now: int) -> int | None:
        """Return the instant at which a frame with an object's record is due, ns, or None."""
        if self._timing is None or not (self._sendings or self._replies.waiting):
            return None
        answer_at, fragment_at = self._replies.due_at(now), self._fragment_due_at(now)
        if answer_at is None or fragment_at is None:
            return fragment_at if answer_at is None else answer_at
        return min(answer_at, fragment_at)

    def owes_answer(self, now: int) -> bool:
        """Return whether feedback about an object is due or still in transmission."""
        return self._replies.owes_answer(now)

    def offer(self, now: int) -> Offer | None:
        """Return the due record: feedback before a fragment."""
        if self._timing is None or not (self._sendings or self._replies.waiting):
            return None
        destination = self._replies.destination(now)
        if destination is not None:
            return Offer(
                destination=destination,
                rank=0,
                owed_first=True,
                is_answer=True,
                is_reply=True,
                ignores_hold=True,
            )
        sending = self._sending(now)
        if sending is None:
            return None
        patience_ns = PATIENCE_NS.get(sending.priority, 0)
        return Offer(
            destination=self._outgoing.next_destination(sending, now),
            is_fragment=True,
            is_answered=sending.outgoing.is_answered,
            ignores_hold=True,
            rank=max(sending.outgoing.due_at, self._last_fragment_at) + patience_ns,
        )

    def has_fragment(self, now: int) -> bool:
        """Return whether a fragment is due."""
        has_timing = self._timing is not None
        return bool(self._sendings) and has_timing and self._sending(now) is not None

    def take_feedback(self, destination: int, room_bytes: int, now: int) -> Taken | None:
        """Take a due answer for this destination, if it fits."""
        if room_bytes < FEEDBACK_BYTES or not self._replies.waiting:
            return None
        taken = self._incoming.take(destination, now)
        if taken is None:
            return None
        feedback, place = taken
        record = feedback.encode()
        return Taken(
            stream_id=self._incoming.stream_of(*place),
            record=record,
            header_bytes=len(record),
            part=Part(reported=partial(self._feedback_reported, place)),
        )

    def take_fragment(self, room_bytes: int, now: int, frames_before_pause: int) -> Taken | None:
        """Take the fragment of `offer`, if it fits.

        Args:
            room_bytes: Room for it in the frame, bytes.
            now: The instant.
            frames_before_pause: Full frames before the next listen window, this one included.
        """
        sending, timing = self._sending(now), self._timing
        if timing is None or sending is None:
            return None
        if FRAGMENT_HEADER_BYTES + self._outgoing.next_bytes(sending, now) > room_bytes:
            return None
        taken = self._outgoing.take(now, timing, frames_before_pause)
        if taken is None:
            return None
        sending, fragment = taken
        self._last_fragment_at = now
        return Taken(
            stream_id=sending.stream_id,
            record=fragment.encode(),
            header_bytes=FRAGMENT_HEADER_BYTES,
            is_first=fragment.index == 0 and sending.outgoing.transmitted == 1,
            is_repair=sending.outgoing.is_repair(fragment.index),
            ends_run=fragment.call is ListenHint.WINDOW,
            part=Part(
                reported=partial(
                    self._fragment_reported, sending, fragment.call is ListenHint.ANSWER
                )
            ),
        )

    def bulk_due_at(self, now: int) -> int | None:
        """Return the instant at which a fragment is due on the bulk service, ns, or None."""
        if self._timing is None or not self._sendings:
            return None
        sending, at = self._outgoing.next(now, bulk=True)
        return at if sending is not None else None

    def bulk_destination(self, now: int) -> int | None:
        """Return the receiver of the fragment that is due on the bulk service, or None."""
        sending, at = self._outgoing.next(now, bulk=True)
        return sending.outgoing.destination if sending is not None and at <= now else None

    def take_bulk(self, room_bytes: int, now: int) -> Taken | None:
        """Take the fragment of `bulk_destination`, if it fits.

        Args:
            room_bytes: Room for it in the frame, bytes.
            now: The instant.
        """
        sending, at = self._outgoing.next(now, bulk=True)
        if sending is None or at > now:
            return None
        if FRAGMENT_HEADER_BYTES + sending.outgoing.fragment_bytes > room_bytes:
            return None
        taken = self._outgoing.take_bulk(now)
        if taken is None:
            return None
        sending, fragment = taken
        outgoing = sending.outgoing
        assert isinstance(outgoing, BulkObject)
        reported = partial(self._bulk_reported, sending, outgoing, fragment.index)
        return Taken(
            stream_id=sending.stream_id,
            record=fragment.encode(),
            header_bytes=FRAGMENT_HEADER_BYTES,
            is_first=fragment.index == 0 and outgoing.transmitted == 1,
            is_repair=outgoing.is_repair(fragment.index),
            part=Part(reported=reported),
        )

    def hold(self, stream_id: int, until: int) -> None:
        """Hold the fragments of a stream until an instant, ns: its airtime is used up."""
        self._outgoing.held[stream_id] = until

    def override(self, stream_id: int, priority: Priority, *, on: bool) -> None:
        """Set the priority of a stream's objects, or stop them."""
        self._outgoing.override(stream_id, priority, on=on)

    def hold_until(self, now: int) -> int:
        """Return until when an answer is awaited that a frame would destroy, ns."""
        return self._outgoing.listens_until(now) if self._sendings else now

    @property
    def quiet_until(self) -> int:
        """Instant until which fragments come; a frame of this node would cost one, ns."""
        return self._replies.quiet_until

    # Inputs

    def fragment(
        self,
        source: int,
        fragment: Fragment,
        received: ReceivedFrame,
        now: int,
        age: Age = NO_AGE,
    ) -> str | None:
        """Take a fragment, and the age that was in it; return why it is dropped, or None."""
        if self._timing is None:
            return "link_down"
        return self._incoming.fragment(source, fragment, received, self._timing, now, age)

    def feedback(self, source: int, feedback: Feedback, now: int) -> str | None:
        """Take a feedback; return why it is dropped, or None."""
        return None if self._outgoing.answered(source, feedback, now) else "object_answer"

    # Getters

    def pending(self, stream_id: int) -> int:
        """Return how many outgoing objects of a stream are not yet delivered."""
        return self._outgoing.pending(stream_id)

    @property
    def incoming_bytes(self) -> int:
        """Bytes of all unfinished incoming objects."""
        return self._incoming.memory_bytes

    @property
    def is_idle(self) -> bool:
        """Whether there is nothing to send."""
        return not self._sendings

    @property
    def is_exclusive(self) -> bool:
        """Whether the object that is being sent has the channel to itself."""
        return self._outgoing.is_exclusive

    # Below the methods above

    def _fragment_reported(
        self, sending: Sending, asks: bool, report: TransmitReport, now: int
    ) -> None:
        assert self._timing is not None
        self._outgoing.transmitted(sending, report.finished_at, self._timing, asks=asks)

    def _bulk_reported(
        self, sending: Sending, outgoing: BulkObject, index: int, report: TransmitReport, now: int
    ) -> None:
        assert self._timing is not None
        self._outgoing.bulk_reported(sending, outgoing, index, report, self._timing, now)

    def _feedback_reported(self, place: TransferKey, report: TransmitReport, now: int) -> None:
        assert self._timing is not None
        self._incoming.transmitted(place, report.finished_at, self._timing)

    def _fragment_due_at(self, now: int) -> int | None:
        sending, at = self._outgoing.next(max(now, self._replies.quiet_until))
        return at if sending is not None else None

    def _sending(self, now: int) -> Sending | None:
        """Return the object with a due fragment."""
        if self._replies.quiet_until > now:
            return None
        sending, at = self._outgoing.next(now)
        return sending if at <= now else None
