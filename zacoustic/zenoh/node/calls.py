"""The calls that a program has made, at the End of its node."""

import asyncio
from typing import Final

from zacoustic.core.engine.events import CallFailure
from zacoustic.errors import (
    CallTimeoutError,
    DeliveryError,
    OutcomeUnknownError,
    ServiceError,
    ZacousticError,
)
from zacoustic.zenoh.ends.calls import CallClient
from zacoustic.zenoh.node.waiters import settle

CLOSED_TEXT: Final = "the service was closed"
"""Error text for callers whose calls were still open."""
_HINTS: Final = {
    CallFailure.NO_SERVER: "start the program that serves it",
    CallFailure.TABLE_MISMATCH: "compare both configs: zacoustic config check FILE",
    CallFailure.TIMED_OUT: "whether the service ran is unknown",
    CallFailure.UNKNOWN: "whether it has done its work is unknown",
}

_KINDS: Final = {
    CallFailure.TIMED_OUT: CallTimeoutError,
    CallFailure.UNKNOWN: OutcomeUnknownError,
}
_REASONS: Final = {CallFailure.UNKNOWN: "the server ended without an answer"}


class SentCall(CallClient):
    """A call that a program has made.

    Args:
        name: Name of the service.
    """

    def __init__(self, name: str) -> None:
        self.over: asyncio.Future[object] = asyncio.get_running_loop().create_future()
        """The answer, or the error."""
        self._name = name

    def reply(self, value: object) -> bool:
        """There is an answer."""
        settle(self.over, value)
        return True

    def fail(self, failure: CallFailure, text: str) -> bool:
        """There is no answer."""
        settle(self.over, call_error(self._name, failure, text))
        return True


def call_error(name: str, failure: CallFailure, text: str) -> ZacousticError:
    """Return the exception for a call without a response.

    Returns:
        `ServiceError` if the handler failed, with its text; `CallTimeoutError` if no answer came in
        time; `OutcomeUnknownError` if the server ended without an answer; otherwise
        `DeliveryError`.
    """
    if failure is CallFailure.HANDLER:
        return ServiceError(text or "the handler failed without a word")
    kind = _KINDS.get(failure, DeliveryError)
    reason = text or _REASONS.get(failure) or failure.name.lower().replace("_", " ")
    return kind(f"{name}: {reason}", hint=_HINTS.get(failure, ""))
