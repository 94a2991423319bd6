"""Calls in the model: request, answer, confirmation, each repeated after a loss."""

import random
from collections.abc import Callable
from typing import Final

from zacoustic.app.tools.design.plan.clockwork import Clockwork
from zacoustic.app.tools.design.plan.items import Item
from zacoustic.app.tools.design.plan.offers import Offer
from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.schedule.timing import LinkTimes

_CALL_HEAD_BYTES: Final = 2


class Call:
    """One call of a service: request, answer, confirmation, each repeated after a loss.

    Args:
        offer: The client and its service.
        payload_bytes: Size of the request's payload.
        walk: Clock and nodes.
        times: Times of the link.
        rng: Draws pauses.
    """

    def __init__(
        self, offer: Offer, payload_bytes: int, walk: Clockwork, times: LinkTimes,
        rng: random.Random, server: int, number: int, timeout_s: float,
    ) -> None:  # fmt: skip
        self._offer = offer
        self._walk = walk
        self._times = times
        self._rng = rng
        self._server = server
        self._began_at = walk.now
        self._until = walk.now + seconds_to_ns(timeout_s)
        self._key = ("call", offer.stream.stream_id, offer.node, number)
        self._request_bytes = _CALL_HEAD_BYTES + payload_bytes
        self._answer_bytes = _CALL_HEAD_BYTES + offer.answer_bytes
        self._is_answered = False
        self._is_confirmed = False
        self._tries = {"request": 0, "answer": 0, "confirm": 0}
        self._sent_at: dict[str, int] = {}
        self._request()

    def _request(self) -> None:
        if self._is_answered or self._walk.now >= self._until:
            return
        self._say(
            self._offer.node, self._server, "request", self._request_bytes,
            heard=self._requested, again=self._request,
        )  # fmt: skip

    def _requested(self) -> None:
        self._answer()

    def _answer(self) -> None:
        if self._is_confirmed or self._walk.now >= self._until:
            return
        self._say(
            self._server, self._offer.node, "answer", self._answer_bytes,
            heard=self._answered, again=self._answer,
        )  # fmt: skip

    def _answered(self) -> None:
        timing = self._walk.timing(self._offer.node, self._server)
        timing.heard()
        timing.answered(in_crowd=False)
        if not self._is_answered:
            self._is_answered = True
            if self._tries["request"] == 1:
                timing.measured(self._walk.now - self._sent_at["request"], self._times)
            self._walk.delivered(self._offer, self._began_at)
        self._walk.speaker(self._offer.node).take_back((*self._key, "request"))
        self._say(
            self._offer.node, self._server, "confirm", _CALL_HEAD_BYTES,
            heard=self._confirmed, wait_ns=self._times.ack_linger_ns,
        )  # fmt: skip

    def _confirmed(self) -> None:
        timing = self._walk.timing(self._server, self._offer.node)
        timing.heard()
        timing.answered(in_crowd=False)
        if not self._is_confirmed and self._tries["answer"] == 1:
            timing.measured(self._walk.now - self._sent_at["answer"], self._times)
        self._is_confirmed = True
        self._walk.speaker(self._server).take_back((*self._key, "answer"))

    def _say(
        self, source: int, target: int, what: str, size_bytes: int, *,
        heard: Callable[[], None], again: Callable[[], None] | None = None, wait_ns: int = 0,
    ) -> None:  # fmt: skip
        speaker, key = self._walk.speaker(source), (*self._key, what)
        if speaker.waits(key):
            return
        item = Item(self._offer.stream.stream_id, target, size_bytes, self._walk.now)
        item.for_one_node, item.wait_ns, item.voice = True, wait_ns, source
        codec = self._offer.stream.codec if what == "request" else self._offer.stream.response_codec
        item.open_ended = what != "confirm" and not codec.delimits_itself
        item.heard = lambda node, _: heard() if node == target else None
        timing = self._walk.timing(source, target)

        def ends(at: int) -> None:
            self._tries[what] += 1
            self._sent_at[what] = at
            if again is not None:
                if self._tries[what] > 1:
                    timing.unanswered(at, self._times)
                priority = self._offer.stream.qos.priority
                pause_ns = timing.pause_ns(self._times, 0, self._rng, priority)
                self._walk.later(at + pause_ns, again)

        item.ends = ends
        if what == "request" and not self._tries[what]:
            item.begins = lambda _: self._walk.went(self._offer)
        qos = self._offer.stream.qos
        priority = Priority.INTERACTIVE_HIGH if what == "confirm" else qos.priority
        speaker.push(key, item, Qos(priority=priority), depth=1)
        self._walk.serve(source)
