"""Transmit silence as a service of the gateway, under ``@acoustic/ADDRESS/silence``.

A `get` on the key tells whether this node is silent; with parameters it orders silence or ends it::

    @acoustic/2/silence                           what holds
    @acoustic/2/silence?order=begin;for_s=1800    silence for half an hour
    @acoustic/2/silence?order=begin               silence until it is resumed
    @acoustic/2/silence?order=resume              the end of it; quiet windows stay

The answer is JSON: ``{"address": 2, "silent": true, "ordered": true, "until_utc": "…Z"}``;
`until_utc` is null where there is no end, or no silence. An order holds before it is answered, and
is answered when it is in the journal. Orders for a node beyond the water need a call across it:
they are not there yet.
"""

import math
import time
from collections.abc import Callable

import msgspec

from zacoustic.core.clock import Clock
from zacoustic.core.encoding import JSON
from zacoustic.core.engine import Engine
from zacoustic.core.events import CallFailure, SilenceChanged
from zacoustic.gateway.presence import PREFIX
from zacoustic.island.queries import Answer, HeldQuery
from zacoustic.permitlog import utc_text
from zacoustic.runtime import LinkRunner


class SilenceState(msgspec.Struct, frozen=True, kw_only=True):
    """The answer."""

    address: int
    """Of the node."""
    silent: bool
    """Nothing is transmitted now."""
    ordered: bool
    """By an order; otherwise, if silent, by a quiet window."""
    until_utc: str | None
    """End of the silence, as far as it is known."""


class SilenceDesk:
    """Takes orders for one node; for the loop.

    Args:
        runner: Whose engine.
        clock: Where instants come from.
        wall_clock: Tells UTC, ns since 1970.
    """

    def __init__(
        self, runner: LinkRunner, *, clock: Clock, wall_clock: Callable[[], int] = time.time_ns
    ) -> None:
        self._runner = runner
        self._clock = clock
        self._wall_clock = wall_clock
        self._waiting: list[HeldQuery] = []

    @property
    def key(self) -> str:
        """Where it is asked."""
        return f"{PREFIX}/{self._runner.engine.address}/silence"

    def serve(self, held: HeldQuery) -> None:
        """Take a query; one that means everything under a prefix is not for a service."""
        if not str(held.query.key_expr).endswith("/silence"):
            held.answer([])
            return
        order, for_s, fault = _read(held)
        if fault:
            held.refuse(CallFailure.BAD_REQUEST, fault)
        elif order is None:
            self._answer(held, self._runner.engine.silence.state(self._clock()))
        else:
            self._waiting.append(held)

            def obey(engine: Engine, now: int) -> None:
                if order == "begin":
                    engine.silence.begin(now, duration_s=for_s)
                else:
                    engine.silence.resume(now)

            self._runner.apply(obey)

    def changed(self, event: SilenceChanged) -> None:
        """The journal has it: answer who ordered it."""
        waiting, self._waiting = self._waiting, []
        for held in waiting:
            self._answer(held, event)

    def state(self, event: SilenceChanged) -> SilenceState:
        """Return what the engine says in the words of the answer."""
        until_utc = None
        if event.ends_at is not None:
            until_utc = utc_text(self._wall_clock() + event.ends_at - self._clock())
        return SilenceState(
            address=self._runner.engine.address,
            silent=event.is_silent,
            ordered=event.is_ordered,
            until_utc=until_utc,
        )

    def _answer(self, held: HeldQuery, event: SilenceChanged) -> None:
        payload = msgspec.json.encode(self.state(event))
        held.answer([Answer(key=self.key, payload=payload, encoding=JSON)])


def _read(held: HeldQuery) -> tuple[str | None, float | None, str]:
    """Read the parameters: order, duration, and what is wrong with them."""
    parameters = held.query.parameters
    order, written = parameters.get("order"), parameters.get("for_s")
    if order not in (None, "begin", "resume"):
        return None, None, f"order is {order}; allowed: begin, resume"
    if written is None:
        return order, None, ""
    try:
        for_s = float(written)
    except ValueError:
        for_s = math.nan
    if order != "begin" or not 0 < for_s < math.inf:
        return None, None, f"for_s is {written}; allowed: with order=begin, seconds above 0"
    return order, for_s, ""
