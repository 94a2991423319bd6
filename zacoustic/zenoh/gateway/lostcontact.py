"""Actions at lost contact: a local service is called, or a key published, until it is answered.

The engine says when contact is lost (`zacoustic.core.peers.lostcontact`); this module acts, on the
local network alone. It calls the service at once, and again after a growing pause, until a reply
says that it was done: an error reply, a reply with ``success: false``, no reply in time and nobody
that serves are all failures. A sample is put again until somebody subscribes to its key. When
contact is back, no further attempt begins.

A call must be harmless twice: an answer may be lost, and a restart may repeat it. All attempts of
one loss have the same `call` in their mark, until the gateway restarts.

Each attempt has a limit of its own on the loop, so an attempt that Zenoh never ends is one more
failure and not the end of the attempts.
"""

import asyncio
import logging
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final

import msgspec
import zenoh

from zacoustic.config.lostcontact import LostContactAction
from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.qos import Priority
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailure, CallKey, ContactLost, ContactRestored
from zacoustic.core.peers.lostcontact import ContactPhase, Countdown
from zacoustic.core.values.encoding import TYPED_ENCODINGS, decode_application
from zacoustic.errors import PayloadInvalidError
from zacoustic.run.inbox import tell_loop
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.dialect.dialects import ServiceDialect
from zacoustic.zenoh.gateway.notices import LostContactNotice, Notify
from zacoustic.zenoh.gateway.status.dates import Dates
from zacoustic.zenoh.session.asking.question import Question
from zacoustic.zenoh.session.marker import Marker
from zacoustic.zenoh.session.session import ZenohSession, zenoh_priority

FIRST_PAUSE_S: Final = 1.0
"""Pause after the first attempt that failed, s; each further one is twice as long."""
LAST_PAUSE_S: Final = 30.0
"""The longest pause, s: a program that starts again serves within half a minute."""
_GRACE_S: Final = 5.0
"""An attempt that has not ended so long after its time-out has failed, s."""
_LONGEST_TEXT: Final = 200
"""Characters of a failure or an answer that are shown."""

_logger = logging.getLogger(__name__)


def pause_s(attempts: int) -> float:
    """Return the pause after the last of so many failed attempts, s."""
    doubled = min(attempts - 1, 16)  # more makes no difference
    return min(LAST_PAUSE_S, FIRST_PAUSE_S * float(1 << doubled))


class _Attempts:
    """The attempts of one action in the present loss."""

    def __init__(self, action: LostContactAction) -> None:
        self.action = action
        self.is_acting = False
        self.count = 0
        self.failure = ""
        self.answer = ""
        self.loss = ""
        self.question: Question | None = None
        self.timer: asyncio.TimerHandle | None = None
        self.is_served: bool | None = None
        """Whether somebody serves the service or subscribes to the key; None: not known yet."""

    def stop(self) -> Question | None:
        """Begin no further attempt; return the question that waits."""
        self.is_acting = False
        if self.timer is not None:
            self.timer.cancel()
            self.timer = None
        question, self.question = self.question, None
        return question


