"""Flooded streams: what has no route arrives all the same, and nothing goes round and round."""

import random
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import msgspec
import pytest

from tests.virtual.lineoffive import NODES, LineOfFive, route
from tests.virtual.sealed import SealedFleet
from zacoustic.channel.scenario import LinkSpec, NodeSpec, Scenario
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    DeliveryEnded,
    DeliveryOutcome,
    Event,
    RequestReceived,
    ResponseReceived,
    SampleReceived,
)
from zacoustic.core.linktypes import BROADCAST, LinkState, ReceivedFrame
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.flood import Flooded
from zacoustic.errors import ConfigError
from zacoustic.testing.virtual import Modem, VirtualNetwork

STOP, ABORT, ARM, PLAIN = 1, 2, 20, 3
UNHEARD_DB: Final = -100.0


def table(nodes: int, listener: int) -> StreamTable:
    """Return the table: node 1 publishes, `listener` serves."""
    urgent = Priority.REAL_TIME
    reliable = Qos(reliability=Reliability.RELIABLE, priority=urgent, depth=50)
    return StreamTable(
        [
            TopicSpec(stream_id=STOP, name="stop", publishers=(1,), qos=Qos(priority=urgent)),
            TopicSpec(
                stream_id=ABORT, name="abort", publishers=(1,), subscribers=(listener,),
                qos=reliable,
            ),
            ServiceSpec(stream_id=ARM, name="arm", server=listener, timeout_s=900.0),
            TopicSpec(stream_id=PLAIN, name="plain"),
        ],
        nodes={each: f"n{each}" for each in range(1, nodes + 1)},
    )  # fmt: skip


def rules(hops: int = 4, **more: Any) -> TransmitRules:
    """Return rules by which the streams but `PLAIN` are flooded."""
    return TransmitRules(
        flood=Flood(link="link", hops=hops, **more),
        links_of_streams=dict.fromkeys((STOP, ABORT, ARM), FLOOD_NAME),
    )


class Sea:
    """Nodes of which only some hear each other.

    Args:
        hears: Whether two nodes hear each other.
        nodes: How many there are; the last one listens.
        loss: Share of the frames that are lost.
        seed: Everything follows from it.
        more: Arguments of `VirtualNetwork`.
    """

    def __init__(
        self, hears: Callable[[int, int], bool], *, nodes: int = 5, loss: float = 0.0,
        seed: int = 1, **more: Any,
    ) -> None:  # fmt: skip
        self.got: dict[int, list[bytes]] = {each: [] for each in range(1, nodes + 1)}
        self.ended: Counter[str] = Counter()
        self.served: Counter[bytes] = Counter()
        self.rng = random.Random(seed)
        scenario = Scenario(
            seed=seed,
            channel="sea",
            nodes=tuple(
                NodeSpec(address=each, position=(100.0 * each, 0.0, 10.0)) for each in self.got
            ),
            links=tuple(
                LinkSpec(source=source, target=target, gain_db=UNHEARD_DB)
                for source in self.got
                for target in self.got
                if source != target and not hears(source, target)
            ),
        )

        def disturb(source: int, node: int, now: int) -> tuple[float, ...]:
            return () if self.rng.random() < loss else (0.0,)

        more.setdefault("rules", rules())
        more.setdefault("disturb", disturb)
        self.network = VirtualNetwork(
            scenario, table(nodes, nodes), deliver=self._happened, digest=False, **more
        )

    def publish(self, at_s: float, value: bytes, stream_id: int = STOP) -> None:
        """Publish at node 1, at an instant."""
        self.network.at(at_s, partial(self.network.publish, 1, stream_id, value))

    @property
    def frames(self) -> int:
        """How many frames all nodes have transmitted."""
        return sum(each.frames_transmitted for each in self.network.stats())

    def dropped(self, reason: str) -> int:
        """How often something was dropped for a reason."""
        return sum(each.dropped.get(reason, 0) for each in self.network.stats())

    def _happened(self, node: int, event: Event) -> None:
        match event:
            case SampleReceived():
                self.got[node].append(event.value)
            case DeliveryEnded():
                self.ended[event.outcome.value] += 1
            case ResponseReceived():
                self.ended["response"] += 1
            case RequestReceived():
                self.served[event.value] += 1
                self.network.at(
                    self.network.now / NS_PER_S,
                    partial(
                        self.network.apply,
                        node,
                        lambda engine, now: engine.reply(event.call, event.value, now),
                    ),
                )


