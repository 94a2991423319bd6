"""Records that are repeated to one node until an answer stops them.

Requests and answers of calls are such records: each is for one node, and some component stops it.
They wait in the transmit queue like all records; this module keeps the instant at which each is due
again. The node's pacer decides when a repetition may go to it (`zacoustic.core.schedule.pacers`).

A record may have a *reminder*, a short record that asks whether the node has it. After two
transmissions without an answer it is likelier that answers were lost than that both copies were. So
from then on the reminder is repeated; a node that lacks the record says so and gets it `again`.

A record may be the *proof* of what the node has taken for `UNPROVED_S` only. Repetitions to the
node may have become rare before it answered, so rare that the effect would end between two of them.
A proof is therefore repeated several times within that time, and at the usual pace after it.
"""

import enum
import random
from functools import partial
from typing import Final

from zacoustic.core.base.allowance import Allowance
from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import TransmitReport
from zacoustic.core.base.parts import Part
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.peers.peers import Peers
from zacoustic.core.schedule.copies import aimed_pause, follow
from zacoustic.core.schedule.pacers import Pacers
from zacoustic.core.schedule.queue import LaneKey, QueuedRecord, TransmitQueue

_WHOLE_TRIES: Final = 2
"""How often the whole record is sent before its reminder. After two tries at 30 % loss, a node that
has not answered has the record in two cases of three. After one try it has it in fewer than half:
then reminders cost what they save, and a lost record arrives a round trip later."""


UNPROVED_S: Final = 600.0
"""How long something holds whose sender has not shown that it has heard this life of the node."""
_UNPROVED_NS: Final = seconds_to_ns(UNPROVED_S)
_PROOFS: Final = 5
"""How often a proof goes within that time, at least. With half of the exchanges lost, one of 32
proofs is late."""


class _Stage(enum.Enum):
    QUEUED = "queued"
    ON_AIR = "on_air"
    SENT = "sent"
    OVER = "over"


class Repetition:
    """One record under way; `Repeater.start` makes it."""

    __slots__ = (
        "allowance",
        "due_at",
        "introduces",
        "is_clear",
        "key",
        "on_air",
        "paced_as",
        "proves_until",
        "qos",
        "record",
        "reminder",
        "sent_at",
        "stage",
        "tries",
        "until",
        "whole",
        "wholes_left",
    )

    def __init__(
        self,
        key: LaneKey,
        whole: QueuedRecord,
        qos: Qos,
        until: int | None,
        reminder: QueuedRecord | None = None,
        *,
        introduces: bool = False,
        proves: bool = False,
    ) -> None:
        self.key = key
        self.whole = whole
        self.reminder = reminder
        self.record = whole
        """The record or the reminder, whichever was or will be sent."""
        self.wholes_left = _WHOLE_TRIES
        self.qos = qos
        self.paced_as = Priority.INTERACTIVE_HIGH if introduces else qos.priority
        """A command goes at once, but its repetitions are paced like the others."""
        self.until = until
        self.introduces = introduces
        """Whether a node that has forgotten this one must be able to read its frame."""
        self.proves_until = whole.queued_at + _UNPROVED_NS if proves else 0
        """Instant until which the node holds unproved what this record proves, ns."""
        self.stage = _Stage.QUEUED
        self.allowance = Allowance()
        """How many frames may still go in vain for it."""
        self.is_clear = True
        """Whether an answer can only answer its last transmission: there was no other one, or it
        is too long ago."""
        self.tries = 0
        self.on_air = 0
        """How many transmissions of it have not ended, even if it has been stopped."""
        self.sent_at = 0
        """End of its last transmission, ns."""
        self.due_at = 0

    def longest_pause_ns(self, now: int) -> int | None:
        """Return how long to wait for an answer at most, ns; None: as the node's pacer says."""
        return _UNPROVED_NS // _PROOFS if now < self.proves_until else None

    def is_late(self, now: int) -> bool:
        """Return whether it has to go, whatever the node's pacer says."""
        return self.late_at is not None and self.late_at <= now

    @property
    def late_at(self) -> int | None:
        """When it has to go, whatever the node's pacer says, ns; None: never."""
        longest_ns = self.longest_pause_ns(self.sent_at)
        return None if longest_ns is None else self.sent_at + longest_ns

    def is_settled(self, now: int, settling_ns: int) -> bool:
        """Return whether each transmission of it has arrived, or never will.

        Args:
            now: The instant.
            settling_ns: Time in which a transmission and its duplicates arrive, ns.
        """
        return not self.on_air and (self.tries == 0 or self.sent_at + settling_ns <= now)


