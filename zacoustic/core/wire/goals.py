"""Records of actions: after the stream id one byte, three bits operation and five bits number.

======  ==========================  ===================================  =======================
number  from the client             from the server                      payload
======  ==========================  ===================================  =======================
0       GOAL                        –                                    of the goal's type
0       –                           SUCCEEDED                            of the result's type
1       CLAIM: what became of it?   ACCEPTED: it runs                    none
2       –                           REFUSED: goal or cancel              failure 1, …; no end
3       CONFIRM: has the result     CONFIRM: has the goal                none
4       CANCEL                      CANCEL: it will end                  none
5       CANCEL_AGAIN                –                                    attempt 1
5       –                           FEEDBACK                             of the feedback's type
6       –                           RESULT                               status 1, result
7       FORMER                      FORMER                               epoch 2, operation 1, …
======  ==========================  ===================================  =======================

After the failure of REFUSED stands a text, and between them, where CANCEL_AGAIN is refused, the
attempt that is refused. A client counts its attempts to cancel a goal modulo 256: CANCEL is attempt
0 and carries no byte for it. A client makes no attempt before the last one is answered.

The status of a RESULT has its highest bit set where no result follows; `80` alone is UNKNOWN, and
`81` a reminder: the result was sent before, and a client that has not received it asks by CLAIM.
SUCCEEDED is the RESULT of most goals, which needs no status. FORMER wraps a record about a goal of
another epoch of its client than the present one: the outer byte has the number, the upper bits of
the inner one the operation; its payload follows.
"""

import enum
from typing import Final

import msgspec

from zacoustic.core.streams.table import Stream
from zacoustic.core.values.payload import PayloadCodec
from zacoustic.core.wire.exchanges import (
    LONGEST_ERROR_TEXT_BYTES,
    ExchangeKey,
    decode_text,
    encode_text,
)

FORMER_BYTES: Final = 3
"""Bytes that FORMER adds."""
UNKNOWN_RESULT: Final = b"\x80"
"""Payload of the RESULT of a goal that ran when its server died."""
REMINDER: Final = b"\x81"
"""Payload of the RESULT that asks whether a RESULT has arrived."""
_NO_RESULT: Final = 0x80
_NUMBER: Final = 0x1F
_ATTEMPTS: Final = 256
_AGAIN_REFUSED: Final = 10
"""Wire code of a failure beside those of `GoalFailure`: of CANCEL_AGAIN; its attempt follows."""


class GoalKey(ExchangeKey, frozen=True):
    """Identifies a goal at both ends and across restarts."""


class GoalStatus(enum.IntEnum):
    """How a goal ended; the numbers are those of ROS 2, and on the wire."""

    UNKNOWN = 0
    """Its server died while it ran, or lost it: its outcome is unknown. No result."""
    SUCCEEDED = 4
    """The goal was reached."""
    CANCELED = 5
    """It was ended because its client asked."""
    ABORTED = 6
    """It was ended for another reason."""


class GoalFailure(enum.IntEnum):
    """Why a goal was refused, or has no result; the numbers are on the wire."""

    REJECTED = 1
    """The server's application rejects it; the application gives the text."""
    NO_SERVER = 2
    """The server's node has no server."""
    BAD_GOAL = 3
    """The server's node could not decode the goal."""
    TABLE_MISMATCH = 4
    """The two nodes hold different definitions of this stream."""
    BAD_RESULT = 5
    """This node could not decode the result."""
    TIMED_OUT = 6
    """Not answered in time, or nothing was heard of it for too long: it may run, or have run."""
    CANCELLED = 7
    """Cancelled before it was accepted: it does not run."""
    UNKNOWN = 8
    """The server died while it ran, or no longer knows it: its outcome is unknown."""
    CANCEL_REFUSED = 9
    """Only in an answer to a cancel: the goal continues."""


class Operation(enum.IntEnum):
    """The three upper bits of the byte."""

    GOAL = 0
    """The goal."""
    ACCEPTED = 1
    """From the server: it runs."""
    REFUSED = 2
    """The goal, or a cancel of it, is refused."""
    CONFIRM = 3
    """From the server: it has the goal. From the client: it has the result."""
    CANCEL = 4
    """From the client: end it, attempt 0. From the server: it will end, for any attempt."""
    FEEDBACK = 5
    """From the server: its progress."""
    RESULT = 6
    """From the server: its outcome."""
    FORMER = 7
    """About a goal of another epoch."""
    CLAIM = 1
    """From the client: what is its outcome?"""
    CANCEL_AGAIN = 5
    """From the client: end it, a later attempt."""
    SUCCEEDED = 0
    """From the server: it has succeeded and has a result."""


_BARE: Final = (Operation.ACCEPTED, Operation.CONFIRM, Operation.CANCEL)
"""The operations without a payload, in either direction."""


class Message(msgspec.Struct, frozen=True):
    """A decoded record of an action."""

    operation: Operation
    """Neither FORMER nor SUCCEEDED; the latter is decoded as RESULT."""
    number: int
    """The goal's number."""
    epoch: int | None
    """The goal's epoch; None: the present one of its client."""
    payload: bytes
    """The bytes after the head."""


def encode_head(operation: Operation, number: int, epoch: int | None) -> bytes:
    """Return the bytes between stream id and payload."""
    if epoch is None:
        return bytes((operation << 5 | number,))
    return bytes((Operation.FORMER << 5 | number, *epoch.to_bytes(2, "big"), operation << 5))