def in_line(source: int, target: int) -> bool:
    """Tell whether two nodes are neighbours."""
    return abs(source - target) == 1


def in_grid(source: int, target: int) -> bool:
    """Tell whether two nodes of eight columns are next to each other, also across."""
    (row, column), (other_row, other_column) = divmod(source - 1, 8), divmod(target - 1, 8)
    return abs(row - other_row) <= 1 and abs(column - other_column) <= 1


def everybody(source: int, target: int) -> bool:
    """Tell that all hear each other."""
    return True


@pytest.mark.parametrize(("loss", "least"), [(0.0, 1.0), (0.1, 0.9), (0.3, 0.6)])
def test_best_effort_crosses_a_line_of_five_without_a_route(
    loss: float, least: float, sized: Callable[..., int]
) -> None:
    arrived = given = 0
    for seed in range(sized(200, share=3)):
        sea = Sea(in_line, loss=loss, seed=seed)
        for index in range(10):
            sea.publish(60.0 + 120 * index, b"%d" % index)
        sea.network.run(until_s=1500)
        assert len(sea.got[NODES]) == len(set(sea.got[NODES]))
        arrived += len(sea.got[NODES])
        given += 10
    assert arrived / given >= least, arrived / given


def test_reliable_and_calls_cross_a_lossy_line_once_each(sized: Callable[..., int]) -> None:
    for seed in range(sized(200, share=3)):
        sea = Sea(in_line, loss=0.3, seed=seed)
        for index in range(5):
            sea.publish(60.0 + 120 * index, b"%d" % index, ABORT)
        sea.network.at(
            90, partial(sea.network.apply, 1, lambda engine, now: engine.call(ARM, b"arm", now))
        )
        sea.network.run(until_s=3600)
        assert sea.got[NODES] == [b"%d" % index for index in range(5)], seed
        assert sea.served == {b"arm": 1}
        assert sea.ended == {DeliveryOutcome.DELIVERED.value: 5, "response": 1}, seed


@pytest.mark.parametrize("modem", [Modem(), Modem(senses_carrier=False)], ids=["senses", "deaf"])
def test_forty_nodes_pass_a_frame_on_a_few_times_each(modem: Modem) -> None:
    fleet = msgspec.structs.replace(rules(), agreement=AgreementMethod.TAG)
    for hears in (everybody, in_grid):
        sea = Sea(hears, nodes=40, modem=modem, rules=fleet)
        for index in range(5):
            sea.publish(60.0 + 200 * index, b"%d" % index)
        sea.network.run(until_s=1500)
        assert sea.frames <= 5 * 40 * 1.2
        in_reach = [each for each in range(2, 41) if hears is everybody or (each - 1) % 8 <= 4]
        arrived = [len(sea.got[each]) / 5 for each in in_reach]
        assert sum(arrived) / len(arrived) >= (1.0 if hears is everybody else 0.85)
        before = sea.frames
        sea.network.run(until_s=3 * 3600)
        assert sea.frames == before, "it goes round and round"


def test_frame_goes_no_farther_than_its_hops() -> None:
    sea = Sea(in_line, rules=rules(hops=2))
    sea.publish(60.0, b"stop")
    sea.network.run(until_s=600)
    assert [each for each, got in sea.got.items() if got] == [2, 3]


def test_doubles_late_ones_and_replays_are_passed_on_once() -> None:
    def disturb(source: int, node: int, now: int) -> tuple[float, ...]:
        return (0.0, 5.0, 100.0)

    sea = Sea(in_line, disturb=disturb)
    sea.publish(60.0, b"stop")
    sea.network.run(until_s=3600)
    assert all(got == [b"stop"] for node, got in sea.got.items() if node > 1)
    before = sea.frames
    sea.network.run(until_s=24 * 3600)
    assert sea.frames == before
    # Of the frame itself; agreement is flooded as well, and confirmed by each node.
    assert sea.dropped("flood_again") > 0


