"""The frames on the channel: the one being sent, and the last ones sent and heard.

``@acoustic/ADDRESS/channel`` is a document of the health report. Counters show how much has
crossed; this shows what crosses now, for a user who waits. Instants are those of a frame's
beginning: after its end it is still under way for the propagation delay.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.linktypes import BROADCAST, UNKNOWN_SOURCE, Service
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.streams.table import StreamTable
from zacoustic.status.channel import ChannelDocument, FrameRow

KEPT: Final = 16
"""Number of past frames in the document."""
_BURSTS_KEPT: Final = 64


class FrameLog:
    """The frames of one engine; for the loop.

    Args:
        table: Its streams.
        engine: Returns the engine.
        unix_s: The wall clock, s.
    """

    def __init__(
        self,
        table: StreamTable,
        engine: Callable[[], Engine],
        *,
        unix_s: Callable[[], float] = time.time,
    ) -> None:
        self._table = table
        self._engine = engine
        self._inside: deque[tuple[str, tuple[int, ...]]] = deque(maxlen=KEPT)
        """Frames that routes and bonds have given to links, and their streams."""
        self._unix_s = unix_s
        self._transmitting: dict[tuple[str, Service], deque[FrameRow]] = {}
        """By link and service, oldest first: a device may have several frames of burst data."""
        self._last: deque[FrameRow] = deque(maxlen=KEPT)

    def note(self, record: TraceRecord) -> None:
        """Take a record of the engine's trace."""
        is_on_link = record.link in self._engine().links
        match record.what:
            case "transmit" if not is_on_link:  # it goes inside a frame of a link
                self._inside.append((record.frame, record.streams))
            case "transmit":
                peer = None if record.peer == BROADCAST else record.peer
                under_way = self._transmitting.setdefault(
                    (record.link, record.service),
                    deque(maxlen=_BURSTS_KEPT if record.service is Service.BULK else 1),
                )
                under_way.append(self._frame("out", peer, record))
            case "link":  # another port: what it had is reported by nobody
                for service in Service:
                    self._transmitting.pop((record.link, service), None)
            case "report" if self._transmitting.get((record.link, record.service)):
                sent = self._transmitting[record.link, record.service].popleft()
                sent.outcome = record.detail
                self._last.append(sent)
            case "receive":
                peer = None if record.peer == UNKNOWN_SOURCE else record.peer
                heard = self._frame("in", peer, record)
                heard.begun_unix_s -= heard.airtime_s
                self._last.append(heard)
            case _:
                pass

    def documents(self) -> dict[str, object]:
        """Return the document, by the end of its key; the past is oldest first."""
        under_way = [each[0] for each in self._transmitting.values() if each]
        newest = max(under_way, key=lambda each: each.begun_unix_s, default=None)
        return {"channel": ChannelDocument(transmitting=newest, last=list(self._last))}

    def _frame(self, way: str, peer: int | None, record: TraceRecord) -> FrameRow:
        inside = next((ids for frame, ids in self._inside if frame in record.frame), ())
        found = (self._table.get(each) for each in dict.fromkeys(record.streams or inside))
        capabilities = self._engine().capabilities_of(record.link)
        size, service = record.size_bytes, record.service
        airtime_ns = 0 if capabilities is None else capabilities.airtime_ns(size, service)
        return FrameRow(
            way=way,
            peer=peer,
            size_bytes=size,
            streams=[stream.name for stream in found if stream is not None],
            begun_unix_s=self._unix_s(),
            airtime_s=ns_to_seconds(airtime_ns),
        )
