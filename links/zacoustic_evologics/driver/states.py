"""The states of a dialogue, and the table of their transitions.

::

    CLOSED ─OPENED─► SETTLING ─SETTLED─► PROBING ─FOUND─► LEAVING ─LEFT─► READING
                         ▲                                                   │ READ
                         │ OPENED                                            ▼
                       LOST ◄─GONE, GIVEN_UP─ any                       CONFIGURING
                                                                             │ CONFIGURED
                   CLOSED ◄─CLOSED─ any       SENDING ◄─TRANSMIT─ READY ◄────┘
                                                 └─────ENDED────────►

A state has its own timers, and leaving it ends them; READY has none.
"""

import enum
from typing import Final


class State(enum.Enum):
    """Where a dialogue is."""

    # No connection has been made yet, or the link was closed.
    CLOSED = "closed"
    # Connected just now: bytes may belong to another program's dialogue, and are dropped.
    SETTLING = "settling"
    # Asks in every way until the modem answers: interpreter, mode and line end.
    PROBING = "probing"
    # Brings the modem from where it was found to where it must be: data mode, listening, idle.
    LEAVING = "leaving"
    # Reads address, firmware, settings.
    READING = "reading"
    # Sets what the configuration changes.
    CONFIGURING = "configuring"
    # The link is UP and idle.
    READY = "ready"
    # A frame is with the modem, or waits for it.
    SENDING = "sending"
    # There is no connection, or the one there is of no use: waits for the next.
    LOST = "lost"


class Input(enum.Enum):
    """What changes the state."""

    OPENED = "opened"
    """A connection is there."""
    GONE = "gone"
    """It is not there any more, or could not be made."""
    GIVEN_UP = "given up"
    """It is there, and the modem does not answer, or with nonsense, or cannot serve."""
    CLOSED = "closed"
    """The link is closed by its user."""
    SETTLED = "settled"
    """The time of dropping is over."""
    FOUND = "found"
    """The modem has answered: how it reads is known."""
    LEFT = "left"
    """It is where it must be."""
    READ = "read"
    """All values are read."""
    CONFIGURED = "configured"
    """All is set."""
    TRANSMIT = "transmit"
    """A frame was given."""
    ENDED = "ended"
    """It has been reported."""


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
"""What is not here is not allowed: the dialogue has a fault."""

CONNECTED: Final = frozenset(State) - {State.CLOSED, State.LOST}
"""Bytes are read."""
UP: Final = frozenset({State.READY, State.SENDING})
"""The link is UP."""