def test_stranger_makes_no_sealed_node_transmit_and_no_other_one_more_than_its_share() -> None:
    for is_sealed in (True, False):
        sea = Sea(everybody, build=SealedFleet() if is_sealed else Engine)
        sea.publish(1.0, b"authentic")
        sea.network.run(until_s=200)
        before = sea.frames
        rng = random.Random(1)
        for number in range(300):
            content = rng.randbytes(40)
            flooded = Flooded(rng.choice((1, 200)), BROADCAST, number % 256, 3, content)

            def hear(engine: Engine, now: int, flooded: Flooded = flooded) -> None:
                frame = ReceivedFrame(
                    frame_bytes=flooded.encode(), source=4, destination=BROADCAST, received_at=now
                )
                engine.handle_frame(frame, now)

            sea.network.at(210.0 + number, partial(sea.network.apply, 3, hear))
        sea.network.run(until_s=600)
        if is_sealed:
            assert sea.frames == before
            assert sea.dropped("unsealed") >= 300
        else:
            (third,) = [
                each for node, each in zip(sea.got, sea.network.stats(), strict=True) if node == 3
            ]
            assert third.airtime_ns / NS_PER_S <= 0.05 * 600 + 30
            assert sea.dropped("flood_stranger") > 50


def test_sealed_streams_are_flooded_and_opened_at_the_end(sized: Callable[..., int]) -> None:
    for seed in range(sized(50, share=2)):
        sea = Sea(in_line, loss=0.1, seed=seed, build=SealedFleet())
        for index in range(5):
            sea.publish(60.0 + 120 * index, b"%d" % index, ABORT)
        sea.network.run(until_s=3000)
        assert sea.got[NODES] == [b"%d" % index for index in range(5)]
        assert sea.ended == {DeliveryOutcome.DELIVERED.value: 5}


def test_nodes_in_the_middle_are_killed_and_nothing_is_handed_on_twice(
    sized: Callable[..., int],
) -> None:
    for seed in range(sized(100, share=2)):
        sea = Sea(in_line, loss=0.2, seed=seed)
        for index in range(5):
            sea.publish(60.0 + 120 * index, b"%d" % index, ABORT)
        for _ in range(10):
            node, at_s = sea.rng.choice((2, 3, 4)), sea.rng.uniform(60, 700)
            sea.network.at(at_s, partial(sea.network.restart, node))
        sea.network.run(until_s=3600)
        assert sea.got[NODES] == [b"%d" % index for index in range(5)]


def test_end_of_a_frame_is_reported_once_though_it_is_repeated_and_the_link_goes_down() -> None:
    sea = Sea(lambda source, target: False)
    sea.publish(60.0, b"stop")
    for at_s, state in ((62.0, LinkState.DOWN), (70.0, LinkState.UP)):
        down = partial(_set_link, state)
        sea.network.at(at_s, partial(sea.network.apply, 1, down))
    sea.publish(100.0, b"stop again")
    sea.network.run(until_s=600)
    assert sea.dropped("stray_report") == 0
    assert sea.network.engine(1).is_idle


def _set_link(state: LinkState, engine: Engine, now: int) -> None:
    engine.handle_link_state(state, now, engine.capabilities_of("link"))


def test_silent_node_passes_nothing_on() -> None:
    sea = Sea(in_line)
    sea.network.at(30, partial(sea.network.apply, 2, lambda engine, now: engine.silence.begin(now)))
    sea.publish(60.0, b"stop")
    sea.network.run(until_s=500)
    assert sea.got[3] == []


def test_streams_that_are_not_flooded_go_as_before() -> None:
    seas = [Sea(everybody), Sea(everybody, rules=TransmitRules())]
    for sea in seas:
        sea.publish(60.0, b"plain", PLAIN)
        sea.network.run(until_s=600)
        assert sea.got[5] == [b"plain"]
    with_flood, without = [
        [(each.frames_transmitted, each.bytes_transmitted) for each in sea.network.stats()]
        for sea in seas
    ]
    assert with_flood == without


def test_routes_and_flooding_share_a_link() -> None:
    line = LineOfFive(0.1, rules=TransmitRules(flood=Flood(link="link")), routes=(
        route(*range(1, NODES + 1)),))  # fmt: skip
    line.network.at(60, partial(line.publish, 2, b"plan"))
    line.network.run(until_s=600)
    assert line.values(2) == [b"plan"]


@pytest.mark.parametrize("wrong", [{"hops": 0}, {"hops": 5}, {"max_airtime": 0.0}])
def test_values_outside_their_range_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="allowed"):
        Flood(link="link", **wrong)


def test_link_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match="flood: link is 'radio'; allowed: link"):
        Sea(everybody, rules=TransmitRules(flood=Flood(link="radio")))
