"""The frames of a long recording as columns of numbers: a hundred bytes each, not a thousand.

A recording of a gigabyte has millions of frames. Of the bytes of a frame a digest is kept, which
finds the frame that was sent in the one that arrived.
"""

import hashlib
import math
from array import array
from collections.abc import Iterator
from typing import Any, Final

from zacoustic.run.recording.channels import RECEIVED, SENT, FrameRecord

_METRICS: Final = (
    "airtime_s", "snr_db", "received_level_db", "integrity", "propagation_s", "range_rate_m_s",
)  # fmt: skip
_DIGEST_BYTES: Final = 8


class FrameColumns:
    """Frames in the order of their recording, with their instants, UTC, ns."""

    def __init__(self) -> None:
        self._utc_ns = array("q")
        self._is_sent = bytearray()
        self._ends = bytearray()
        """Node, source and destination of each."""
        self._sizes = array("L")
        self._digests = bytearray()
        self._measured: set[str] = set()
        """The names of numbers that any frame has."""
        self._numbers = {name: array("d") for name in _METRICS}

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self._utc_ns)

    def append(self, item: tuple[int, FrameRecord]) -> None:
        """Take a frame with its instant."""
        utc_ns, frame = item
        self._utc_ns.append(utc_ns)
        self._is_sent.append(frame.direction == SENT)
        self._ends += bytes((frame.node, frame.source, frame.destination))
        self._sizes.append(frame.size_bytes)
        self._digests += hashlib.blake2b(frame.frame, digest_size=_DIGEST_BYTES).digest()
        for name, column in self._numbers.items():
            number = getattr(frame, name)
            if number is None:
                column.append(math.nan)
            else:
                column.append(number)
                self._measured.add(name)

    def measured(self, name: str) -> Iterator[tuple[int, tuple[int, int], float]]:
        """Yield the measurements of one kind on frames that arrived.

        Args:
            name: A field of `LinkMetrics`; the yields are UTC, ns, sender and receiver, and number.
        """
        if name not in self._measured:
            return
        for index, number in enumerate(self._numbers[name]):
            if not (math.isnan(number) or self._is_sent[index]):
                node, source = self._ends[3 * index], self._ends[3 * index + 1]
                if source:
                    yield self._utc_ns[index], (source, node), number

    def sent(self) -> dict[int, tuple[int, int, float]]:
        """Return number, bytes and airtime, s, of each node's own frames."""
        found: dict[int, tuple[int, int, float]] = {}
        airtimes_s = self._numbers["airtime_s"]
        for index, is_sent in enumerate(self._is_sent):
            if is_sent:
                node = self._ends[3 * index]
                frames, size_bytes, sum_s = found.get(node, (0, 0, 0.0))
                own_s = airtimes_s[index]
                sum_s += 0.0 if math.isnan(own_s) else own_s
                found[node] = frames + 1, size_bytes + self._sizes[index], sum_s
        return found

    def __iter__(self) -> Iterator[tuple[int, FrameRecord]]:
        """Yield the instants, and frames whose contents are their digests."""
        for index, utc_ns in enumerate(self._utc_ns):
            node, source, destination = self._ends[3 * index : 3 * index + 3]
            numbers: dict[str, Any] = {
                name: None if math.isnan(column[index]) else column[index]
                for name, column in self._numbers.items()
            }
            begin = _DIGEST_BYTES * index
            yield (
                utc_ns,
                FrameRecord(
                    direction=SENT if self._is_sent[index] else RECEIVED,
                    node=node,
                    source=source,
                    destination=destination,
                    size_bytes=self._sizes[index],
                    frame=bytes(self._digests[begin : begin + _DIGEST_BYTES]),
                    at=0,
                    **numbers,
                ),
            )
