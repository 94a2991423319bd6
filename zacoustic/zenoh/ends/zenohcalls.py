"""Calls on a Zenoh network: queries of its clients, and a `get` to one of its servers.

A query is held until it has its answer, or an error; it is never left without a reply. Zenoh does
not tell how long the caller waits: 10 s by default, which is short for sound. Of the replies to a
`get` the first good one is the answer; without one, the first error. Without any reply there is no
server; but if a server was there when it was asked, it has ended without an answer, and the outcome
is unknown.
"""

import asyncio
from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import partial
from typing import Final

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.core.base.qos import Priority
from zacoustic.core.engine.events import CallFailure
from zacoustic.errors import PayloadInvalidError, PayloadTooLargeError, ZacousticError
from zacoustic.zenoh.ends.calls import CallClient, CancelCall, TakeCall, TakenCall
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery
from zacoustic.zenoh.session.asking.question import Question
from zacoustic.zenoh.session.marker import read_marker
from zacoustic.zenoh.session.session import ZenohSession

# Zenoh's own time limit is above ours, because our error says more.
_BEHIND_S: Final = 1.0


class CallForm(ABC):
    """The local form of the messages of one service."""

    @property
    @abstractmethod
    def key(self) -> str:
        """The local key."""

    @abstractmethod
    def is_marked(self, attachment: bytes) -> bool:
        """Return whether a call with this attachment came from the channel."""

    @abstractmethod
    def read_request(self, payload: bytes, encoding: object) -> tuple[object, str]:
        """Read a program's request; returns the value, and the encoding it wants in return.

        Raises:
            PayloadInvalidError: It cannot be read.
        """

    @abstractmethod
    def write_response(self, value: object, encoding: str) -> tuple[bytes, str]:
        """Write an answer in the wanted encoding; returns it with its encoding.

        Raises:
            PayloadInvalidError: The encoding cannot carry it.
        """

    @abstractmethod
    def write_request(self, value: object) -> tuple[bytes, str]:
        """Write a request for the serving program; returns it with its encoding.

        Raises:
            PayloadInvalidError: The encoding cannot carry it.
        """

    @abstractmethod
    def read_response(self, payload: bytes, encoding: object) -> object:
        """Read the answer of the serving program.

        Raises:
            PayloadInvalidError: It cannot be read.
        """

    @abstractmethod
    def answer_mark(self, asked: bytes | None) -> bytes | None:
        """Return the attachment of the answer to a query with the attachment `asked`."""


class ZenohCallers:
    """The clients of one service on a Zenoh network.

    Args:
        form: Reads and writes their messages.
        take: Takes their calls.
        timeout_s: Time limit of an answer, s.
        clock: Source of instants.
        takes_marked: Also calls from the channel.
        complain: Takes requests that cannot be passed on: a word, a line of text.
    """

    def __init__(
        self,
        form: CallForm,
        take: TakeCall,
        *,
        timeout_s: float,
        clock: Clock,
        takes_marked: bool,
        complain: Callable[[str, str], object],
    ) -> None:
        self._form = form
        self._clock = clock
        self._take = take
        self._timeout_s = timeout_s
        self._takes_marked = takes_marked
        self._complain = complain

    def take(self, held: HeldQuery) -> None:
        """Take a query."""
        form = self._form
        if held.key != form.key:
            # A program that browses with a wildcard does not mean to call a service on a vehicle.
            text = f"a wildcard calls no service, only {form.key} itself does"
            held.refuse(CallFailure.BAD_REQUEST, text)
            return
        try:
            call = ZenohTakenCall(held, form, clock=self._clock, timeout_s=self._timeout_s)
            if call.is_marked and not self._takes_marked:
                text = "the call came off the channel, it does not go back"
                call.fail(CallFailure.NO_SERVER, text)
            else:
                self._take(call)
        except ZacousticError as error:
            is_wrong = isinstance(error, PayloadInvalidError | PayloadTooLargeError)
            failure = CallFailure.BAD_REQUEST if is_wrong else CallFailure.NO_SERVER
            self._complain("request", str(error))
            held.refuse(failure, str(error))


