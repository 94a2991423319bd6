"""When to repeat a sample: how long receivers get to answer, and which of them to wait for.

Repetitions to a node that does not answer become rare. For a topic with a deadline they do not
become rarer than the deadline: one ends within each deadline, unless even a few answers take
longer, or the node was silent for so long that nothing meets a deadline any more. So such a sample
does not wait through a pause that other streams have agreed for the node.
"""

import random
from typing import Final

from zacoustic.core.base.linktypes import TransmitOutcome, TransmitReport
from zacoustic.core.base.qos import Priority
from zacoustic.core.base.stats import EngineStats
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.schedule.copies import (
    aimed_pause,
    follow,
    is_doubled,
    is_emergency,
    row_frames,
    spread,
)
from zacoustic.core.schedule.pacers import Pacers
from zacoustic.core.schedule.timing import FEW_RECEIVERS, LinkTimes, Pacer, ack_slots
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.reliable.sending.sendlane import (
    AT_ONCE,
    OutgoingSample,
    SendLane,
    Stage,
)

_COPIED_AT_ONCE: Final = 2
"""With more samples than this, copies would fill the channel and no answer could be heard."""
_ROUND_TRIPS_OF_ASKING: Final = 2
"""How many round trips a publisher waits for a receiver that asks for overdue samples."""

_SURE_HOLES: Final = 2
"""An emergency goes into so many holes at once, and into each further one by chance."""
_HOLE_CHANCE: Final = 0.5
_MOST_HOLES: Final = 6
"""Then it has its own pauses only: its receiver may be away, and a run of trains last for long."""


