"""A receiver that knows more than its publisher: then the publisher has forgotten something.

A publisher may live on an old copy of its journal. What it sends again then stands in a lineage
that its receiver has seen end, or below a number that it awaits beyond all that was ever given
away here: it is dropped there as a repetition, and the ACK tells why, by SYNC with a lineage or a
number that the publisher does not know. It is told so twice, the second time for a sample that was
sent after the first and a settling time later, before it is believed: an ACK may be a late one, or
forged. And each further time it takes twice as long: nobody makes a publisher begin anew for ever.

What it does then. Of samples out of former lives nobody can tell any more whether the receiver has
handed them on: they end as unknown. Those of this life it has not: they go in a lineage drawn for
this receiver, which takes them for what they are.
"""

import random
from collections.abc import Callable
from typing import Final

from zacoustic.core.peers.doubt import Doubt
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.reliable.sending.keeping import Keeping
from zacoustic.core.transport.reliable.sending.sendlane import SendLane, Stage
from zacoustic.core.transport.reliable.spans import Span
from zacoustic.core.wire.frame import Sync

_LINEAGES: Final = 1 << 16
_LONGEST: Final = 12
_SUSPECTED: Final = 16
"""For so many settling times a first contradiction keeps old calls and goals from being begun."""


class Contradictions:
    """What receivers say that cannot be, and what follows.

    Args:
        keeping: The lanes in the journal.
        doubt: Is told that something was forgotten.
        rng: Draws lineages.
        lose: Takes the lane and the address of a receiver that needs SYNC.
    """

    def __init__(
        self,
        keeping: Keeping,
        doubt: Doubt,
        rng: random.Random,
        lose: Callable[[SendLane, int], None],
    ) -> None:
        self._keeping = keeping
        self._doubt = doubt
        self._rng = rng
        self._lose = lose
        self.settling_ns = 0
        """Within what time a repetition of a frame arrives, ns."""

    def heard(self, stream: Stream, lane: SendLane, source: int, sync: Sync, now: int) -> None:
        """A receiver has acknowledged what cannot be."""
        reception = lane.receptions[source]
        if reception.contradicted_at is None:
            reception.contradicted_at = now
            self._doubt.suspect(now + _SUSPECTED * self.settling_ns)
            self._lose(lane, source)  # what it lacks is sent again: it is asked a second time
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
            f"{sync.floor}) than this node remembers: its journal is an old copy",
            now,
        )
        self._lose(lane, source)

    def agrees(self, lane: SendLane, source: int, expected: int) -> None:
        """A receiver tells what it awaits.

        Where the journal is in doubt, what former lives have left and is not awaited when that is
        told for the first time may have been handed on, or given up.
        """
        reception = lane.receptions[source]
        reception.contradicted_at = None
        is_first, reception.is_told = not reception.is_told, True
        if not is_first or not self._doubt.reason:
            return
        for sample in lane.samples:
            if sample.number < min(expected, lane.born) and source not in sample.acknowledged:
                sample.unknown.add(source)

    def _forget_former(self, lane: SendLane, source: int) -> bool:
        """End for a receiver what former lives have left; returns whether there was any."""
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
        lineage = self._rng.randrange(_LINEAGES)
        while lane.spans.knows(lineage):
            lineage = self._rng.randrange(_LINEAGES)
        lane.spans.own[source] = Span(lane.floor_of(source), lineage)
