import heapq
import random
from collections import Counter
from collections.abc import Callable
from typing import Any

import pytest

from zacoustic.channel.arrival import Arrival, Outcome, Reception
from zacoustic.channel.faults.faults import corrupt
from zacoustic.channel.medium import Medium
from zacoustic.channel.scenario import Scenario, scenario_from_mapping

SECOND = 1_000_000_000
Line = Callable[..., Scenario]


def _run(
    medium: Medium, transmissions: list[tuple[int, int]], *, late_ns: int = 0
) -> dict[tuple[int, int, int], Reception]:
    """Drive a medium through (instant, source) in order; finish arrivals that much late."""
    agenda: list[tuple[int, int, Arrival]] = []
    receptions: dict[tuple[int, int, int], Reception] = {}

    def finish_until(instant: int) -> None:
        while agenda and agenda[0][0] + late_ns <= instant:
            arrival = heapq.heappop(agenda)[2]
            key = (arrival.source, arrival.node, arrival.sequence)
            receptions[key] = medium.finish(arrival)

    count = 0
    for now, source in transmissions:
        finish_until(now)
        for arrival in medium.transmit(source, 64, now).arrivals:
            count += 1
            heapq.heappush(agenda, (arrival.ends_at, count, arrival))
    finish_until(1 << 62)
    return receptions


def _shares(receptions: dict[tuple[int, int, int], Reception]) -> dict[Outcome, float]:
    counts = Counter(reception.outcome for reception in receptions.values())
    return {outcome: counts[outcome] / len(receptions) for outcome in Outcome}


def _every(seconds: float, source: int, count: int) -> list[tuple[int, int]]:
    return [(round(index * seconds * SECOND), source) for index in range(count)]


def test_sound_arrives_after_distance_over_speed_and_lasts_its_airtime(line: Line) -> None:
    medium = Medium(line(0, 1500, 4500, channel="none"))
    emission = medium.transmit(1, 64, 7 * SECOND)
    airtime_ns = medium.profile(1).airtime_ns(64)
    assert emission.ends_at == 7 * SECOND + airtime_ns
    assert emission.ready_at == emission.ends_at + 90_400_000
    near, far = emission.arrivals
    assert (near.node, far.node) == (2, 3)
    assert (near.starts_at, far.starts_at) == (8 * SECOND, 10 * SECOND)
    assert near.ends_at - near.starts_at == far.ends_at - far.starts_at == airtime_ns
    assert (near.propagation_s, near.distance_m, near.range_rate_m_s) == (1.0, 1500.0, 0.0)
    assert near.received_level_db > far.received_level_db
    assert (near.source, near.sequence, near.frame_bytes) == (1, 0, 64)
    assert medium.transmit(1, 1, emission.ready_at).sequence == 1


def test_the_slant_distance_and_the_given_sound_speed_count() -> None:
    nodes = [{"address": 1, "position": [0, 0, 0]}, {"address": 9, "position": [300, 400, 1200]}]
    mapping = {"sound_speed_m_s": 1450, "nodes": nodes}
    medium = Medium(scenario_from_mapping(mapping, source="test"))
    path = medium.path(1, 9, 0)
    assert path.distance_m == 1300.0
    assert path.propagation_s == pytest.approx(1300.0 / 1450.0)
    assert medium.addresses == (1, 9)
    assert medium.position(9, 0) == (300.0, 400.0, 1200.0)


def test_nodes_at_one_place_hear_each_other_at_once(line: Line) -> None:
    medium = Medium(line(0, 0, profile="ideal"))
    (arrival,) = medium.transmit(1, 512, 5).arrivals
    assert (arrival.starts_at, arrival.ends_at) == (5, 4101)
    assert medium.finish(arrival).is_received


