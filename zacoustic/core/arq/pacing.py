"""When a sample goes again: how long its receivers are given to answer, and who is waited for."""

import random
from typing import Final

from zacoustic.core.arq.sendlane import AT_ONCE, Outgoing, SendLane
from zacoustic.core.arq.timing import LinkTimes, PeerTiming
from zacoustic.core.linktypes import TransmitOutcome, TransmitReport
from zacoustic.core.qos import Priority
from zacoustic.core.streams import StreamTable

_URGENT_COPIES: Final = 4
"""A REAL_TIME sample is sent so often before an answer is awaited: at 40 % loss one of four arrives
in 97 of 100 cases, and a round trip lasts longer than four short frames."""
_URGENT_AT_ONCE: Final = 2
_CROWD_ROUND_TRIPS: Final = 20
"""Whoever was heard within so many round trips may be speaking."""


class Pacing:
    """What this node knows of how long others take to answer.

    Args:
        table: The streams.
        rng: Draws the pauses between repetitions.
    """

    def __init__(self, table: StreamTable, rng: random.Random) -> None:
        self.times: LinkTimes | None = None
        """The airtimes of the link; None before it was up."""
        self._table = table
        self._rng = rng
        self._timings: dict[int, PeerTiming] = {}
        self._heard_at: dict[int, int] = {}

    def timing(self, address: int) -> PeerTiming:
        """Return what is known of one node."""
        timing = self._timings.get(address)
        if timing is None:
            timing = self._timings[address] = PeerTiming()
        return timing

    def heard(self, source: int, now: int) -> bool:
        """Anything was heard of a node; True when repetitions to it had become rare."""
        self._heard_at[source] = now
        timing = self._timings.get(source)
        if timing is None or not timing.heard():
            return False
        timing.quiet_until = 0
        return True

    def answered(self, source: int, now: int) -> None:
        """A node has told that it has something of what it lacked."""
        # Where two speak, silence is loss. Where more do, it may be that all speak at once: then
        # one answer does not mean that the channel is free.
        lately = now - _CROWD_ROUND_TRIPS * self.times.first_round_trip_ns if self.times else now
        others = any(at > lately for each, at in self._heard_at.items() if each != source)
        self.timing(source).answered(in_crowd=others)

    def ready_at(self, lane: SendLane, sample: Outgoing) -> int:
        """Return when a sample may be repeated: an answer to what was sent later is waited for."""
        if self._copies_wait(lane, sample):
            return sample.due_at
        # Of several receivers the first: one that is out of range does not hold back the others.
        quiet = (self.timing(address).quiet_until for address in lane.lacking(sample))
        return max(sample.due_at, min(quiet, default=0))

    def repeats(self, lane: SendLane, sample: Outgoing, now: int) -> None:
        """A sample is repeated: its receivers have not answered."""
        if self.times is None:
            return
        if not self._copies_wait(lane, sample):
            for address in lane.lacking(sample):
                self.timing(address).unanswered(now, self.times)
        self._await_answer(lane, sample, now + self.pause_ns(lane, sample))

    def is_doubtful(self, lane: SendLane, sample: Outgoing) -> bool:
        """Tell whether all receivers that lack a sample have not answered again and again."""
        return all(self.timing(address).is_doubtful for address in lane.lacking(sample))

    def repeat_at(self, lane: SendLane, sample: Outgoing, report: TransmitReport) -> int:
        """Return when a sample that was just sent is due again."""
        if self._copies_wait(lane, sample) and report.outcome is not TransmitOutcome.REJECTED:
            return AT_ONCE
        pause_ns = self.pause_ns(lane, sample)
        if report.outcome is TransmitOutcome.NOT_DELIVERED:
            pause_ns //= 2
        due_at = report.finished_at + pause_ns
        self._await_answer(lane, sample, due_at)
        return due_at

    def pause_ns(self, lane: SendLane, sample: Outgoing) -> int:
        """Draw how long the receivers that lack a sample are given, ns."""
        assert self.times is not None
        times, lacking, rank, spread_ns = self.times, lane.lacking(sample), 0, 0
        if sample.tries > 1 or sample.waiting.sync:
            spread_ns = times.ack_spread_ns(len(lane.receptions))
        elif len(lacking) > 1:
            rank = len(lane.receptions) - 1
        pauses_ns = (
            self.timing(each).pause_ns(times, rank, self._rng, spread_ns=spread_ns)
            for each in lacking
        )
        return min(pauses_ns, default=times.first_round_trip_ns)

    def _await_answer(self, lane: SendLane, sample: Outgoing, until: int) -> None:
        for address in lane.lacking(sample):
            timing = self.timing(address)
            timing.quiet_until = max(timing.quiet_until, until)

    def _copies_wait(self, lane: SendLane, sample: Outgoing) -> bool:
        """Tell whether it is sent again without waiting for an answer."""
        urgent = self._table.by_id(lane.key[0]).qos.priority is Priority.REAL_TIME
        # A stream of them would fill the channel with copies, and no answer could be heard.
        return urgent and sample.tries < _URGENT_COPIES and len(lane.samples) <= _URGENT_AT_ONCE
