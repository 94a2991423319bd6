"""The stream that a name in a recording means: an id, a key, or the last part of one."""

import msgspec

from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import ConfigError


class Named(msgspec.Struct, frozen=True):
    """The meaning of a name."""

    stream: Stream
    """The topic."""
    source: int | None
    """The node of the samples; None: unknown."""


class StreamNames:
    """Looks names up.

    Args:
        table: The streams.
        are_typed: Look for typed topics, or for those without a type.
    """

    def __init__(self, table: StreamTable, *, are_typed: bool = True) -> None:
        self._table = table
        self._topics = [
            stream
            for stream in table
            if (stream.type is not None) == are_typed and isinstance(stream.spec, TopicSpec)
        ]
        self._known: dict[str, Named | None] = {}

    def find(self, name: str) -> Named | None:
        """Return the meaning of a name; None: no such topic.

        Raises:
            ConfigError: The name is ambiguous.
        """
        if name not in self._known:
            self._known[name] = self._find(name)
        return self._known[name]

    def _find(self, name: str) -> Named | None:
        for stream in self._topics:
            if name in (str(stream.stream_id), stream.name):
                return Named(stream, self._publisher(stream))
        for stream in self._topics:
            named_by_node = stream.keys.is_named_by_node
            for node in self._table.nodes if named_by_node else (0,):
                if stream.keys.match(name, node) is not None:
                    return Named(stream, node if named_by_node else self._publisher(stream))
        found = [each for each in self._topics if each.name.endswith(f"/{name}")]
        if len(found) > 1:
            several = ", ".join(each.name for each in found)
            raise ConfigError(f'"{name}" may mean {several}; allowed: a whole name, or an id')
        return Named(found[0], self._publisher(found[0])) if found else None

    def _publisher(self, stream: Stream) -> int | None:
        """Return the only node that publishes a topic, or None."""
        assert isinstance(stream.spec, TopicSpec)
        publishers = stream.spec.publishers or ()
        return publishers[0] if len(publishers) == 1 else None
