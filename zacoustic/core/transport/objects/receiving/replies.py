"""When a receiver sends feedback about the objects that it receives.

It does so on request: at once when the sender waits for an answer; and when it has the object and
the sender does not know it, in the sender's next listen window (which medium access knows:
`zacoustic.core.schedule.access.listening`). A requested answer is repeated while fragments are
lost, as long as the copies leave before the sender can react to the first. Several receivers answer
one after the other.
"""

import random
from collections.abc import Callable
from typing import Final

from zacoustic.core.transport.objects.timing import Timing
from zacoustic.core.wire.objects import ListenHint

TransferKey = tuple[int, int]
"""``(source, transfer)``."""

# A copy of an answer where more than that is lost, and another.
_LOSS_FOR_TWO: Final = 0.1
_LOSS_FOR_THREE: Final = 0.35
_SLOTS_EACH: Final = 2


class _Reply:
    """An answer that is due."""

    def __init__(self, at: int, copies: int, until: int | None = None) -> None:
        self.at = at
        self.copies = copies
        self.until = until
        """Instant after which it would come too late; None: until the sender sends on."""
        self.is_on_air = False


class Replies:
    """The answers of one node.

    Args:
        rng: Spreads the answers of several receivers.
        is_sayable: ``key`` → nothing is in the way of the answer.
    """

    def __init__(self, rng: random.Random, is_sayable: Callable[[TransferKey], bool]) -> None:
        self._rng = rng
        self._is_sayable = is_sayable
        self._replies: dict[TransferKey, _Reply] = {}
        self.quiet_until = 0
        """Until then fragments of another node, or an exchange with it, are expected."""

    def called(
        self, key: TransferKey, call: ListenHint, heard_at: int, timing: Timing, *, loss: float
    ) -> None:
        """The sender listens for the answer of this node alone."""
        at = self._listens_at(call, heard_at, timing)
        copies = 1 + (loss > _LOSS_FOR_TWO) + (loss > _LOSS_FOR_THREE)
        in_time = 2 * timing.propagation_ns // timing.feedback_slot_ns
        self._replies[key] = _Reply(at, min(copies, 1 + in_time))

    def called_among(
        self,
        key: TransferKey,
        call: ListenHint,
        heard_at: int,
        timing: Timing,
        *,
        rank: int,
        others: int,
        repeats: bool,
    ) -> None:
        """The sender listens for the answers of several.

        Args:
            key: Which object.
            call: When it listens.
            heard_at: End of the fragment, ns.
            timing: The durations.
            rank: So many receivers answer before this one.
            others: Number of the other receivers.
            repeats: It has said the same before. Since they are not equally far away, it may have
                met the answer of another then, and would again.
        """
        at = self._listens_at(call, heard_at, timing)
        slots = _SLOTS_EACH * rank + self._rng.random()
        if repeats:
            slots = self._rng.random() * _SLOTS_EACH * (others + 1)
        self._replies[key] = _Reply(at + round(slots * timing.feedback_slot_ns), 1)

    def goes_on(
        self, key: TransferKey, heard_at: int, timing: Timing, *, tell: bool, window: bool
    ) -> None:
        """The sender sends on.

        Args:
            key: Which object.
            heard_at: End of the fragment, ns.
            timing: The durations.
            tell: The source should learn that it need not send more.
            window: A listen window begins now, and then others.
        """
        self.quiet_until = heard_at + timing.slot_ns + timing.pause_ns
        if not tell:
            self._replies.pop(key, None)
        elif window:
            # Medium access decides when it starts.
            self._replies[key] = _Reply(heard_at, 1, heard_at + 2 * timing.period_ns)

    def due_at(self, now: int) -> int | None:
        """Return the instant at which the next answer is to go, or None."""
        if not self._replies:
            return None
        for key, reply in list(self._replies.items()):
            if reply.until is not None and reply.until < now and not reply.is_on_air:
                del self._replies[key]
        return min((reply.at for _, reply in self._sayable()), default=None)

    def owes_answer(self, now: int) -> bool:
        """Tell whether an answer is to go, or has not yet been on the air."""
        is_on_air = any(reply.is_on_air for reply in self._replies.values())
        return is_on_air or self.due_at(now) is not None

    def due(self, now: int, source: int | None = None) -> list[TransferKey]:
        """Return the objects with due feedback, to one source or to all."""
        due = [
            (reply.at, key)
            for key, reply in self._sayable()
            if reply.at <= now and source in (None, key[0])
        ]
        return [key for _, key in sorted(due)]

    def say(self, key: TransferKey) -> None:
        """An answer is in the frame that goes now."""
        self._replies[key].is_on_air = True

    def drop(self, key: TransferKey) -> None:
        """There is no feedback to send."""
        self._replies.pop(key, None)

    def forget(self, source: int) -> None:
        """Say nothing more to a source."""
        for key in [key for key in self._replies if key[0] == source]:
            self.drop(key)

    def transmitted(self, key: TransferKey, finished_at: int, timing: Timing) -> None:
        """An answer has been on the air: repeat it, or not."""
        reply = self._replies.get(key)
        if reply is None:
            return
        reply.is_on_air = False
        reply.copies -= 1
        reply.at = finished_at + timing.gap_ns
        if reply.copies <= 0:
            del self._replies[key]

    # Below the methods above

    def _listens_at(self, call: ListenHint, heard_at: int, timing: Timing) -> int:
        at = heard_at
        if call is ListenHint.ANSWER_NEXT:
            at += timing.slot_ns + timing.gap_ns + timing.feedback_ns // 4
        self.quiet_until = at + timing.exchange_ns
        return at

    def _sayable(self) -> list[tuple[TransferKey, _Reply]]:
        return [
            (key, reply)
            for key, reply in self._replies.items()
            if not reply.is_on_air and self._is_sayable(key)
        ]
