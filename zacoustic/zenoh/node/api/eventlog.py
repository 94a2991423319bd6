"""Events of a node besides samples and calls, kept for a while for its readers."""

from collections import deque
from collections.abc import AsyncIterator
from typing import Final

from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.zenoh.node.api.mailbox import Mailbox
from zacoustic.zenoh.node.carrier import NodeEvent

EVENTS_KEPT: Final = 64
"""Recent events for a new reader, and events that wait for a reader; as many of progress
besides."""

_PROGRESS: Final = "progress"


class EventLog:
    """The events of one node; for the loop."""

    def __init__(self) -> None:
        self._recent: deque[NodeEvent] = deque(maxlen=EVENTS_KEPT)
        self._readers: set[Mailbox[NodeEvent]] = set()
        self._is_closed = False
        self._error: Exception | None = None

    def add(self, event: NodeEvent) -> None:
        """Pass an event to all readers."""
        key = ""
        if isinstance(event, ObjectProgress) and event.state is ObjectState.UNDER_WAY:
            key = _PROGRESS  # many: one replaces only others of its kind
        else:
            self._recent.append(event)
        for reader in self._readers:
            reader.put(event, key)

    async def read(self) -> AsyncIterator[NodeEvent]:
        """Iterate over the recent events, then new ones; ends when the log is closed."""
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
        """End all iterations, with the error if there is one. May be called again."""
        if not self._is_closed:
            self._is_closed, self._error = True, error
        for reader in self._readers:
            reader.close(error)
