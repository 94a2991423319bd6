"""Values and their encodings between the local network and the engine.

A sample's encoding crosses only if it differs from the stream's, which both ends know.
"""

from typing import Final

from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import PayloadInvalidError
from zacoustic.zenoh.session.values import read_value, said_encoding, write_value

_SCHEMA_MARK: Final = ";"


def from_local(
    payload: bytes, encoding: object, type_spec: TypeSpec | None, stream_encoding: str
) -> tuple[object, str | None]:
    """Read a payload of an application.

    Args:
        payload: Its bytes.
        encoding: Its Zenoh encoding; Zenoh's own default and None mean the stream's.
        type_spec: The type; None: opaque.
        stream_encoding: The stream's encoding.

    Returns:
        The value for the engine, and its encoding if it differs from the stream's.

    Raises:
        PayloadInvalidError: It cannot be read.
    """
    said = said_encoding(encoding, stream_encoding)
    if type_spec is not None:
        # A schema repeats the type, and its text would cost bytes on the channel.
        said = said.partition(_SCHEMA_MARK)[0]
        stream_encoding = stream_encoding.partition(_SCHEMA_MARK)[0]
    value = read_value(payload, type_spec, said)
    return value, None if said == stream_encoding else said


def to_local(
    value: object, type_spec: TypeSpec | None, encoding: str, stream_encoding: str
) -> tuple[bytes, str]:
    """Write a value from the engine for an application; returns the bytes and their encoding.

    A typed value may have an encoding that cannot carry it; only another implementation sends such
    a value. It is written in the stream's encoding.
    """
    try:
        return write_value(value, type_spec, encoding), encoding
    except PayloadInvalidError:
        return write_value(value, type_spec, stream_encoding), stream_encoding
