"""A fleet with a key: what holds without a seal holds with it, and strangers do nothing.

The oracle for nonces is in the cipher (`tests.virtual.sealed`): it refuses one that comes twice.
"""

import random
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import msgspec
import pytest

from tests.virtual.fleet import line
from tests.virtual.sealed import IN_STEP_BYTES, SealedFleet, seal_bytes
from zacoustic.core.base.qos import Forward, Priority, Qos, Reliability
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
    StreamsDiffer,
)
from zacoustic.core.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.linkseal import SealRules
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.testing.scenarios import draw_scenario, run_scenario
from zacoustic.testing.virtual import Modem, VirtualNetwork

NAV, LOG, ARM, DENSE = 10, 11, 20, 30
HOUR_S: Final = 3600.0
CALM_S: Final = 2 * HOUR_S
"""Where frames have 32 bytes, a seal makes objects of short samples, and without carrier sense five
nodes need 4,900 s for them (seed 93)."""
QUIET: Final = {"channel": "none"}
REPORTS: Final = 1_600
_DEPTH: Final = TypeSpec(
    name="Depth",
    fields=(
        FieldSpec(name="depth", type="float32", range=(0, 1000), step=0.1),
        FieldSpec(name="ticket", type="uint16", range=(0, 60_000)),
    ),
)


def table(nodes: int = 2, *, other: bool = False) -> StreamTable:
    """Return the table of a fleet, or one of which a topic differs."""
    return StreamTable(
        [
            TopicSpec(stream_id=NAV, name="{node}/nav" if not other else "{node}/navigation"),
            TopicSpec(
                stream_id=LOG,
                name="{node}/log",
                qos=Qos(reliability=Reliability.RELIABLE, depth=20),
            ),
            ServiceSpec(stream_id=ARM, name="arm", server=2, timeout_s=300),
            TopicSpec(
                stream_id=DENSE,
                name="{node}/depth",
                type_name="Depth",
                codec="dense",
                qos=Qos(depth=20, priority=Priority.DATA),
            ),
        ],
        types=TypeTable([_DEPTH]),
        nodes={address: f"n{address}" for address in range(1, nodes + 1)},
    )


def test_all_holds_in_any_random_scenario(count: Callable[[int], int]) -> None:
    for seed in range(count(300)):
        drawn = msgspec.structs.replace(draw_scenario(seed), calm_s=CALM_S)
        violations = run_scenario(drawn, build=SealedFleet()).violations
        assert not violations, f"{seed}: {len(violations)} complaints, {violations[0]}"


def test_a_seal_takes_five_and_a_quarter_bytes(sized: Callable[..., int]) -> None:
    reports = sized(REPORTS, share=400)
    network = VirtualNetwork(line(0, 800, **QUIET), table(), build=SealedFleet())
    for number in range(reports):
        network.at(5.0 + 2 * number, lambda: network.publish(1, NAV, b"x" * 10))
    network.run(until_s=HOUR_S)
    assert len(network.samples(2, NAV)) == reports
    frames, seals = seal_bytes(network)
    assert seals / frames == pytest.approx(IN_STEP_BYTES, rel=0.01)


@pytest.mark.parametrize(
    "every", [1, *(pytest.param(each, marks=pytest.mark.soak) for each in (2, 4)), 10]
)
def test_a_strong_frame_takes_seven_and_three_quarters_more(
    every: int, sized: Callable[..., int]
) -> None:
    """One report in so many is followed by a call; request and answer are strong."""
    reports = sized(REPORTS, share=400)
    fleet = SealedFleet()

    def reply(node: int, event: Event) -> None:
        if isinstance(event, RequestReceived):
            network.apply(node, lambda each, now: each.reply(event.call, b"", now))

    network = VirtualNetwork(line(0, 800, **QUIET), table(), build=fleet, deliver=reply)
    for number in range(reports):
        network.at(5.0 + 12 * number, lambda: network.publish(1, NAV, b"x" * 10))
        if number % every == 0:
            at_s = 8.0 + 12 * number
            network.at(at_s, lambda: network.apply(1, lambda each, now: each.call(ARM, b"", now)))
    network.run(until_s=reports * 12.0 + 400)
    frames, seals = seal_bytes(network)
    assert 0.1 < fleet.strong_share < 0.8
    assert seals / frames == pytest.approx(fleet.expected_bytes, rel=0.01)


