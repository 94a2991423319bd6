"""When a receiver sends feedback about incoming objects.

It answers a request at once. When it has an object and the sender does not know that, it sends
feedback in the sender's next listen window (which medium access knows:
`zacoustic.core.schedule.access.listening`). While fragments are lost, a requested answer is
repeated as long as the copies leave before the sender can react to the first. Several receivers
answer one after the other.
"""

import random
from collections.abc import Callable
from typing import Final

from zacoustic.core.transport.objects.timing import Timing
from zacoustic.core.wire.objects import ListenHint

TransferKey = tuple[int, int]
"""``(source, transfer)``."""

# Losses above which an answer is sent twice, and three times.
_LOSS_FOR_TWO: Final = 0.1
_LOSS_FOR_THREE: Final = 0.35
_SLOTS_EACH: Final = 2


class _Reply:
    """A due answer."""

    def __init__(self, at: int, copies: int, until: int | None = None) -> None:
        self.at = at
        self.copies = copies
        self.until = until
        """Instant after which it would come too late, ns; None: until the sender continues."""
        self.is_on_air = False


class Replies:
    """The answers of one node.

    Args:
        rng: Spreads the answers of several receivers.
        is_sayable: ``key`` → whether the answer may be sent now.
    """

    def __init__(self, rng: random.Random, is_sayable: Callable[[TransferKey], bool]) -> None:
        self._rng = rng
        self._is_sayable = is_sayable
        self.waiting: dict[TransferKey, _Reply] = {}
        """The answers that are due, or on the air; read-only."""
        self.quiet_until = 0
        """Instant until which fragments of another node, or an exchange with it, are expected,
        ns."""

    def called(
        self, key: TransferKey, call: ListenHint, heard_at: int, timing: Timing, *, loss: float
    ) -> None:
        """Schedule the answer of this node alone to a sender that listens."""
        at = self._listens_at(call, heard_at, timing)
        copies = 1 + (loss > _LOSS_FOR_TWO) + (loss > _LOSS_FOR_THREE)
        in_time = 2 * timing.propagation_ns // timing.feedback_slot_ns
        self.waiting[key] = _Reply(at, min(copies, 1 + in_time))

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
        """Schedule the answer of this node among others to a sender that listens.

        Args:
            key: The object.
            call: When the sender listens.
            heard_at: End of the fragment, ns.
            timing: The durations.
            rank: How many receivers answer before this one.
            others: Number of the other receivers.
            repeats: It has sent the same answer before. Since distances differ, that answer may
                have collided with another one, and would again.
        """
        at = self._listens_at(call, heard_at, timing)
        slots = _SLOTS_EACH * rank + self._rng.random()
        if repeats:
            slots = self._rng.random() * _SLOTS_EACH * (others + 1)
        self.waiting[key] = _Reply(at + round(slots * timing.feedback_slot_ns), 1)

    def goes_on(
        self, key: TransferKey, heard_at: int, timing: Timing, *, tell: bool, window: bool
    ) -> None:
        """Note that the sender continues.

        Args:
            key: The object.
            heard_at: End of the fragment, ns.
            timing: The durations.
            tell: Whether to tell the source that it need not send more.
            window: Whether a listen window begins now, and then further ones.
        """
        self.quiet_until = heard_at + timing.slot_ns + timing.pause_ns
        if not tell:
            self.waiting.pop(key, None)
        elif window:
            # Medium access decides when it starts.
            self.waiting[key] = _Reply(heard_at, 1, heard_at + 2 * timing.period_ns)

    def due_at(self, now: int) -> int | None:
        """Return the instant at which the next answer is due, ns, or None."""
        if not self.waiting:
            return None
        for key, reply in list(self.waiting.items()):
            if reply.until is not None and reply.until < now and not reply.is_on_air:
                del self.waiting[key]
        return min((reply.at for _, reply in self._sayable()), default=None)

    def owes_answer(self, now: int) -> bool:
        """Return whether an answer is due or still in transmission."""
        is_on_air = any(reply.is_on_air for reply in self.waiting.values())
        return is_on_air or self.due_at(now) is not None

    def destination(self, now: int) -> int | None:
        """Return the destination of a due answer, or None."""
        due = self.due(now)
        return due[0][0] if due else None

    def due(self, now: int, source: int | None = None) -> list[TransferKey]:
        """Return the objects with due feedback, for one source or for all."""
        due = [
            (reply.at, key)
            for key, reply in self._sayable()
            if reply.at <= now and source in (None, key[0])
        ]
        return [key for _, key in sorted(due)]

    def say(self, key: TransferKey) -> None:
        """Note that an answer is in the frame that goes now."""
        self.waiting[key].is_on_air = True

    def drop(self, key: TransferKey) -> None:
        """Drop the answer about an object."""
        self.waiting.pop(key, None)

    def forget(self, source: int) -> None:
        """Drop all answers to a source."""
        for key in [key for key in self.waiting if key[0] == source]:
            self.drop(key)

    def transmitted(self, key: TransferKey, finished_at: int, timing: Timing) -> None:
        """Schedule the next copy of an answer after a transmission, if one is left."""
        reply = self.waiting.get(key)
        if reply is None:
            return
        reply.is_on_air = False
        reply.copies -= 1
        reply.at = finished_at + timing.gap_ns
        if reply.copies <= 0:
            del self.waiting[key]

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
            for key, reply in self.waiting.items()
            if not reply.is_on_air and self._is_sayable(key)
        ]