def decode_message(content: bytes, *, from_client: bool) -> Message | None:
    """Decode a record; return None if it is invalid.

    Args:
        content: The bytes after the stream id.
        from_client: Whether a client of the action has sent it.
    """
    found = _operation_at(content, 0)
    if found is None:
        return None
    operation, start = found
    number, payload = content[0] & _NUMBER, content[start:]
    epoch = None if start == 1 else int.from_bytes(content[1:FORMER_BYTES], "big")
    if _has_left_over(operation, payload, from_client=from_client):
        return None
    if operation is Operation.SUCCEEDED and not from_client:
        operation, payload = Operation.RESULT, encode_result(GoalStatus.SUCCEEDED, payload)
    return Message(operation, number, epoch, payload)


def measure_message(stream: Stream, buffer: bytes, offset: int, *, from_client: bool) -> int | None:
    """Find the end of a record; None: it does not delimit itself, or is invalid.

    Args:
        stream: The action's stream.
        buffer: The bytes with the record.
        offset: Start of the content, after the stream id.
        from_client: Whether a client of the action has sent it.
    """
    found = _operation_at(buffer, offset)
    if found is None:
        return None
    operation, offset = found
    codec: PayloadCodec
    match operation:
        case Operation.ACCEPTED | Operation.CONFIRM | Operation.CANCEL:
            return offset
        case Operation.REFUSED | Operation.RESULT if from_client:
            return None
        case Operation.CANCEL_AGAIN if from_client:
            return offset + 1
        case Operation.GOAL:
            codec = stream.codec if from_client else stream.response_codec
        case Operation.FEEDBACK:
            codec = stream.feedback_codec
        case Operation.RESULT:
            if offset < len(buffer) and buffer[offset] & _NO_RESULT:
                return offset + 1
            codec, offset = stream.response_codec, offset + 1
        case Operation.REFUSED | Operation.FORMER:
            return None
    return codec.measure(buffer, offset) if codec.delimits_itself else None


def _has_left_over(operation: Operation, payload: bytes, *, from_client: bool) -> bool:
    """Return whether a payload goes on behind the end that it shows."""
    if operation in _BARE:
        return bool(payload)
    is_result = operation is Operation.RESULT and not from_client
    return is_result and len(payload) > 1 and payload[0] >= _NO_RESULT


def _operation_at(buffer: bytes, offset: int) -> tuple[Operation, int] | None:
    """Return the operation of a record, and the offset of its payload; None: it is invalid."""
    if offset >= len(buffer):
        return None
    operation = Operation(buffer[offset] >> 5)
    if operation is not Operation.FORMER:
        return operation, offset + 1
    offset += FORMER_BYTES
    if offset >= len(buffer) or buffer[offset] & _NUMBER:
        return None
    operation = Operation(buffer[offset] >> 5)
    return None if operation is Operation.FORMER else (operation, offset + 1)


def encode_cancel(attempt: int) -> tuple[Operation, bytes]:
    """Return the operation that cancels a goal, and its payload.

    Args:
        attempt: How often its client has cancelled it before; counted modulo 256.
    """
    attempt %= _ATTEMPTS
    if not attempt:
        return Operation.CANCEL, b""
    return Operation.CANCEL_AGAIN, bytes((attempt,))


def decode_cancel(message: Message) -> int | None:
    """Return the attempt of a CANCEL or CANCEL_AGAIN, 0…255; None if it is invalid."""
    if message.operation is Operation.CANCEL:
        return 0
    return message.payload[0] if len(message.payload) == 1 else None


def is_later(attempt: int, other: int) -> bool:
    """Return whether an attempt to cancel is later than another one."""
    return 0 < (attempt - other) % _ATTEMPTS < _ATTEMPTS // 2


class GoalRefusal(msgspec.Struct, frozen=True):
    """The payload of REFUSED."""

    failure: GoalFailure
    """The reason."""
    text: str
    """The reason in one line."""
    attempt: int = 0
    """The refused attempt to cancel, if one is refused; counted modulo 256."""

    def is_of(self, attempt: int) -> bool:
        """Return whether this attempt to cancel is the refused one."""
        return self.attempt == attempt % _ATTEMPTS

    def encode(self, longest_bytes: int = 2 + LONGEST_ERROR_TEXT_BYTES) -> bytes:
        """Return the payload, its text cut at a character."""
        head = bytes((self.failure,))
        if self.attempt % _ATTEMPTS:
            head = bytes((_AGAIN_REFUSED, self.attempt % _ATTEMPTS))
        return head + encode_text(self.text, longest_bytes - len(head))


def decode_refusal(payload: bytes) -> GoalRefusal | None:
    """Return the content of REFUSED; None if it does not say which attempt to cancel is refused."""
    failure = payload[0] if payload else 0
    if failure == _AGAIN_REFUSED:
        if len(payload) < 2:
            return None
        return GoalRefusal(GoalFailure.CANCEL_REFUSED, decode_text(payload[2:]), payload[1])
    try:
        return GoalRefusal(GoalFailure(failure), decode_text(payload[1:]))
    except ValueError:
        return GoalRefusal(GoalFailure.REJECTED, "")


def encode_result(status: GoalStatus, result: bytes | None) -> bytes:
    """Return the payload of RESULT; None: there is no result."""
    return bytes((status | _NO_RESULT,)) if result is None else bytes((status,)) + result


def shorten_result(payload: bytes) -> tuple[Operation, bytes]:
    """Return the operation of a RESULT with the fewest bytes, and its payload."""
    if payload[0] == GoalStatus.SUCCEEDED:
        return Operation.SUCCEEDED, payload[1:]
    return Operation.RESULT, payload


def decode_result(payload: bytes) -> tuple[GoalStatus, bytes | None] | None:
    """Return status and result of RESULT; None if it is invalid."""
    try:
        status = GoalStatus(payload[0] & ~_NO_RESULT)
    except (IndexError, ValueError):
        return None
    return status, None if payload[0] & _NO_RESULT else payload[1:]
