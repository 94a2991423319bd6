"""Calls: a request crosses, a response or an error comes back, and the caller always hears.

A record of a service has one byte behind its stream id: two bits say request, response, error or
confirm, six bits are the *call number*, chosen by the client. Client address, the client's boot
epoch, stream and number together name a call for its server (`CallKey`).

At the client a call ends in exactly one of: response, error, time-out. Its request is repeated
until the server has answered, or has confirmed that it has the request; the answer is repeated
until the client has confirmed it. At the server a request that arrives twice runs once: the number
is remembered, and a repetition gets the answer that the first one got. With a journal that holds
over restarts: that a request is about to run is written down before it runs, and one that was
running when the server died is answered `UNKNOWN`.

Numbers come again, so both ends must agree when one is free. The client keeps three rules:

1. No call is begun before the one `WINDOW` numbers earlier has ended, and nothing of its request
   can arrive any more: so all requests under way are of `WINDOW` successive numbers.
2. A request closes at its server all calls `WINDOW` to 64 - `WINDOW` numbers earlier, since by rule
   1 they have ended; they are forgotten there.
3. A number is used again only when an answer has proved that its last use was closed so. If none
   comes, and nothing is under way, the client begins a new boot epoch instead.

Numbers come again in the client's next life, too, and an answer tells no epoch: the server may
still answer the former life. So a client takes an answer only if it has been told in this life
that the server knows its epoch (`Peer.knows_us`); then the server has given up the calls of
all other lives. Until it is told so its frames begin with HELLO or TAG, and from that the server
knows it: to such a request it gives a *named* answer, which has the epoch in it.
"""

from typing import Any, Final

import msgspec

from zacoustic.core.transport.repeating import Repetition
from zacoustic.core.wire.calls import CALL_NUMBERS, CallFailure, CallKey, CallKind
from zacoustic.errors import QueueFullError

WINDOW: Final = 16
"""Calls of one client to one service that can be under way at once."""
_LIVES: Final = 2
_NEVER: Final = 1 << 62


class RequestReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A client calls a service of this node: answer by `Engine.reply` or `Engine.reply_error`."""

    call: CallKey
    """Names the call in the answer."""
    value: Any
    """The request."""
    deadline_at: int
    """Instant after which an answer is worthless, ns."""
    age_s: float | None = None
    """How old the request was when its frame was composed, s; None: the service has no stamp."""


class ResponseReceived(msgspec.Struct, frozen=True, kw_only=True):
    """A call of this node was answered."""

    call_id: int
    """What `Engine.call` returned."""
    stream_id: int
    """The service's stream."""
    value: Any
    """The response."""
    age_s: float | None = None
    """How old it was when its frame was composed, s; None: the service has no stamp."""


class CallFailed(msgspec.Struct, frozen=True, kw_only=True):
    """A call of this node has no response."""

    call_id: int
    """What `Engine.call` returned."""
    stream_id: int
    """The service's stream."""
    failure: CallFailure
    """Why."""
    text: str
    """One line for people."""


CallEvent = RequestReceived | ResponseReceived | CallFailed
"""What the application is told of calls."""


class _Call:
    """An own call that has no answer yet."""

    __slots__ = ("index", "lane", "number", "request", "server", "stream_id")

    def __init__(self, stream_id: int, server: int, lane: "_Numbers") -> None:
        self.stream_id = stream_id
        self.server = server
        self.lane = lane
        self.index, self.number = lane.take()
        self.request: Repetition | None = None


