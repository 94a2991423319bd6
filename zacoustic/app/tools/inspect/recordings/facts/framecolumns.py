"""The frames of a long recording as columns of numbers: a hundred bytes each, not a thousand.

A recording of a gigabyte has millions of frames. Of the bytes of a frame a digest is kept, which
finds the frame that was sent in the one that arrived.
"""

import hashlib
import math
from array import array
from collections.abc import Iterator
from typing import Final

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
            column.append(math.nan if number is None else number)

    def __iter__(self) -> Iterator[tuple[int, FrameRecord]]:
        """Yield the instants, and frames whose contents are their digests."""
        for index, utc_ns in enumerate(self._utc_ns):
            node, source, destination = self._ends[3 * index : 3 * index + 3]
            numbers = {
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