def test_nothing_is_said_in_a_day_in_which_nothing_happens() -> None:
    network = VirtualNetwork(line(0, 800, 1500), table(3), build=SealedFleet())
    network.run(until_s=24 * HOUR_S)
    assert sum(stats.frames_transmitted for stats in network.stats()) == 0


def executes_after_power_cut(seed: int) -> None:
    """Cut the power of a vehicle at some instant, and see that it executes the first command."""
    rng = random.Random(seed)
    network = VirtualNetwork(line(0, rng.uniform(50, 1500)), table(), build=SealedFleet())
    for number in range(rng.randrange(12)):
        report = partial(network.publish, 1, rng.choice((NAV, LOG)), b"report")
        network.at(10.0 + 7 * number, report)
    for at_s in (30.0, 60.0)[: rng.randrange(3)]:
        network.at(at_s, lambda: network.apply(1, lambda each, now: each.call(ARM, b"", now)))
    cut_s = rng.uniform(5.0, 100.0)
    network.at(cut_s, lambda: network.crash(2, reboots=True))
    network.at(cut_s + 5.0, lambda: network.start(2))
    network.run(until_s=400.0)
    network.events.clear()
    before = network.engine(1).stats.transmitted.get(ARM, 0)
    network.apply(1, lambda each, now: each.call(ARM, b"stop", now))
    network.run(until_s=410.0)
    asked = [event for at, event in network.events if isinstance(event, RequestReceived)]
    assert [event.value for event in asked] == [b"stop"], f"seed {seed}"
    assert network.engine(1).stats.transmitted[ARM] == before + 1, f"seed {seed}"


def test_the_first_command_after_a_power_cut_is_executed(count: Callable[[int], int]) -> None:
    for seed in range(count(1_000)):
        executes_after_power_cut(seed)


def test_a_dense_publisher_and_a_restarted_listener_understand_each_other_again() -> None:
    network = VirtualNetwork(line(0, 800, **QUIET), table(), build=SealedFleet())
    for number in range(120):
        sample = {"depth": 100 + number / 10, "ticket": number}
        network.at(10.0 * number, partial(network.publish, 1, DENSE, sample))
    network.at(604.0, lambda: network.restart(2))
    network.run(until_s=1300.0)
    tickets = [event.value["ticket"] for event in network.samples(2, DENSE)]
    lost = set(range(120)) - set(tickets)
    assert lost <= {61, 62, 63}


@pytest.mark.parametrize("nodes", [3, pytest.param(40, marks=pytest.mark.soak)])
def test_a_table_is_rolled_out_one_vehicle_after_the_other(nodes: int) -> None:
    """Stop and silence work both ways at every instant, and what differs has a name."""
    positions = [75.0 * index for index in range(nodes)]
    network = VirtualNetwork(line(*positions), table(nodes), build=SealedFleet())
    day_s = 24 * HOUR_S
    for address in range(2, nodes + 1):
        at_s = day_s * (address - 1)
        network.at(at_s, partial(network.restart, address, table(nodes, other=True)))
    asked: Counter[int] = Counter()

    def order(source: int, target: int) -> None:
        network.apply(source, asks(target))
        asked[source] += 1

    rng = random.Random(nodes)
    days = nodes + 12  # a report a day, of which the sea takes a third
    for day in range(days):
        for hour in (1, 13):
            vehicle = rng.randrange(2, nodes + 1)
            network.at(day * day_s + hour * HOUR_S, partial(order, 1, vehicle))
            network.at(day * day_s + (hour + 2) * HOUR_S, partial(order, vehicle, 1))
        for address in network.addresses:
            at_s = day * day_s + 5 * HOUR_S + 60.0 * address
            network.at(at_s, partial(network.publish, address, NAV, b"here"))
    network.run(until_s=(days + 1) * day_s)
    answered = Counter(at for at, event in network.events if isinstance(event, ResponseReceived))
    assert answered == asked
    named = {
        (at, event.address) for at, event in network.events if isinstance(event, StreamsDiffer)
    }
    assert {at for at, _ in named} == set(network.addresses)
    assert {address for at, address in named if at == 1} == set(range(2, nodes + 1))


def asks(target: int) -> Callable[[Engine, int], int]:
    """Return a command to a node, which goes as that of silence does."""
    command = RemoteCommand(kind=CommandKind.ASK)
    return lambda engine, now: engine.commands.send(target, command, now)


