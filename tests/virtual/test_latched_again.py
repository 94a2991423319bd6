"""A node that comes back without a journal gets the last samples of latched topics again."""

from collections.abc import Callable
from functools import partial
from typing import Any, Final

import msgspec
import pytest

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Durability, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import DeliveryEnded, SampleReceived
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import WIRE_VERSION, Confirm, Hello
from zacoustic.testing.virtual import VirtualNetwork

MAP, TREE, LOOSE, COMMAND = 10, 11, 12, 13
AUV, SHORE = 1, 2
RULES: Final = TransmitRules(contact=ContactRules(announces=True))
TAGGING: Final = msgspec.structs.replace(RULES, agreement=AgreementMethod.TAG)
LIFESPAN_S: Final = 1800.0


def table(nodes: int = 2, *, lifespan_s: float | None = None) -> StreamTable:
    def qos(depth: int, reliability: Reliability = Reliability.RELIABLE) -> Qos:
        return Qos(
            durability=Durability.TRANSIENT_LOCAL,
            reliability=reliability,
            depth=depth,
            lifespan_s=lifespan_s,
        )

    joints = Wildcard(name="joint", values=("arm", "head", "tail"))
    return StreamTable(
        [
            TopicSpec(stream_id=MAP, name="map", publishers=(AUV,), qos=qos(1), max_bytes=4000),
            TopicSpec(
                stream_id=TREE,
                name="tree/{joint}",
                wildcards=(joints,),
                publishers=(AUV,),
                qos=qos(3),
            ),
            TopicSpec(
                stream_id=LOOSE,
                name="loose",
                publishers=(AUV,),
                qos=qos(2, Reliability.BEST_EFFORT),
            ),
            TopicSpec(stream_id=COMMAND, name="command", publishers=(SHORE,)),
        ],
        nodes={address: f"n{address}" for address in range(1, nodes + 1)},
    )


class Sea:
    """Node 1 publishes; the others come back."""

    def __init__(
        self,
        seed: int,
        nodes: int = 2,
        *,
        loss: float = 0.0,
        keeps: bool = False,
        rules: TransmitRules = RULES,
        lifespan_s: float | None = None,
        **faults: Any,
    ) -> None:
        scenario = line(
            *(150 * place for place in range(nodes)),
            seed=seed,
            channel="none",
            loss={"frame": loss},
            faults={"journal": {"commit_s": 0.02, "keeps": keeps}, **faults},
        )
        self.network = VirtualNetwork(
            scenario, table(nodes, lifespan_s=lifespan_s), rules=rules, digest=False
        )

    def publish(self, large: int = 0) -> None:
        self.network.publish(AUV, MAP, b"map" + bytes(large))
        for joint in range(3):
            for number in range(5):
                self.network.publish(AUV, TREE, bytes((joint, number)), instance=(joint,))
        for number in range(3):
            self.network.publish(AUV, LOOSE, bytes((number,)))

    def restart(self, *addresses: int) -> None:
        for address in addresses:
            self.network.crash(address)
            self.network.start(address)

    def got(self, address: int, stream_id: int, since_s: float) -> list[Any]:
        """Return the values that a node received of a stream, in order."""
        return [
            event.value
            for node, event in self.network.events
            if node == address
            and isinstance(event, SampleReceived)
            and event.stream_id == stream_id
            and event.received_at >= since_s * NS_PER_S
        ]

    def frames(self, address: int) -> int:
        return sum(each.frames_transmitted for each in self.network.stats_of(address))


TREES: Final = [bytes((joint, number)) for joint in range(3) for number in (2, 3, 4)]


@pytest.mark.parametrize("rules", [RULES, TAGGING], ids=["confirm", "tag"])
@pytest.mark.parametrize("loss", [0.0, 0.4])
def test_it_has_the_last_samples_of_each_key_in_order_and_once(
    count: Callable[[int], int], loss: float, rules: TransmitRules
) -> None:
    missing = 0
    for seed in range(count(100)):
        sea = Sea(seed, loss=loss, rules=rules)
        sea.publish()
        sea.network.run(until_s=3600.0)
        sea.restart(SHORE)
        sea.network.run(until_s=7200.0)
        maps, trees = sea.got(SHORE, MAP, 3600.0), sea.got(SHORE, TREE, 3600.0)
        if not maps and not trees:
            missing += 1  # the announcements were all lost
            continue
        assert maps == [b"map"], seed
        assert sorted(trees) == TREES, seed
        for joint in range(3):
            assert [each for each in trees if each[0] == joint] == TREES[3 * joint : 3 * joint + 3]
        loose = sea.got(SHORE, LOOSE, 3600.0)
        assert len(loose) <= 2
        assert loss or loose == [b"\x01", b"\x02"]
        assert sea.network.is_quiet
    assert missing <= 0.05 * count(100)


def test_one_that_has_lost_nothing_costs_one_record_a_key() -> None:
    sea = Sea(1, keeps=True)
    sea.publish()
    sea.network.run(until_s=3600.0)
    before = sea.frames(AUV)
    sea.restart(SHORE)
    sea.network.run()
    assert sea.got(SHORE, MAP, 3600.0) == sea.got(SHORE, TREE, 3600.0) == []
    assert sea.frames(AUV) - before <= 6


def test_outcomes_are_reported_once() -> None:
    sea = Sea(1)
    sea.publish()
    sea.network.run(until_s=3600.0)
    sea.restart(SHORE)
    sea.network.run()
    ends = [
        each.delivery_id
        for node, each in sea.network.events
        if node == AUV and isinstance(each, DeliveryEnded)
    ]
    assert len(ends) == len(set(ends)) == 16


