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
from zacoustic.core.values.types import TypeSpec

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


def usual_bytes(stream: Stream) -> int | None:
    """Return the size of a usual sample of a packed stream that is not dense; None: another stream.

    No number is outside of its range, texts and lists are half as long as they may be, and optional
    fields are there.
    """
    if stream.type is None or stream.dense_type is not None:
        return None
    if not isinstance(stream.codec, PackedCodec):
        return None
    return PackedCodec(_usual(stream.type)).largest_bytes


def _usual(spec: TypeSpec) -> TypeSpec:
    """Return a type whose largest value is as large as a usual one of another type."""
    fields = []
    for field in spec.fields:
        usual = field
        if usual.escapes:
            usual = msgspec.structs.replace(usual, outside="clamp")
        if usual.max_length is not None:
            half = max((usual.max_length + 1) // 2, usual.min_length or 0)
            usual = msgspec.structs.replace(usual, max_length=half)
        fields.append(usual)
    nested = tuple(_usual(each) for each in spec.nested)
    return TypeSpec(name=spec.name, fields=tuple(fields), nested=nested, is_hidden=spec.is_hidden)
