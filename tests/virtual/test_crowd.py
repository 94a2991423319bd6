"""Many nodes share one channel: agreement costs a few bytes a frame, and nothing grows with pairs.

`tests/benchmarks/bench_fleets.py` has the figures of fleets of 10 to 60 nodes.
"""

import random
from collections.abc import Callable, Mapping
from functools import partial

import pytest

from tests.core.rig import End
from tests.virtual.crowd import OFF, run_crowd
from tests.virtual.fleet import Trial, line
from tests.virtual.manysubscribers import run_subscribers
from zacoustic.core.base.stats import Cause
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import PeerSeen, SampleReceived, StreamsDiffer
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import WIRE_VERSION
from zacoustic.testing.virtual import Disturb, VirtualNetwork

TAG = TransmitRules(agreement=AgreementMethod.TAG)
NODES = 12
REPORT_EVERY_S = 60.0


def table(nodes: int = NODES) -> StreamTable:
    names = {address: f"n{address}" for address in range(1, nodes + 1)}
    return StreamTable([TopicSpec(stream_id=1, name="{node}/report")], nodes=names)


def reporting(seed: int, disturb: Disturb | None = None) -> VirtualNetwork:
    """Return a fleet on a line in calm water, of which each node reports once a minute."""
    network = VirtualNetwork(
        line(*(100.0 * node for node in range(NODES)), channel="none"),
        table(),
        seed=seed,
        disturb=disturb,
        rules=TAG,
    )
    rng = random.Random(seed)
    for address in network.addresses:
        first_s = rng.uniform(0, REPORT_EVERY_S)
        network.every(REPORT_EVERY_S, partial(publish, network, address), first_s=first_s)
    return network


def publish(network: VirtualNetwork, address: int) -> None:
    if network.is_running(address):
        network.publish(address, 1, b"report")


def spent(network: VirtualNetwork, cause: Cause) -> int:
    return sum(
        entry.transmitted_bytes
        for stats in network.stats()
        for entry in stats.ledger()
        if entry.cause is cause
    )


def frames(network: VirtualNetwork) -> int:
    return sum(stats.frames_transmitted for stats in network.stats())


def test_a_cold_fleet_delivers_what_bare_reports_do() -> None:
    for seed in (1, 2):
        bare, tagged = (
            run_crowd(seed, method, nodes=10, period_s=60, length_s=600)
            for method in (OFF, AgreementMethod.TAG.value)
        )
        assert tagged.arrived >= 0.9 * bare.arrived, f"seed {seed}"
        assert tagged.agreement <= 0.3, f"seed {seed}"  # a cold start has more HELLOs than an hour
        assert Cause.CONFIRM.value not in tagged.bytes_by_cause, f"seed {seed}"
        assert tagged.frames <= 1.02 * bare.frames, f"seed {seed}"


def test_a_restarted_node_understands_the_others_with_their_next_report() -> None:
    network = reporting(1)
    network.at(1800, partial(network.crash, 1))
    network.at(1810, partial(network.start, 1))
    network.run(until_s=1800)
    before = spent(network, Cause.HELLO)
    network.events.clear()
    network.run(until_s=1810 + 3 * REPORT_EVERY_S)
    known = {
        event.address for at, event in network.events if at == 1 and isinstance(event, PeerSeen)
    }
    assert known == set(range(2, NODES + 1))
    # A HELLO of each of the others, and what all frames have; no frame of its own for any of it.
    assert spent(network, Cause.HELLO) - before <= 4 * NODES * 3 + 5 * (NODES + 4)
    assert spent(network, Cause.CONFIRM) == 0


def test_nodes_that_have_missed_every_hello_do_not_ask_all_at_once() -> None:
    """All lack the HELLOs of all, which come again by themselves: no cause for 132 questions."""
    deaf_until = round(7.2 * REPORT_EVERY_S * NS_PER_S)  # there are three HELLOs before
    network = reporting(1, disturb=lambda source, node, now: (0.0,) if now > deaf_until else ())
    network.run(until_s=40 * REPORT_EVERY_S)
    assert spent(network, Cause.ASK) <= 3 * 3 * NODES
    assert frames(network) <= 1.05 * 40 * NODES
    heard = {(at, event.address) for at, event in network.events if isinstance(event, PeerSeen)}
    assert len(heard) == NODES * (NODES - 1)


