"""Latched samples in the journal: a gateway has them for late joiners also after a restart.

A map that was published once may not come again for hours, so a gateway with empty caches would
have nothing for late joiners. Each sample of a latched topic is journalled as it was put, with its
wall-clock instant, and put again after a restart. Earlier subscribers get it twice, as from any
latched publisher that restarts.

The space is bounded: per key as many samples as its topic keeps, and `LIMIT_BYTES` for all
together; the oldest make room. Samples that arrive while no gateway runs are missing; a reliable
topic gets them afterwards.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.zenoh.gateway.dialect.lastvalues import LastValue

LIMIT_BYTES: Final = 4 * 1024 * 1024
"""Space for all latched topics, bytes, headers included."""
_NAME: Final = "latched"
_HEADER_BYTES: Final = 64


class _Entry(msgspec.Struct, frozen=True, array_like=True):
    """A sample in the journal."""

    digest: bytes
    key: str
    payload: bytes
    encoding: str
    source: int
    age_s: float | None
    received_utc_ns: int
    publisher: int = 0
    age_error_s: float | None = None


class KeptSamples:
    """The samples of the latched topics of one gateway; for the loop.

    Args:
        write: Journals a value under a name; None deletes it.
        clock: Source of instants.
        wall_clock: Returns UTC, ns since 1970.
        limit_bytes: Maximum space.
    """

    def __init__(
        self,
        write: Callable[[str, bytes | None], None],
        *,
        clock: Clock,
        wall_clock: Clock,
        limit_bytes: int = LIMIT_BYTES,
    ) -> None:
        self._write = write
        self._clock = clock
        self._wall_clock = wall_clock
        self._limit_bytes = limit_bytes
        self._sizes: dict[tuple[int, str, int], int] = {}
        """Sizes by ``(stream id, key, serial)``, the oldest first."""
        self._publishers: dict[tuple[int, str, int], int] = {}
        self._bytes = 0
        self._next_serial = 0

    def recover(
        self, stored: Mapping[str, bytes], table: StreamTable
    ) -> Iterator[tuple[Stream, LastValue]]:
        """Yield the samples from before the restart, in order; delete unreadable entries.

        Args:
            stored: The content of the journal.
            table: The streams.
        """
        found = sorted(
            (int(name.split("/")[2]), name) for name in stored if name.startswith(f"{_NAME}/")
        )
        for serial, name in found:
            self._next_serial = serial + 1
            entry = msgspec.msgpack.decode(stored[name], type=_Entry)
            stream = table.get(int(name.split("/")[1]))
            if stream is None or stream.digest != entry.digest:
                self._write(name, None)
                continue
            identity = (stream.stream_id, entry.key, serial)
            self._note(identity, len(stored[name]), entry.publisher)
            passed_ns = max(0, self._wall_clock() - entry.received_utc_ns)
            passed_s = ns_to_seconds(passed_ns)
            lifespan_s = stream.qos.lifespan_s
            if lifespan_s is not None and (entry.age_s or 0.0) + passed_s >= lifespan_s:
                self._drop((stream.stream_id, entry.key, serial))
                continue
            age_s = None if entry.age_s is None else entry.age_s + passed_s
            yield (
                stream,
                LastValue(
                    key=entry.key,
                    stream_id=stream.stream_id,
                    payload=entry.payload,
                    encoding=entry.encoding,
                    source=entry.source,
                    age_s=age_s,
                    age_error_s=entry.age_error_s,
                    received_at=self._clock(),
                    publisher=entry.publisher,
                    journalled_s=passed_s,
                ),
            )

    def keep(self, stream: Stream, value: LastValue) -> None:
        """Journal a sample that was put on the local network."""
        received_utc_ns = self._wall_clock() - (self._clock() - value.received_at)
        entry = msgspec.msgpack.encode(
            _Entry(
                stream.digest,
                value.key,
                value.payload,
                value.encoding,
                value.source,
                value.age_s,
                received_utc_ns,
                value.publisher,
                value.age_error_s,
            )
        )
        identity = (stream.stream_id, value.key, self._next_serial)
        self._next_serial += 1
        self._note(identity, len(entry), value.publisher)
        self._write(_name(identity), entry)
        of_key = [
            each
            for each in self._sizes
            if each[:2] == identity[:2] and self._publishers[each] == value.publisher
        ]
        for old in of_key[: max(0, len(of_key) - stream.qos.depth)]:
            self._drop(old)
        while self._bytes > self._limit_bytes:
            self._drop(next(iter(self._sizes)))

    def forget(self, stream: Stream, key: str) -> None:
        """Delete the samples of a key that was deleted."""
        for old in [each for each in self._sizes if each[:2] == (stream.stream_id, key)]:
            self._drop(old)

    def _note(self, identity: tuple[int, str, int], entry_bytes: int, publisher: int) -> None:
        self._publishers[identity] = publisher
        self._sizes[identity] = entry_bytes + _HEADER_BYTES
        self._bytes += self._sizes[identity]

    def _drop(self, identity: tuple[int, str, int]) -> None:
        self._bytes -= self._sizes.pop(identity)
        del self._publishers[identity]
        self._write(_name(identity), None)


def _name(identity: tuple[int, str, int]) -> str:
    stream_id, _, serial = identity
    return f"{_NAME}/{stream_id}/{serial}"
