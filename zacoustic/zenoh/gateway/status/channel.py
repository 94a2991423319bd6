"""The frames on the channel: the one being sent, and the last ones sent and heard.

``@acoustic/ADDRESS/channel`` is a document of the health report. Counters show how much has
crossed; this shows what crosses now, for a user who waits. Instants are those of a frame's
beginning: after its end it is still under way for the propagation delay.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Final

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.linktypes import BROADCAST, UNKNOWN_SOURCE
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.streams.table import StreamTable
from zacoustic.link.contract import Link

KEPT: Final = 16
"""Number of past frames in the document."""


class Frame(msgspec.Struct, kw_only=True):
    """One frame, in the document's form."""

    way: str
    """``out`` or ``in``."""
    peer: int | None
    """The other node; null: everybody, or unknown."""
    bytes: int
    streams: list[str]
    """Names, each once; empty: the link's own frame, such as an acknowledgement."""
    begun_unix_s: float
    """When the modem got it, or, if received, when it began to arrive."""
    airtime_s: float
    """By the modem's bit rate."""
    outcome: str = ""
    """Reported outcome of a sent frame: a word of `TransmitOutcome`."""


class FrameLog:
    """The frames of one engine; for the loop.

    Args:
        table: Its streams.
        link: Its link.
        unix_s: The wall clock, s.
    """

    def __init__(
        self, table: StreamTable, link: Link, *, unix_s: Callable[[], float] = time.time
    ) -> None:
        self._table = table
        self._link = link
        self._unix_s = unix_s
        self._transmitting: Frame | None = None
        self._last: deque[Frame] = deque(maxlen=KEPT)

    def note(self, record: TraceRecord) -> None:
        """Take a record of the engine's trace."""
        match record.what:
            case "transmit":
                peer = None if record.peer == BROADCAST else record.peer
                self._transmitting = self._frame("out", peer, record)
            case "report" if self._transmitting is not None:
                self._transmitting.outcome = record.detail
                self._last.append(self._transmitting)
                self._transmitting = None
            case "receive":
                peer = None if record.peer == UNKNOWN_SOURCE else record.peer
                heard = self._frame("in", peer, record)
                heard.begun_unix_s -= heard.airtime_s
                self._last.append(heard)
            case _:
                pass

    def documents(self) -> dict[str, object]:
        """Return the document, by the end of its key; the past is oldest first."""
        return {"channel": {"transmitting": self._transmitting, "last": list(self._last)}}

    def _frame(self, way: str, peer: int | None, record: TraceRecord) -> Frame:
        found = (self._table.get(each) for each in dict.fromkeys(record.streams))
        airtime_ns = self._link.capabilities.airtime_ns(record.size_bytes)
        return Frame(
            way=way,
            peer=peer,
            bytes=record.size_bytes,
            streams=[stream.name for stream in found if stream is not None],
            begun_unix_s=self._unix_s(),
            airtime_s=ns_to_seconds(airtime_ns),
        )
