"""The texts of error replies, written and read: ``<service>: <failure>: <text>``.

`<failure>`, a name of `CallFailure`, tells the caller how far the call got. An error reply of
another form comes from a program that does not know this form: its handler has failed.
"""

from typing import Final

from zacoustic.core.engine.events import CallFailure
from zacoustic.core.values.encoding import OPAQUE

ERROR_ENCODING: Final = "text/plain"
"""Encoding of the text in an error reply: UTF-8."""

REASONS: Final = {
    CallFailure.HANDLER: "the server failed",
    CallFailure.NO_SERVER: "nobody on the local network of the server's node serves it",
    CallFailure.BAD_REQUEST: "the request does not decode",
    CallFailure.TABLE_MISMATCH: "the two nodes define the stream in different ways",
    CallFailure.BAD_RESPONSE: "the response does not decode",
    CallFailure.TIMED_OUT: "no answer before the deadline",
    CallFailure.CANCELLED: "given up",
    CallFailure.UNKNOWN: "the server ended without an answer",
}
"""Text to show if the other end sent none, which saves airtime."""


def error_text(name: str, failure: CallFailure, text: str) -> str:
    """Write the text of an error reply.

    Args:
        name: The service, as named in the query.
        failure: How far the call got.
        text: One line; the name of the service before it is not repeated.
    """
    return f"{name}: {failure.name}: {text.removeprefix(f'{name}: ') or REASONS[failure]}"


def read_error(name: str, payload: bytes, encoding: str) -> tuple[CallFailure, str]:
    """Read an error reply: how far the call got, and the text in one line."""
    text = " ".join(payload.decode(errors="replace").split())
    if text == "Timeout" and encoding == OPAQUE:  # Zenoh's own word
        return CallFailure.TIMED_OUT, "no answer in time"
    head, _, rest = text.removeprefix(f"{name}: ").partition(": ")
    if text.startswith(f"{name}: ") and head in CallFailure.__members__:
        return CallFailure[head], rest
    return CallFailure.HANDLER, text
