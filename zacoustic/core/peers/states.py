"""The states of another node: three transition tables, which `docs/wire.md` prints.

Each table maps a state and an event to the next state; an event without an entry for a state
changes nothing. Other effects of an event are where it is handled.
"""

import enum
from collections.abc import Mapping
from typing import Final, Generic, TypeVar

State = TypeVar("State", bound=enum.Enum)


class Agreement(enum.Enum):
    """Whether a node has confirmed the current boot epoch of this one, and so its table."""

    UNCONFIRMED = "unconfirmed"
    """No: frames to it begin with HELLO or TAG."""
    PROVISIONAL = "provisional"
    """Yes, but before its settling time was over: valid when that time is over."""
    CONFIRMED = "confirmed"
    """Yes: frames to it need neither HELLO nor TAG."""


class Life(enum.Enum):
    """Knowledge of the current boot epoch of a node."""

    UNKNOWN = "unknown"
    """No HELLO was heard since its last restart."""
    SETTLING = "settling"
    """Its epoch is known; frames of an earlier one may still arrive."""
    SETTLED = "settled"
    """No frame of an earlier epoch can arrive any more."""


class Reachability(enum.Enum):
    """Whether a node is heard."""

    UNHEARD = "unheard"
    """Not yet since the start of this node."""
    HEARD = "heard"
    """A frame of it came recently enough."""
    LOST = "lost"
    """None came for the configured time."""


class Change(enum.Enum):
    """What changes a state."""

    CONFIRM = "CONFIRM of the present epoch"
    EARLY_CONFIRM = "provisional CONFIRM, this life is old"
    HELD = "the settling time of that is over"
    DOUBT = "ASK, or CONFIRM of another epoch"
    TABLE_CHANGED = "this node begins an epoch"
    NEW_LIFE = "HELLO of another epoch or digest"
    STRAY_TAG = "TAG of another epoch"
    SETTLED = "the settling time is over"
    FRAME = "a frame of it arrives"
    SILENCE = "nothing for `lost_after_s`"


class Transitions(Generic[State]):
    """One table.

    Args:
        first: The initial state.
    """

    def __init__(self, first: State, table: Mapping[tuple[State, Change], State]) -> None:
        self.first = first
        self._table = table

    def after(self, state: State, event: Change) -> State:
        """Return the state that follows."""
        return self._table.get((state, event), state)

    def rows(self) -> list[tuple[str, str, str]]:
        """Return state, event and next state of each entry, as printed."""
        return [
            (str(state.value), event.value, str(following.value))
            for (state, event), following in self._table.items()
        ]


AGREEMENT: Final = Transitions(
    Agreement.UNCONFIRMED,
    {
        (Agreement.UNCONFIRMED, Change.EARLY_CONFIRM): Agreement.PROVISIONAL,
        (Agreement.UNCONFIRMED, Change.CONFIRM): Agreement.CONFIRMED,
        (Agreement.PROVISIONAL, Change.CONFIRM): Agreement.CONFIRMED,
        (Agreement.PROVISIONAL, Change.HELD): Agreement.CONFIRMED,
        **{
            (state, event): Agreement.UNCONFIRMED
            for state in (Agreement.PROVISIONAL, Agreement.CONFIRMED)
            for event in (Change.DOUBT, Change.NEW_LIFE, Change.STRAY_TAG, Change.TABLE_CHANGED)
        },
    },
)
"""Agreement of a node with this one."""

LIFE: Final = Transitions(
    Life.UNKNOWN,
    {
        (Life.UNKNOWN, Change.NEW_LIFE): Life.SETTLING,
        (Life.SETTLING, Change.SETTLED): Life.SETTLED,
        (Life.SETTLING, Change.STRAY_TAG): Life.UNKNOWN,
        (Life.SETTLED, Change.NEW_LIFE): Life.SETTLING,
        (Life.SETTLED, Change.STRAY_TAG): Life.UNKNOWN,
    },
)
"""Boot epoch of a node, as far as it is known here."""

REACHABILITY: Final = Transitions(
    Reachability.UNHEARD,
    {
        (Reachability.UNHEARD, Change.FRAME): Reachability.HEARD,
        (Reachability.UNHEARD, Change.SILENCE): Reachability.LOST,
        (Reachability.HEARD, Change.SILENCE): Reachability.LOST,
        (Reachability.LOST, Change.FRAME): Reachability.HEARD,
    },
)
"""Whether a node is heard; only with a configured time after which it is lost."""
