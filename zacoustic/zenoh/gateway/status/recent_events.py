"""Recent events: notices, and input errors of the local network.

``@acoustic/ADDRESS/events`` is a document of the health report: a late reader gets the earlier
events, and a monitor shows the last errors.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Final

from zacoustic.status.node import EventRow, EventsDocument
from zacoustic.text.safetext import one_line
from zacoustic.zenoh.gateway.notices import Notice, Notify

EVENTS_KEPT: Final = 16
"""Number of events kept."""
TROUBLES_KEPT: Final = 4
"""Number of errors kept in addition, so that usual events displace no error."""
_LONGEST_TEXT: Final = 200
INPUT_ERROR: Final = "input_error"
"""The `event` of an input error of the local network."""


class RecentEvents:
    """The recent events of one gateway; for the loop.

    Args:
        unix_s: The wall clock, s.
    """

    def __init__(self, unix_s: Callable[[], float] = time.time) -> None:
        self._unix_s = unix_s
        self._events: deque[EventRow] = deque()
        self._troubles: deque[EventRow] = deque(maxlen=TROUBLES_KEPT)

    def note(self, notice: Notice) -> None:
        """Keep a notice."""
        lines = [one_line(" ".join(line.split())) for line in notice.lines()]
        self._keep(notice.event, ", ".join(lines), is_trouble=notice.is_trouble)

    def input_error(self, text: str) -> None:
        """Keep an input error."""
        self._keep(INPUT_ERROR, text, is_trouble=True)

    def documents(self) -> dict[str, object]:
        """Return the document, by the end of its key; oldest first."""
        return {"events": EventsDocument(events=[*self._troubles, *self._events])}

    def _keep(self, event: str, text: str, *, is_trouble: bool) -> None:
        self._events.append(
            EventRow(
                at_unix_s=round(self._unix_s(), 3),
                event=event,
                is_trouble=is_trouble,
                text=text[:_LONGEST_TEXT],
            )
        )
        if len(self._events) > EVENTS_KEPT and (oldest := self._events.popleft()).is_trouble:
            self._troubles.append(oldest)


class Announcer:
    """Emits notices, and keeps them for late readers.

    Args:
        recent_events: Keeps them.
        notify: Receives them.
    """

    def __init__(self, recent_events: RecentEvents, notify: Notify) -> None:
        self._recent_events = recent_events
        self._notify = notify
        self._is_closed = False

    def tell(self, notice: Notice) -> None:
        """Emit a notice."""
        self._recent_events.note(notice)
        if not self._is_closed:
            self._notify(notice)

    def close(self) -> None:
        """Emit nothing any more."""
        self._is_closed = True
