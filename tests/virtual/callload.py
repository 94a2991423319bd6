"""Calls one after the other over a bad and slow water, with what they took and what they cost."""

import random
from functools import partial
from typing import Final

import msgspec

from tests.virtual.fleet import line
from tests.virtual.sealed import SealedFleet, seal_bytes
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    CallKey,
    Event,
    RequestReceived,
    ResponseReceived,
)
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import QueueFullError
from zacoustic.testing.virtual import VirtualNetwork

SOUND_M_S: Final = 1500.0
_ARM: Final = 20
_REQUEST_BYTES: Final = 12
_RESPONSE_BYTES: Final = 12


class Load(msgspec.Struct):
    """What became of the calls."""

    calls: int
    answered: dict[int, float] = {}
    """Latency by call, s."""
    failed: dict[int, str] = {}
    executed: dict[int, int] = {}
    """How often, by call."""
    refused: int = 0
    frames: int = 0
    bytes_sent: int = 0
    airtime_s: float = 0.0
    sealed_bytes: int = 0
    """Bytes of seals."""
    expected_seals: float = 0.0
    """Bytes that seals would take if no frame were repeated."""


def carry_calls(
    seed: int,
    *,
    calls: int = 1000,
    loss: float = 0.3,
    delay_s: float = 2.0,
    period_s: float = 10.0,
    handler_s: float = 1.0,
    timeout_s: float = 600.0,
    sealed: bool = False,
) -> Load:
    """Let node 2 call node 1 again and again; each call is known by a number in its payload.

    Args:
        seed: Everything follows from it.
        calls: How many.
        loss: Share of the frames that is lost, each way.
        delay_s: Sound's way, one way, s.
        period_s: Mean time from one call to the next, s, exponentially distributed.
        handler_s: The handler takes up to this, s.
        timeout_s: Of the service, s.
        sealed: The nodes have a key.
    """
    fleet = SealedFleet() if sealed else None
    rng = random.Random(f"load/{seed}")
    load = Load(calls, answered={}, failed={}, executed={})
    began: dict[int, tuple[int, int]] = {}
    table = StreamTable(
        [ServiceSpec(stream_id=_ARM, name="arm", server=1, timeout_s=timeout_s)],
        nodes={1: "server", 2: "client"},
    )

    def take(node: int, event: Event) -> None:
        if isinstance(event, RequestReceived):
            number = int.from_bytes(event.value[:4], "big")
            load.executed[number] = load.executed.get(number, 0) + 1
            response = event.value[:4] + bytes(_RESPONSE_BYTES - 4)
            at_s = medium.now / NS_PER_S + rng.uniform(0, handler_s)
            medium.at(at_s, partial(medium.apply, 1, partial(_reply, event.call, response)))
        elif isinstance(event, ResponseReceived):
            number, at = began[event.call_id]
            assert int.from_bytes(event.value[:4], "big") == number
            load.answered[number] = (medium.now - at) / NS_PER_S
        elif isinstance(event, CallFailed):
            load.failed[began[event.call_id][0]] = event.failure.name

    medium = VirtualNetwork(
        line(
            0,
            delay_s * SOUND_M_S,
            seed=seed,
            channel="none",
            loss={"frame": loss},
        ),
        table,
        deliver=take,
        digest=False,
        build=fleet or Engine,
    )

    def call(number: int) -> None:
        value = number.to_bytes(4, "big") + bytes(_REQUEST_BYTES - 4)

        def begin(engine: Engine, now: int) -> None:
            began[engine.call(_ARM, value, now)] = (number, medium.now)

        try:
            medium.apply(2, begin)
        except QueueFullError:
            load.refused += 1
            medium.at(medium.now / NS_PER_S + period_s, partial(call, number))

    at_s = 0.0
    for number in range(calls):
        medium.at(at_s, partial(call, number))
        at_s += rng.expovariate(1 / period_s)
    medium.run()
    for stats in medium.stats():
        load.frames += stats.frames_transmitted
        load.bytes_sent += stats.bytes_transmitted
        load.airtime_s += stats.airtime_ns / NS_PER_S
    if fleet is not None:
        load.sealed_bytes = seal_bytes(medium)[1]
        load.expected_seals = fleet.expected_bytes * load.frames
    return load


def _reply(call: CallKey, response: bytes, engine: Engine, now: int) -> bool:
    return engine.reply(call, response, now)
