"""Detects receivers that know more than their publisher: then the publisher has lost something.

A publisher may run on an old copy of its journal. The samples that it then sends stand in a lineage
that its receiver has seen end, or have numbers below the one that the receiver awaits, which this
publisher has not yet assigned. The receiver drops them as repetitions and says why in its ACK: SYNC
names a lineage or a number that the publisher does not know. An ACK may be late or forged, so the
publisher believes this only the second time, when the ACK answers a sample that was sent after the
first contradiction, and at least a settling time has passed. Each further time it takes twice as
long, so that nobody can make a publisher begin anew for ever.

Then the publisher acts. Nobody can tell any more whether the receiver has delivered the samples
from before the restart: they end as unknown. The receiver has not delivered the samples published
since: the publisher sends them in a lineage drawn for this receiver, which accepts them as new.
"""

import random
from collections.abc import Callable
from typing import Final

from zacoustic.core.peers.doubt import Doubt
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.reliable.sending.keeping import Keeping
from zacoustic.core.transport.reliable.sending.sendlane import SendLane, Stage
from zacoustic.core.transport.reliable.spans import LINEAGES, Span
from zacoustic.core.wire.frame import Sync

_LONGEST: Final = 12
_SUSPECTED: Final = 16
"""For how many settling times a first contradiction keeps old calls and goals from beginning."""


class Contradictions:
    """Contradictions between receivers and this publisher, and the response to them.

    Args:
        table: The streams.
        keeping: The lanes in the journal.
        doubt: Learns that something was forgotten.
        rng: Draws lineages.
        lose: Takes the lane and the address of a receiver that needs SYNC.
    """

    def __init__(
        self,
        table: StreamTable,
        keeping: Keeping,
        doubt: Doubt,
        rng: random.Random,
        lose: Callable[[SendLane, int], None],
    ) -> None:
        self._table = table
        self._keeping = keeping
        self._doubt = doubt
        self._rng = rng
        self._lose = lose
        self.settling_ns = 0
        """Time in which every repetition of a frame arrives, ns."""

    def heard(self, stream: Stream, lane: SendLane, source: int, sync: Sync, now: int) -> None:
        """Record an impossible acknowledgement from a receiver."""
        reception = lane.receptions[source]
        if reception.contradicted_at is None:
            reception.contradicted_at = now
            self._doubt.suspect(now + _SUSPECTED * self.settling_ns)
            self._lose(lane, source)  # repeat what it lacks, and so ask it a second time
            return
        lasts_ns = now - reception.contradicted_at
        was_asked = any(
            each.sent_at > reception.contradicted_at
            for each in lane.samples
            if source not in each.acknowledged
        )
        if not was_asked or lasts_ns < self.settling_ns << min(reception.anew, _LONGEST):
            return
        reception.contradicted_at = None
        reception.anew += 1
        is_former = self._forget_former(lane, source)
        if not is_former:
            self._begin_anew(lane, source)
        if lane.is_journalled:
            self._keeping.keep_count(stream, lane)
        self._doubt.told(
            f"node {source} has later samples of {stream.name} (lineage {sync.lineage:04x}, "
            f"{sync.floor}) than this node remembers: its journal is an old copy, or another "
            "node has its address",
            now,
        )
        self._lose(lane, source)

    def agrees(self, lane: SendLane, source: int, expected: int) -> None:
        """Record which number a receiver awaits.

        If the journal is in doubt, samples from before the restart that the receiver no longer
        awaits in its first report may have been delivered or given up; they become unknown.
        """
        reception = lane.receptions[source]
        reception.contradicted_at = None
        is_first, reception.is_told = not reception.is_told, True
        if not is_first or not self._doubt.reason:
            return
        for sample in lane.samples:
            if sample.number < min(expected, lane.born) and source not in sample.acknowledged:
                sample.unknown.add(source)

    def claimed(self, lane: SendLane) -> None:
        """Begin anew: a receiver that lacks nothing acknowledges what was never published.

        Somebody else has sent that sample, so the next one would be taken for a repetition of it.
        Nothing is under way to this receiver, so nothing gets lost or is sent twice, and a forged
        acknowledgement costs a SYNC: it is believed at once, and once for each sample.
        """
        if lane.anew_at != lane.next_number:
            lane.anew_at = lane.next_number
            self.begin_anew(lane)

    def begin_anew(self, lane: SendLane) -> None:
        """Begin another lineage with the next sample: a receiver takes the newest one for over.

        A refused object says so. The object has ended by that, so nothing is sent twice, and a
        forged refusal costs a SYNC: it is believed at once.
        """
        if lane.is_former:
            return  # the next sample begins one in any case
        lane.spans.begin(lane.next_number, self._unused(lane))
        lane.spans.forget_before(lane.floor)
        if lane.is_journalled:
            self._keeping.keep_count(self._table.by_id(lane.key[0]), lane)

    def _forget_former(self, lane: SendLane, source: int) -> bool:
        """End for a receiver the samples from before the restart; return whether any existed."""
        former = [
            sample
            for sample in lane.samples
            if sample.number < lane.born
            and source not in sample.acknowledged
            and sample.stage is not Stage.OBJECT  # its receiver refuses it
        ]
        for sample in former:
            lane.skip(sample, source)
            sample.unknown.add(source)
        return bool(former)

    def _begin_anew(self, lane: SendLane, source: int) -> None:
        """Give a receiver a lineage of its own for all that it lacks."""
        lane.spans.own[source] = Span(lane.floor_of(source), self._unused(lane))

    def _unused(self, lane: SendLane) -> int:
        """Draw a lineage that a lane has not used."""
        lineage = self._rng.randrange(LINEAGES)
        while lane.spans.knows(lineage):
            lineage = self._rng.randrange(LINEAGES)
        return lineage
