"""Codecs of the payloads that cross the channel.

A stream has one codec, made once from what both ends know of the stream. `OpaqueCodec` carries
bytes as they are; `CborCodec` carries the values of a type as CBOR by position, `PackedCodec` as
bits. The frame layer needs three facts of a codec: whether a payload delimits itself, and how small
and how large it can be.

An application's mistake in a value to be sent is a `PayloadInvalidError` for the application.
Damage in a received payload is a `PayloadError`, internal to the core: it is counted, traced,
dropped.
"""

from zacoustic.core.values.payload.cbor import CborCodec
from zacoustic.core.values.payload.codec import (
    OpaqueCodec,
    PayloadCodec,
    PayloadError,
    ReferenceUnknownError,
)
from zacoustic.core.values.payload.packed import PackedCodec
from zacoustic.core.values.payload.typed import TypedCodec

__all__ = [
    "CborCodec",
    "OpaqueCodec",
    "PackedCodec",
    "PayloadCodec",
    "PayloadError",
    "ReferenceUnknownError",
    "TypedCodec",
]
