"""A receiver's watch over a periodic key: it asks for missing samples.

An ACK also serves as a request: it names the number that the receiver awaits. The watch sends it
when the next sample is overdue, and again one round trip later, until a sample comes. How many
copies it sends in each round, and how many rounds, follows from the share of samples missed lately.
When one of so many requests would probably have been heard, the publisher has nothing more to send
or is out of reach. Then the watch pauses until a further sample comes.
"""

from typing import Final

from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.transport.reliable.rhythm import Beat

_SMOOTHING: Final = 1 / 16
_FIRST_GUESS: Final = 0.25
_LEAST_MISSED, _MOST_MISSED = 0.05, 0.5
"""Bounds of the assumed share of missed samples: a loss of zero is never certain, and above the
upper bound asking costs more than it brings."""
_ALL_UNHEARD: Final = 0.1
"""Probability that no copy in a round of requests is heard."""
_ALL_IN_VAIN: Final = 0.01
"""Probability that an existing sample does not come although all rounds asked for it."""


class Watch:
    """Decides when to ask for the samples of one key of a publisher.

    See `zacoustic.core.transport.reliable.rhythm`.
    """

    __slots__ = (
        "_beat",
        "_copies",
        "_frames_ns",
        "_in_vain",
        "_missed",
        "_overdue_at",
        "_round_at",
        "ask_at",
    )

    def __init__(self) -> None:
        self.ask_at: int | None = None
        """Instant at which to ask the publisher for what is missing then, ns; None: never."""
        self._beat = Beat()
        self._frames_ns = (0, 0)
        self._missed = _FIRST_GUESS
        self._overdue_at = 0
        self._copies = 0
        self._in_vain = 1.0
        self._round_at = 0

    @property
    def is_known(self) -> bool:
        """Whether the rhythm is known."""
        return self._beat.period_ns is not None

    def forget(self) -> None:
        """Forget the rhythm."""
        self._beat = Beat()
        self._frames_ns = (0, 0)
        self.ask_at = None

    def take(
        self, number: int, *, at: int, frame_ns: int, newest: bool, marked: bool, times: LinkTimes
    ) -> bool:
        """Learn from a sample; return whether it needs no ACK of its own.

        Args:
            number: Its number.
            at: When its frame began to arrive, ns.
            frame_ns: The airtime of that frame, ns.
            newest: It has the highest number so far.
            marked: The publisher has marked it as in rhythm.
            times: The airtimes of the link.
        """
        was_known, due_at = self.is_known, self._beat.due_at(number)
        is_early = due_at is not None and at < due_at - times.doubt_ns
        is_late = due_at is not None and at > due_at + times.doubt_ns
        is_on_beat = newest and was_known and not is_early and not is_late
        if not marked and not is_on_beat:
            self.forget()
            return False
        if newest and not is_late:  # otherwise it was asked for, and is no beat
            if is_early:
                self._beat.begin(number, at)
            else:
                self._beat.goes_on(number, at)
            period_ns = self._beat.period_ns
            if period_ns is not None and period_ns < times.first_round_trip_ns:
                self._beat.begin(number, at)  # too fast to be asked for in time
            self._frames_ns = (self._frames_ns[1], frame_ns)
        if was_known:
            self._missed += ((not is_on_beat) - self._missed) * _SMOOTHING
        return marked and was_known

    def plan(self, newest: int, *, is_whole: bool, soon_at: int, times: LinkTimes) -> None:
        """Plan, after a sample has come, to ask when the next one is overdue.

        Args:
            newest: The highest number that came.
            is_whole: Nothing is missing before it; otherwise ask at `soon_at`.
            soon_at: The earliest instant to ask, ns.
            times: The airtimes of the link.
        """
        due_at = self._beat.due_at(newest + 1)
        if due_at is None:
            self.ask_at = None
            return
        self._overdue_at = due_at + max(self._frames_ns) + times.doubt_ns
        self.ask_at = max(soon_at, self._overdue_at) if is_whole else soon_at
        self._copies, self._in_vain = 0, 1.0

    def asks(self, now: int, times: LinkTimes) -> None:
        """Note that a request is sent now, and plan the next one."""
        if not self._copies:
            self._round_at = now
        missed = min(max(self._missed, _LEAST_MISSED), _MOST_MISSED)
        self._copies += 1
        unheard = missed**self._copies
        if unheard > _ALL_UNHEARD:
            self.ask_at = now + times.ack_slot_ns
            return
        self._copies = 0
        self._in_vain *= 1 - (1 - unheard) * (1 - missed)
        self.ask_at = self._next_round_at(times) if self._in_vain > _ALL_IN_VAIN else None

    def _next_round_at(self, times: LinkTimes) -> int:
        """Return when to ask again, but not right before a further sample is due."""
        round_trip_ns = times.ask_round_trip_ns(max(self._frames_ns))
        period_ns = self._beat.period_ns
        assert period_ns is not None
        beats_over = max(0, (self._round_at - self._overdue_at) // period_ns + 1)
        self._overdue_at += beats_over * period_ns
        next_at = self._round_at + round_trip_ns
        return next_at if next_at + round_trip_ns <= self._overdue_at else self._overdue_at
