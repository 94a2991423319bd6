"""Who survives an overlap: half-duplex, deafness, the three collision rules."""

from collections.abc import Callable

import pytest

from zacoustic.channel.arrival import Arrival, Outcome, Reception
from zacoustic.channel.medium import Medium
from zacoustic.channel.scenario import Scenario, scenario_from_mapping

SECOND = 1_000_000_000
Line = Callable[..., Scenario]


def _receptions(
    medium: Medium, transmissions: list[tuple[int, float]], *, frame_bytes: int = 64
) -> dict[tuple[int, int], Reception]:
    """Transmit (source, s) in order; return what became of the last frame from source at node."""
    pending: list[Arrival] = []
    for source, at_s in transmissions:
        pending += medium.transmit(source, frame_bytes, round(at_s * SECOND)).arrivals
    pending.sort(key=lambda arrival: arrival.ends_at)
    return {(arrival.source, arrival.node): medium.finish(arrival) for arrival in pending}


def _outcomes(
    medium: Medium, transmissions: list[tuple[int, float]]
) -> dict[tuple[int, int], Outcome]:
    return {key: reception.outcome for key, reception in _receptions(medium, transmissions).items()}


def test_a_node_does_not_hear_what_arrives_while_it_transmits(line: Line) -> None:
    # One second apart; both transmit at once, and the frames last 0.86 s: they pass each other.
    outcomes = _outcomes(Medium(line(0, 1500, channel="none")), [(1, 0.0), (2, 0.0)])
    assert outcomes == {(1, 2): Outcome.RECEIVED, (2, 1): Outcome.RECEIVED}
    for start_s in (0.2, 0.9, 1.0, 1.5, 1.8):
        medium = Medium(line(0, 1500, channel="none"))
        outcomes = _outcomes(medium, [(1, 0.0), (2, start_s)])
        assert outcomes[1, 2] is Outcome.HALF_DUPLEX


def test_frames_that_only_touch_do_not_disturb(line: Line) -> None:
    medium = Medium(line(0, 1500, channel="none"))
    emission = medium.transmit(1, 64, 0)
    (arrival,) = emission.arrivals
    medium.transmit(2, 64, arrival.ends_at)
    assert medium.finish(arrival).outcome is Outcome.RECEIVED


def test_a_full_duplex_modem_hears_while_it_transmits(line: Line) -> None:
    medium = Medium(line(0, 0, profile="ideal"))
    outcomes = _outcomes(medium, [(1, 0.0), (2, 0.0), (1, 0.0)])
    assert set(outcomes.values()) == {Outcome.RECEIVED}


def test_the_ideal_modem_receives_from_all_at_once(line: Line) -> None:
    medium = Medium(line(0, 0, 0, profile="ideal"))
    outcomes = _outcomes(medium, [(1, 0.0), (2, 0.0), (3, 0.0)])
    assert len(outcomes) == 6
    assert set(outcomes.values()) == {Outcome.RECEIVED}


def test_of_two_equal_frames_the_first_collides_and_the_second_meets_a_deaf_receiver(
    line: Line,
) -> None:
    medium = Medium(line(-1000, 1000, 0, channel="none"))
    receptions = _receptions(medium, [(1, 0.0), (2, 0.3)])
    assert receptions[1, 3].outcome is Outcome.COLLISION
    assert receptions[2, 3].outcome is Outcome.DEAF
    # 0.56 of 0.86 s overlap.
    assert receptions[1, 3].sinr_db == pytest.approx(1.86, abs=0.05)


def test_the_first_frame_survives_when_it_is_much_stronger(line: Line) -> None:
    outcomes = _outcomes(Medium(line(-300, 1500, 0, channel="none")), [(2, 0.0), (1, 0.9)])
    assert outcomes[1, 3] is Outcome.DEAF
    assert outcomes[2, 3] is Outcome.COLLISION
    outcomes = _outcomes(Medium(line(-300, 1500, 0, channel="none")), [(2, 0.0), (1, 0.7)])
    assert outcomes[1, 3] is Outcome.RECEIVED
    assert outcomes[2, 3] is Outcome.DEAF


