"""One item of a frame, in words."""

import json

import msgspec

from zacoustic.core.values.payload import PayloadCodec, PayloadError


class DecodedItem(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One control or record of a frame."""

    kind: str
    """`hello`, `tag`, `confirm`, `ask`, `table`, `sample`, `delete`, `request`, `response`,
    `error`, `call_confirm`, `goal`, `goal_accepted`, `goal_claim`, `goal_refused`,
    `goal_confirm`, `goal_cancel`, `goal_feedback`, `goal_result`, `fragment`, `feedback`,
    `subscribe`, `dense`, `dense_ack`, `carried`, `sealed`, `record` (not decoded) or `stray`;
    of rmw_desert `sample`, `request`, `response`, `beacon`, `discovery_request`, `record` or
    `stray`."""
    text: str
    """One line for people."""
    stream_id: int = 0
    """The stream; 0: none."""
    name: str = ""
    """The key of a sample or the name of a service or action; empty without a configuration."""
    value: object = None
    """The value, bytes in hexadecimal; None: there is none, or it cannot be decoded."""
    fault: str = ""
    """Why it cannot be decoded; empty: it is."""


def decoded(
    kind: str, head: str, stream_id: int, name: str, codec: PayloadCodec, payload: bytes
) -> DecodedItem:
    """Explain a payload with its context; never raises."""
    try:
        value = printable(codec.decode(payload))
    except PayloadError as error:
        return DecodedItem(
            kind=kind, text=f"{head}: {payload.hex()} does not decode: {error}",
            stream_id=stream_id, name=name, fault=str(error),
        )  # fmt: skip
    text = f"{head}: {json.dumps(value, ensure_ascii=False)}"
    return DecodedItem(kind=kind, text=text, stream_id=stream_id, name=name, value=value)


def printable(value: object) -> object:
    """Return a value in a form that JSON can carry: bytes in hexadecimal."""
    if isinstance(value, bytes):
        return value.hex()
    if isinstance(value, dict):
        return {str(name): printable(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [printable(part) for part in value]
    return value
