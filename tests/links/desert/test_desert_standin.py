import itertools
import random
from typing import Any

import pytest

from tests.links.desert.desert_rig import standin
from zacoustic.channel.faults.faults import FaultSpec
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.clock import NS_PER_S, ns_to_seconds
from zacoustic.errors import ConfigError
from zacoustic_desert import standin as module
from zacoustic_desert.channel import SampleChannel, medium_of
from zacoustic_desert.standin import StandIn, StandInConfig

MS = NS_PER_S // 1000


def run_out(behind: StandIn, until: int = 10**15) -> list[tuple[int, int, bytes]]:
    """Step to the end; returns instant, node and payload of each delivery."""
    seen = []
    while (due_at := behind.poll_timeout()) is not None and due_at <= until:
        behind.handle_timeout(due_at)
        while (delivery := behind.poll_delivery()) is not None:
            seen.append((due_at, delivery.node, delivery.payload))
    return seen


def with_clients(**settings: Any) -> StandIn:
    behind = standin(**settings)
    for node in range(behind.nodes):
        behind.handle_client(node, 0)
    return behind


@pytest.mark.parametrize(
    ("length", "written", "packets"),
    [
        (64, 65, [64, 1]),
        (64, 100, [64, 36]),
        (64, 200, [64, 64, 64, 8]),
        (64, 1000, [64] * 15 + [40]),
        (512, 500, [500]),
        (512, 513, [512, 1]),
        (512, 1000, [512, 488]),
        (4096, 4096, [4096]),
    ],
)
def test_long_writes_are_split_at_the_read_length(
    length: int, written: int, packets: list[int]
) -> None:
    behind = with_clients(max_read_length=length)
    content = random.Random(written).randbytes(written)
    behind.handle_write(0, content, 0)
    seen = run_out(behind)
    assert [len(payload) for _, _, payload in seen] == packets
    assert b"".join(payload for _, _, payload in seen) == content
    assert behind.poll_timeout() is None, "an idle stand-in has a timer"


def test_writes_without_a_pause_merge_in_some_runs_and_with_one_millisecond_never() -> None:
    shapes = set()
    for seed in range(30):
        apart, together = with_clients(seed=seed), with_clients(seed=seed)
        for number in range(50):
            apart.handle_write(0, bytes((number,)) * 30, number * MS)
            together.handle_write(0, bytes((number,)) * 30, number * 100_000)
        assert [len(payload) for _, _, payload in run_out(apart)] == [30] * 50
        seen = [payload for _, _, payload in run_out(together)]
        assert b"".join(seen) == b"".join(bytes((number,)) * 30 for number in range(50))
        shapes.add(tuple(map(len, seen)))
    assert len(shapes) > 10
    assert all(max(shape) <= 64 for shape in shapes)


@pytest.mark.parametrize(("length", "rate"), [(64, 2.77), (512, 2.21), (4096, 0.96)])
def test_saturated_rate_is_the_measured_one(length: int, rate: float) -> None:
    behind = with_clients(max_read_length=length)
    behind.handle_write(0, bytes(length * 300), 0)
    seen = run_out(behind)
    measured = 299 / ns_to_seconds(seen[-1][0] - seen[0][0])
    assert measured == pytest.approx(rate, rel=0.06)


def test_latency_of_an_idle_hop_is_the_measured_one() -> None:
    behind = with_clients()
    sent_at = [number * 3_070_000_000 for number in range(400)]
    took = []
    for at in sent_at:
        behind.handle_write(0, bytes(20), at)
        took += [ns_to_seconds(instant - at) for instant, _, _ in run_out(behind)]
    assert len(took) == 400
    # Measured over one hop: 0.52..1.10, mean 0.72..0.82.
    assert sum(took) / 400 == pytest.approx(0.78, abs=0.05)
    assert min(took) > 0.4
    assert max(took) < 1.2


def test_one_packet_at_most_leaves_the_application_in_a_period() -> None:
    behind = with_clients(period_s=5.0, wait_s=0.0, listen_s=0.0)
    for number in range(8):
        behind.handle_write(0, b"frame", number * 10 * MS)
    instants = [at for at, _, _ in run_out(behind)]
    assert [after - before for before, after in itertools.pairwise(instants)] == [5 * NS_PER_S] * 7


