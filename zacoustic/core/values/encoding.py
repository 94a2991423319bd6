"""The encodings of payloads: their form for the application, and their numbers on the wire.

Zenoh samples carry an *encoding*, a text like ``application/cbor``. A stream has one, which both
ends know. Only a sample with another encoding states it, in a prefix of one byte, or as the text
itself if the text has no number:

=============  ====================================================
first byte     then
=============  ====================================================
0…254          nothing: an index of `ENCODINGS`; unlisted: refused
255            one byte, the length 1…255; the text in UTF-8
=============  ====================================================

`ENCODINGS` is wire format: it only ever grows at its end.

The application gets values of typed streams as CBOR maps of field names, or as JSON objects if the
stream says so. In JSON, bytes fields are base64 texts. NaN and the infinities, which JSON lacks,
are null; a null is read as NaN where a float may be NaN and is not optional. With the schema `nan`
(``application/json;nan``) they are the words ``NaN``, ``Infinity`` and ``-Infinity``, as some
libraries write and read them; these words are always read. Every other encoding is bytes as they
are. Decoding here uses cbor2 and msgspec, with a bound of `LARGEST_VALUE_BYTES`: data from the
local network is trusted not to be an attack, but not to be well-formed.
"""

import base64
import binascii
import io
import json
import math
from collections.abc import Callable
from typing import Any, Final

import cbor2
import msgspec

from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.core.values.types.scalars import shown
from zacoustic.errors import PayloadInvalidError

OPAQUE: Final = "zenoh/bytes"
"""Default encoding of opaque streams: Zenoh's own default."""
CBOR: Final = "application/cbor"
"""Default encoding of typed streams."""
JSON: Final = "application/json"

TYPED_ENCODINGS: Final = (CBOR, JSON, "text/json")
"""The allowed encodings of a typed stream for the application."""

