"""Values as text, for the command line: read and printed.

A value with a type is JSON5, with base64 texts for bytes fields; an opaque value is the text
itself. On Zenoh without a configuration nothing has a type: a text in braces then counts as fields
and travels as CBOR, and a received payload is read as its encoding says.
"""

import base64
import json
from typing import Any

import msgspec

from zacoustic.config.json5 import parse_json5
from zacoustic.core.values.encoding import (
    CBOR,
    JSON,
    TYPED_ENCODINGS,
    decode_application,
    encode_application,
)
from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import ConfigError, PayloadInvalidError

TEXT = "text/plain"
"""Encoding of a text without a type."""


def read_text(text: str, spec: TypeSpec | None, *, source: str) -> Any:  # noqa: ANN401
    """Read a value that a user typed.

    Args:
        text: The text.
        spec: Its type; None: opaque.
        source: Name of the argument, for the messages.

    Returns:
        A dict with every field, or bytes.

    Raises:
        ConfigError: The text is not JSON5, or not of the type.
    """
    if spec is None:
        return text.encode()
    try:
        written = json.dumps(_parse(text, source)).encode()
        return spec.validate(decode_application(written, JSON, type_spec=spec))
    except PayloadInvalidError as error:
        raise ConfigError(f"{source}: {error.args[0]}", hint=error.hint) from error


def read_untyped(text: str, *, source: str) -> tuple[bytes, str]:
    """Read a value without a type; return payload and encoding.

    Raises:
        ConfigError: The text begins with a brace and is not JSON5.
    """
    if not text.lstrip().startswith("{"):
        return text.encode(), TEXT
    return encode_application(_parse(text, source), CBOR), CBOR


def shown_value(value: object, encoding: str) -> dict[str, Any]:
    """Return a value for JSON, under `value`, `text` or `base64`, whichever can show it.

    Args:
        value: A dict of fields, or bytes.
        encoding: Encoding of the bytes; an unset one is inferred.
    """
    if not isinstance(value, bytes):
        return {"value": msgspec.to_builtins(value)}
    kind = encoding.split(";", 1)[0]
    if kind not in TYPED_ENCODINGS and value[:1] and 0xA0 <= value[0] <= 0xBF:
        kind = CBOR  # no text begins with this byte, a CBOR map does
    if kind in TYPED_ENCODINGS:
        try:
            return {"value": msgspec.to_builtins(decode_application(value, kind))}
        except (PayloadInvalidError, TypeError):
            pass
    try:
        return {"text": value.decode()}
    except UnicodeDecodeError:
        return {"base64": base64.b64encode(value).decode()}


def line_of(shown: dict[str, Any]) -> str:
    """Return the result of `shown_value` as one line."""
    if "text" in shown:
        return str(shown["text"])
    content = shown.get("value", shown)
    return json.dumps(content, ensure_ascii=False)


def _parse(text: str, source: str) -> object:
    try:
        return json.loads(text)
    except ValueError:
        return parse_json5(text, source=source)