def test_a_question_that_another_node_asks_is_not_asked_again() -> None:
    tagged = bytes((0xB1, 1, 1, 1)) + b"report"
    for is_asked_by_another in (True, False):
        end = End(1, table(), rules=TAG)
        for instant_s in range(16):
            end.hear(tagged, instant_s * NS_PER_S, source=2)
        if is_asked_by_another:
            end.hear(bytes((0xB6, 2, 0)), 15 * NS_PER_S + 1, source=3)
        sent = [end.send(instant_s * NS_PER_S) for instant_s in range(16, 1000)]
        assert any(sent) is not is_asked_by_another


def test_the_row_that_another_node_has_asked_for_answers_this_one() -> None:
    end = End(1, table(), rules=TAG)
    end.hear(bytes((0xB0, WIRE_VERSION, 1, 1)) + b"othr", 0, source=2)
    end.hear(bytes((0xB1, 1, 1, 1)) + b"report", NS_PER_S // 9, source=2)  # a row is missing
    end.hear(bytes((0xB6, 2, 1)), NS_PER_S // 8, source=3)
    end.hear(bytes((0xB7, 1, 1, 1)) + b"diff", NS_PER_S // 7, source=2)
    assert [each.stream_id for each in end.got(StreamsDiffer)] == [1]
    assert not any(end.send(instant_s * NS_PER_S) for instant_s in range(1, 1000))


def test_noise_of_strangers_draws_no_frame() -> None:
    """Whoever has not heard the HELLO of a boot epoch waits for it, and asks once."""
    rng = random.Random(1)
    end = End(1, table(), rules=TAG)
    for instant_s in range(2000):
        tagged = bytes((0xB1, *rng.randbytes(2), 1)) + b"noise"
        end.hear(tagged, instant_s * NS_PER_S, source=rng.randrange(2, 255))
        assert end.poll(end.now) is None
    for instant_s in range(2000, 4000):
        end.hear(bytes((0xB1, 1, 1, 1)) + b"noise", instant_s * NS_PER_S, source=200)
        transmission = end.poll(end.now)
        if transmission is not None:
            assert transmission.frame_bytes == bytes((0xB6, 200, 0))
            end.report(transmission)
    assert end.engine.stats.frames_transmitted == 1


def test_what_is_told_to_one_node_is_agreed_on_as_ever() -> None:
    """Reports for the shore alone have no TAG once it has confirmed."""
    crowd = run_crowd(
        1, AgreementMethod.TAG.value, nodes=6, period_s=30, length_s=900, to_shore=True
    )
    assert crowd.bytes_by_cause[Cause.HELLO.value] <= 6 * 5 * 8
    assert crowd.arrived >= 0.7


@pytest.mark.parametrize("method", AgreementMethod)
def test_a_bare_frame_of_a_node_that_believes_itself_confirmed_draws_a_question(
    method: AgreementMethod,
) -> None:
    end = End(1, table(), rules=TransmitRules(agreement=method))
    end.hear(b"\x01report", 0, source=2)
    sent = [end.send(instant_s * NS_PER_S) for instant_s in range(120)]
    assert [each.frame_bytes for each in sent if each] == [bytes((0xB6, 2, 0))]
    assert not end.got(SampleReceived)


def test_nodes_that_agree_in_different_ways_misread_nothing(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        rng = random.Random(f"ways {seed}")
        nodes = rng.choice((2, 3, 4))
        ways: Mapping[int, AgreementMethod] = {
            address: rng.choice(tuple(AgreementMethod)) for address in range(1, nodes + 1)
        }
        mtu_bytes, repeat = rng.choice((8, 16, 64)), rng.choice((0.0, 0.4))
        trial = Trial(
            seed, nodes=nodes, mtu_bytes=mtu_bytes, repeat=repeat, calm_s=5000, agreement=ways
        )
        trial.run()
        drawn = f"seed {seed}, {ways}, {mtu_bytes}, {repeat}"
        assert not trial.wrong, f"{drawn}: {trial.wrong[0]}"
        assert not trial.missing(), f"{drawn}: {trial.missing()}"
        assert trial.delivered, drawn


def test_many_subscribers_acknowledge_in_turn_and_who_lacks_a_sample_gets_it_alone() -> None:
    """Each subscriber has to say once that it has a sample; that took 3.4 frames of each of 16."""
    subscribers = 16
    for seed in (1, 2):
        cost = run_subscribers(seed, subscribers, AgreementMethod.TAG, reports=False, length_s=1200)
        assert cost.arrived == 1.0, f"seed {seed}"
        assert cost.frames <= 2.8 * subscribers, f"seed {seed}"