ENCODINGS: Final = (
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
"""Encodings by their number on the wire; append only."""

SPELLED_OUT: Final = 255
"""The first byte of an encoding without a number."""

LONGEST_ENCODING_BYTES: Final = 255
"""Longest text of an encoding, bytes in UTF-8."""

# A value of a type is fields, not files: 1 MiB is an hour of airtime at 2 kbit/s.
LARGEST_VALUE_BYTES: Final = 1 << 20
"""Largest CBOR or JSON text of one value that is decoded, bytes."""

JSON_WITH_NAN: Final = "nan"
"""Schema of JSON that has words for NaN and the infinities."""

_NUMBERS: Final = {encoding: number for number, encoding in enumerate(ENCODINGS)}
_SCHEMA_MARK: Final = ";"


def encode_prefix(encoding: str) -> bytes:
    """Return the wire form of an encoding: one byte, or 255, the length and the text.

    Raises:
        PayloadInvalidError: The text is empty or longer than `LONGEST_ENCODING_BYTES`.
    """
    number = _NUMBERS.get(encoding)
    if number is not None:
        return bytes((number,))
    text = encoding.encode(errors="replace")
    if not 1 <= len(text) <= LONGEST_ENCODING_BYTES:
        raise PayloadInvalidError(
            f"encoding has {len(text)} bytes; allowed: 1..{LONGEST_ENCODING_BYTES}"
        )
    return bytes((SPELLED_OUT, len(text))) + text


def decode_prefix(buffer: bytes, offset: int) -> tuple[str, int] | None:
    """Decode the encoding at `offset`.

    Returns:
        The encoding and the offset after it; None when it is truncated, empty, not UTF-8, or a
        number that this version does not know.
    """
    if offset >= len(buffer):
        return None
    number = buffer[offset]
    if number != SPELLED_OUT:
        return (ENCODINGS[number], offset + 1) if number < len(ENCODINGS) else None
    start = offset + 2
    end = start + buffer[offset + 1] if start < len(buffer) else start
    text = buffer[start:end]
    if not text or end > len(buffer):
        return None
    try:
        return text.decode(), end
    except UnicodeDecodeError:
        return None


def encode_application(value: object, encoding: str = CBOR) -> bytes:
    """Encode a value for the application.

    Args:
        value: A value as a `PayloadCodec` decodes it: a dict for a typed stream, bytes for an
            opaque one.
        encoding: The encoding, with or without a schema after ``;``.

    Raises:
        PayloadInvalidError: The encoding cannot carry the value.
    """
    kind, _, schema = encoding.partition(_SCHEMA_MARK)
    try:
        if kind == CBOR:
            return cbor2.dumps(value)
        if kind in TYPED_ENCODINGS and schema == JSON_WITH_NAN:
            plain = msgspec.to_builtins(value)
            return json.dumps(plain, separators=(",", ":"), ensure_ascii=False).encode()
        if kind in TYPED_ENCODINGS:
            return msgspec.json.encode(value)
    except (cbor2.CBOREncodeError, TypeError, ValueError, OverflowError, RecursionError) as error:
        raise PayloadInvalidError(f"{shown(value)} as {encoding}: {_one_line(error)}") from error
    if isinstance(value, bytes | bytearray | memoryview):
        return bytes(value)
    raise PayloadInvalidError(
        f"{shown(value)} as {encoding}; allowed: bytes, or one of {', '.join(TYPED_ENCODINGS)}"
    )


def decode_application(
    payload: bytes, encoding: str = CBOR, *, type_spec: TypeSpec | None = None
) -> object:
    """Decode an application's payload.

    Args:
        payload: The bytes of the sample, request or reply.
        encoding: Its encoding, with or without a schema after ``;``.
        type_spec: The type, if there is one: tells which texts of a JSON object are bytes, and
            which nulls are NaN.

    Returns:
        The value, not yet validated; for encodings other than CBOR and JSON the bytes.

    Raises:
        PayloadInvalidError: The payload is malformed or too large.
    """
    kind = encoding.split(_SCHEMA_MARK, 1)[0]
    if kind not in TYPED_ENCODINGS:
        return bytes(payload)
    if len(payload) > LARGEST_VALUE_BYTES:
        raise PayloadInvalidError(
            f"{encoding} of {len(payload)} bytes; allowed: at most {LARGEST_VALUE_BYTES} bytes"
        )
    if kind == CBOR:
        return _read_cbor(payload)
    try:
        value = _read_json(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise PayloadInvalidError(f"no {encoding}: {_one_line(error)}") from error
    return value if type_spec is None else _of_type(value, type_spec, type_spec.name)


def _read_json(payload: bytes) -> object:
    try:
        return msgspec.json.decode(payload)
    except msgspec.DecodeError:
        if not any(word in payload for word in (b"NaN", b"Infinity")):
            raise
        try:  # the words that JSON lacks
            return json.loads(payload)
        except ValueError:
            pass
        raise


def _read_cbor(payload: bytes) -> object:
    stream = io.BytesIO(payload)
    try:
        # Read single bytes: versions differ in the position of a stream after a read ahead.
        value: object = cbor2.CBORDecoder(stream, read_size=1).decode()
    except (
        cbor2.CBORDecodeError,
        ValueError,
        TypeError,
        ArithmeticError,
        EOFError,
        LookupError,
        RecursionError,
        MemoryError,
    ) as error:
        raise PayloadInvalidError(f"no {CBOR}: {_one_line(error)}") from error
    if stream.tell() != len(payload):
        raise PayloadInvalidError(
            f"no {CBOR}: {len(payload) - stream.tell()} bytes behind the value; allowed: one value"
        )
    return value


def _of_type(value: object, type_spec: TypeSpec, path: str) -> object:
    """Return a JSON value with the texts of its bytes fields decoded, and NaN for null."""
    if not isinstance(value, dict):
        return value
    read: dict[Any, Any] = dict(value)
    for field in type_spec.fields:
        if field.name not in read:
            continue
        if field.may_be_nan:
            read[field.name] = _with_nan(read[field.name], field)
        elif (field.type == "bytes" or field.is_nested) and read[field.name] is not None:
            read[field.name] = _read_field(read[field.name], field, type_spec, path)
    return read


def _with_nan(value: object, field: FieldSpec) -> object:
    if field.is_array and isinstance(value, list):
        return [math.nan if element is None else element for element in value]
    return math.nan if value is None and not (field.optional or field.is_array) else value


def _read_field(value: object, field: FieldSpec, type_spec: TypeSpec, path: str) -> object:
    where = f"{path}.{field.name}"
    read: Callable[[object], object]
    if field.is_nested:
        nested = type_spec.nested_type(field.type)

        def read(element: object) -> object:
            return _of_type(element, nested, where)
    else:

        def read(element: object) -> object:
            return _read_base64(element, where)

    if field.is_array and isinstance(value, list):
        return [read(element) for element in value]
    return read(value)


def _read_base64(value: object, where: str) -> object:
    if not isinstance(value, str):
        return value
    try:
        return base64.b64decode(value, validate=True)
    except (binascii.Error, ValueError):
        raise PayloadInvalidError(f"{where} is {shown(value)}; allowed: base64") from None


def _one_line(error: BaseException) -> str:
    return " ".join(str(error).split()) or type(error).__name__
