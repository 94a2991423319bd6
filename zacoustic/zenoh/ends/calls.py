"""Calls at an End: those that it takes from clients, and those that it gives to servers.

As with goals (`zacoustic.zenoh.ends.goals`), a `TakenCall` is a `CallClient`, which hears the
outcome of a given call: so a gateway gives each call that one End takes to its other End.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any

from zacoustic.core.engine.events import CallFailure


class CallClient(ABC):
    """Hears the outcome of a call: the first one counts."""

    @abstractmethod
    def reply(self, value: object) -> bool:
        """There is an answer; False: it is too late, or the call was already answered.

        Raises:
            LocalError: The answer cannot be passed on.
        """

    @abstractmethod
    def fail(self, failure: CallFailure, text: str) -> bool:
        """There is no answer; False: it is too late, or the call was already answered."""


class TakenCall(CallClient):
    """A call that an End has from a client.

    Args:
        value: The request, a dict or bytes.
        client: Acoustic address of the caller; None: the caller is local.
        call_id: Call id; None: the caller is local.
        deadline_at: Instant after which an answer is useless, ns.
    """

    def __init__(
        self, value: object, *, client: int | None, call_id: str | None, deadline_at: int
    ) -> None:
        self.value: Any = value
        self.client = client
        self.call_id = call_id
        self.deadline_at = deadline_at


TakeCall = Callable[[TakenCall], None]
"""Takes the calls of one service that arrive at an End; raises `ZacousticError` if it cannot."""
CancelCall = Callable[[], None]
"""Gives up a given call: nobody waits for it any more."""