class _Numbers:
    """Which call numbers of one service are free; calls are counted by an *index* from 0."""

    def __init__(self, first_number: int) -> None:
        self._first_number = first_number
        self._next = 0
        self._closed_below = 0
        self._open: set[int] = set()
        self._ended: dict[int, Repetition | None] = {}

    def take(self) -> tuple[int, int]:
        """Return index and number of a call that begins."""
        index = self._next
        self._next += 1
        self._open.add(index)
        return index, (self._first_number + index) % CALL_NUMBERS

    def may_begin(self, now: int, settling_ns: int) -> bool:
        """Rules 1 and 3: tell whether the next call may begin."""
        for index, request in list(self._ended.items()):
            if request is None or request.is_settled(now, settling_ns):
                del self._ended[index]
        oldest = min((*self._open, *self._ended), default=self._next)
        return self._next - oldest < WINDOW and not self.is_exhausted

    @property
    def is_exhausted(self) -> bool:
        """No answer has come for so long that the next number is not proved free."""
        return self._next - CALL_NUMBERS >= self._closed_below

    def proved(self, index: int) -> None:
        """The server has seen the request of this index: it has closed what is far behind."""
        if self._closed_below >= index - (CALL_NUMBERS - WINDOW):
            self._closed_below = max(self._closed_below, index - WINDOW + 1)

    def ended(self, index: int, request: Repetition | None) -> None:
        """A call has ended; its request is not sent any more."""
        self._open.discard(index)
        self._ended[index] = request


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
        self._lanes: dict[tuple[int, int], _Numbers] = {}
        self._next_call_id = 1
        self.settling_ns = 0
        """A request arrives for the last time so long after its last transmission, at most, ns."""

    def begin(self, stream_id: int, server: int, now: int) -> tuple[int, int]:
        """Reserve a number for a call; returns ``(call_id, number)``.

        Args:
            stream_id: The service's stream.
            server: Address of its server.
            now: The instant.

        Raises:
            QueueFullError: As many calls as can be under way are, or have been just now.
        """
        lane = self._lane(server, stream_id)
        if not lane.may_begin(now, self.settling_ns):
            raise QueueFullError(
                f"stream {stream_id}: {WINDOW} calls to node {server} are under way, or no number "
                "is proved free",
                hint="wait for answers, or set a shorter timeout_s",
            )
        call_id = self._next_call_id
        self._next_call_id += 1
        call = self._calls[call_id] = _Call(stream_id, server, lane)
        self._by_number[(server, stream_id, call.number)] = call_id
        return call_id, call.number

    def needs_new_epoch(self, stream_id: int, server: int) -> bool:
        """Tell whether only a new boot epoch frees numbers, and none is in use."""
        return not self._calls and self._lane(server, stream_id).is_exhausted

    def begin_epoch(self, first_number: int) -> None:
        """Forget all numbers: those of a new epoch are others."""
        self._first_number = first_number
        self._lanes.clear()

    def attach(self, call_id: int, request: Repetition) -> None:
        """Remember the request, to stop it when the call ends."""
        self._calls[call_id].request = request

    def request(self, call_id: int) -> Repetition | None:
        """Return the request of a call that has no answer yet."""
        return self._calls[call_id].request

    def find(self, server: int, stream_id: int, number: int) -> int | None:
        """Return the id of the call that an answer belongs to, or None."""
        return self._by_number.get((server, stream_id, number))

    def proved(self, call_id: int) -> None:
        """The server has shown that it has the request of a call."""
        call = self._calls[call_id]
        call.lane.proved(call.index)

    def respond(self, call_id: int, value: object) -> ResponseReceived:
        """End a call with its response; its request has been stopped."""
        call = self._end(call_id)
        return ResponseReceived(call_id=call_id, stream_id=call.stream_id, value=value)

    def fail(self, call_id: int, failure: CallFailure, text: str) -> CallFailed:
        """End a call without one; its request has been stopped."""
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
        """Forget the numbers of a node to which no call is under way."""
        for place in [place for place in self._lanes if place[0] == server]:
            del self._lanes[place]

    def __len__(self) -> int:
        return len(self._calls)

    def _lane(self, server: int, stream_id: int) -> _Numbers:
        lane = self._lanes.get((server, stream_id))
        if lane is None:
            lane = self._lanes[server, stream_id] = _Numbers(self._first_number)
        return lane

    def _end(self, call_id: int) -> _Call:
        call = self._calls.pop(call_id)
        del self._by_number[(call.server, call.stream_id, call.number)]
        call.lane.ended(call.index, call.request)
        return call


