"""Section 6: encodings. Written from docs/wire.md alone."""

from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

ENCODINGS = (
    "zenoh/bytes",
    "zenoh/string",
    "zenoh/serialized",
    "application/octet-stream",
    "text/plain",
    "application/json",
    "text/json",
    "application/cdr",
    "application/cbor",
    "application/yaml",
    "text/yaml",
    "text/json5",
    "application/python-serialized-object",
    "application/protobuf",
    "application/xml",
    "text/xml",
    "text/csv",
    "text/markdown",
    "text/html",
    "image/png",
    "image/jpeg",
    "image/gif",
    "image/bmp",
    "image/webp",
    "audio/aac",
    "audio/ogg",
    "audio/vorbis",
    "video/h264",
    "video/h265",
    "video/mp4",
)
_SPELLED = 0xFF


def read(cursor: Cursor) -> str:
    """Take an encoding."""
    number = cursor.take(1)[0]
    if number < len(ENCODINGS):
        return ENCODINGS[number]
    if number != _SPELLED:
        raise ReadError("no such encoding")
    length = cursor.take(1)[0]
    if not length:
        raise ReadError("an encoding without text")
    try:
        return cursor.take(length).decode()
    except UnicodeDecodeError as error:
        raise ReadError("no UTF-8") from error


def write(encoding: str) -> bytes:
    """Return an encoding, by its number if it has one."""
    if encoding in ENCODINGS:
        return bytes((ENCODINGS.index(encoding),))
    raw = encoding.encode()
    if not 1 <= len(raw) <= 255:
        raise ReadError("an encoding has 1…255 bytes")
    return bytes((_SPELLED, len(raw))) + raw