class ZenohTakenCall(TakenCall):
    """A query that waits for its answer.

    Raises:
        PayloadInvalidError: The query cannot be read.
    """

    def __init__(self, held: HeldQuery, form: CallForm, *, clock: Clock, timeout_s: float) -> None:
        query = held.query
        self._asked = query.attachment.to_bytes() if query.attachment is not None else None
        payload = query.payload.to_bytes() if query.payload is not None else b""
        value, self._encoding = form.read_request(payload, query.encoding)
        marker = read_marker(self._asked)
        super().__init__(
            value,
            client=marker.acoustic if marker is not None else None,
            call_id=marker.call if marker is not None else None,
            deadline_at=clock() + seconds_to_ns(timeout_s),
        )
        self.is_marked = self._asked is not None and form.is_marked(self._asked)
        """Whether it came off the channel."""
        self._held = held
        self._form = form
        self._clock = clock

    def reply(self, value: object) -> bool:
        """Answer."""
        payload, encoding = self._form.write_response(value, self._encoding)
        mark = self._form.answer_mark(self._asked)
        answer = Answer(key=self._form.key, payload=payload, encoding=encoding, attachment=mark)
        return self._held.answer([answer]) and self._is_in_time()

    def fail(self, failure: CallFailure, text: str) -> bool:
        """Answer with an error."""
        return self._held.refuse(failure, text) and self._is_in_time()

    def _is_in_time(self) -> bool:
        return self._clock() < self.deadline_at


class ZenohServer:
    """The server of one service on a Zenoh network.

    Args:
        zenoh_session: The session.
        form: Reads and writes its messages.
        priority: Priority of the queries.
        complain: Takes answers that cannot be passed on: a word, a line of text.
        nobody_text: What clients hear if there is no server.
    """

    def __init__(
        self,
        zenoh_session: ZenohSession,
        form: CallForm,
        *,
        priority: Priority,
        complain: Callable[[str, str], object],
        nobody_text: str = "",
    ) -> None:
        self._zenoh_session = zenoh_session
        self._form = form
        self._priority = priority
        self._complain = complain
        self._nobody_text = nobody_text
        self._loop = asyncio.get_running_loop()
        self._asked: dict[Question, tuple[CallClient, asyncio.TimerHandle]] = {}

    def give(
        self,
        value: object,
        client: CallClient,
        *,
        limit_s: float,
        mark: bytes | None = None,
        is_there: bool = False,
    ) -> CancelCall:
        """Send a call to the server.

        Args:
            value: The request.
            client: Hears the outcome.
            limit_s: Time limit for the answer, s.
            mark: A gateway's mark of the origin.
            is_there: Whether a server is known to be there.

        Raises:
            PayloadInvalidError: The encoding cannot carry the request.
        """
        payload, encoding = self._form.write_request(value)
        question = Question(
            self._zenoh_session,
            self._form.key,
            partial(self._settle, is_there),
            payload,
            encoding=encoding,
            priority=self._priority,
            timeout_s=limit_s + _BEHIND_S,
            attachment=mark,
        )
        timer = self._loop.call_later(limit_s, self._expire, question, limit_s)
        self._asked[question] = client, timer
        return partial(self._forget, question)

    def close(self) -> None:
        """Wait for no answers any more."""
        for question in tuple(self._asked):
            self._forget(question)

    def _settle(self, was_there: bool, question: Question) -> None:
        asked = self._asked.pop(question, None)
        if asked is None:
            return
        client, timer = asked
        timer.cancel()
        if question.good is None:
            ended = CallFailure.UNKNOWN if was_there else CallFailure.NO_SERVER
            client.fail(*(question.error or (ended, "" if was_there else self._nobody_text)))
            return
        try:
            value = self._form.read_response(*question.good)
        except PayloadInvalidError as error:
            self._complain("response", str(error))
            client.fail(CallFailure.BAD_RESPONSE, str(error))
            return
        try:
            client.reply(value)
        except ZacousticError as error:  # the engine has informed the caller
            self._complain("response", str(error))

    def _expire(self, question: Question, limit_s: float) -> None:
        client, _ = self._asked[question]
        self._forget(question)
        client.fail(CallFailure.TIMED_OUT, f"no answer within {limit_s:g} s")

    def _forget(self, question: Question) -> None:
        asked = self._asked.pop(question, None)
        if asked is not None:
            asked[1].cancel()
            question.cancel()