def test_each_epoch_gets_them_once_and_two_restarts_in_a_row_end_well() -> None:
    sea = Sea(1)
    sea.publish()
    sea.network.run(until_s=3600.0)
    sea.restart(SHORE)
    sea.network.run(until_s=3602.0)
    sea.restart(SHORE)
    sea.network.run()
    assert sea.got(SHORE, MAP, 3602.0) == [b"map"]
    assert sorted(sea.got(SHORE, TREE, 3602.0)) == TREES


def test_what_is_older_than_its_lifespan_does_not_go() -> None:
    sea = Sea(1, lifespan_s=LIFESPAN_S)
    sea.publish()
    sea.network.run(until_s=LIFESPAN_S - 600.0)
    sea.restart(SHORE)
    sea.network.run(until_s=LIFESPAN_S - 100.0)
    assert sea.got(SHORE, MAP, LIFESPAN_S - 600.0) == [b"map"]
    sea.network.run(until_s=LIFESPAN_S + 100.0)
    sea.restart(SHORE)
    sea.network.run()
    after = [sea.got(SHORE, each, LIFESPAN_S + 100.0) for each in (MAP, TREE, LOOSE)]
    assert after == [[], [], []]


def test_it_goes_on_with_what_is_published_later() -> None:
    sea = Sea(1)
    sea.publish()
    sea.network.run(until_s=3600.0)
    sea.restart(SHORE)
    sea.network.publish(AUV, TREE, b"new", instance=(0,))
    sea.network.run(until_s=5000.0)
    trees = [each for each in sea.got(SHORE, TREE, 3600.0) if each == b"new" or each[0] == 0]
    assert trees == [b"\x00\x03", b"\x00\x04", b"new"]
    for number in range(4):
        sea.network.publish(AUV, TREE, bytes((9, number)), instance=(0,))
    sea.network.run()
    assert sea.got(SHORE, TREE, 5000.0) == [bytes((9, each)) for each in range(4)]


@pytest.mark.parametrize("keeps", [False, True])
def test_large_ones_too_and_only_a_batch_to_a_node_that_has_them(keeps: bool) -> None:
    sea = Sea(1, keeps=keeps)
    sea.publish(large=2000)
    sea.network.run(until_s=3600.0)
    before = sea.frames(AUV)
    sea.restart(SHORE)
    sea.network.run()
    maps = sea.got(SHORE, MAP, 3600.0)
    assert maps == ([] if keeps else [b"map" + bytes(2000)])
    if keeps:
        assert sea.frames(AUV) - before <= 25  # of 43


def test_many_that_come_back_at_once_all_have_them(count: Callable[[int], int]) -> None:
    nodes = 12
    sea = Sea(1, nodes, rules=TAGGING)
    sea.publish()
    sea.network.run(until_s=7200.0)
    others = range(2, nodes + 1)
    sea.restart(*others)
    sea.network.run(until_s=14_400.0)
    for address in others:
        assert sea.got(address, MAP, 7200.0) == [b"map"], address
        assert sorted(sea.got(address, TREE, 7200.0)) == TREES, address


@pytest.mark.parametrize("rules", [RULES, TAGGING], ids=["confirm", "tag"])
def test_an_announcement_that_nobody_hears_does_not_cost_the_first_sample(
    rules: TransmitRules,
) -> None:
    sea = Sea(1, rules=rules)
    sea.network.crash(AUV)
    sea.network.run(until_s=5.0)
    sea.network.start(AUV)
    sea.network.run(until_s=6.0)
    sea.network.publish(SHORE, COMMAND, b"go")
    sea.network.run(until_s=8.0)
    assert sea.got(AUV, COMMAND, 0.0) == [b"go"]


def test_deleted_keys_have_nothing() -> None:
    sea = Sea(1)
    sea.publish()
    sea.network.run(until_s=3000.0)
    sea.network.apply(
        AUV, lambda engine, now: engine.publish(TREE, None, now, instance=(0,), delete=True)
    )
    sea.network.run(until_s=3600.0)
    sea.restart(SHORE)
    sea.network.run()
    assert sorted(sea.got(SHORE, TREE, 3600.0)) == TREES[3:]


def forge(sea: Sea, epoch: int) -> None:
    """Tell node 1, as somebody who listens can, that node 2 has begun a boot epoch."""
    said = Hello(WIRE_VERSION, epoch, sea.network.engine(AUV).table.digest).encode()
    said += Confirm(AUV, sea.network.engine(AUV).epoch).encode()
    sea.network.apply(
        AUV,
        lambda engine, now: engine.handle_frame(
            ReceivedFrame(frame_bytes=said, source=SHORE, destination=AUV, received_at=now),
            now,
        ),
    )


@pytest.mark.parametrize("epochs", [1, 60])
def test_forged_epochs_cost_some_rounds_and_have_no_effect_that_lasts(epochs: int) -> None:
    sea = Sea(1)
    sea.publish()
    sea.network.run(until_s=3600.0)
    before = sea.frames(AUV)
    for number in range(epochs):
        sea.network.at(3600.0 + 10.0 * number, partial(forge, sea, 700 + number))
    sea.network.run(until_s=7200.0)
    rounds = sea.got(SHORE, LOOSE, 3600.0)
    assert len(rounds) == 2 if epochs == 1 else len(rounds) <= 2 * 12
    assert sea.got(SHORE, MAP, 3600.0) == sea.got(SHORE, TREE, 3600.0) == []
    assert sea.frames(AUV) - before <= (4 if epochs == 1 else 2 * epochs)
    sea.network.publish(AUV, MAP, b"next")
    sea.restart(SHORE)
    sea.network.run()
    assert sea.got(SHORE, MAP, 7200.0) == [b"next"]
    assert sorted(sea.got(SHORE, TREE, 7200.0)) == TREES
