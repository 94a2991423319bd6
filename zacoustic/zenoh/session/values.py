"""Values on the Zenoh side: CBOR maps or JSON objects with a type, plain bytes without one.

Decoding and encoding do not check whether the type allows the value; the caller that passes it to
Decoding and encoding do not check whether the type allows the value; the caller does, when it
passes the value to an engine or to an application.
"""

from zacoustic.core.values.encoding import OPAQUE, decode_application, encode_application
from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import PayloadInvalidError


def said_encoding(encoding: object, otherwise: str) -> str:
    """Return the encoding of a sample; `otherwise` for Zenoh's default and None.

    Args:
        encoding: Zenoh's encoding; its text counts.
        otherwise: The stream's encoding.
    """
    said = OPAQUE if encoding is None else str(encoding)
    return otherwise if said == OPAQUE else said


def read_value(payload: bytes, spec: TypeSpec | None, encoding: str) -> object:
    """Decode a local payload: a dict, or bytes.

    Raises:
        PayloadInvalidError: The payload cannot be read.
    """
    return payload if spec is None else decode_application(payload, encoding, type_spec=spec)


def write_value(value: object, spec: TypeSpec | None, encoding: str) -> bytes:
    """Encode a value for the local network.

    Raises:
        PayloadInvalidError: The encoding cannot carry the value, or it is opaque and not bytes.
    """
    if spec is not None:
        return encode_application(value, encoding)
    if not isinstance(value, bytes | bytearray | memoryview):
        raise PayloadInvalidError(f"{type(value).__name__} on an opaque stream; allowed: bytes")
    return bytes(value)
