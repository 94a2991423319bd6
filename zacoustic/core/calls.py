"""Calls: a request crosses, a response or an error comes back, and the caller always hears.

A record of a service has one byte behind its stream id: two bits say request, response, error or
confirm, six bits are the *call number*, chosen by the client. Client address, the client's boot
epoch, stream and number together name a call for its server (`CallKey`).

At the client a call ends in exactly one of: response, error, time-out. At the server a request
that arrives twice runs
once: the number is remembered, and a repetition gets the answer that the first one got, or none
while it still runs. The client in turn does not use a number again before the server must have
forgotten it; both derive that time from the call's time-out and from the *settling time* of the
link, within which a duplicate can still arrive.

Requests are transmitted once here; repetition, journalled execution and `confirm` belong to the
reliable transport.
"""

import enum
from typing import Final

import msgspec

from zacoustic.core.events import (
    CallFailed,
    CallFailure,
    CallKey,
    RequestReceived,
    ResponseReceived,
)
from zacoustic.errors import QueueFullError

CALL_NUMBERS: Final = 64
"""Calls of one client to one service that can be distinguished."""
_LIVES: Final = 2
LONGEST_ERROR_TEXT_BYTES: Final = 48
"""An error's text is cut to this many bytes of UTF-8: it is for people, and airtime is dear."""


class CallKind(enum.IntEnum):
    """The two upper bits of the call byte."""

    REQUEST = 0
    RESPONSE = 1
    ERROR = 2
    CONFIRM = 3


def encode_call_byte(kind: CallKind, number: int) -> int:
    """Return the byte behind the stream id of a service's record."""
    return kind << 6 | number


def decode_call_byte(byte: int) -> tuple[CallKind, int]:
    """Return kind and number of a call byte."""
    return CallKind(byte >> 6), byte & 0x3F


def encode_error(failure: CallFailure, text: str) -> bytes:
    """Return the payload of an error: its number and its text, cut at a character."""
    cut = text.encode()[:LONGEST_ERROR_TEXT_BYTES].decode(errors="ignore")
    return bytes((failure,)) + cut.encode()


def decode_error(payload: bytes) -> tuple[CallFailure, str] | None:
    """Return number and text of an error's payload, or None when it is none."""
    try:
        return CallFailure(payload[0]), payload[1:].decode()
    except (IndexError, ValueError):
        return None


class _Call:
    """An own call that has no answer yet."""

    __slots__ = ("deadline_at", "number", "served_ns", "server", "stream_id")

    def __init__(
        self, stream_id: int, server: int, number: int, deadline_at: int, served_ns: int
    ) -> None:
        self.stream_id = stream_id
        self.server = server
        self.number = number
        self.deadline_at = deadline_at
        self.served_ns = served_ns


