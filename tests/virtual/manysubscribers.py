"""A reliable topic of one publisher with many subscribers, in a square of sea."""

import random
from functools import partial
from typing import Final

import msgspec

from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.base.stats import Cause
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing import VirtualNetwork

PERIOD_S: Final = 120.0
SIDE_M: Final = 3000.0
COMMAND, REPORT = 1, 2


class Cost(msgspec.Struct, frozen=True):
    """Of one run, for each sample."""

    arrived: float
    """Share of samples and subscribers."""
    airtime_s: float
    """Of all nodes."""
    late_s: float
    """From publication to arrival: 95 of 100 take no longer."""
    frames: float
    ack_bytes: float
    repeated_bytes: float


def run_subscribers(
    seed: int,
    subscribers: int,
    method: AgreementMethod,
    *,
    reports: bool,
    length_s: float = 3600.0,
) -> Cost:
    """Run one fleet.

    Args:
        seed: Everything follows from it.
        subscribers: How many.
        method: How they agree on tables.
        reports: Each of them reports to all, as often as the publisher says something.
        length_s: How long samples are published, s.
    """
    rng = random.Random(seed)
    addresses = range(1, subscribers + 2)
    scenario = Scenario(
        nodes=tuple(
            NodeSpec(
                address=each,
                position=(rng.uniform(0, SIDE_M), rng.uniform(0, SIDE_M), rng.uniform(5, 50)),
            )
            for each in addresses
        ),
        seed=seed,
    )
    command = TopicSpec(
        stream_id=COMMAND,
        name="mission",
        publishers=(1,),
        qos=Qos(reliability=Reliability.RELIABLE, depth=8),
    )
    table = StreamTable(
        [command, TopicSpec(stream_id=REPORT, name="{node}/report")],
        nodes={each: f"n{each}" for each in addresses},
    )
    published_s: list[float] = []
    late_s: list[float] = []

    def deliver(address: int, event: Event) -> None:
        if isinstance(event, SampleReceived) and event.stream_id == COMMAND:
            late_s.append(network.now / 1e9 - published_s[event.value[0]])

    def command_all() -> None:
        network.publish(1, COMMAND, bytes((len(published_s), *bytes(19))))
        published_s.append(network.now / 1e9)

    network = VirtualNetwork(
        scenario, table, deliver=deliver, digest=False, rules=TransmitRules(agreement=method)
    )
    samples = round(length_s / PERIOD_S)
    for turn in range(samples):
        network.at(PERIOD_S * (turn + rng.random()), command_all)
        for each in addresses[1:] if reports else ():
            at_s = PERIOD_S * (turn + rng.random())
            network.at(at_s, partial(network.publish, each, REPORT, bytes(10)))
    network.run(until_s=length_s + 900)
    causes = dict.fromkeys(Cause, 0)
    for stats in network.stats():
        for entry in stats.ledger():
            causes[entry.cause] += entry.transmitted_bytes
    return Cost(
        len(late_s) / samples / subscribers,
        sum(stats.airtime_ns for stats in network.stats()) / 1e9 / samples,
        sorted(late_s)[round(0.95 * len(late_s)) - 1],
        sum(stats.frames_transmitted for stats in network.stats()) / samples,
        causes[Cause.ACK] / samples,
        causes[Cause.REPEAT] / samples,
    )