@pytest.mark.parametrize(
    ("source", "frame_bytes", "message"),
    [
        (1, 65, "frame has 65 bytes; allowed by evologics_s2c_18_34: 1..64"),
        (1, 0, "frame has 0 bytes; allowed by evologics_s2c_18_34: 1..64"),
        (3, 8, r"node is 3; nodes: \[1, 2\]"),
    ],
)
def test_what_no_modem_can_transmit_is_refused(
    line: Line, source: int, frame_bytes: int, message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Medium(line(0, 100)).transmit(source, frame_bytes, 0)


def test_a_half_duplex_modem_transmits_one_frame_at_a_time(line: Line) -> None:
    medium = Medium(line(0, 100))
    emission = medium.transmit(1, 64, 0)
    with pytest.raises(ValueError, match=f"node 1 transmits until {emission.ends_at} ns"):
        medium.transmit(1, 64, emission.ends_at - 1)
    assert medium.transmit(1, 64, emission.ends_at).sequence == 1


def test_paths_lead_from_one_node_to_another(line: Line) -> None:
    medium = Medium(line(0, 100))
    with pytest.raises(ValueError, match="no sound goes from 1 to 1"):
        medium.path(1, 1, 0)
    with pytest.raises(ValueError, match="no sound goes from 1 to 7"):
        medium.path(1, 7, 0)


def test_a_moving_node_changes_delay_level_and_duration() -> None:
    track = [{"t": 0, "position": [300, 0, 10]}, {"t": 1000, "position": [2300, 0, 10]}]
    nodes = [{"address": 1, "position": [0, 0, 10]}, {"address": 2, "track": track}]
    mapping = {"channel": "none", "nodes": nodes}
    medium = Medium(scenario_from_mapping(mapping, source="test"))
    (start,) = medium.transmit(1, 64, 0).arrivals
    (later,) = medium.transmit(1, 64, 600 * SECOND).arrivals
    assert start.propagation_s == pytest.approx(300.0 / 1498.0)
    assert later.propagation_s == pytest.approx(1500.0 / 1498.0)
    assert later.received_level_db < start.received_level_db
    assert later.range_rate_m_s == pytest.approx(2.0)
    stretch = (later.ends_at - later.starts_at) / medium.profile(1).airtime_ns(64)
    assert stretch == pytest.approx(1.0 + 2.0 / 1500.0, abs=1e-8)
    assert medium.path(2, 1, 2000 * SECOND).distance_m == 2300.0


@pytest.mark.parametrize(
    ("distance_m", "low", "high"), [(1500, 0.08, 0.12), (3500, 0.45, 0.55), (50, 0.0, 0.01)]
)
def test_the_default_sea_loses_frames_by_distance(
    line: Line, distance_m: float, low: float, high: float
) -> None:
    lost = 0
    for seed in range(20):
        receptions = _run(Medium(line(0, distance_m, seed=seed)), _every(2.0, 1, 250))
        lost += sum(not reception.is_received for reception in receptions.values())
    assert low <= lost / 5000 <= high


def test_one_sender_alone_loses_nothing_without_a_channel(line: Line) -> None:
    receptions = _run(Medium(line(0, 1500, 60_000, channel="none")), _every(2.0, 1, 200))
    assert _shares(receptions)[Outcome.RECEIVED] == 1.0


def test_named_losses_act_alone_or_on_top_of_the_channel(line: Line) -> None:
    loss = {"frame": 0.3}
    alone = _run(Medium(line(0, 1500, channel="none", loss=loss)), _every(1.0, 1, 4000))
    assert _shares(alone)[Outcome.NOISE] == pytest.approx(0.3, abs=0.02)
    both = _run(Medium(line(0, 1500, loss=loss)), _every(10.0, 1, 4000))
    assert _shares(both)[Outcome.NOISE] == pytest.approx(1 - 0.7 * 0.9, abs=0.025)


def test_a_direction_can_have_a_loss_of_its_own(line: Line) -> None:
    links = [{"from": 1, "to": 2, "loss": {"frame": 1.0}}, {"from": 2, "to": 1, "loss": {}}]
    scenario = line(0, 1500, 2000, channel="none", loss={"frame": 0.5}, links=links)
    transmissions = sorted(
        _every(8.0, 1, 500) + [(4 * SECOND + at, 2) for at, _ in _every(8.0, 2, 500)]
    )
    receptions = _run(Medium(scenario), transmissions)
    received = Counter(key[:2] for key, reception in receptions.items() if reception.is_received)
    assert received[1, 2] == 0
    assert received[2, 1] == 500
    assert 200 < received[1, 3] < 300


def test_bursts_of_loss_come_in_runs(line: Line) -> None:
    loss = {"frame": 0.2, "burst_frames": 5}
    receptions = _run(Medium(line(0, 1500, channel="none", loss=loss)), _every(1.0, 1, 10_000))
    lost = [not receptions[1, 2, index].is_received for index in range(10_000)]
    runs = sum(b and not a for a, b in zip([False, *lost], lost, strict=False))
    assert sum(lost) / 10_000 == pytest.approx(0.2, abs=0.03)
    assert sum(lost) / runs == pytest.approx(5.0, rel=0.1)


def test_received_frames_may_be_damaged_or_doubled(line: Line) -> None:
    faults = {"corrupt": 0.2, "duplicate": 0.1, "duplicate_after_s": 0.25}
    scenario = line(0, 1500, channel="none", loss={"frame": 0.5}, faults=faults)
    receptions = _run(Medium(scenario), _every(1.0, 1, 4000)).values()
    received = [reception for reception in receptions if reception.is_received]
    damaged = [reception for reception in received if reception.corrupt_seed is not None]
    doubled = [reception for reception in received if reception.duplicates_after_s]
    assert len(damaged) / len(received) == pytest.approx(0.2, abs=0.03)
    assert len(doubled) / len(received) == pytest.approx(0.1, abs=0.025)
    assert {reception.duplicates_after_s for reception in doubled} == {(0.25,)}
    for reception in receptions:
        if not reception.is_received:
            assert reception.corrupt_seed is None
            assert reception.duplicates_after_s == ()
    assert corrupt(b"frame", random.Random(damaged[0].corrupt_seed)) != b"frame"


def _crowd(line: Line, **settings: Any) -> Scenario:
    return line(0, 700, 1500, 2600, 3300, **settings)


def _traffic(count: int) -> list[tuple[int, int]]:
    """Frames of five nodes at instants that make them overlap now and then."""
    rng = random.Random(5)
    free_at = dict.fromkeys(range(1, 6), 0)
    transmissions: list[tuple[int, int]] = []
    now = 0
    while len(transmissions) < count:
        now += round(rng.expovariate(0.8) * SECOND)
        source = rng.randrange(1, 6)
        if free_at[source] <= now:
            free_at[source] = now + SECOND
            transmissions.append((now, source))
    return transmissions


@pytest.mark.parametrize("collisions", ["capture", "sinr", "protocol"])
def test_one_seed_gives_one_history_and_another_seed_another(line: Line, collisions: str) -> None:
    traffic = _traffic(400)
    first = _run(Medium(_crowd(line, seed=3, collisions=collisions)), traffic)
    again = _run(Medium(_crowd(line, seed=3, collisions=collisions)), traffic)
    other = _run(Medium(_crowd(line, seed=4, collisions=collisions)), traffic)
    assert first == again
    assert first != other
    assert all(share > 0.0 for outcome, share in _shares(first).items() if outcome != Outcome.DEAF)


@pytest.mark.parametrize("collisions", ["capture", "sinr", "protocol"])
def test_a_driver_that_finishes_late_gets_the_same_history(line: Line, collisions: str) -> None:
    traffic = _traffic(400)
    in_time = _run(Medium(_crowd(line, collisions=collisions)), traffic)
    late = _run(Medium(_crowd(line, collisions=collisions)), traffic, late_ns=20 * SECOND)
    assert in_time == late


def test_the_order_of_calls_at_one_instant_does_not_matter(line: Line) -> None:
    traffic = [(2 * index * SECOND, source) for index in range(100) for source in (1, 3, 5)]
    mirrored = [(2 * index * SECOND, source) for index in range(100) for source in (5, 3, 1)]
    assert _run(Medium(_crowd(line)), traffic) == _run(Medium(_crowd(line)), mirrored)


def test_another_node_that_is_silent_changes_nothing(line: Line) -> None:
    traffic = _every(2.0, 1, 300)
    two = _run(Medium(line(0, 1500)), traffic)
    three = _run(Medium(line(0, 1500, 2500)), traffic)
    assert {key: value for key, value in three.items() if key[1] == 2} == two


def test_a_seed_means_the_same_sea_in_every_process_and_version(line: Line) -> None:
    receptions = _run(Medium(line(0, 3500, seed=7)), _every(2.0, 1, 40))
    history = "".join("." if receptions[1, 2, index].is_received else "x" for index in range(40))
    assert history == ".................x..........x..........."


def test_memory_does_not_grow_with_the_number_of_transmissions(line: Line) -> None:
    medium = Medium(line(0, 1500))
    most = 0
    pending: list[Arrival] = []
    for index in range(100_000):
        now = index * SECOND
        while pending and pending[0].ends_at <= now:
            medium.finish(pending.pop(0))
        pending += medium.transmit(1 + index % 2, 64, now).arrivals
        most = max(most, medium.remembered)
    assert most < 100


def test_arrivals_that_nobody_asks_about_are_forgotten(line: Line) -> None:
    medium = Medium(line(0, 1500))
    (first,) = medium.transmit(1, 64, 0).arrivals
    for index in range(1, 2000):
        medium.transmit(1, 64, index * SECOND)
    assert medium.remembered < 700
    with pytest.raises(ValueError, match="is not expected"):
        medium.finish(first)
    (last,) = medium.transmit(1, 64, 2000 * SECOND).arrivals
    assert isinstance(medium.finish(last), Reception)
