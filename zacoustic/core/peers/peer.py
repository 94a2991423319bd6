"""What this node knows of another one, and what it owes to it; see `handshake` for the rules."""

from typing import Final

import msgspec

from zacoustic.core.base.allowance import SHARE
from zacoustic.core.base.linktypes import ONE_LINK
from zacoustic.core.base.stats import Cause
from zacoustic.core.peers.states import AGREEMENT, Agreement, Change, Life

_FIRST_PAUSE_UNITS: Final = 2
_LONGEST_ANSWER_PAUSE_UNITS: Final = 256
_LONGEST_QUESTION_PAUSE_UNITS: Final = 64
"""A question goes to a node whose frames cannot be decoded here. It costs little, and all those
frames are lost until it is answered."""

_SHARE: Final = SHARE // 2
"""As of repetitions; a node that is heard may be owed a question and an answer."""


class Pause:
    """A pause that doubles with each use: nobody repeats a question faster than answers can come.

    Args:
        longest_units: Its maximum, units; after long it is a share of the time since the first use.
    """

    __slots__ = ("_longest_units", "_since", "_units", "not_before")

    def __init__(self, longest_units: int) -> None:
        self._longest_units = longest_units
        self.reset()

    def reset(self) -> None:
        """Allow the next use at once."""
        self._units = _FIRST_PAUSE_UNITS
        self._since: int | None = None
        self.not_before = 0

    def use(self, now: int, unit_ns: int) -> None:
        """Note a use; the next one is allowed after the pause."""
        self._since = now if self._since is None else self._since
        self.not_before = now + max(self._units * unit_ns, (now - self._since) // _SHARE)
        self._units = min(2 * self._units, self._longest_units)

    @property
    def is_longest(self) -> bool:
        """The pause has reached its maximum."""
        return self._units == self._longest_units


class Row(msgspec.Struct, frozen=True):
    """A row of a node's table, as announced by it."""

    digest: bytes
    """The digest."""
    is_sure: bool
    """It answered a question of ours: anybody can announce a row under its address."""


class Peer:
    """The knowledge of another node, and what this node owes to it."""

    def __init__(self) -> None:
        self.epoch: int | None = None
        """The last epoch that it announced, or None."""
        self.digest = b""
        self.missed_epoch: int | None = None
        """The epoch of its last TAG, if no HELLO of that epoch was heard."""
        self.marked = 0
        """Number of frames with that TAG."""
        self.settled_at = 0
        self.credit_bytes: int | None = None
        """Bytes that this node may still send to a stranger; None: it is one of the fleet."""
        self.rows: dict[int, Row] = {}
        self.rows_now: set[int] = set()
        """Rows in the frame that is being read."""
        self.asked_rows: set[int] = set()
        """Rows that it was asked for and has not announced since."""
        self.agreement = AGREEMENT.first
        """Whether it has confirmed us; only `take` changes it."""
        self.knows_us = False
        """It confirmed the current epoch of this node at least once since it started. A question of
        it revokes its agreement but not this: it still knows the epoch."""
        self.holds_at = 0
        """Instant from which a provisional agreement holds, ns."""
        self.link = ONE_LINK
        """Name of the link of its last frame, or of the repetitions of a record for it: what this
        node owes to it goes there."""
        self.is_assured = False
        """It knows that we have confirmed it."""
        self.confirms_now = False
        """The frame that is being read shows that it knows our current epoch and shares our
        table."""
        self.heard_alone = False
        """The frame that is being read is for this node alone."""
        self.is_being_confirmed = False
        """The frame that is being composed confirms it."""
        self.told_differing: set[int] = set()
        self.owes_confirm = False
        self.owes_hello = False
        self.owed_rows: dict[int, None] = {}
        self.questions: dict[int, None] = {}
        self.speak_at: int | None = None
        self.speaks_to_all = False
        """The frame at that instant goes to all."""
        self.answers_within_ns = 0
        """How long its answers take behind a device that decides when it transmits, as measured,
        ns."""
        self.answered_at = 0
        """Before this instant, ns, it may not have received our last CONFIRM."""
        self.ask_pause = Pause(_LONGEST_QUESTION_PAUSE_UNITS)
        self.answer_pause = Pause(_LONGEST_ANSWER_PAUSE_UNITS)
        self.named_pause = Pause(_LONGEST_ANSWER_PAUSE_UNITS)
        """Between records that name our epoch and end `answer_pause`."""

    @property
    def present_epoch(self) -> int:
        """Epoch of a node whose record has just been allowed."""
        assert self.epoch is not None
        return self.epoch

    def shares(self, digest: bytes) -> bool:
        """Return whether it is known to have the table with a digest."""
        return self.epoch is not None and self.digest == digest

    @property
    def confirmed_us(self) -> bool:
        """It has confirmed us: frames to it need no HELLO and no TAG."""
        return self.agreement is Agreement.CONFIRMED

    def life(self, now: int) -> Life:
        """Return the state of its current boot epoch."""
        if self.epoch is None:
            return Life.UNKNOWN
        return Life.SETTLED if now >= self.settled_at else Life.SETTLING

    def take(self, event: Change) -> None:
        """Apply an event to its agreement."""
        self.agreement = AGREEMENT.after(self.agreement, event)
        self.knows_us |= self.confirmed_us

    def ripen(self, now: int) -> None:
        """Turn a provisional agreement into a confirmed one when its time has come."""
        if self.agreement is Agreement.PROVISIONAL and self.holds_at <= now:
            self.take(Change.HELD)

    def differs_from(self, digest: bytes) -> bool:
        """Return whether it is known to have another table than the one with a digest."""
        return self.epoch is not None and self.digest != digest

    @property
    def is_owed(self) -> bool:
        """This node owes it something."""
        return self.owes_confirm or self.owes_hello or bool(self.owed_rows or self.questions)

    @property
    def confirm_at(self) -> int:
        """Earliest instant at which it may be confirmed, ns."""
        return max(self.settled_at, self.answer_pause.not_before, self.answered_at)

    @property
    def sayable_at(self) -> int:
        """Earliest instant at which a part of what it is owed may go, ns; only if it `is_owed`."""
        instants = [self.confirm_at] if self.owes_confirm else []
        if self.questions:
            instants.append(self.ask_pause.not_before)
        return 0 if self.owes_hello or self.owed_rows else min(instants)

    def said(self, cause: Cause, now: int, unit_ns: int) -> None:
        """Note that the next item of one kind was sent to it."""
        if cause is Cause.CONFIRM:
            self.owes_confirm = False
            self.answer_pause.use(now, unit_ns)
            self.answered_at = now + self.answers_within_ns
        elif cause is Cause.TABLE:
            self.owed_rows.pop(next(iter(self.owed_rows)))
        else:
            stream_id = next(iter(self.questions))
            del self.questions[stream_id]
            self.asked_rows.add(stream_id)
            if not self.questions:
                self.ask_pause.use(now, unit_ns)

    def spend(self, size_bytes: int) -> bool:
        """Return whether it may get this many bytes more, and count them."""
        if self.credit_bytes is None:
            return True
        is_enough = self.credit_bytes >= size_bytes
        self.credit_bytes -= size_bytes * is_enough
        return is_enough

    def doubt(self, event: Change) -> None:
        """Forget all agreement on tables because of an event."""
        self.take(event)
        self.knows_us = self.is_assured = self.confirms_now = False
        self.owes_confirm = False
        self.answered_at = 0
        self.rows.clear()
        self.asked_rows.clear()
        self.told_differing.clear()

    def begin_life(self, event: Change) -> None:
        """Begin a new epoch of it: it knows nothing of us, and we know nothing of its table."""
        self.doubt(event)
        self.owed_rows.clear()
        self.questions.clear()
        for pause in (self.ask_pause, self.answer_pause, self.named_pause):
            pause.reset()
