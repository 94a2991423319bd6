"""Frames of another fleet with the same addresses, whole and mutated."""

import functools
import random
from typing import Final

import msgspec

from tests.hostile import fleet, load
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.events import Event, GoalStatus, RequestReceived
from zacoustic.core.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.transport.actions.events import GoalReceived
from zacoustic.testing.virtual import Modem, VirtualNetwork

VARIANTS: Final = 4
_BUSY_S: Final = 600.0


class Stranger(msgspec.Struct, frozen=True):
    """A frame that somebody else's node has sent."""

    source: int
    destination: int
    frame_bytes: bytes

    def received(self, now: int, *, addressed: bool) -> ReceivedFrame:
        """Return it as a modem hands it over."""
        return ReceivedFrame(
            frame_bytes=self.frame_bytes,
            received_at=now,
            source=self.source if addressed else 0,
            destination=self.destination if addressed else BROADCAST,
        )


@functools.lru_cache(maxsize=64)
def frames(variant: int, modem: Modem) -> tuple[Stranger, ...]:
    """Return all that a fleet says in a while, with streams of every kind."""
    addresses = range(1, 4)
    rng = random.Random(f"foreign {variant} {modem}")
    heard: list[Stranger] = []

    def note(record: TraceRecord) -> None:
        if record.what == "transmit":
            heard.append(Stranger(record.node, record.peer, bytes.fromhex(record.frame)))

    nodes = [{"address": each, "position": [300 * each, 0, 10]} for each in addresses]
    table = fleet.table(addresses, variant=variant, server=1 + variant % 3)

    def deliver(node: int, event: Event) -> None:
        if isinstance(event, RequestReceived):
            network.apply(node, lambda engine, now: engine.reply(event.call, b"yes", now))
        elif isinstance(event, GoalReceived):
            network.apply(node, lambda engine, now: engine.actions.accept(event.goal, now))
            network.apply(
                node,
                lambda engine, now: engine.actions.finish(
                    event.goal, GoalStatus.SUCCEEDED, b"done", now
                ),
            )

    network = VirtualNetwork(
        scenario_from_mapping(
            {"nodes": nodes, "channel": "none", "seed": variant}, source="foreign"
        ),
        table,
        modem=modem,
        trace=note,
        deliver=deliver,
        digest=False,
    )

    def speak(address: int, say: load.Say) -> None:
        network.apply(address, lambda engine, now: load.said(engine, now, say))

    for address in addresses:
        at_s = rng.uniform(0, 10)
        while at_s < _BUSY_S:
            say = load.anything(rng, address, table)
            network.at(at_s, functools.partial(speak, address, say))
            at_s += rng.expovariate(1 / 15)
    network.run(until_s=_BUSY_S + 600)
    return tuple(heard)


@functools.lru_cache(maxsize=16)
def subscribe_requests(modem: Modem) -> tuple[Stranger, ...]:
    """Return what a node of the fleet itself says that only subscribes and sends goals."""
    heard: list[Stranger] = []

    def note(record: TraceRecord) -> None:
        if record.what == "transmit" and record.node == 2:
            heard.append(Stranger(record.node, record.peer, bytes.fromhex(record.frame)))

    nodes = [{"address": each, "position": [300 * each, 0, 10]} for each in (1, 2)]
    network = VirtualNetwork(
        scenario_from_mapping({"nodes": nodes, "channel": "none", "seed": 1}, source="wishes"),
        fleet.table(range(1, 4)),
        modem=modem,
        trace=note,
        deliver=lambda node, event: None,
        digest=False,
    )

    def wish(number: int) -> None:
        network.apply(
            2,
            lambda engine, now: engine.subscriptions.want(
                fleet.ON_DEMAND[number % 2], now, {1} if number % 3 else set()
            ),
        )
        value = fleet.value_of(fleet.RAW, number, 4)
        network.apply(
            2,
            lambda engine, now: load.said(
                engine,
                now,
                lambda engine, now: engine.actions.send_goal(fleet.GOTO, value, now, timeout_s=100),
            ),
        )

    for number in range(60):
        network.at(10.0 * number, functools.partial(wish, number))
    network.run(until_s=700)
    return tuple(heard)


def mutated(rng: random.Random, stranger: Stranger) -> Stranger:
    """Return a frame with bits flipped, bytes cut off, put in, or those of others behind it."""
    data = bytearray(stranger.frame_bytes)
    for _ in range(rng.choice((1, 1, 2, 8))):
        where = rng.randrange(len(data)) if data else 0
        match rng.randrange(4):
            case 0 if data:
                data[where] ^= 1 << rng.randrange(8)
            case 1 if data:
                del data[where:]
            case 2:
                data[where:where] = rng.randbytes(rng.choice((1, 2, 5)))
            case _ if data:
                data[where] = rng.choice((0, 0xFF, *range(0xB0, 0xC1)))
    source = rng.choice((stranger.source, 1, 2, 3, 0, 200))
    destination = rng.choice((stranger.destination, 1, BROADCAST, 3))
    return Stranger(source, destination, bytes(data))
