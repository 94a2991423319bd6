"""Calls: a request crosses, a response or an error comes back, and the caller always hears.

A service record has one byte after its stream id: two bits give its kind (request, response, error
or confirm), six bits the *call number*, which the client chooses. For the server, client address,
client boot epoch, stream and number together identify a call (`CallKey`).

At the client, a call ends in exactly one of response, error or time-out. The client repeats its
request until the server answers or confirms that it has the request; the server repeats the answer
until the client confirms it. At the server, a request that arrives twice runs once: the server
remembers the number and gives a repetition the same answer. With a journal this holds across
restarts: the server journals a request before it runs, and after a restart answers `UNKNOWN` to a
request that was running.

Numbers are reused by the rules of `zacoustic.core.transport.exchanges.numbers`. If no number is
free and no call is under way, the client begins a new boot epoch.

The client's next boot epoch uses the same numbers, and a plain answer carries no epoch: the server
may still answer a call of an earlier epoch. So a client accepts a plain answer only after it has
learned in this boot epoch that the server knows its epoch (`Peer.knows_us`); by then the server has
abandoned the calls of all other epochs. Until then the client's frames begin with HELLO or TAG, and
the server replies with a *named* answer, which carries the epoch.
"""

from collections.abc import Iterator
from typing import Any

import msgspec

from zacoustic.core.base.sizes import Numbering
from zacoustic.core.transport.exchanges.numbers import NumberWindow
from zacoustic.core.transport.exchanges.repeating import Repetition
from zacoustic.core.transport.exchanges.taken import TakenExchange
from zacoustic.core.wire.calls import CallFailure, CallKey, CallKind
from zacoustic.errors import QueueFullError


class RequestReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A client calls a service of this node; answer with `Engine.reply` or `Engine.reply_error`."""

    call: CallKey
    """Identifies the call in the answer."""
    value: Any
    """The request."""
    deadline_at: int
    """Instant after which an answer is worthless, ns."""
    age_s: float | None = None
    """Age of the request as it arrived, s; None: unknown, or the service has no stamp."""


class ResponseReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A call of this node has its response."""

    call_id: int
    """The return value of `Engine.call`."""
    stream_id: int
    """The service's stream."""
    value: Any
    """The response."""
    age_s: float | None = None
    """Age of the response as it arrived, s; None: unknown, or the service has no stamp."""


class CallFailed(msgspec.Struct, frozen=True, kw_only=True):
    """A call of this node ended without a response."""

    call_id: int
    """The return value of `Engine.call`."""
    stream_id: int
    """The service's stream."""
    failure: CallFailure
    """The reason."""
    text: str
    """One line for people."""


CallEvent = RequestReceived | ResponseReceived | CallFailed
"""The events that report calls to the application."""


class _Call:
    """A call of this node that has no answer yet."""

    __slots__ = ("index", "lane", "number", "request", "server", "stream_id")

    def __init__(self, stream_id: int, server: int, lane: NumberWindow) -> None:
        self.stream_id = stream_id
        self.server = server
        self.lane = lane
        self.index, self.number = lane.take()
        self.request: Repetition | None = None


