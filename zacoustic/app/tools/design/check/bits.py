"""The cost of a sample in bits: the smallest, the typical and the largest, for planning a link.

Of packed samples these are the payload's bits; the record's id, and what fills the last byte, come
on top. Of a dense sample they are what it adds to a block that goes anyway; the largest is the
whole block of a sample that is like nothing before. What is typical of it has been measured by the
fit, one sample behind the one before it, and is in the model's file.
"""

from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.core.streams.table import Stream
from zacoustic.core.values.payload import PackedCodec, PayloadCodec

_MORE_BYTES: Final = 2  # of a dense block of one sample beside its packed payload, at most
_LEAST_DENSE_BITS: Final = 1


class SampleBits(msgspec.Struct, frozen=True, kw_only=True):
    """The bits of a sample."""

    smallest: int
    """Of the one that costs least."""
    typical: float | None
    """On the average; None: not known."""
    largest: int | None
    """Of the one that costs most; None: no bound."""


def sample_bits(
    stream: Stream, codec: PayloadCodec, typical: Mapping[int, float]
) -> SampleBits | None:
    """Return the cost of a sample in bits; None where bytes say all: CBOR, opaque.

    Args:
        stream: The stream.
        codec: The one of its codecs that is meant.
        typical: What was measured of dense streams, by stream id, bits.
    """
    if not isinstance(codec, PackedCodec):
        return None
    if stream.dense_type is None:
        is_fixed = codec.smallest_bits == codec.largest_bits
        return SampleBits(
            smallest=codec.smallest_bits,
            typical=float(codec.smallest_bits) if is_fixed else None,
            largest=codec.largest_bits,
        )
    largest = codec.largest_bytes
    return SampleBits(
        smallest=_LEAST_DENSE_BITS,
        typical=typical.get(stream.stream_id),
        largest=None if largest is None else 8 * (largest + _MORE_BYTES),
    )
