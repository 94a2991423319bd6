"""Goals at an End: those that it takes from clients, and those that it gives to servers.

::

                  TakenGoal ───── the goal, a cancel ─────► GivenGoal
    client ◄► End    ▲                                         │    End ◄► server
                     └── accepted, feedback, result, lost ─────┘

An End is the engine with its channel, or a Zenoh network; the application of a node stands in the
place of one, too. A `GoalHandler` takes the goals that arrive at an End. Whoever gives a goal to an
End passes a `GoalClient`, which hears what becomes of it. A `TakenGoal` is a `GoalClient`: so a
gateway gives each goal that one End takes to its other End (`Passage`), and knows nothing more
about it.

Values cross as dicts and bytes, as in the codecs. All calls are on the loop.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Protocol

from zacoustic.core.engine.events import GoalFailure, GoalStatus

Complain = Callable[[str, str, str], object]
"""Takes what cannot be passed on: name of the action, a word, a line of text."""


class GivenGoal(Protocol):
    """A goal that an End has for a server."""

    def cancel(self) -> bool:
        """Ask the server to end the goal; False: it has ended.

        `GoalClient.answer_cancel` follows, or the end of the goal.
        """
        ...


class GoalClient(ABC):
    """Hears what becomes of a given goal: `accept` or `reject`, later `finish`, or else `lose`."""

    @abstractmethod
    def accept(self) -> bool:
        """The goal runs; False: its client has given up, and it must be cancelled."""

    @abstractmethod
    def reject(self, failure: GoalFailure, text: str) -> bool:
        """The goal does not run; False: nobody waits for it any more. So with all methods below."""

    @abstractmethod
    def feed(self, value: object) -> bool:
        """Feedback of the running goal.

        Raises:
            LocalError: The feedback cannot be passed on.
        """

    @abstractmethod
    def answer_cancel(self, accepted: bool, text: str) -> bool:
        """The server will end the goal, or will not."""

    @abstractmethod
    def finish(self, status: GoalStatus, value: object, text: str = "") -> bool:
        """The goal has ended.

        Raises:
            LocalError: The result cannot be passed on.
        """

    @abstractmethod
    def lose(self, failure: GoalFailure, text: str) -> bool:
        """Nothing more will be known of the goal."""


class TakenGoal(GoalClient):
    """A goal that an End has from a client.

    Args:
        value: The goal.
        client: Acoustic address of the client; None: the client is local.
    """

    def __init__(self, value: object, client: int | None) -> None:
        self.value: Any = value
        self.client = client
        self.given: GivenGoal | None = None
        """The same goal at the other End of a gateway."""


class GoalHandler(Protocol):
    """Takes the goals of one action that arrive at an End."""

    def take(self, goal: TakenGoal) -> None:
        """Take a goal.

        Raises:
            ZacousticError: It cannot be taken.
        """
        ...

    def cancel(self, goal: TakenGoal) -> None:
        """Take a request to cancel a goal."""
        ...


class Passage:
    """Gives each goal of one action to the other End of a gateway.

    Args:
        give: Gives it; it is also its client.
    """

    def __init__(self, give: Callable[[TakenGoal], GivenGoal]) -> None:
        self._give = give

    def take(self, goal: TakenGoal) -> None:
        """Give a goal."""
        goal.given = self._give(goal)

    def cancel(self, goal: TakenGoal) -> None:
        """Pass on a request to cancel."""
        if goal.given is not None:
            goal.given.cancel()