class ClientCalls:
    """The calls that this node has made.

    Args:
        epoch: Boot epoch of this node.
        ids: Assigns the ids of calls.
        numbering: How they are numbered.
    """

    def __init__(self, epoch: int, ids: Iterator[int], numbering: Numbering) -> None:
        self._numbering = numbering
        self._epoch = epoch
        self._ids = ids
        self._calls: dict[int, _Call] = {}
        self._by_number: dict[tuple[int, int, int], int] = {}
        self._lanes: dict[tuple[int, int], NumberWindow] = {}
        self.settling_ns = 0
        """The longest time from the last transmission of a request to its last arrival, ns."""

    def begin(self, stream_id: int, server: int, now: int) -> tuple[int, int]:
        """Reserve a number for a call; return ``(call_id, number)``.

        Args:
            stream_id: The service's stream.
            server: Address of its server.
            now: The instant.

        Raises:
            QueueFullError: As many calls as allowed are under way, or ended too recently.
        """
        lane = self._lane(server, stream_id)
        if not lane.may_begin(now, self.settling_ns):
            raise QueueFullError(
                f"stream {stream_id}: {self._numbering.window} calls to node {server} are under "
                "way, or no number is proved free",
                hint="wait for answers, or set a shorter timeout_s",
            )
        call_id = next(self._ids)
        call = self._calls[call_id] = _Call(stream_id, server, lane)
        self._by_number[(server, stream_id, call.number)] = call_id
        return call_id, call.number

    def needs_new_epoch(self, stream_id: int, server: int) -> bool:
        """Return whether numbers are exhausted, no call is open, and so a new epoch may begin."""
        return not self._calls and self._lane(server, stream_id).is_stuck

    def begin_epoch(self, epoch: int) -> None:
        """Forget all numbers: a new epoch numbers its calls afresh."""
        self._epoch = epoch
        self._lanes.clear()

    def attach(self, call_id: int, request: Repetition) -> None:
        """Attach the request to its call, so that it stops when the call ends."""
        self._calls[call_id].request = request

    def request(self, call_id: int) -> Repetition | None:
        """Return the request of a call that has no answer yet."""
        return self._calls[call_id].request

    def find(self, server: int, stream_id: int, number: int) -> int | None:
        """Return the id of the call that an answer belongs to, or None."""
        return self._by_number.get((server, stream_id, number))

    def proved(self, call_id: int, now: int) -> None:
        """Note that the server has the request of a call."""
        call = self._calls[call_id]
        call.lane.proved(call.index, now + self.settling_ns)

    def confirms(self, server: int, stream_id: int, number: int, now: int) -> None:
        """Note that an answer is being confirmed, which must not confirm that of a later call."""
        lane = self._lanes.get((server, stream_id))
        if lane is not None:
            lane.rest(number, now + self.settling_ns)

    def respond(self, call_id: int, value: object) -> ResponseReceived:
        """End a call with its response; the caller has stopped its request."""
        call = self._end(call_id)
        return ResponseReceived(call_id=call_id, stream_id=call.stream_id, value=value)

    def fail(self, call_id: int, failure: CallFailure, text: str) -> CallFailed:
        """End a call without a response; the caller has stopped its request."""
        call = self._end(call_id)
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

    def to_node(self, server: int) -> list[int]:
        """Return the ids of the unanswered calls to one node."""
        return [call_id for call_id, call in self._calls.items() if call.server == server]

    def forget(self, server: int) -> None:
        """Forget the call numbers of a node; no call to it may be open."""
        for place in [place for place in self._lanes if place[0] == server]:
            del self._lanes[place]

    def __len__(self) -> int:
        return len(self._calls)

    def _lane(self, server: int, stream_id: int) -> NumberWindow:
        lane = self._lanes.get((server, stream_id))
        if lane is None:
            lane = self._lanes[server, stream_id] = NumberWindow(self._numbering, self._epoch)
        return lane

    def _end(self, call_id: int) -> _Call:
        call = self._calls.pop(call_id)
        del self._by_number[(call.server, call.stream_id, call.number)]
        call.lane.ended(call.index, () if call.request is None else (call.request,))
        return call


class CallAnswer(msgspec.Struct, frozen=True):
    """The answer to a call, kept for repetitions of its request."""

    kind: CallKind
    payload: bytes


class Served(TakenExchange[CallKey]):
    """A request that this node has accepted."""

    __slots__ = ("abandoned_at", "answer", "answered_at", "is_closed", "is_named")

    def __init__(self, key: CallKey) -> None:
        super().__init__(key)
        self.answer: CallAnswer | None = None
        self.answered_at: int | None = None
        """Instant at which it was answered, ns; None: not yet, or before a restart."""
        self.is_named = True
        """Whether answers carry the client's epoch: the client may not know that this node has
        it."""
        self.is_closed = False
        """Whether the client has the answer."""
        self.abandoned_at: int | None = None
        """Instant since which another boot epoch of the client is heard, ns."""

    @property
    def is_answerable(self) -> bool:
        """Whether the answer is to be sent to the client."""
        waits = self.answer is not None and self.is_journalled
        return waits and not self.is_closed and self.abandoned_at is None
