"""Samples that come in a rhythm: who knows it asks for what is missing, and answers little else.

The problem: silence behind a sample means that it was lost, or that its ACK was. A publisher that
repeats after each silence sends every third sample for nothing, where three frames in ten are lost.

The idea: a receiver that knows when the next sample is due says so when it does not come. Then the
publisher repeats what is asked for and nothing else, and an ACK for each sample is not needed:
what is asked for tells of all before it. The publisher knows its own rhythm best, so it marks its
samples: *in rhythm* says that this one was sent as long after the one before as that one after
its own. The receiver learns the rhythm from two such samples, and is taken to know it when it has
acknowledged both. Whatever else the publisher sends of its own accord, off the beat or again,
is not marked, and ends the rhythm for both: so they always agree, or will with the next samples.
A sample on the beat that is not marked wants an answer, and goes on with the rhythm.

`Beat` is the instants, for both; `SendRhythm` the publisher's view of one key and its receiver.
"""

from typing import Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.qos import Qos
from zacoustic.core.schedule.timing import LinkTimes

_SMOOTHING: Final = 4
_LEAST_ROUND_TRIPS: Final = 2
"""Of a faster stream the next sample itself shows soon enough what is missing."""
_MOST_ROUND_TRIPS: Final = 32
"""The publisher of a slower one would wait too long to be told of its delivery."""
_LEARNED_FROM: Final = 2
_MOST_UNANSWERED: Final = 3
_RESERVE: Final = 4
"""Unanswered are at most so small a part of the samples that the stream keeps."""


class Beat:
    """Instants of numbered samples, and from them when further ones are due."""

    __slots__ = ("_at", "_number", "period_ns")

    def __init__(self) -> None:
        self.period_ns: int | None = None
        """From one number to the next, ns; None before two samples."""
        self._number: int | None = None
        self._at = 0

    def due_at(self, number: int) -> int | None:
        """Return when a number is due, ns; None: not known."""
        if self.period_ns is None or self._number is None:
            return None
        return self._at + (number - self._number) * self.period_ns

    def begin(self, number: int, at: int) -> None:
        """Forget all samples but this one."""
        self.period_ns, self._number, self._at = None, number, at

    def goes_on(self, number: int, at: int) -> None:
        """Take a sample that came when it was due, or the second of all."""
        if self._number is None or number <= self._number:
            self.begin(number, at)
            return
        observed_ns = (at - self._at) // (number - self._number)
        if self.period_ns is None:
            self.period_ns = observed_ns
        self.period_ns += (observed_ns - self.period_ns) // _SMOOTHING
        self._number, self._at = number, at

    def changes(self, number: int, at: int) -> None:
        """Take a sample that came at another time: the rhythm may be another one from here."""
        self.period_ns = None
        self.goes_on(number, at)


class SendRhythm:
    """The rhythm of a publisher's samples of one key, which has one receiver.

    Args:
        qos: Of the stream.
    """

    def __init__(self, qos: Qos) -> None:
        self._depth = qos.depth
        lifespan_ns = None if qos.lifespan_s is None else seconds_to_ns(qos.lifespan_s)
        bounds_ns = [each for each in (lifespan_ns, qos.deadline_ns) if each is not None]
        self._patience_ns = min(bounds_ns, default=None)
        self._beat = Beat()
        self._next_number = 0
        self._window = (1, 0)
        self._unanswered = 0
        self._since: int | None = None

    @property
    def period_ns(self) -> int:
        """From one sample to the next, ns, where the receiver knows it."""
        return self._beat.period_ns or 0

    def is_known(self, number: int, expected: int) -> bool:
        """Tell whether the receiver would ask for a number.

        Args:
            number: The newest that was sent.
            expected: The one that the receiver waits for, as far as it has told.
        """
        if self._since is None or expected < self._since + _LEARNED_FROM:
            return False
        # It asks, and is asked, again and again: so much silence is that of somebody who is gone.
        return number - expected <= 2 * self._unanswered

    def marks(self, number: int, expected: int, now: int) -> bool:
        """Tell whether a sample that is sent for the first time is marked as in rhythm."""
        return self._is_on_beat(number, now) and number - expected <= self._unanswered

    def first_sent(self, number: int, expected: int, now: int, times: LinkTimes) -> None:
        """A sample begins to be sent for the first time."""
        is_on_beat = self._is_on_beat(number, now)
        if self.marks(number, expected, now):
            self._since = number if self._since is None else self._since
        elif not (is_on_beat and self.is_known(number, expected)):
            self._since = None
        if is_on_beat:
            self._beat.goes_on(number, now)
        else:
            self._beat.changes(number, now)
        self._look_ahead(number + 1, times)

    def end(self) -> None:
        """A sample is sent that the receiver takes for the end of the rhythm."""
        self._since = None

    def _is_on_beat(self, number: int, now: int) -> bool:
        return number == self._next_number and self._window[0] <= now <= self._window[1]

    def _look_ahead(self, number: int, times: LinkTimes) -> None:
        self._next_number, self._window, self._unanswered = number, (1, 0), 0
        due_at, period_ns = self._beat.due_at(number), self._beat.period_ns
        if due_at is None or period_ns is None or times.is_delegated:
            return
        if not _LEAST_ROUND_TRIPS <= period_ns / times.first_round_trip_ns <= _MOST_ROUND_TRIPS:
            return
        kept = self._depth
        if self._patience_ns is not None:
            kept = min(kept, self._patience_ns // period_ns)
        self._unanswered = min(_MOST_UNANSWERED, kept // _RESERVE)
        if self._unanswered:
            # Half of what the receiver allows for.
            tolerance_ns = times.doubt_ns // 2
            self._window = (due_at - tolerance_ns, due_at + tolerance_ns)
