"""The cost of a sample in bits: the smallest, the typical and the largest, for planning a link.

For packed samples these are the payload's bits; the record's id and padding to a whole byte come on
top. For a dense sample they are its part of a block that is sent anyway; the largest is the whole
block of a sample that resembles nothing before. The fit has measured the typical size, each sample
coded against the previous one, and the model's file contains it.
"""

from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.core.streams.table import Stream
from zacoustic.core.values.payload import PackedCodec, PayloadCodec

_MORE_BYTES: Final = 2  # of a dense block of one sample besides its packed payload, at most
_LEAST_DENSE_BITS: Final = 1


class SampleBits(msgspec.Struct, frozen=True, kw_only=True):
    """The bits of a sample."""

    smallest: int
    """Cost of the smallest sample."""
    typical: float | None
    """Mean cost; None: unknown."""
    largest: int | None
    """Cost of the largest sample; None: unbounded."""


def sample_bits(
    stream: Stream, codec: PayloadCodec, typical: Mapping[int, float]
) -> SampleBits | None:
    """Return the cost of a sample in bits; None for codecs in bytes: CBOR, opaque.

    Args:
        stream: The stream.
        codec: The codec to consider, one of its own.
        typical: Measured bits of dense streams, by stream id.
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