def test_an_on_demand_topic_goes_to_whoever_wants_it() -> None:
    """Subscriptions wait in the queue like records, and belong to no stream."""
    wanted = StreamTable(
        [
            TopicSpec(
                stream_id=NAV, name="view", publishers=(1,), qos=Qos(forward=Forward.ON_DEMAND)
            )
        ],
        nodes={1: "n1", 2: "n2"},
    )
    network = VirtualNetwork(line(0, 800, **QUIET), wanted, build=SealedFleet())
    network.at(
        10.0,
        lambda: network.apply(2, lambda each, now: each.subscriptions.want(NAV, now, {1})),
    )
    for number in range(6):
        network.at(5.0 + 20.0 * number, partial(network.publish, 1, NAV, b"%d" % number))
    network.run(until_s=600.0)
    assert [event.value for event in network.samples(2, NAV)] == [b"1", b"2", b"3", b"4", b"5"]


def test_a_call_is_not_taken_from_a_frame_with_the_short_tag() -> None:
    weak = TransmitRules(sealing=SealRules(strong=frozenset()))
    network = VirtualNetwork(
        line(0, 800, **QUIET), table(), build=SealedFleet(), rules={1: weak, 2: TransmitRules()}
    )
    network.at(10.0, lambda: network.publish(1, NAV, b"report"))
    network.at(20.0, lambda: network.apply(1, lambda each, now: each.call(ARM, b"arm", now)))
    network.run(until_s=600.0)
    assert [event.value for event in network.samples(2, NAV)] == [b"report"]
    assert not any(isinstance(event, RequestReceived) for _, event in network.events)
    assert network.engine(2).stats.dropped["weak"] > 0


@pytest.mark.parametrize("checked", [True, False])
@pytest.mark.parametrize("allowed", [frozenset[int](), frozenset({NAV})])
def test_an_emergency_without_a_key_is_taken_where_that_is_wanted(
    allowed: frozenset[int], checked: bool
) -> None:
    """Node 1 has no key; node 2 takes the topic that it allows, and nothing else."""
    fleet = SealedFleet()

    def build(*, address: int, **settings: Any) -> Engine:
        make = fleet if address == 2 else Engine
        return make(address=address, **settings)

    rules = TransmitRules(sealing=SealRules(unsealed=allowed))
    network = VirtualNetwork(
        line(0, 800, **QUIET), table(), modem=Modem(checked=checked), build=build, rules=rules
    )
    network.at(10.0, lambda: network.publish(1, NAV, b"stop"))
    network.at(20.0, lambda: network.publish(1, LOG, b"log"))
    network.at(30.0, lambda: network.apply(1, lambda each, now: each.call(ARM, b"arm", now)))
    network.run(until_s=600.0)
    taken = [event for at, event in network.events if at == 2]
    samples = [event.value for event in taken if isinstance(event, SampleReceived)]
    assert samples == [b"stop"] * bool(allowed)
    assert not any(isinstance(event, RequestReceived) for event in taken)
    assert network.engine(2).stats.frames_transmitted == 0


def test_frames_of_strangers_do_nothing(count: Callable[[int], int]) -> None:
    network = VirtualNetwork(
        line(0, 800, 1500), table(3), modem=Modem(addressed=False), build=SealedFleet()
    )
    for number in range(20):
        network.at(10.0 * number, lambda: network.publish(1, NAV, b"report"))
    network.run(until_s=300.0)
    engine, rng = network.engine(2), random.Random(7)
    sent = engine.stats.frames_transmitted
    network.events.clear()
    now = seconds_to_ns(400.0)
    for number in range(count(1 << 20)):
        frame = rng.randbytes(rng.randrange(2, 64))
        if number % 2:
            frame = bytes((rng.choice((2, BROADCAST)), rng.randrange(1, 255))) + frame
        received = ReceivedFrame(
            frame_bytes=frame, source=0, destination=0, received_at=now + number * 1000
        )
        engine.handle_frame(received, now + number * 1000)
        assert engine.poll_transmit(now + number * 1000) is None
    assert engine.stats.frames_transmitted == sent
    told = [engine.poll_event() for _ in range(2_000)]
    assert not [each for each in told if isinstance(each, SampleReceived)]
