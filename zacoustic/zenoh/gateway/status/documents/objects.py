"""Samples larger than a frame, for monitors: those on their way, and how the last ones ended."""

from collections import deque
from typing import Final

import msgspec
from msgspec import UNSET

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.status.channel import ObjectsDocument, TransferRow

_ENDED_KEPT: Final = 8


class Objects:
    """The large samples of one gateway; for the loop.

    Args:
        table: The streams.
    """

    def __init__(self, table: StreamTable) -> None:
        self._table = table
        self._sending: dict[int, ObjectProgress] = {}
        self._receiving: dict[tuple[int, int], ObjectProgress] = {}
        self._ended: deque[ObjectProgress] = deque(maxlen=_ENDED_KEPT)

    def note(self, event: ObjectProgress) -> None:
        """Note the progress or the end of one."""
        if event.object_id is not None:
            self._sending.pop(event.object_id, None)
        else:
            self._receiving.pop((event.peer, event.transfer), None)
        if event.state is not ObjectState.UNDER_WAY:
            self._ended.append(event)
        elif event.object_id is not None:
            self._sending[event.object_id] = event
        else:
            self._receiving[event.peer, event.transfer] = event

    def documents(self) -> dict[str, object]:
        """Return the document, by the end of its key."""
        ended = [
            msgspec.structs.replace(
                self._row(each),
                outcome=each.state.value,
                missing=list(each.missing),
                detail=each.detail,
            )
            for each in self._ended
        ]
        return {
            "objects": ObjectsDocument(
                sending=[self._row(each) for each in self._sending.values()],
                receiving=[self._row(each) for each in self._receiving.values()],
                ended=ended,
            )
        }

    def _row(self, event: ObjectProgress) -> TransferRow:
        stream = self._table.get(event.stream_id)
        is_own = event.object_id is not None
        return TransferRow(
            id=UNSET if event.object_id is None else event.object_id,
            to=UNSET if not is_own else None if event.peer == BROADCAST else event.peer,
            sent_bytes=event.sent_bytes if is_own else UNSET,
            source=UNSET if is_own else event.peer,
            transfer=UNSET if is_own else event.transfer,
            stream=stream.name if stream is not None else None,
            done_bytes=event.done_bytes,
            total_bytes=event.total_bytes,
        )