def test_several_faint_frames_add_up_to_a_collision(line: Line) -> None:
    # 6 dB are needed: one interferer is 7.9 dB below, two together 4.9.
    places = (-500, 1000, 1000, 0)
    alone = _outcomes(Medium(line(*places, channel="none")), [(1, 0.0), (2, 0.1)])
    assert alone[1, 4] is Outcome.RECEIVED
    both = _outcomes(Medium(line(*places, channel="none")), [(1, 0.0), (2, 0.1), (3, 0.1)])
    assert both[1, 4] is Outcome.COLLISION


def test_protocol_rule_destroys_both_whatever_their_levels(line: Line) -> None:
    medium = Medium(line(-300, 1500, 0, channel="none", collisions="protocol"))
    outcomes = _outcomes(medium, [(2, 0.0), (1, 0.7)])
    assert outcomes[1, 3] is Outcome.COLLISION
    assert outcomes[2, 3] is Outcome.COLLISION


def test_sinr_rule_lets_a_strong_frame_pass_and_kills_an_equal_one(line: Line) -> None:
    strong = Medium(line(-300, 3000, 0, channel="awgn", collisions="sinr"))
    receptions = _receptions(strong, [(2, 0.0), (1, 1.7)])
    assert receptions[1, 3].outcome is Outcome.RECEIVED
    assert receptions[1, 3].sinr_db < receptions[1, 3].arrival.snr_db
    # Spreading gains 13 dB against an equal level, but not against one 15 dB stronger.
    equal = Medium(line(-3000, 500, 0, channel="awgn", collisions="sinr"))
    assert _outcomes(equal, [(1, 0.0), (2, 1.8)])[1, 3] is Outcome.COLLISION


def test_an_own_transmission_makes_the_receiver_give_up_and_lock_anew(line: Line) -> None:
    # Node 3 follows 1 (1.0 s to 1.86 s), transmits a byte at 1.1 s, then hears its neighbour 2.
    medium = Medium(line(-1500, 15, 0, channel="none"))
    first = medium.transmit(1, 64, 0).arrivals[1]
    medium.transmit(3, 1, round(1.1 * SECOND))
    second = medium.transmit(2, 8, round(1.4 * SECOND)).arrivals[1]
    assert (first.node, second.node) == (3, 3)
    assert medium.finish(second).outcome is Outcome.RECEIVED
    assert medium.finish(first).outcome is Outcome.HALF_DUPLEX


def test_what_is_too_weak_to_be_noticed_does_not_make_the_receiver_deaf(line: Line) -> None:
    # 20 km are 30 dB below the noise.
    medium = Medium(line(-20_000, 500, 0, channel="awgn"))
    outcomes = _outcomes(medium, [(1, 0.0), (2, 13.5)])
    assert outcomes[1, 3] is Outcome.NOISE
    assert outcomes[2, 3] is Outcome.RECEIVED


def _mixed(collisions: str, other: str) -> Medium:
    nodes = [
        {"address": 1, "position": [0, 0, 10]},
        {"address": 2, "position": [1500, 0, 10]},
        {"address": 3, "position": [1400, 0, 10], "profile": other},
    ]
    mapping = {"channel": "none", "collisions": collisions, "nodes": nodes}
    return Medium(scenario_from_mapping(mapping, source="test"))


@pytest.mark.parametrize("collisions", ["capture", "protocol"])
def test_another_kind_of_modem_disturbs_only_in_the_same_band(collisions: str) -> None:
    for other, expected in (("nanomodem", Outcome.COLLISION), ("janus", Outcome.RECEIVED)):
        medium = _mixed(collisions, other)
        emission = medium.transmit(1, 64, 0)
        assert [arrival.node for arrival in emission.arrivals] == [2]
        assert medium.transmit(3, 64, SECOND).arrivals == ()
        assert medium.finish(emission.arrivals[0]).outcome is expected


def test_only_foreign_sound_is_forgotten_too() -> None:
    medium = _mixed("capture", "nanomodem")
    for index in range(500):
        medium.transmit(3, 64, index * 2 * SECOND)
    assert medium.remembered < 100


def test_an_arrival_is_judged_once(line: Line) -> None:
    medium = Medium(line(0, 1500))
    (arrival,) = medium.transmit(1, 64, 0).arrivals
    medium.finish(arrival)
    with pytest.raises(ValueError, match="arrival 0 from 1 at 2 is not expected"):
        medium.finish(arrival)