class ClientCalls:
    """The calls that this node has made.

    Args:
        first_number: The call number to begin with, 0…63; another one in each life, so that a late
            answer to a call of the life before meets no call of this one.
    """

    def __init__(self, first_number: int = 0) -> None:
        self._first_number = first_number
        self._calls: dict[int, _Call] = {}
        self._by_number: dict[tuple[int, int, int], int] = {}
        self._free_at: dict[tuple[int, int], list[int]] = {}
        self._next_number: dict[tuple[int, int], int] = {}
        self._next_call_id = 1

    def begin(
        self, stream_id: int, server: int, *, deadline_at: int, served_ns: int, now: int
    ) -> tuple[int, int]:
        """Reserve a number for a call; returns ``(call_id, number)``.

        Args:
            stream_id: The service's stream.
            server: Address of its server.
            deadline_at: Instant at which the caller gives up, ns.
            served_ns: How long the server may take from the request's arrival on, ns.
            now: The instant.

        Raises:
            QueueFullError: All numbers are in use or too fresh to be used again.
        """
        lane = (server, stream_id)
        free_at = self._free_at.setdefault(lane, [0] * CALL_NUMBERS)
        first = self._next_number.get(lane, self._first_number)
        for step in range(CALL_NUMBERS):
            number = (first + step) % CALL_NUMBERS
            if free_at[number] <= now and (server, stream_id, number) not in self._by_number:
                break
        else:
            raise QueueFullError(
                f"stream {stream_id}: all {CALL_NUMBERS} call numbers to node {server} are in use",
                hint="wait for answers, or set a shorter timeout_s",
            )
        self._next_number[lane] = (number + 1) % CALL_NUMBERS
        call_id = self._next_call_id
        self._next_call_id += 1
        self._calls[call_id] = _Call(stream_id, server, number, deadline_at, served_ns)
        self._by_number[(server, stream_id, number)] = call_id
        return call_id, number

    def find(self, server: int, stream_id: int, number: int) -> int | None:
        """Return the id of the call that an answer belongs to, or None."""
        return self._by_number.get((server, stream_id, number))

    def respond(
        self, call_id: int, value: object, *, now: int, settling_ns: int
    ) -> ResponseReceived:
        """End a call with its response."""
        call = self._end(call_id, now + 2 * settling_ns)
        return ResponseReceived(call_id=call_id, stream_id=call.stream_id, value=value)

    def fail(
        self, call_id: int, failure: CallFailure, text: str, *, now: int, settling_ns: int
    ) -> CallFailed:
        """End a call without one."""
        call = self._calls[call_id]
        answered = failure not in (CallFailure.TIMED_OUT, CallFailure.CANCELLED)
        # The request may have left at the deadline, and the answer when the server's time was up.
        late_at = call.deadline_at + call.served_ns
        self._end(call_id, (now if answered else late_at) + 2 * settling_ns)
        return CallFailed(call_id=call_id, stream_id=call.stream_id, failure=failure, text=text)

    def locate(self, call_id: int) -> tuple[int, int, int] | None:
        """Return ``(stream_id, server, number)`` of a call that has no answer yet, or None."""
        call = self._calls.get(call_id)
        return None if call is None else (call.stream_id, call.server, call.number)

    def to(self, server: int, stream_id: int) -> list[int]:
        """Return the ids of the unanswered calls to one service."""
        return [
            call_id
            for call_id, call in self._calls.items()
            if (call.server, call.stream_id) == (server, stream_id)
        ]

    def due(self, now: int) -> list[int]:
        """Return the ids of the calls whose deadline has come."""
        return [call_id for call_id, call in self._calls.items() if call.deadline_at <= now]

    def next_deadline_at(self) -> int | None:
        """Return the earliest deadline, ns, or None."""
        return min((call.deadline_at for call in self._calls.values()), default=None)

    def _end(self, call_id: int, reuse_at: int) -> _Call:
        call = self._calls.pop(call_id)
        del self._by_number[(call.server, call.stream_id, call.number)]
        self._free_at[(call.server, call.stream_id)][call.number] = reuse_at
        return call


class Answer(msgspec.Struct, frozen=True):
    """What a call was answered with, kept for a repetition of its request."""

    kind: CallKind
    payload: bytes


class _Served:
    """A request that this node has taken."""

    __slots__ = ("answer", "deadline_at", "forget_at", "is_abandoned")

    def __init__(self, deadline_at: int) -> None:
        self.deadline_at = deadline_at
        self.forget_at = deadline_at
        self.answer: Answer | None = None
        self.is_abandoned = False


class ServerCalls:
    """The calls that this node serves: those of two lives of each client and service at most."""

    def __init__(self) -> None:
        self._served: dict[CallKey, _Served] = {}

    def take(self, key: CallKey, *, timeout_ns: int, now: int) -> Answer | bool:
        """Note a request.

        Returns:
            True when it is new and is to be served; an `Answer` when it is a repetition of an
            answered one, to be sent again; False when it is a repetition of one that still runs,
            or that nobody waits for any more.
        """
        self._forget(now)
        served = self._served.get(key)
        if served is not None:
            return (not served.is_abandoned and served.answer) or False
        rivals = sum(
            (other.client, other.stream_id) == (key.client, key.stream_id) for other in self._served
        )
        if rivals >= _LIVES * CALL_NUMBERS:
            return False
        self._served[key] = _Served(now + timeout_ns)
        return True

    def request(self, key: CallKey, value: object) -> RequestReceived:
        """Return the event of a request that was taken."""
        deadline_at = self._served[key].deadline_at
        return RequestReceived(call=key, value=value, deadline_at=deadline_at)

    def answer(self, key: CallKey, answer: Answer, *, now: int, settling_ns: int) -> int | None:
        """Note the answer; returns the call's deadline, or None if it comes too late."""
        served = self._served.get(key)
        if served is None or served.answer is not None or served.deadline_at <= now:
            return None
        if served.is_abandoned:
            return None
        served.answer = answer
        served.forget_at = now + settling_ns
        return served.deadline_at

    def abandon(self, client: int, epoch: int, *, now: int, settling_ns: int) -> list[CallKey]:
        """Give up the calls of a client's other lives and return them.

        They stay known until no repetition of their requests can arrive, so that none runs again.
        """
        gone = [key for key in self._served if key.client == client and key.epoch != epoch]
        for key in gone:
            served = self._served[key]
            if not served.is_abandoned:
                served.is_abandoned = True
                served.forget_at = now + settling_ns
        return gone

    def _forget(self, now: int) -> None:
        for key in [key for key, served in self._served.items() if served.forget_at <= now]:
            del self._served[key]
