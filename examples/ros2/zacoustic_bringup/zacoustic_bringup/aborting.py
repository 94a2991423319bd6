"""When and how a mission is aborted, without ROS: instants are arguments, s."""

from __future__ import annotations

from collections.abc import Callable


class Aborting:
    """Asks for the abort until it is answered, once per loss.

    The gateway calls again until it hears `success`, so no call waits here: the first one asks, and
    a later one is told the answer.

    Args:
        ask: Asks the mission to abort; the answer goes to `answered`.
        timeout_s: How long an answer may take.
        kept_s: For how long an answer waits for the call that is told it: longer than the pauses
            of the gateway (30 s), and shorter than its `lost_after_s`.
    """

    def __init__(self, ask: Callable[[], None], *, timeout_s: float, kept_s: float = 45.0) -> None:
        self._ask = ask
        self._timeout_s = timeout_s
        self._kept_s = kept_s
        self._asked_at: float | None = None
        self._done_at: float | None = None
        self._text = ""

    def lost(self, now_s: float) -> tuple[bool, str]:
        """Contact is lost: return whether the mission is aborted, and what is said of it."""
        if self._is_done(now_s):
            return self._told()
        if self._asked_at is not None and now_s - self._asked_at < self._timeout_s:
            return False, "asked; no answer yet"
        was = self._text
        if self._asked_at is not None:
            was = f"no answer in {self._timeout_s:g} s"
        self._asked_at, self._text = now_s, ""
        self._ask()  # may be answered at once
        if self._is_done(now_s):
            return self._told()
        return False, self._text or (f"{was}; asked again" if was else "asked; no answer yet")

    def answered(self, success: bool, text: str, now_s: float) -> None:
        """Take the mission's answer."""
        self._asked_at, self._text = None, text
        self._done_at = now_s if success else None

    # Below the methods above

    def _is_done(self, now_s: float) -> bool:
        return self._done_at is not None and now_s - self._done_at <= self._kept_s

    def _told(self) -> tuple[bool, str]:
        """The next call is of another loss."""
        self._done_at = None
        return True, self._text


class GatewayWatch:
    """Acts for a gateway that is gone: nobody else would say that contact is lost.

    Args:
        aborting: Aborts.
        gone_after_s: How long the gateway may be gone; the countdown begins with the start.
        now_s: The start.
    """

    def __init__(self, aborting: Aborting, gone_after_s: float, now_s: float) -> None:
        self._aborting = aborting
        self._gone_after_s = gone_after_s
        self._seen_at = now_s
        self._is_acted = False

    def look(self, is_there: bool, now_s: float) -> str:
        """Take whether the gateway is there; return what happened, empty: nothing."""
        if is_there:
            self._seen_at, self._is_acted = now_s, False
            return ""
        gone_s = now_s - self._seen_at
        if self._is_acted or gone_s < self._gone_after_s:
            return ""
        self._is_acted, text = self._aborting.lost(now_s)
        done = "aborted" if self._is_acted else "not aborted yet"
        return f"the gateway has been gone for {gone_s:.0f} s: {done}: {text}"
