"""What values, marks and errors look like on an island, between Zenoh and the endpoints.

Typed values are CBOR maps, or what the stream's encoding says; so every Zenoh program can take
part. Of the water nothing is known but what a gateway says: the attachment of a sample or request
tells the acoustic address that it came from and its age (``{"acoustic": 2, "age_s": 1.3}``, CBOR),
and an error reply reads ``<service>: <failure>: <text>``. Any other error is the handler's text.
"""

import contextlib
import re
from collections.abc import Iterator
from typing import Final

import cbor2
import msgspec
import zenoh

from zacoustic.core.encoding import OPAQUE, decode_application, encode_application
from zacoustic.core.events import CallFailure
from zacoustic.core.qos import Priority
from zacoustic.core.types import TypeSpec
from zacoustic.errors import LocalError, PayloadInvalidError, ZacousticError
from zacoustic.node.carrier import call_error

ERROR_ENCODING: Final = "text/plain"
"""Encoding of the text in an error reply: UTF-8."""

_NOISE: Final = re.compile(r" at \S+\.rs:\d+\.?| \(os error \d+\)")
_PRIORITIES: Final[dict[Priority, zenoh.Priority]] = {
    priority: getattr(zenoh.Priority, priority.name) for priority in Priority
}


class Marker(msgspec.Struct, frozen=True):
    """What the attachment of a gateway says."""

    acoustic: int | None = None
    """Acoustic address that it came from; None: it has not crossed any water."""
    age_s: float | None = None
    """How old it was when its frame was composed, s; None: not known."""


def read_marker(attachment: zenoh.ZBytes | None) -> Marker:
    """Read an attachment; an empty marker when it is not one of a gateway."""
    if attachment is None:
        return Marker()
    try:
        return msgspec.convert(cbor2.loads(attachment.to_bytes()), Marker)
    except (cbor2.CBORDecodeError, EOFError, ValueError, TypeError, RecursionError):
        return Marker()


def encode_value(value: object, spec: TypeSpec | None, encoding: str) -> bytes:
    """Write a value of the application.

    Raises:
        PayloadInvalidError: The type does not allow it, or it is opaque and not bytes.
    """
    if spec is not None:
        return encode_application(spec.validate(value), encoding)
    if not isinstance(value, bytes | bytearray | memoryview):
        raise PayloadInvalidError(f"{type(value).__name__} on an opaque stream; allowed: bytes")
    return bytes(value)


def decode_value(payload: bytes, spec: TypeSpec | None, encoding: str) -> object:
    """Read what somebody on the island sent: a dict of its type, or bytes.

    Raises:
        PayloadInvalidError: It is not of the type.
    """
    if spec is None:
        return payload
    return spec.validate(decode_application(payload, encoding, type_spec=spec))


def said_encoding(encoding: zenoh.Encoding | None, otherwise: str) -> str:
    """Return the encoding of a sample; `otherwise` for Zenoh's default, which says nothing."""
    said = OPAQUE if encoding is None else str(encoding)
    return otherwise if said == OPAQUE else said


def error_text(name: str, failure: CallFailure, text: str) -> str:
    """Write the text of an error reply; `read_error` reads it."""
    return text if failure is CallFailure.HANDLER else f"{name}: {failure.name}: {text}"


def read_error(name: str, error: zenoh.ReplyError) -> ZacousticError:
    """Make the exception of an error reply."""
    text = error.payload.to_bytes().decode(errors="replace")
    if text == "Timeout" and str(error.encoding) == OPAQUE:  # Zenoh's own word
        return call_error(name, CallFailure.TIMED_OUT, "no answer in time")
    head, colon, rest = text.removeprefix(f"{name}: ").partition(": ")
    if text.startswith(f"{name}: ") and head in CallFailure.__members__:
        return call_error(name, CallFailure[head], rest if colon else "")
    return call_error(name, CallFailure.HANDLER, text)


def zenoh_priority(priority: Priority) -> zenoh.Priority:
    """Return Zenoh's own constant."""
    return _PRIORITIES[priority]


def one_line(error: zenoh.ZError) -> str:
    """What Zenoh says, without places in its source."""
    return " ".join(_NOISE.sub("", str(error)).split())


@contextlib.contextmanager
def zenoh_errors(name: str) -> Iterator[None]:
    """Turn what Zenoh raises about a key into a `LocalError`."""
    try:
        yield
    except zenoh.ZError as error:
        raise LocalError(f"{name}: {one_line(error)}") from error
