"""Dense strings as they were sent, one after the other: what they refer to is known if it was seen.

Whoever sees all frames of a source, in their order, holds what its listeners hold. A block that
stands for itself needs none of that.
"""

from typing import Any

from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.dense import DenseCodec, Listener
from zacoustic.core.values.payload import PayloadError


class Overheard:
    """The dense blocks of all sources.

    Args:
        table: The streams, with the model.
    """

    def __init__(self, table: StreamTable) -> None:
        self._table = table
        self._listeners: dict[int, Listener] = {}
        self._epochs: dict[int, int] = {}

    def introduced(self, source: int, epoch: int) -> None:
        """Take note of a HELLO or TAG: in a new epoch nothing is referred to that was before."""
        if self._epochs.setdefault(source, epoch) != epoch:
            self._epochs[source] = epoch
            self._listeners.pop(source, None)

    def read(self, source: int, block: bytes) -> tuple[tuple[int, dict[str, Any]], ...]:
        """Read a block; gives stream ids and values.

        Raises:
            PayloadError: It cannot be read; with the reason.
        """
        listener = self._listeners.get(source)
        if listener is None:
            types = {
                stream.stream_id: stream.dense_type
                for stream in self._table
                if stream.dense_type is not None and stream.may_publish(source)
            }
            if not types:
                raise PayloadError(f"node {source} has no dense streams")
            codec = DenseCodec(types, model=self._table.model, digest=self._table.digest)
            listener = self._listeners[source] = Listener(codec)
        return listener.decode(block).samples
