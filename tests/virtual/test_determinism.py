"""One seed, one trace; five nodes report day and night in seconds."""

import hashlib
import random
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.virtual.fleet import Trial, line
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork


def five_nodes(
    seed: int, hours: float, trace: Callable[[TraceRecord], None] | None = None, **settings: Any
) -> VirtualNetwork:
    """Let five nodes publish 30 bytes every ten seconds each; returns the network at the end."""
    rng = random.Random(seed)
    table = StreamTable(
        [TopicSpec(stream_id=10, name="{node}/report")],
        nodes={address: f"n{address}" for address in range(1, 6)},
    )
    medium = VirtualNetwork(
        line(0, 400, 800, 1200, 1600, seed=seed, **settings),
        table,
        trace=trace,
        deliver=lambda address, event: None,
    )

    def publish(address: int) -> None:
        medium.publish(address, 10, rng.randbytes(30))

    for address in range(1, 6):
        medium.every(10, partial(publish, address), first_s=2.0 * address)
    medium.run(until_s=hours * 3600)
    return medium


@pytest.mark.parametrize(
    "seed", [*(pytest.param(each, marks=pytest.mark.soak) for each in (0, 1)), 2]
)
def test_same_seed_gives_the_same_trace_and_another_seed_another(seed: int) -> None:
    digests = [five_nodes(each, 0.25).digest for each in (seed, seed, seed + 100)]
    assert digests[0] == digests[1]
    assert digests[0] != digests[2]


@pytest.mark.parametrize(
    "seed", [*(pytest.param(each, marks=pytest.mark.soak) for each in (0, 1)), 2]
)
def test_scenarios_full_of_faults_are_repeatable(seed: int) -> None:
    def told() -> tuple[str, int]:
        trial = Trial(seed, nodes=4, modem=Modem(checked=False), repeat=0.4, corrupt=0.2)
        trial.run()
        return trial.network.digest, len(trial.delivered)

    assert told() == told()


def test_trace_holds_what_the_digest_is_made_of() -> None:
    records: list[TraceRecord] = []
    five_nodes(1, 0.1, records.append)
    again: list[TraceRecord] = []
    five_nodes(1, 0.1, again.append)
    assert records == again
    assert [record.at for record in records] == sorted(record.at for record in records)
    text = "\n".join(record.render() for record in records)
    assert hashlib.sha256(text.encode()).digest()
    assert len(records) > 100


def test_five_nodes_deliver_most_of_their_reports(sized: Callable[..., int]) -> None:
    hours = sized(60, share=30) / 60
    medium = five_nodes(1, hours, channel="none")
    received = sum(medium.engine(address).stats.received.get(10, 0) for address in range(1, 6))
    published = 5 * 360 * hours
    # Each report is for four others; the channel is busy for a third of the time.
    assert received > 0.5 * 4 * published
    for address in range(1, 6):
        stats = medium.engine(address).stats
        assert sum(entry.transmitted_bytes for entry in stats.ledger()) == stats.bytes_transmitted
        assert sum(entry.airtime_ns for entry in stats.ledger()) == stats.airtime_ns