class Pacing:
    """Decides when the reliable samples of this node are repeated.

    Args:
        table: The streams.
        pacers: How long other nodes take to answer.
        rng: Draws the pauses between repetitions.
        stats: Gets the round-trip times.
        handshake: Gets the round-trip times where the device decides when it transmits.
    """

    def __init__(
        self,
        table: StreamTable,
        pacers: Pacers,
        rng: random.Random,
        stats: EngineStats,
        handshake: Handshake,
    ) -> None:
        self._table = table
        self._rng = rng
        self._stats = stats
        self._handshake = handshake
        self._pacers = pacers

    @property
    def times(self) -> LinkTimes | None:
        """The airtimes of the link; None before it was up."""
        return self._pacers.times

    def timing(self, address: int) -> Pacer:
        """Return the pacer of one node."""
        return self._pacers[address]

    def forget(self, address: int) -> None:
        """Remove a node's round-trip time from the statistics; its pacer goes with the node."""
        self._stats.round_trips_ns.pop(address, None)

    def first_acknowledged(
        self, lane: SendLane, sample: OutgoingSample, source: int, now: int, *,
        is_last: bool, had_gap: bool,
    ) -> int:  # fmt: skip
        """Learn from an ACK; return the order of the transmission that it presumably answers.

        Args:
            lane: The key.
            sample: Of the samples that the ACK acknowledges for the first time, the one sent last.
            source: The receiver that acknowledges.
            now: The instant.
            is_last: Nothing at all was sent later.
            had_gap: The receiver was known to hold a sample behind one that it lacked.
        """
        times, timing, round_trip_ns = self.times, self.timing(source), now - sample.sent_at
        if times is None or sample.stage is not Stage.SENT or sample.marked:
            return sample.order
        if sample.is_clear and (is_last or times.is_delegated):
            # An ACK this late came because no further sample did; the first answer was lost.
            is_answer = not lane.rhythm_is_known(sample) or 2 * round_trip_ns < _period_ns(lane)
            if is_answer:
                self._measured(source, round_trip_ns, times)
                if len(lane.receptions) == 1:  # of several, each waits for those before it
                    self._pacers.answers(source, sample.sent_at, times.ack_linger_ns)
        if not times.is_delegated:
            return sample.order
        order = sample.order
        is_too_soon = round_trip_ns < timing.least_ns(times)
        if not sample.is_clear and (is_too_soon or not had_gap):
            # It may answer an earlier transmission, and later samples may be on their way, too.
            order = sample.first_order
        for other in lane.active():
            # Frames wait in the device: start the time-out of whatever was sent later only now.
            if other.stage is Stage.SENT and other.order > order and source in lane.lacking(other):
                other.due_at = max(other.due_at, now + self.pause_ns(lane, other))
        return order

    def begins(self, lane: SendLane, sample: OutgoingSample, now: int) -> None:
        """Record that a transmission of a sample begins."""
        lane.begins(sample, now, self._pacers.link_times)

    def asked(self, lane: SendLane, source: int, now: int) -> None:
        """Repeat the samples that an ACK asks for, where the receiver knows the rhythm."""
        shortest_ns = self.timing(source).shortest_ns
        if self.times is None or shortest_ns is None:
            return
        # Nobody can answer sooner: an earlier ACK was sent before the sample came.
        least_ns = shortest_ns - self.times.ack_linger_ns
        for sample in lane.active():
            is_lacking = lane.awaits(sample) and now - sample.sent_at >= least_ns
            if is_lacking and lane.rhythm_is_known(sample):
                sample.asked, sample.due_at = True, AT_ONCE

    def hole_begins(self, lane: SendLane, now: int) -> None:
        """Make due the emergencies without an answer: the ends of a bulk service hear for a moment.

        By their own pauses they would meet one train after the other. They go twice, since the
        next hole is seconds away; the first may also destroy the acknowledgement of the train, and
        then the second is heard.
        """
        if self.times is None or self._priority(lane) is not Priority.REAL_TIME:
            return
        for sample in lane.active():
            if not lane.awaits(sample) or sample.holes >= _MOST_HOLES:
                continue
            # Others may have an emergency, too, and would meet it in each hole.
            goes = sample.holes < _SURE_HOLES or self._rng.random() < _HOLE_CHANCE
            if goes and now - sample.sent_at >= self.times.first_round_trip_ns:
                sample.follows = sample.in_hole = True
                sample.holes += 1
                sample.due_at = AT_ONCE

    def ready_at(self, lane: SendLane, sample: OutgoingSample) -> int:
        """Return when to repeat a sample, ns; answers to later transmissions are awaited first."""
        if sample.follows or sample.asked:
            return sample.due_at
        if self.times is None:
            return self._before_end(sample, sample.due_at)
        # Of several receivers, wait for the first: one out of range must not hold back the others.
        priority, at_most_ns = self._priority(lane), self._at_most_ns(lane, sample)
        quiet = (
            self.timing(each).ready_at(self.times, priority, in_haste=at_most_ns is not None)
            for each in lane.lacking(sample)
        )
        at = max(self._in_time(lane, sample, at_most_ns), min(quiet, default=0))
        return self._before_end(sample, at)

    def due_at(self, lane: SendLane, sample: OutgoingSample) -> int:
        """Return when a sample is due, without regard to answers to later transmissions, ns."""
        return self._before_end(sample, self._in_time(lane, sample, self._at_most_ns(lane, sample)))

    def may_repeat(self, lane: SendLane, sample: OutgoingSample, now: int) -> bool:
        """Return whether a sample may open or join a turn of repetitions now."""
        if self.ready_at(lane, sample) <= now:
            return True
        return (
            self.times is not None
            and self.due_at(lane, sample) <= now
            and any(
                self.timing(each).may_repeat(now, self.times, self._priority(lane))
                for each in lane.lacking(sample)
            )
        )

    def takes(self, lane: SendLane, sample: OutgoingSample, now: int) -> bool:
        """Take a sample into the present turn of the receivers that lack it; False: no room."""
        times, priority = self.times, self._priority(lane)
        lacking = [self.timing(each) for each in lane.lacking(sample)]
        is_urgent = any(each.is_urgent(priority) for each in lacking)
        # A row of emergencies is none: without a pause, several such senders would deafen all.
        is_emergency = is_urgent and len(lane.samples) <= _COPIED_AT_ONCE
        is_free = sample.follows or sample.asked or is_emergency
        if times is None or is_free or self._at_most_ns(lane, sample) is not None:
            return True
        if self._before_end(sample, now + 1) <= now:
            return True  # a later turn would be too late
        size_bytes = sample.waiting.size_bytes
        turns = [each for each in lacking if each.may_repeat(now, times, priority)]
        taken = [each.takes(size_bytes, now, times) for each in turns]
        return any(taken) or not lacking

    def repeats(self, lane: SendLane, sample: OutgoingSample, now: int) -> None:
        """Record that a sample is repeated because its receivers have not answered."""
        if self.times is None or sample.asked:
            return
        if not sample.follows:
            for address in lane.addressed(sample):
                self.timing(address).unanswered(now, self.times)
        self._await_answer(lane, sample, now, now + self.pause_ns(lane, sample))

    def is_doubtful(self, lane: SendLane, sample: OutgoingSample) -> bool:
        """Return whether each receiver that lacks a sample has failed to answer repeatedly."""
        times = self._pacers.link_times
        return all(self.timing(each).is_doubtful(times) for each in lane.lacking(sample))

    def repeat_at(self, lane: SendLane, sample: OutgoingSample, report: TransmitReport) -> int:
        """Return when a sample that was just sent is due again, ns."""
        times = self._pacers.link_times
        was_copy, sample.follows = sample.follows, False
        priority, is_first = self._priority(lane), sample.tries == 1
        for address in lane.addressed(sample):
            for allowance in (self.timing(address).allowance, lane.receptions[address].allowance):
                if is_first and priority is Priority.REAL_TIME:
                    allowance.grant(hasty=True)
                allowance.sent(report.finished_at, times.frames_each, is_first=is_first)
        was_sent = report.outcome in (TransmitOutcome.SENT, TransmitOutcome.DELIVERED)
        if was_sent and lane.rhythm_is_known(sample):
            # If the sample was lost, the receiver asks for it; if it was the last, for the next
            # one.
            round_trips_ns = _ROUND_TRIPS_OF_ASKING * times.first_round_trip_ns
            return lane.put_off(report.finished_at + _period_ns(lane) + round_trips_ns)
        if sample.in_hole:
            sample.in_hole, sample.follows = False, True
            return AT_ONCE
        if len(lane.samples) <= _COPIED_AT_ONCE and report.outcome is not TransmitOutcome.REJECTED:
            at = report.finished_at
            sample.follows = follow(sample.waiting, priority, sample.tries, times, at, self._rng)
            sample.follows |= is_emergency(priority, sample.tries)
            if not was_copy and not self.is_doubtful(lane, sample):
                sample.follows |= is_doubled(priority, sample.tries)
            if sample.follows:
                return AT_ONCE
        pause_ns = spread(self.pause_ns(lane, sample), priority, times, self._rng)
        if not self.is_doubtful(lane, sample):
            pause_ns = aimed_pause(
                pause_ns, priority, sample.tries, times, report.finished_at, self._rng
            )
        if report.outcome is TransmitOutcome.NOT_DELIVERED:
            pause_ns //= 2
        due_at = report.finished_at + pause_ns
        is_repeated = sample.tries > 1
        self._await_answer(lane, sample, report.finished_at, due_at, is_repeated=is_repeated)
        return max(due_at, report.finished_at + self._floor_ns(lane, sample))

    def pause_ns(self, lane: SendLane, sample: OutgoingSample) -> int:
        """Draw how long the receivers that lack a sample get to answer, ns."""
        times, lacking = self._pacers.link_times, lane.addressed(sample)
        rank, spread_ns = _order_of_answers(lane, sample, lacking, times)
        priority, at_most_ns = self._priority(lane), self._at_most_ns(lane, sample)
        pauses_ns = (
            self.timing(each).pause_ns(
                times,
                rank,
                self._rng,
                priority,
                frames=row_frames(priority),
                spread_ns=spread_ns,
                at_most_ns=at_most_ns,
            )
            for each in lacking
        )
        pause_ns = min(pauses_ns, default=times.first_round_trip_ns)
        if rank > FEW_RECEIVERS and priority is not Priority.REAL_TIME and at_most_ns is None:
            # With many receivers, let each have its turn before asking anybody again.
            pause_ns = max(pause_ns, times.first_round_trip_ns + rank * times.ack_slot_ns)
        return pause_ns

    def _floor_ns(self, lane: SendLane, sample: OutgoingSample) -> int:
        """Return the shortest pause for a key that no receiver acknowledges, ns."""
        frames = self._pacers.link_times.frames_each
        is_urgent = self._priority(lane) is Priority.REAL_TIME
        allowances = (lane.receptions[each].allowance for each in lane.addressed(sample))
        floors_ns = (each.floor_ns(frames, is_urgent=is_urgent) for each in allowances)
        return min(floors_ns, default=0)

    def _at_most_ns(self, lane: SendLane, sample: OutgoingSample) -> int | None:
        """Return the longest pause with which a repetition meets the deadline, ns; None: none.

        The random part and the airtime of a frame come on top of the pause. After a long silence of
        all receivers that lack the sample there is none.
        """
        times, deadline_ns = self.times, self._table.by_id(lane.key[0]).qos.deadline_ns
        if deadline_ns is None or times is None:
            return None
        lacking = (self.timing(each) for each in lane.lacking(sample))
        if not any(each.allowance.keeps_deadlines for each in lacking):
            return None
        return max(1, deadline_ns - times.doubt_ns - times.airtime_ns(times.mtu_bytes))

    def _in_time(self, lane: SendLane, sample: OutgoingSample, at_most_ns: int | None) -> int:
        """Return when a sample is due, limited by the longest pause, ns, if there is one."""
        if at_most_ns is None or self.times is None:
            return sample.due_at
        lacking = lane.lacking(sample)
        rank, spread_ns = _order_of_answers(lane, sample, lacking, self.times)
        priority = self._priority(lane)
        pauses_ns = (
            self.timing(each).least_pause_ns(self.times, rank, priority) for each in lacking
        )
        least_ns = min(pauses_ns, default=self.times.first_round_trip_ns) + spread_ns
        drawn_ns = row_frames(priority) * self.times.longest_ns
        longest_ns = max(least_ns + drawn_ns, at_most_ns)
        return min(sample.due_at, sample.sent_at + longest_ns)

    def _measured(self, source: int, round_trip_ns: int, times: LinkTimes) -> None:
        timing = self.timing(source)
        timing.measured(round_trip_ns, times)
        self._stats.round_trips_ns[source] = timing.smooth_ns
        if times.is_delegated:
            self._handshake.answers_within(source, timing.round_trip_ns(times))

    def _before_end(self, sample: OutgoingSample, at: int) -> int:
        """Return `at`, ns, but early enough that an answer can come before the sample expires.

        However rare repetitions have become, a sample gets this last one; not before the previous
        one can have been answered.
        """
        if sample.expires_at is None or self.times is None:
            return at
        round_trip_ns = self.times.first_round_trip_ns
        last_at = max(sample.sent_at, sample.expires_at - 2 * round_trip_ns) + round_trip_ns
        return min(at, last_at) if last_at < sample.expires_at else at

    def _await_answer(
        self,
        lane: SendLane,
        sample: OutgoingSample,
        since: int,
        until: int,
        *,
        is_repeated: bool = True,
    ) -> None:
        for address in lane.addressed(sample):
            self.timing(address).await_answer(since, until, is_repeated=is_repeated)

    def _priority(self, lane: SendLane) -> Priority:
        return self._table.by_id(lane.key[0]).qos.priority


def _order_of_answers(
    lane: SendLane, sample: OutgoingSample, lacking: list[int], times: LinkTimes
) -> tuple[int, int]:
    """Return how many receivers answer before the last one, and the range of random answers, ns."""
    if sample.aimed_at is not None:
        return 0, times.ack_spread_ns(1)
    if sample.tries > 1 or sample.waiting.sync:
        return 0, times.ack_spread_ns(len(lane.receptions))
    last = len(lane.receptions) - 1 if len(lacking) > 1 else 0
    return ack_slots(last, len(lane.receptions)), 0


def _period_ns(lane: SendLane) -> int:
    return lane.rhythm.period_ns if lane.rhythm else 0