class LostContactActions:
    """The actions of one gateway; for the loop, except `declare` and `undeclare`.

    Args:
        address: Acoustic address of the gateway.
        actions: What it does.
        runner: Runs the engine, which says when.
        zenoh_session: The session of the local programs.
        dialects: The local form of each service, by stream id.
        dates: Dates of the documents.
        tell: Takes notices.
    """

    def __init__(
        self,
        address: int,
        actions: Sequence[LostContactAction],
        runner: LinkRunner,
        zenoh_session: ZenohSession,
        dialects: Mapping[int, ServiceDialect],
        *,
        dates: Dates,
        tell: Notify,
    ) -> None:
        self._address = address
        self._runner = runner
        self._zenoh_session = zenoh_session
        self._dialects = dialects
        self._dates = dates
        self._tell = tell
        self._loop = asyncio.get_running_loop()
        self._attempts = {each.rule.name: _Attempts(each) for each in actions}
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._watchers: list[zenoh.Querier | zenoh.MatchingListener[None]] = []
        self._is_closed = False

    def declare(self) -> None:
        """Declare the keys that may be published, and watch who would act; in the worker.

        Whether there is somebody is known before contact is lost, when it can still be mended.
        """
        for each in self._attempts.values():
            declared: zenoh.Publisher | zenoh.Querier
            if each.action.is_call:
                declared = self._zenoh_session.session.declare_querier(
                    zenoh.KeyExpr(self._key(each.action)),
                    allowed_destination=zenoh.Locality.REMOTE,
                )
                self._watchers.append(declared)
            else:
                declared = self._publisher(each.action)
            listener = declared.declare_matching_listener(
                self._zenoh_session.callback(partial(self._served, each))
            )
            self._watchers.append(listener)
            status: Any = declared.matching_status  # an object, not the bool that the stub says
            self._served(each, status, is_first=True)

    def undeclare(self) -> None:
        """Undeclare them; in the worker."""
        while self._watchers:
            self._watchers.pop().undeclare()  # type: ignore[no-untyped-call]
        while self._publishers:
            self._publishers.popitem()[1].undeclare()  # type: ignore[no-untyped-call]

    def lost(self, event: ContactLost) -> None:
        """Act from now on."""
        each = self._attempts[event.name]
        if each.is_acting or self._is_closed:
            return  # a new engine says again what the former one has said
        each.is_acting = True
        each.count, each.failure, each.answer = 0, "", ""
        since_s = self._dates.of(event.silent_since)
        each.loss = f"{self._address}/lost/{event.name}/{since_s:.3f}"
        silent_s = (event.lost_at - event.silent_since) / seconds_to_ns(1)
        self._notify(each, "lost", f"nobody heard for {silent_s:.0f} s: {_doing(each.action)}")
        self._attempt(each)

    def restored(self, event: ContactRestored) -> None:
        """Begin no further attempt: contact is back."""
        each = self._attempts[event.name]
        self._cancel(each)
        done = "was answered" if event.acted else "was not answered"
        detail = f"node {event.source} is heard again; {_doing(each.action)} {done}; armed again"
        self._notify(each, "restored", detail)

    def documents(self) -> dict[str, object]:
        """Return the documents, by the end of their keys."""
        countdowns = self._runner.engine.lost_contact.countdowns()
        return {
            f"contact/{each.rule.name}": self._document(self._attempts[each.rule.name], each)
            for each in countdowns
            if each.rule.name in self._attempts
        }

    def close(self) -> None:
        """Begin no further attempt."""
        self._is_closed = True
        for each in self._attempts.values():
            self._cancel(each)

    # Below the methods above

    def _document(self, each: _Attempts, countdown: Countdown) -> dict[str, object]:
        action = each.action
        is_lost = countdown.phase is not ContactPhase.COUNTING
        return {
            "state": countdown.phase.value,
            "of": list(action.rule.nodes),
            "lost_after_s": action.rule.lost_after_s,
            "silent_since_unix_s": self._dates.of(countdown.silent_since),
            "acts_at_unix_s": None if is_lost else self._dates.of(countdown.acts_at),
            "call" if action.is_call else "publish": action.key,
            "served": each.is_served,
            "attempts": each.count,
            "failure": each.failure,
            "answer": each.answer,
        }

    def _key(self, action: LostContactAction) -> str:
        """Return the key of a service on the local network."""
        return action.key if action.stream_id is None else self._dialects[action.stream_id].key

    def _served(
        self, each: _Attempts, status: zenoh.MatchingStatus, *, is_first: bool = False
    ) -> None:
        """Note whether somebody is there; on a thread of Zenoh's, or in the worker."""
        is_served = bool(status.matching)

        def note() -> None:
            if is_first and each.is_served is not None:
                return  # the listener was faster, and knows better
            if not self._is_closed and each.is_served is not is_served:
                each.is_served = is_served
                self._tell_engine(lambda engine, now: None)  # the health report has changed

        tell_loop(self._loop, note)

    def _attempt(self, each: _Attempts) -> None:
        """Act once; on the loop."""
        each.count += 1
        number, action = each.count, each.action
        settle = partial(self._settled, each, each.loss, number)
        limit_s = action.timeout_s + _GRACE_S
        overdue = partial(settle, f"no end of it in {limit_s:g} s", "")
        each.timer = self._loop.call_later(limit_s, overdue)
        if action.is_call:
            self._call(each, settle)
        else:
            self._zenoh_session.worker.submit(partial(self._put, each, settle))

    def _call(self, each: _Attempts, settle: Callable[[str, str], None]) -> None:
        action = each.action
        dialect = None if action.stream_id is None else self._dialects[action.stream_id]
        key, payload, encoding = action.key, action.payload, action.encoding
        mark = self._mark(each)
        if dialect is not None:
            key = dialect.key
            payload, encoding = dialect.write_request(action.value)
            if action.is_ros:
                mark = dialect.question_mark(CallKey(self._address, 0, dialect.stream.stream_id, 0))

        each.question = Question(
            self._zenoh_session,
            key,
            lambda question: settle(*_outcome(question, action, dialect)),
            payload,
            encoding=encoding,
            priority=Priority.REAL_TIME,
            timeout_s=action.timeout_s,
            attachment=mark,
        )

    def _put(self, each: _Attempts, settle: Callable[[str, str], None]) -> None:
        """Put the sample; in the worker."""
        failure, action = "", each.action
        try:
            publisher = self._publisher(action)
            status: Any = publisher.matching_status  # an object, not the bool that the stub says
            is_heard = bool(status.matching)
            # Put in any case: a storage, or a subscriber that appears now, may have it.
            publisher.put(action.payload, attachment=self._mark(each))
            failure = "" if is_heard else f"nobody subscribes to {action.key}"
        except zenoh.ZError as error:
            failure = f"not put: {error}"
        tell_loop(self._loop, lambda: settle(failure, "" if failure else "published"))

    def _publisher(self, action: LostContactAction) -> zenoh.Publisher:
        """Return the publisher of a key, declared here if contact is lost from the start."""
        name = action.rule.name
        if name not in self._publishers:
            self._publishers[name] = self._zenoh_session.session.declare_publisher(
                zenoh.KeyExpr(action.key),
                encoding=action.encoding,
                priority=zenoh_priority(Priority.REAL_TIME),
                congestion_control=zenoh.CongestionControl.BLOCK,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        return self._publishers[name]

    def _settled(self, each: _Attempts, loss: str, number: int, failure: str, answer: str) -> None:
        """Take the end of an attempt."""
        if self._is_closed or not each.is_acting or (loss, number) != (each.loss, each.count):
            return  # contact is back, or the attempt was given up
        was, name = each.failure, each.action.rule.name
        each.failure, each.answer = failure[:_LONGEST_TEXT], answer[:_LONGEST_TEXT]
        self._cancel(each)
        if not failure:
            self._notify(each, "acted", f"{_doing(each.action)}: {each.answer}")
            self._tell_engine(lambda engine, now: engine.lost_contact.acted(name, now))
            return
        each.is_acting = True
        each.timer = self._loop.call_later(pause_s(number), self._attempt, each)
        _logger.warning("lost contact %s, attempt %d: %s", name, number, each.failure)
        if each.failure != was:
            again = f"{_doing(each.action)} fails, and is repeated: {each.failure}"
            self._notify(each, "unanswered", again)
        self._tell_engine(lambda engine, now: None)  # the health report has changed

    def _cancel(self, each: _Attempts) -> None:
        question = each.stop()
        if question is not None:
            question.cancel()

    def _mark(self, each: _Attempts) -> bytes:
        return Marker(acoustic=self._address, call=each.loss).encode()

    def _notify(self, each: _Attempts, state: str, detail: str) -> None:
        self._tell(LostContactNotice(name=each.action.rule.name, state=state, detail=detail))

    def _tell_engine(self, command: Callable[[Engine, int], object]) -> None:
        # A replaced engine says again that contact is lost, unless it knows of the answer.
        self._runner.try_apply(command)


def _doing(action: LostContactAction) -> str:
    return f"{'call' if action.is_call else 'publish'} {action.key}"


def _outcome(
    question: Question, action: LostContactAction, dialect: ServiceDialect | None
) -> tuple[str, str]:
    """Return the failure of a call, empty if there is none, and the answer."""
    if question.good is None:
        failure, text = question.error or (CallFailure.NO_SERVER, f"nobody serves {action.key}")
        return f"{failure.name}: {text}", ""
    payload, encoding = question.good
    try:
        if dialect is not None:
            value = dialect.read_response(payload, encoding)
        elif encoding.partition(";")[0] in TYPED_ENCODINGS and payload:
            value = decode_application(payload, encoding)
        else:
            value = payload.decode(errors="replace")
    except PayloadInvalidError as error:
        return f"{CallFailure.BAD_RESPONSE.name}: {error}", ""
    text = msgspec.json.encode(value, enc_hook=repr).decode()
    if isinstance(value, dict) and value.get("success") is False:
        return f"{CallFailure.HANDLER.name}: {text}", ""
    return "", text
