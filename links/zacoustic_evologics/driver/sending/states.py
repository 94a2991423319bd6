"""The phases of one frame, what can happen to it, and the table of both; drawn in `sending`."""

import enum
from typing import Final


class Phase(enum.Enum):
    """Where a frame is."""

    # A burst first, and what was refused: `AT?S` is asked, whether the modem has time.
    CHECKING = "checking"
    # A burst: `AT?PC` is asked, the number of the next one. On deck, `AT!L3` is said.
    PREPARING = "preparing"
    # The modem has the frame and has not accepted it yet.
    GIVING = "giving"
    # It did not accept it in time; it is asked whether it has the frame.
    DOUBTING = "doubting"
    # It cannot take the frame now. Waits for a pause, or for something to end.
    PAUSING = "pausing"
    # `ATZ4` or `ATA` is to make it take the frame.
    MENDING = "mending"
    # It has accepted the frame and will report the outcome.
    FLYING = "flying"
    # It should have said so by now, or may have meant another frame; it is asked. A piggyback
    # message: it is told to forget it, and says so if it still could.
    POLLING = "polling"
    # It knows nothing of a frame any more; it is asked whether it was restarted.
    VERIFYING = "verifying"
    # The frame has taken too long; the modem must drop it.
    DROPPING = "dropping"
    # The report is there.
    OVER = "over"


class Word(enum.Enum):
    """What can happen to a frame."""

    LISTENING = "listening"
    """`AT?S`: it has time."""
    OCCUPIED = "occupied"
    """`AT?S`: it has none."""
    PREPARED = "prepared"
    """What is asked before was answered, or there is nothing."""
    ACCEPTED = "accepted"
    """`OK`."""
    NOT_NOW = "not now"
    """BUSY, or an error that passes."""
    MENDABLE = "mendable"
    """An error that a command mends."""
    REFUSED = "refused"
    """An error that stays."""
    HAS_IT = "has it"
    """The modem has the frame still."""
    IDLE = "idle"
    """The modem has no frame."""
    DONE = "done"
    """A command that need not say more was answered."""
    RESTARTED = "restarted"
    """The modem has lost its settings."""
    UNANSWERED = "unanswered"
    """No answer came in time."""
    PROVEN = "proven"
    """A notification reports its outcome."""
    RUMOUR = "rumour"
    """A notification may report its outcome, or an earlier one's."""
    RETURNED = "returned"
    """The modem has given it back unsent, and there is another way or another chance."""
    STIRRED = "stirred"
    """Something ended that may have kept the modem busy."""
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
"""What is not here changes nothing: a word about something else, or one that comes too late."""

HAS_FRAME: Final = frozenset(
    {Phase.GIVING, Phase.DOUBTING, Phase.FLYING, Phase.POLLING, Phase.VERIFYING, Phase.DROPPING}
)
"""The modem may have the frame."""
