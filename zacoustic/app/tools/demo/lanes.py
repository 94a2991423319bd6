"""The lanes of the demo: what should cross in one direction, what has crossed, and the delays."""

from collections.abc import Iterator
from typing import Any

from zacoustic.app.tools.demo.networks import NAMES, SHORE
from zacoustic.core.base.qos import Reliability
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.errors import PayloadInvalidError, UnknownStreamError


class Lane:
    """One direction of one stream; the clients number its items from 0.

    Args:
        name: Name of the stream, for a service with `request` or `response`.
        stream: The stream.
        source: Address of the sending side.
    """

    def __init__(self, name: str, stream: Stream, source: int) -> None:
        self.name = name
        self.stream_id = stream.stream_id
        self.source = source
        spec = stream.spec
        self.is_repeated = not (
            isinstance(spec, TopicSpec) and spec.qos.reliability is Reliability.BEST_EFFORT
        )
        """A lost sample is sent again; a best-effort one is not."""
        self.transmitted_bytes: int | None = None
        """Bytes on the link, by the sender's gateway; None: not reported yet."""
        self.faults: list[str] = []
        """Items that arrived twice, changed, or without having been sent."""
        self._codec = stream.response_codec if name.endswith("response") else stream.codec
        self._sent: dict[int, tuple[float, Any]] = {}
        self._delays_s: dict[int, float] = {}

    @property
    def sent(self) -> int:
        """Number of items put on the local network."""
        return len(self._sent)

    @property
    def crossed(self) -> int:
        """Number of them that have arrived."""
        return len(self._delays_s)

    @property
    def mean_delay_s(self) -> float | None:
        """Mean time from client to client, s; None before the first."""
        delays_s = self._delays_s.values()
        return sum(delays_s) / len(delays_s) if delays_s else None

    @property
    def missing(self) -> list[int]:
        """Numbers of the missing ones."""
        return sorted(set(self._sent) - set(self._delays_s))

    def send(self, count: int, at: float, value: object) -> None:
        """Note an item that should cross."""
        self._sent[count] = (at, value)

    def receive(self, count: int, at: float, value: object) -> float:
        """Note an item that has crossed; return its delay, s."""
        if count in self._delays_s:
            self.faults.append(f"{count} arrived twice")
        if count not in self._sent:
            self.faults.append(f"{count} arrived and was never sent")
            return 0.0
        sent_at, sent_value = self._sent[count]
        if isinstance(value, dict) and value != self._as_it_crosses(sent_value):
            self.faults.append(f"{count} arrived as {value}, was sent as {sent_value}")
        return self._delays_s.setdefault(count, at - sent_at)

    def next_unreceived(self) -> int:
        """Return the number of the oldest missing item; if none is missing, the next number."""
        return next(iter(self.missing), self.sent)

    def _as_it_crosses(self, value: object) -> object:
        """Return the value as rounded by its type."""
        try:
            return self._codec.decode(self._codec.encode(value))
        except PayloadInvalidError:
            return value


class Lanes:
    """All lanes of a stream table.

    Args:
        table: The streams; services are called from the shore.
    """

    def __init__(self, table: StreamTable) -> None:
        self._table = table
        self._by_name: dict[str, Lane] = {}
        for stream in table:
            for name, source in _directions(stream):
                self._by_name[name] = Lane(name, stream, source)

    def __iter__(self) -> Iterator[Lane]:
        return iter(self._by_name.values())

    def of_key(self, key: str, source: int) -> Lane:
        """Return the lane of a topic's key from one side.

        Raises:
            UnknownStreamError: The table has no such topic.
        """
        found = self._table.find(key, source)
        if found is None or found[0].name not in self._by_name:
            raise UnknownStreamError(f"no stream for {key} from {NAMES.get(source, source)}")
        return self._by_name[found[0].name]

    def of_call(self, key: str, direction: str) -> Lane:
        """Return the lane `request` or `response` of a service."""
        return self._by_name[f"{key} {direction}"]


def _directions(stream: Stream) -> list[tuple[str, int]]:
    spec = stream.spec
    if isinstance(spec, ServiceSpec):
        return [(f"{stream.name} request", SHORE), (f"{stream.name} response", spec.server)]
    if isinstance(spec, ActionSpec):
        return []  # the demo has none
    sources = spec.publishers or tuple(NAMES)
    return [(stream.name, source) for source in sources[:1]]