class Answer(msgspec.Struct, frozen=True):
    """What a call was answered with, kept for a repetition of its request."""

    kind: CallKind
    payload: bytes


class Served:
    """A request that this node has taken."""

    __slots__ = (
        "abandoned_at", "answer", "deadline_at", "forget_at", "is_closed", "is_journalled",
        "is_named",
        "repetition",
    )  # fmt: skip

    def __init__(self, deadline_at: int, forget_at: int) -> None:
        self.deadline_at = deadline_at
        """Instant after which the client does not wait any more, ns."""
        self.forget_at = forget_at
        """Instant after which no repetition of the request can arrive, ns."""
        self.answer: Answer | None = None
        self.repetition: Repetition | None = None
        """The answer on its way."""
        self.is_journalled = False
        """The journal has it."""
        self.is_named = True
        """The client does not know that this node knows its epoch."""
        self.is_closed = False
        """The client has the answer."""
        self.abandoned_at: int | None = None
        """Since when another life of the client is heard, ns."""

    @property
    def is_answerable(self) -> bool:
        """The answer has to go to the client."""
        waits = self.answer is not None and self.is_journalled
        return waits and not self.is_closed and self.abandoned_at is None


class ServerCalls:
    """The calls that this node serves: those of two lives of each client and service at most."""

    def __init__(self) -> None:
        self._served: dict[CallKey, Served] = {}

    def find(self, key: CallKey) -> Served | None:
        """Return a call that is known."""
        return self._served.get(key)

    def take(self, key: CallKey, *, timeout_ns: int, settling_ns: int, now: int) -> Served | None:
        """Note a new request; None when there are too many."""
        rivals = sum(
            (other.client, other.stream_id) == (key.client, key.stream_id) for other in self._served
        )
        if rivals >= _LIVES * CALL_NUMBERS:
            return None
        served = self._served[key] = Served(0, 0)
        self.begin(served, timeout_ns=timeout_ns, settling_ns=settling_ns, now=now)
        return served

    def begin(self, served: Served, *, timeout_ns: int, settling_ns: int, now: int) -> None:
        """Begin the times of a call."""
        served.deadline_at = now + timeout_ns
        # The client repeats for `timeout_ns`; that again for a link that holds back a frame.
        served.forget_at = now + 2 * (timeout_ns + settling_ns)

    def closed_by(self, key: CallKey, *, settling_ns: int, now: int) -> list[CallKey]:
        """Return the calls that a new request shows to be over.

        Those that have ended at its client (rule 2); and those of lives that were over before
        anything was heard of this one: by now nothing of them can arrive any more.
        """
        return [
            other
            for other, served in self._served.items()
            if other.client == key.client
            and (
                _is_closed(other, key)
                if other.epoch == key.epoch
                else served.abandoned_at is not None
                and served.abandoned_at + 2 * settling_ns <= now
            )
        ]

    def answerable(self, key: CallKey, now: int) -> Served | None:
        """Return a call that waits for its answer, or None: it is too late."""
        served = self._served.get(key)
        if served is None or served.answer is not None or served.deadline_at <= now:
            return None
        return served

    def of(self, client: int) -> list[tuple[CallKey, Served]]:
        """Return the calls of a client, of all its lives."""
        return [(key, each) for key, each in self._served.items() if key.client == client]

    def forget(self, key: CallKey) -> Served | None:
        """Forget a call."""
        return self._served.pop(key, None)

    def restore(self, key: CallKey, answer: Answer) -> Served:
        """Go on with a call of a former life of this node; its times begin at the link's UP."""
        served = self._served[key] = Served(_NEVER, _NEVER)
        served.answer, served.is_journalled = answer, True
        return served

    def restored(self) -> list[tuple[CallKey, Served]]:
        """Return the calls whose times have not begun."""
        return [(key, each) for key, each in self._served.items() if each.deadline_at == _NEVER]


def _is_closed(other: CallKey, by: CallKey) -> bool:
    distance = (by.number - other.number) % CALL_NUMBERS
    return other.stream_id == by.stream_id and WINDOW <= distance <= CALL_NUMBERS - WINDOW
