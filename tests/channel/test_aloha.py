"""Throughput of ALOHA against theory: senders at unequal distances, one node that only listens."""

import heapq
import math
import random
from collections.abc import Callable, Iterable

import pytest

from zacoustic.channel.arrival import Arrival, Outcome
from zacoustic.channel.medium import Medium
from zacoustic.channel.scenario import Scenario

Line = Callable[..., Scenario]
SENDERS = 12
FRAMES = 4000


@pytest.fixture
def medium(line: Line) -> Medium:
    """Node 1 listens, twelve others are 200 to 2950 m away."""
    places = [200 + 250 * index for index in range(SENDERS)]
    return Medium(line(0, *places, channel="none", collisions="protocol"))


def _successes(medium: Medium, transmissions: Iterable[tuple[int, int]]) -> int:
    """Number of frames that reach node 1."""
    agenda: list[tuple[int, int, Arrival]] = []
    received = count = 0
    for now, source in [*transmissions, (1 << 62, 0)]:
        while agenda and agenda[0][0] <= now:
            arrival = heapq.heappop(agenda)[2]
            outcome = medium.finish(arrival).outcome
            received += arrival.node == 1 and outcome is Outcome.RECEIVED
        if source:
            for arrival in medium.transmit(source, 64, now).arrivals:
                count += 1
                heapq.heappush(agenda, (arrival.ends_at, count, arrival))
    return received


def _slotted(
    medium: Medium, load: float, *, at_receiver: bool
) -> tuple[list[tuple[int, int]], int]:
    """Poisson numbers of frames in slots as long as a frame, timed at the sender or at node 1."""
    rng = random.Random(11)
    airtime_ns = medium.profile(2).airtime_ns(64)
    transmissions: list[tuple[int, int]] = []
    slot = 4
    while len(transmissions) < FRAMES:
        slot += 1
        number = 0
        left = rng.random() - math.exp(-load)
        while left > 0.0 and number < SENDERS:
            number += 1
            left -= math.exp(-load) * load**number / math.factorial(number)
        for source in rng.sample(range(2, SENDERS + 2), number):
            early_ns = round(medium.path(source, 1, 0).propagation_s * 1e9) if at_receiver else 0
            transmissions.append((slot * airtime_ns - early_ns, source))
    return sorted(transmissions), slot


@pytest.mark.parametrize("load", [0.2, 0.5, 1.0])
def test_pure_aloha_carries_what_theory_says(medium: Medium, load: float) -> None:
    rng = random.Random(7)
    airtime_ns = medium.profile(2).airtime_ns(64)
    free_at = dict.fromkeys(range(2, SENDERS + 2), 0)
    transmissions = []
    now = 0
    for _ in range(FRAMES):
        now += round(rng.expovariate(load) * airtime_ns)
        source = rng.choice([address for address, free in free_at.items() if free <= now])
        free_at[source] = now + airtime_ns
        transmissions.append((now, source))
    offered = FRAMES * airtime_ns / now
    throughput = _successes(medium, transmissions) * airtime_ns / now
    assert throughput == pytest.approx(offered * math.exp(-2.0 * offered), abs=0.015)


@pytest.mark.parametrize("load", [0.5, 1.0])
def test_slots_aligned_at_the_receiver_double_it(medium: Medium, load: float) -> None:
    transmissions, slots = _slotted(medium, load, at_receiver=True)
    throughput = _successes(medium, transmissions) / slots
    assert throughput == pytest.approx(load * math.exp(-load), abs=0.02)


@pytest.mark.parametrize("load", [0.5, 1.0])
def test_slots_aligned_at_the_senders_gain_nothing(medium: Medium, load: float) -> None:
    transmissions, slots = _slotted(medium, load, at_receiver=False)
    throughput = _successes(medium, transmissions) / slots
    assert throughput == pytest.approx(load * math.exp(-2.0 * load), abs=0.02)
