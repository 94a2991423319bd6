"""Overheard dense blocks in the order of transmission; a reference is known if it was overheard.

All frames of a source, in order, tell what its listeners know. An independent block needs none of
that.
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
        """Note a HELLO or TAG: blocks of a new epoch do not refer to earlier ones."""
        if self._epochs.setdefault(source, epoch) != epoch:
            self._epochs[source] = epoch
            self._listeners.pop(source, None)

    def read(self, source: int, block: bytes) -> tuple[tuple[int, dict[str, Any]], ...]:
        """Read a block; return stream ids and values.

        Raises:
            PayloadError: It cannot be read; tells why.
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
