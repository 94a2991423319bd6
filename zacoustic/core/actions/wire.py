"""Records of actions: behind the stream id one byte, three bits operation and five bits number.

======  ==========================  ===================================  =======================
number  from the client             from the server                      payload
======  ==========================  ===================================  =======================
0       GOAL                        –                                    of the goal's type
1       CLAIM: what became of it?   ACCEPTED: it runs                    none
2       –                           REFUSED: goal or cancel              failure 1, text; no end
3       CONFIRM: has the result     CONFIRM: has the goal                none
4       CANCEL                      CANCEL: it will end                  none
5       –                           FEEDBACK                             of the feedback's type
6       –                           RESULT                               status 1, result
7       FORMER                      FORMER                               epoch 2, operation 1, …
======  ==========================  ===================================  =======================

The status of a RESULT has its highest bit set where no result follows; `80` alone is UNKNOWN.
FORMER wraps a record about a goal of another epoch of its client than the present one: the number
stands in the outer byte, the operation in the upper bits of the inner one, and its payload behind.
"""

import enum
from typing import Final

import msgspec

from zacoustic.core.actions.news import GoalFailure, GoalStatus
from zacoustic.core.calls import LONGEST_ERROR_TEXT_BYTES
from zacoustic.core.payload import PayloadCodec
from zacoustic.core.streams import Stream

GOAL_NUMBERS: Final = 32
"""Goals of one life of a client on one stream that can be distinguished."""
FORMER_BYTES: Final = 3
"""What FORMER costs."""
UNKNOWN_RESULT: Final = b"\x80"
"""Payload of the RESULT of a goal that ran when its server died."""
_NO_RESULT: Final = 0x80


class Operation(enum.IntEnum):
    """The three upper bits of the byte."""

    GOAL = 0
    """The goal."""
    ACCEPTED = 1
    """From the server: it runs."""
    REFUSED = 2
    """The goal is refused, or its cancelling."""
    CONFIRM = 3
    """From the server: it has the goal. From the client: it has the result."""
    CANCEL = 4
    """From the client: it is to end. From the server: it will."""
    FEEDBACK = 5
    """How far it is."""
    RESULT = 6
    """How it has ended."""
    FORMER = 7
    """About a goal of another epoch."""
    CLAIM = 1
    """From the client: what became of it?"""


class Message(msgspec.Struct, frozen=True):
    """A record of an action, taken apart."""

    operation: Operation
    """Never FORMER."""
    number: int
    """Of the goal."""
    epoch: int | None
    """Epoch of the goal; None: the present one of its client."""
    payload: bytes
    """What follows."""


def encode_head(operation: Operation, number: int, epoch: int | None) -> bytes:
    """Return what stands between stream id and payload."""
    if epoch is None:
        return bytes((operation << 5 | number,))
    return bytes((Operation.FORMER << 5 | number, *epoch.to_bytes(2, "big"), operation << 5))


def decode_message(content: bytes) -> Message | None:
    """Take a record apart; None when it is none."""
    if not content:
        return None
    operation, number = Operation(content[0] >> 5), content[0] & 0x1F
    if operation is not Operation.FORMER:
        return Message(operation, number, None, content[1:])
    if len(content) <= FORMER_BYTES:
        return None
    inner, epoch = content[FORMER_BYTES], int.from_bytes(content[1:FORMER_BYTES], "big")
    operation = Operation(inner >> 5)
    if inner & 0x1F or operation is Operation.FORMER:
        return None
    return Message(operation, number, epoch, content[FORMER_BYTES + 1 :])


def measure_message(stream: Stream, buffer: bytes, offset: int) -> int | None:
    """Find the end of a record; None: it shows none, or it is none."""
    if offset >= len(buffer):
        return None
    operation = Operation(buffer[offset] >> 5)
    if operation is Operation.FORMER:
        offset += FORMER_BYTES
        if offset >= len(buffer):
            return None
        operation = Operation(buffer[offset] >> 5)
    offset += 1
    codec: PayloadCodec
    match operation:
        case Operation.ACCEPTED | Operation.CONFIRM | Operation.CANCEL:
            return offset
        case Operation.GOAL:
            codec = stream.codec
        case Operation.FEEDBACK:
            codec = stream.feedback_codec
        case Operation.RESULT:
            if offset < len(buffer) and buffer[offset] & _NO_RESULT:
                return offset + 1
            codec, offset = stream.response_codec, offset + 1
        case Operation.REFUSED | Operation.FORMER:
            return None
    return codec.measure(buffer, offset) if codec.delimits_itself else None


def encode_refusal(failure: GoalFailure, text: str) -> bytes:
    """Return the payload of REFUSED: failure and text, cut at a character."""
    cut = text.encode()[:LONGEST_ERROR_TEXT_BYTES].decode(errors="ignore")
    return bytes((failure,)) + cut.encode()


def decode_refusal(payload: bytes) -> tuple[GoalFailure, str] | None:
    """Return failure and text of REFUSED, or None when it is none."""
    try:
        return GoalFailure(payload[0]), payload[1:].decode()
    except (IndexError, ValueError):
        return None


def encode_result(status: GoalStatus, result: bytes | None) -> bytes:
    """Return the payload of RESULT; None: there is no result."""
    return bytes((status | _NO_RESULT,)) if result is None else bytes((status,)) + result


def decode_result(payload: bytes) -> tuple[GoalStatus, bytes | None] | None:
    """Return status and result of RESULT, or None when it is none."""
    try:
        status = GoalStatus(payload[0] & ~_NO_RESULT)
    except (IndexError, ValueError):
        return None
    return status, None if payload[0] & _NO_RESULT else payload[1:]