class Repeater:
    """Repeats the records of one engine.

    Args:
        queue: Takes the records.
        peers: The other nodes.
        pacers: Decide when to repeat to a node.
        timers: Repeat and end the records.
        rng: Draws the pauses.
    """

    def __init__(
        self,
        queue: TransmitQueue,
        peers: Peers,
        pacers: Pacers,
        timers: Timers,
        rng: random.Random,
    ) -> None:
        self._queue = queue
        self._timers = timers
        self._rng = rng
        self._pacers = pacers
        self._repetitions: dict[Repetition, None] = {}
        peers.forgotten.connect(lambda address, now: self._changed())
        pacers.on_repeat(self._repeat)
        pacers.changed.connect(self._changed)
        pacers.released.connect(self._released)

    def start(
        self,
        key: LaneKey,
        record: QueuedRecord,
        qos: Qos,
        *,
        until: int | None,
        introduces: bool = False,
        proves: bool = False,
        reminder: QueuedRecord | None = None,
    ) -> Repetition:
        """Send a record until it is stopped, or until an instant.

        Args:
            key: The lane in which it waits.
            record: The record.
            qos: The QoS of that lane.
            until: End, ns; None: none.
            introduces: A node that has forgotten this one must be able to read each frame with it.
            proves: It proves what the node has taken for a while.
            reminder: A short record that asks for an answer; None: none.
        """
        self._pacers[record.destination].begin(record.queued_at)
        repetition = Repetition(
            key, record, qos, until, reminder, introduces=introduces, proves=proves
        )
        part = Part(
            transmitted=partial(self._transmitted, repetition),
            reported=partial(self._reported, repetition),
        )
        for each in (record, reminder):
            if each is not None:
                each.part = part
        self._repetitions[repetition] = None
        self._push(repetition)
        return repetition

    def stop(
        self, repetition: Repetition, now: int, *, answered: bool = False, prompt: bool = True
    ) -> None:
        """End a repetition.

        Args:
            repetition: The repetition; one that has ended stays so.
            now: The instant.
            answered: The node has just shown that it has the record.
            prompt: The node answers at once; otherwise it may have worked on the request meanwhile.
        """
        peer = repetition.record.destination
        if answered:
            if repetition.is_clear and repetition.stage is _Stage.SENT:
                times = self._pacers.link_times
                round_trip_ns = now - repetition.sent_at
                if prompt or round_trip_ns < 2 * times.first_round_trip_ns:
                    self._pacers[peer].measured(round_trip_ns, times)
                if prompt:
                    linger_ns = seconds_to_ns(times.confirm_linger_s)
                    self._pacers.answers(peer, repetition.sent_at, linger_ns)
            self._pacers.answered(peer, now)
            self._pacers.await_nothing(peer)
        self._repetitions.pop(repetition, None)
        self._queue.discard(repetition.key, repetition.record)
        repetition.stage = _Stage.OVER
        self._changed()

    def again(self, repetition: Repetition) -> None:
        """Repeat a record at once: the node has shown that it lacks it."""
        repetition.wholes_left = max(1, repetition.wholes_left)
        reminds = repetition.stage is _Stage.QUEUED and repetition.record is repetition.reminder
        if reminds:
            self._queue.discard(repetition.key, repetition.record)
        if reminds or repetition.stage is _Stage.SENT:
            self._push_again(repetition)

    def resume(self, repetition: Repetition, now: int) -> None:
        """Resume a stopped repetition unless its end has passed."""
        if repetition.stage is _Stage.OVER and (repetition.until is None or now < repetition.until):
            self._repetitions[repetition] = None
            self._push_again(repetition)

    # Below the methods above

    def _released(self, address: int, now: int) -> None:
        """Make due what waits for a node."""
        for repetition in self._repetitions:
            if repetition.record.destination == address:
                repetition.allowance.back(now)
                repetition.due_at = 0
        self._changed()

    def _changed(self) -> None:
        self._timers.changed((Due.REPETITION,), self._due_at, self._go_on)

    def _go_on(self, now: int) -> None:
        """End expired repetitions, and repeat what is due."""
        self._changed()
        for repetition in list(self._repetitions):
            if repetition.until is not None and repetition.until <= now:
                self.stop(repetition, now)
        self._pacers.repeat(now)

    def _repeat(self, now: int) -> None:
        times = self._pacers.times
        if times is None:
            return
        for repetition in list(self._repetitions):
            pacer, priority = self._pacers[repetition.record.destination], repetition.paced_as
            if (
                repetition.stage is _Stage.SENT
                and repetition.due_at <= now
                and (repetition.is_late(now) or pacer.may_repeat(now, times, priority))
                and (
                    pacer.is_urgent(priority)
                    or pacer.takes(repetition.record.size_bytes, now, times)
                )
            ):
                pacer.unanswered(now, times)
                longest_ns = repetition.longest_pause_ns(now)
                pause_ns = pacer.pause_ns(times, 0, self._rng, priority, at_most_ns=longest_ns)
                pacer.await_answer(now, now + pause_ns)
                self._push_again(repetition)

    def _due_at(self) -> int | None:
        """Return the earliest instant at which a repetition is due or ends, ns, or None."""
        earliest: int | None = None
        for repetition in self._repetitions:
            at = repetition.until
            if repetition.stage is _Stage.SENT:
                ready_at = self._ready_at(repetition)
                at = ready_at if at is None else min(at, ready_at)
            if at is not None and (earliest is None or at < earliest):
                earliest = at
        return earliest

    def _transmitted(self, repetition: Repetition, now: int) -> None:
        """Record that a transmission begins."""
        self._changed()
        is_long_ago = now - repetition.sent_at >= self._pacers.link_times.longest_round_trip_ns
        repetition.is_clear = not repetition.tries or is_long_ago
        repetition.tries += 1
        repetition.wholes_left -= repetition.record is repetition.whole
        repetition.stage = _Stage.ON_AIR
        repetition.on_air += 1

    def _reported(self, repetition: Repetition, report: TransmitReport, now: int) -> None:
        """Record that a transmission has ended, and await an answer."""
        self._changed()
        at = report.finished_at
        repetition.on_air -= 1
        repetition.sent_at = at
        if repetition.stage is not _Stage.ON_AIR:
            return
        repetition.stage = _Stage.SENT
        priority, times = repetition.qos.priority, self._pacers.link_times
        pacer = self._pacers[repetition.record.destination]
        for allowance in (pacer.allowance, repetition.allowance):
            allowance.sent(at, times.frames_each, is_first=repetition.tries == 1)
        if follow(repetition.record, priority, repetition.tries, times, at, self._rng):
            self._push_again(repetition)
            return
        longest_ns = repetition.longest_pause_ns(at)
        pause_ns = pacer.pause_ns(times, 0, self._rng, repetition.paced_as, at_most_ns=longest_ns)
        if not pacer.is_doubtful(times):
            pause_ns = aimed_pause(pause_ns, priority, repetition.tries, times, at, self._rng)
        is_urgent = repetition.paced_as is Priority.REAL_TIME
        floor_ns = repetition.allowance.floor_ns(times.frames_each, is_urgent=is_urgent)
        due_ns = max(pause_ns, floor_ns)
        repetition.due_at = at + (due_ns if longest_ns is None else min(due_ns, longest_ns))
        pacer.await_answer(at, at + pause_ns, is_repeated=repetition.tries > 1)

    def _ready_at(self, repetition: Repetition) -> int:
        times = self._pacers.times
        if times is None:
            return repetition.due_at
        pacer = self._pacers[repetition.record.destination]
        ready_at = pacer.ready_at(times, repetition.paced_as)
        if repetition.late_at is not None:
            ready_at = min(ready_at, repetition.late_at)
        return max(repetition.due_at, ready_at)

    def _push_again(self, repetition: Repetition) -> None:
        if repetition.wholes_left <= 0 and repetition.reminder is not None:
            repetition.record = repetition.reminder
        else:
            repetition.record = repetition.whole
        repetition.record.cause = Cause.REPEAT
        self._push(repetition)

    def _push(self, repetition: Repetition) -> None:
        self._changed()
        largest_bytes = self._queue.largest_bytes
        if largest_bytes is not None and repetition.record.size_bytes > largest_bytes:
            # It was made for a link with larger frames.
            self._repetitions.pop(repetition, None)
            repetition.stage = _Stage.OVER
            return
        repetition.stage = _Stage.QUEUED
        record = repetition.record
        self._pacers.introduce(record.destination, record.stream_id, anyway=repetition.introduces)
        self._queue.push(repetition.key, repetition.record, repetition.qos)
