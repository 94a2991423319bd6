"""Events of a node besides samples and calls, kept for a while for its readers."""

from collections import deque
from collections.abc import AsyncIterator
from typing import Final

from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.zenoh.node.api.mailbox import Mailbox
from zacoustic.zenoh.node.carrier import NodeEvent

EVENTS_KEPT: Final = 64
"""Events that a reader begins with, and that wait for it; and as many of how far something is."""

_PROGRESS: Final = "progress"


class EventLog:
    """The events of one node; for the loop."""

    def __init__(self) -> None:
        self._recent: deque[NodeEvent] = deque(maxlen=EVENTS_KEPT)
        self._readers: set[Mailbox[NodeEvent]] = set()
        self._is_closed = False
        self._error: Exception | None = None

    def add(self, event: NodeEvent) -> None:
        """Tell all readers."""
        key = ""
        if isinstance(event, ObjectProgress) and event.state is ObjectState.UNDER_WAY:
            key = _PROGRESS  # many: it pushes out nothing but its like
        else:
            self._recent.append(event)
        for reader in self._readers:
            reader.put(event, key)

    async def read(self) -> AsyncIterator[NodeEvent]:
        """Iterate over the events, those that are kept first; ends when the log is closed."""
        reader: Mailbox[NodeEvent] = Mailbox(EVENTS_KEPT)
        for event in self._recent:
            reader.put(event)
        if self._is_closed:
            reader.close(self._error)
        self._readers.add(reader)
        try:
            while (next_event := await reader.get()) is not None:
                yield next_event
        finally:
            self._readers.discard(reader)

    def close(self, error: Exception | None = None) -> None:
        """End the iterations, with an error if there is one. May be called again."""
        if not self._is_closed:
            self._is_closed, self._error = True, error
        for reader in self._readers:
            reader.close(error)
