"""The states of a dialogue, and the table of their transitions.

::

    CLOSED ─OPENED─► SETTLING ─SETTLED─► PROBING ─FOUND─► LEAVING ─LEFT─► READING
                         ▲                                                   │ READ
                         │ OPENED                                            ▼
                       LOST ◄─GONE, GIVEN_UP─ any                       CONFIGURING
                                                                             │ CONFIGURED
                   CLOSED ◄─CLOSED─ any       SENDING ◄─TRANSMIT─ READY ◄────┘
                                                 └─────ENDED────────►

A state has its own timers, which end when it is left; READY has none.
"""

import enum
from typing import Final


class State(enum.Enum):
    """The state of a dialogue."""

    # No connection has been made yet, or the link was closed.
    CLOSED = "closed"
    # Just connected: bytes may belong to another program's dialogue, and are dropped.
    SETTLING = "settling"
    # Probes in every way until the modem answers: interpreter, mode and line end.
    PROBING = "probing"
    # Brings the modem into the required state: data mode, listening, idle.
    LEAVING = "leaving"
    # Reads address, firmware, settings.
    READING = "reading"
    # Sets the configured settings.
    CONFIGURING = "configuring"
    # The link is UP and idle.
    READY = "ready"
    # The modem has a frame, or a frame waits for it.
    SENDING = "sending"
    # There is no connection, or a useless one: waits for the next.
    LOST = "lost"


class Input(enum.Enum):
    """An input of the dialogue."""

    OPENED = "opened"
    """A connection was made."""
    GONE = "gone"
    """It was lost, or could not be made."""
    GIVEN_UP = "given up"
    """It exists, but the modem does not answer, sends nonsense, or cannot serve."""
    CLOSED = "closed"
    """The user has closed the link."""
    SETTLED = "settled"
    """The time of dropping bytes is over."""
    FOUND = "found"
    """The modem has answered: its framing is known."""
    LEFT = "left"
    """It is in the required state."""
    READ = "read"
    """All values are read."""
    CONFIGURED = "configured"
    """All settings are made."""
    TRANSMIT = "transmit"
    """A frame was given."""
    ENDED = "ended"
    """The frame was reported."""


TRANSITIONS: Final[dict[tuple[State, Input], State]] = {
    **{(state, Input.OPENED): State.SETTLING for state in State},
    **{(state, Input.GONE): State.LOST for state in State},
    **{(state, Input.CLOSED): State.CLOSED for state in State},
    **{
        (state, Input.GIVEN_UP): State.LOST
        for state in State
        if state not in (State.CLOSED, State.LOST)
    },
    (State.SETTLING, Input.SETTLED): State.PROBING,
    (State.PROBING, Input.FOUND): State.LEAVING,
    (State.LEAVING, Input.LEFT): State.READING,
    (State.READING, Input.READ): State.CONFIGURING,
    (State.CONFIGURING, Input.CONFIGURED): State.READY,
    (State.READY, Input.TRANSMIT): State.SENDING,
    (State.SENDING, Input.ENDED): State.READY,
}
"""Other pairs are not allowed: the dialogue has a bug."""

CONNECTED: Final = frozenset(State) - {State.CLOSED, State.LOST}
"""States in which bytes are read."""
UP: Final = frozenset({State.READY, State.SENDING})
"""States in which the link is UP."""
