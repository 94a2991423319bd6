"""The phases of one frame, its inputs, and the transition table; drawn in `sending`."""

import enum
from typing import Final


class Phase(enum.Enum):
    """The phase of a frame."""

    # A burst first, and after a refusal: `AT?S` asks whether the modem has time.
    CHECKING = "checking"
    # For a burst, `AT?PC` asks for the number of the next one. On deck, `AT!L3` sets the level.
    PREPARING = "preparing"
    # The modem has the frame and has not accepted it yet.
    GIVING = "giving"
    # It did not accept it in time; the driver asks whether it has the frame.
    DOUBTING = "doubting"
    # It cannot take the frame now. The driver waits for a pause, or for something to end.
    PAUSING = "pausing"
    # `ATZ4` or `ATA` makes it ready for the frame.
    MENDING = "mending"
    # It has accepted the frame and will report the outcome.
    FLYING = "flying"
    # It should have reported by now, or may have meant another frame; the driver asks. A piggyback
    # message: the driver tells the modem to drop it; the modem reports if it still could.
    POLLING = "polling"
    # It has no frame any more; the driver asks whether it was restarted.
    VERIFYING = "verifying"
    # The frame has taken too long; the modem must drop it.
    DROPPING = "dropping"
    # The report is ready.
    OVER = "over"


class Word(enum.Enum):
    """An input of a frame."""

    LISTENING = "listening"
    """`AT?S`: the modem has time."""
    OCCUPIED = "occupied"
    """`AT?S`: it has no time."""
    PREPARED = "prepared"
    """The preparations are answered, or there are none."""
    ACCEPTED = "accepted"
    """`OK`."""
    NOT_NOW = "not now"
    """BUSY, or a temporary error."""
    MENDABLE = "mendable"
    """An error that a command removes."""
    REFUSED = "refused"
    """A permanent error."""
    HAS_IT = "has it"
    """The modem still has the frame."""
    IDLE = "idle"
    """The modem has no frame."""
    DONE = "done"
    """The answer of a command that proves no more."""
    RESTARTED = "restarted"
    """The modem has lost its settings."""
    UNANSWERED = "unanswered"
    """No answer came in time."""
    PROVEN = "proven"
    """A notification reports its outcome."""
    RUMOUR = "rumour"
    """A notification may report its outcome, or that of an earlier frame."""
    RETURNED = "returned"
    """The modem has returned it unsent, and there is another service or another opportunity."""
    STIRRED = "stirred"
    """Something ended that may have occupied the modem."""
    DUE = "due"
    """The time of the phase is over."""
    EXPIRED = "expired"
    """The time of the frame is over."""
    LOST = "lost"
    """The connection is lost or closed, or the modem does not answer at all."""


TRANSITIONS: Final[dict[tuple[Phase, Word], Phase]] = {
    (Phase.CHECKING, Word.LISTENING): Phase.PREPARING,
    (Phase.CHECKING, Word.OCCUPIED): Phase.PAUSING,
    (Phase.CHECKING, Word.UNANSWERED): Phase.PAUSING,
    (Phase.PREPARING, Word.PREPARED): Phase.GIVING,
    (Phase.PREPARING, Word.NOT_NOW): Phase.PAUSING,
    (Phase.PREPARING, Word.UNANSWERED): Phase.PAUSING,
    (Phase.PREPARING, Word.MENDABLE): Phase.MENDING,
    (Phase.PREPARING, Word.REFUSED): Phase.OVER,
    (Phase.GIVING, Word.ACCEPTED): Phase.FLYING,
    (Phase.GIVING, Word.NOT_NOW): Phase.PAUSING,
    (Phase.GIVING, Word.MENDABLE): Phase.MENDING,
    (Phase.GIVING, Word.REFUSED): Phase.OVER,
    (Phase.GIVING, Word.RETURNED): Phase.PREPARING,
    (Phase.GIVING, Word.UNANSWERED): Phase.DOUBTING,
    (Phase.GIVING, Word.PROVEN): Phase.GIVING,
    (Phase.DOUBTING, Word.HAS_IT): Phase.FLYING,
    (Phase.DOUBTING, Word.IDLE): Phase.OVER,
    (Phase.DOUBTING, Word.REFUSED): Phase.OVER,
    (Phase.DOUBTING, Word.UNANSWERED): Phase.OVER,
    (Phase.DOUBTING, Word.PROVEN): Phase.DOUBTING,
    (Phase.PAUSING, Word.DUE): Phase.CHECKING,
    (Phase.PAUSING, Word.STIRRED): Phase.CHECKING,
    (Phase.PAUSING, Word.EXPIRED): Phase.OVER,
    (Phase.MENDING, Word.DONE): Phase.PREPARING,
    (Phase.MENDING, Word.UNANSWERED): Phase.PAUSING,
    (Phase.FLYING, Word.PROVEN): Phase.OVER,
    (Phase.FLYING, Word.RUMOUR): Phase.POLLING,
    (Phase.FLYING, Word.DUE): Phase.POLLING,
    (Phase.FLYING, Word.EXPIRED): Phase.DROPPING,
    **{
        (phase, Word.RETURNED): Phase.PREPARING
        for phase in (Phase.FLYING, Phase.POLLING, Phase.VERIFYING)
    },
    (Phase.POLLING, Word.HAS_IT): Phase.FLYING,
    (Phase.POLLING, Word.UNANSWERED): Phase.FLYING,
    (Phase.POLLING, Word.IDLE): Phase.VERIFYING,
    (Phase.POLLING, Word.PROVEN): Phase.OVER,
    (Phase.VERIFYING, Word.DONE): Phase.OVER,
    (Phase.VERIFYING, Word.RESTARTED): Phase.OVER,
    (Phase.VERIFYING, Word.UNANSWERED): Phase.OVER,
    (Phase.VERIFYING, Word.PROVEN): Phase.OVER,
    (Phase.DROPPING, Word.DONE): Phase.OVER,
    (Phase.DROPPING, Word.UNANSWERED): Phase.OVER,
    (Phase.DROPPING, Word.PROVEN): Phase.OVER,
    **{(phase, Word.LOST): Phase.OVER for phase in Phase if phase is not Phase.OVER},
}
"""Other pairs change nothing: the input is about another matter, or comes too late."""

HAS_FRAME: Final = frozenset(
    {Phase.GIVING, Phase.DOUBTING, Phase.FLYING, Phase.POLLING, Phase.VERIFYING, Phase.DROPPING}
)
"""The modem may have the frame."""
