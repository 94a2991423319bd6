"""Periodic samples: a receiver that knows the period asks for what is missing, and ACKs little.

The problem: silence after a sample means that the sample was lost or that its ACK was. At a loss of
three frames in ten, a publisher that repeats after each silence sends every third sample in vain.

The idea: a receiver that knows when the next sample is due reports when it does not come. Then the
publisher repeats only what the receiver asks for and needs no ACK for each sample, since a request
also acknowledges everything before it. The publisher knows its own rhythm best, so it marks its
samples: *in rhythm* means that the interval between this sample and the one before equals the
interval before that. The receiver learns the rhythm from two such samples, and the publisher
assumes that the receiver knows it once it has acknowledged both. The publisher does not mark a
sample that it sends off the beat or repeats unasked; such a sample ends the rhythm for both ends.
So both always agree, or will after the next samples. An unmarked sample on the beat asks for an ACK
and continues the rhythm.

`Beat` holds the instants, for both ends; `SendRhythm` is the publisher's view of one key and its
receiver.

Measured at 1,500 m with samples of 12 bytes every 10 to 60 s: 27 % less airtime at a loss of up to
one frame in ten, 10 to 17 % at three in ten, nothing at five in ten.
"""

from typing import Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.qos import Qos
from zacoustic.core.schedule.timing import LinkTimes

_SMOOTHING: Final = 4
_LEAST_ROUND_TRIPS: Final = 2
"""In a faster stream the next sample itself shows soon enough what is missing."""
_MOST_ROUND_TRIPS: Final = 32
"""In a slower stream the publisher would learn too late that a sample was delivered."""
_LEARNED_FROM: Final = 2
_MOST_UNANSWERED: Final = 3
_RESERVE: Final = 4
"""The unanswered samples are at most this fraction, 1/4, of those that the stream keeps."""


class Beat:
    """Instants of numbered samples, and the instants at which further ones are due."""

    __slots__ = ("_at", "_number", "period_ns")

    def __init__(self) -> None:
        self.period_ns: int | None = None
        """Interval from one number to the next, ns; None before two samples."""
        self._number: int | None = None
        self._at = 0

    def due_at(self, number: int) -> int | None:
        """Return the instant at which a number is due, ns; None: unknown."""
        if self.period_ns is None or self._number is None:
            return None
        return self._at + (number - self._number) * self.period_ns

    def begin(self, number: int, at: int) -> None:
        """Forget all samples except this one."""
        self.period_ns, self._number, self._at = None, number, at

    def goes_on(self, number: int, at: int) -> None:
        """Take a sample that came when it was due, or the second sample of all."""
        if self._number is None or number <= self._number:
            self.begin(number, at)
            return
        observed_ns = (at - self._at) // (number - self._number)
        if self.period_ns is None:
            self.period_ns = observed_ns
        self.period_ns += (observed_ns - self.period_ns) // _SMOOTHING
        self._number, self._at = number, at

    def changes(self, number: int, at: int) -> None:
        """Take a sample that came at another time, and restart the estimate of the period."""
        self.period_ns = None
        self.goes_on(number, at)


class SendRhythm:
    """The rhythm of a publisher's samples of one key, which has one receiver.

    Args:
        qos: The stream's QoS.
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
        """Interval between samples, ns; 0: unknown."""
        return self._beat.period_ns or 0

    def is_known(self, number: int, expected: int) -> bool:
        """Return whether the receiver would ask for a number.

        Args:
            number: The newest number that was sent.
            expected: The number that the receiver awaits, by its last ACK.
        """
        if self._since is None or expected < self._since + _LEARNED_FROM:
            return False
        # Requests repeat: a receiver that has acknowledged nothing for so long has gone.
        return number - expected <= 2 * self._unanswered

    def marks(self, number: int, expected: int, now: int) -> bool:
        """Return whether a sample is marked as in rhythm when it is first sent."""
        return self._is_on_beat(number, now) and number - expected <= self._unanswered

    def first_sent(self, number: int, expected: int, now: int, times: LinkTimes) -> None:
        """Record that a sample is sent for the first time."""
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
        """End the rhythm: the receiver takes the sample that is sent now for its end."""
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
            # Half of the receiver's own tolerance.
            tolerance_ns = times.doubt_ns // 2
            self._window = (due_at - tolerance_ns, due_at + tolerance_ns)
