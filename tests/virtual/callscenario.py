"""Random scenarios of calls: several clients, one server, and everything goes wrong for a while.

Each request carries a ticket of its own, and each answer the ticket of its request, so that an
answer to another call shows.
"""

import random
from functools import partial
from typing import Any, Final

import msgspec

from tests.virtual.judged import NEWS, JudgedScenario
from tests.virtual.weather import LONGEST_OUTAGE_S, weather
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import (
    CallFailed,
    CallFailure,
    Event,
    RequestReceived,
    ResponseReceived,
)
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import QueueFullError
from zacoustic.testing.virtual import Modem, VirtualNetwork

SERVER: Final = 1
ARM: Final = 20
MOST_ENTRIES: Final = 128
"""Calls of one client in the journal of its server at most: two lives of 64 numbers."""
_CALM_CALLS: Final = 3


class Call(msgspec.Struct):
    """A call that a client has begun."""

    node: int
    life: int
    ticket: bytes
    at: int
    is_calm: bool
    cancelled: bool = False
    events: list[tuple[int, Event]] = []
    """With the instants at which they came."""


class CallScenario(JudgedScenario):
    """One random scenario.

    Args:
        seed: Everything follows from it.
    """

    def __init__(self, seed: int) -> None:
        self._rng = rng = random.Random(f"calls/{seed}")
        super().__init__(seed)
        self.calls: dict[tuple[int, int, int], Call] = {}
        """By client, its life and the call id."""
        self.executed: dict[bytes, int] = {}
        self.crashes: list[int] = []
        """When the server crashed."""
        self._tickets = 0
        self._addresses = range(1, 2 + rng.choice((1, 1, 2, 3)))
        self._timeout_s = rng.choice((60.0, 120.0, 300.0, 600.0))
        self._busy_s = rng.choice((300.0, 900.0, 2700.0))
        self._handler_s = rng.choice((0.0, 2.0, 20.0, 90.0))
        # A node that is listed and not there: nobody ever omits the introduction in a broadcast.
        absent = {99: "absent"} if rng.random() < 0.3 else {}
        table = StreamTable(
            [
                ServiceSpec(stream_id=ARM, name="arm", server=SERVER, timeout_s=self._timeout_s),
                NEWS,
            ],
            nodes={address: f"n{address}" for address in self._addresses} | absent,
        )
        modem = Modem(acknowledges=rng.random() < 0.2)
        self.network = VirtualNetwork(
            weather(rng, seed, self._addresses, self._busy_s, modem, _outage_s),
            table,
            modem=modem,
            deliver=self._take,
            lives=self._live,
            digest=False,
        )

    def run(self) -> list[str]:
        """Run it; returns what must not have happened."""
        rng, network = self._rng, self.network
        period_s = rng.choice((3.0, 15.0, 60.0))
        calm_s = self._busy_s + 2 * self._timeout_s + 120
        for client in self._addresses[1:]:
            at_s = rng.uniform(0, 20)
            while at_s < self._busy_s:
                for _ in range(rng.choice((1,) * 20 + (5, 30))):
                    network.at(at_s, partial(self._call, client))
                at_s += rng.expovariate(1 / period_s)
            for number in range(_CALM_CALLS):
                at_s = calm_s + 60 * number + 10 * client
                network.at(at_s, partial(self._call, client, is_calm=True))
        self._plan_news(rng, self._addresses, self._busy_s)
        end_s = calm_s + 2 * self._timeout_s + 2000
        for second in range(0, int(end_s), 30):
            network.at(second, self._look_at_journal)
        network.run(until_s=end_s)
        self._judge()
        return self.violations

    # What the nodes do

    def _call(self, client: int, *, is_calm: bool = False) -> None:
        if not self.network.is_running(client):
            return
        self._tickets += 1
        ticket = b"%d" % self._tickets
        draw = self._rng.random()
        timeout_s = None if is_calm or draw < 0.7 else self._rng.uniform(5, 600)

        def begin(engine: Any, now: int) -> int:
            call_id = engine.call(ARM, ticket, now, timeout_s=timeout_s)
            key = (client, self.network.life(client), call_id)
            self.calls[key] = Call(client, key[1], ticket, self.network.now, is_calm, events=[])
            return int(call_id)

        try:
            call_id = self.network.apply(client, begin)
        except QueueFullError:
            self._count("refused")
            return
        key = (client, self.network.life(client), call_id)
        if not is_calm and draw > 0.95:
            after_s = self.network.now / NS_PER_S + self._rng.uniform(0, 30)
            self.network.at(after_s, lambda: self._cancel(key))

    def _cancel(self, key: tuple[int, int, int]) -> None:
        client, life, call_id = key
        if self.network.is_running(client) and self.network.life(client) == life:
            if not self.calls[key].events:
                self.calls[key].cancelled = True
            self.network.apply(client, lambda engine, now: engine.cancel(call_id, now))

    def _serve(self, event: RequestReceived) -> None:
        ticket = bytes(event.value)
        self.executed[ticket] = self.executed.get(ticket, 0) + 1
        if self.executed[ticket] > 1:
            self._complain(f"{ticket!r} is executed again")
        life, draw = self.network.life(SERVER), self._rng.random()
        if draw < 0.05:
            return  # a handler that never comes back

        def answer() -> None:
            if not self.network.is_running(SERVER) or self.network.life(SERVER) != life:
                return
            if draw < 0.2:
                self.network.apply(
                    SERVER,
                    lambda engine, now: engine.reply_error(
                        event.call, CallFailure.HANDLER, ticket.decode(), now
                    ),
                )
            else:
                value = b"re " + ticket + b"." * self._rng.randrange(20)
                self.network.apply(SERVER, lambda engine, now: engine.reply(event.call, value, now))

        after_s = self._rng.uniform(0, self._handler_s)
        self.network.at(self.network.now / NS_PER_S + after_s, answer)

    # What the engines say

    def _take(self, node: int, event: Event) -> None:
        if isinstance(event, RequestReceived):
            self._serve(event)
        elif isinstance(event, CallFailed | ResponseReceived):
            call = self.calls.get((node, self.network.life(node), event.call_id))
            if call is None:
                self._complain(f"{event} at node {node} ends no call")
                return
            call.events.append((self.network.now, event))

    def _live(self, address: int, is_alive: bool) -> None:
        if address == SERVER and not is_alive:
            self.crashes.append(self.network.now)

    def _look_at_journal(self) -> None:
        entries = self._journalled()
        if len(entries) > MOST_ENTRIES * (len(self._addresses) - 1):
            self._complain(f"{len(entries)} calls in the journal")

    def _journalled(self) -> list[str]:
        return [name for name in self.network.journal(SERVER).entries if name.startswith("call/")]

    # What must hold

    def _judge(self) -> None:
        for (node, life, _), call in self.calls.items():
            is_living = self.network.is_running(node) and self.network.life(node) == life
            expected = 0 if call.cancelled else 1
            if len(call.events) > expected or (is_living and len(call.events) != expected):
                self._complain(f"{call} has {len(call.events)} ends; expected: {expected}")
            for at, event in call.events:
                self._judge_end(call, at, event)
        if self._journalled():
            self._complain(f"left in the journal: {self._journalled()}")
        self._expect_rest(self._addresses)

    def _judge_end(self, call: Call, at: int, event: Event) -> None:
        if isinstance(event, ResponseReceived):
            self._count("response")
            if event.value.rstrip(b".") != b"re " + call.ticket:
                self._complain(f"{call.ticket!r} is answered with {event.value!r}")
            return
        assert isinstance(event, CallFailed)
        self._count(event.failure.name)
        if event.failure is CallFailure.HANDLER:
            if event.text != call.ticket.decode():
                self._complain(f"{call.ticket!r} fails with {event.text}")
        elif event.failure is CallFailure.UNKNOWN:
            if not any(call.at <= crash <= at for crash in self.crashes):
                self._complain(f"{call.ticket!r} is unknown without a crash")
        elif event.failure is not CallFailure.TIMED_OUT:
            self._complain(f"{call.ticket!r} fails: {event}")
        elif call.is_calm and call.ticket not in self.executed:
            self._complain(f"{call.ticket!r} never arrived although all is calm")


def _outage_s(rng: random.Random) -> float:
    return rng.uniform(1, rng.choice((30.0, 300.0, LONGEST_OUTAGE_S)))