def test_packets_for_nobody_are_discarded_and_those_of_a_client_that_left_are_sent() -> None:
    behind = standin()
    behind.handle_client(0, 0)
    behind.handle_write(0, bytes(384), 0)
    behind.handle_client_left(0, 1)
    assert run_out(behind, 2 * NS_PER_S) == []
    discarded = behind.counts["discarded"]
    assert discarded >= 1
    behind.handle_client(1, 2 * NS_PER_S)
    seen = run_out(behind)
    assert len(seen) + discarded == behind.counts["sent"] == 6


def test_broadcast_and_pairs() -> None:
    for paired, expected in ((False, {0, 2, 3}), (True, {0})):
        behind = with_clients(nodes=4, paired=paired)
        behind.handle_write(1, b"x", 0)
        assert {node for _, node, _ in run_out(behind)} == expected
    with pytest.raises(ConfigError, match="3 nodes cannot be paired"):
        standin(nodes=3, paired=True)


def test_node_that_transmits_loses_what_arrives() -> None:
    behind = with_clients(half_duplex=True, max_read_length=512)
    for second in range(200):
        for node in (0, 1):
            behind.handle_write(node, bytes(512), second * 500 * MS)
    run_out(behind)
    share = behind.counts["lost"] / behind.counts["sent"]
    assert 0.10 < share < 0.24  # measured: 0.14 and 0.17
    quiet = with_clients(half_duplex=True)
    quiet.handle_write(0, bytes(64 * 100), 0)
    assert len(run_out(quiet)) == 100


def test_loss_is_the_share_that_was_asked_for_and_reproducible() -> None:
    def fates(seed: int) -> list[tuple[int, int, bytes]]:
        behind = with_clients(loss=0.2, seed=seed)
        behind.handle_write(0, bytes(64 * 500), 0)
        return run_out(behind)

    assert fates(1) == fates(1)
    assert fates(1) != fates(2)
    assert 370 < len(fates(1)) < 430
    with pytest.raises(ConfigError, match="loss is 2; allowed"):
        standin(loss=2.0)


def test_scenario_decides_about_packets() -> None:
    scenario = Scenario(
        channel="none",
        nodes=tuple(NodeSpec(address=at, position=(1500.0 * at, 0.0, 10.0)) for at in (7, 9)),
        loss=LossSpec(frame=0.3),
        faults=FaultSpec(corrupt=0.2, duplicate=0.2),
    )
    behind = StandIn(medium_of(scenario, 64), rng=random.Random(1))
    for node in (0, 1):
        behind.handle_client(node, 0)
    behind.handle_write(0, bytes(64 * 300), 0)
    payloads = [payload for _, node, payload in run_out(behind) if node == 1]
    assert behind.counts["sent"] == 300
    assert 60 < behind.counts["lost"] < 120
    assert len(payloads) > 300 - behind.counts["lost"]
    assert any(any(payload) for payload in payloads), "nothing was damaged"
    with pytest.raises(ConfigError, match="of node 7 takes 64 bytes; max_read_length is 65"):
        medium_of(scenario, 65)


def test_crash_forgets_everything() -> None:
    behind = with_clients()
    behind.handle_write(0, bytes(640), 0)
    behind.handle_timeout(600 * MS)
    behind.handle_crash(601 * MS)
    assert behind.poll_timeout() is None
    assert behind.waiting(0) == 0
    behind.handle_client(0, 700 * MS)
    behind.handle_client(1, 700 * MS)
    behind.handle_write(0, b"again", 800 * MS)
    assert [payload for _, _, payload in run_out(behind)] == [b"again"]


def test_queue_has_an_end(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "QUEUE_LIMIT_PACKETS", 10)
    behind = with_clients()
    behind.handle_write(0, bytes(64 * 50), 0)
    assert len(run_out(behind)) < 50
    assert behind.counts["dropped"] + behind.counts["sent"] == 50


def test_own_transmissions_are_remembered_no_longer_than_they_matter() -> None:
    medium = SampleChannel(2, random.Random(1))
    for number in range(1000):
        medium.transmit(0, 64, number * NS_PER_S)
    assert len(medium._transmits[0]) < 10


@pytest.mark.parametrize(
    "settings",
    [{"max_read_length": 0}, {"max_read_length": 4097}, {"period_s": 0.0}, {"wait_s": -1.0}],
)
def test_settings_outside_their_range_are_named(settings: dict[str, Any]) -> None:
    (name,) = settings
    with pytest.raises(ValueError, match=f"{name} is "):
        StandInConfig(**settings)
