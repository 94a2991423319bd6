"""Two links of one engine: each stream goes by its own, and neither disturbs the other."""

import random
from collections.abc import Callable
from functools import partial

import pytest

from tests.virtual.twolinks import (
    ARM,
    BESIDE,
    FIX,
    KEPT,
    LINKS,
    MOVE,
    PLAN,
    RADIO,
    SOUND,
    VIEW,
    TwoLinks,
    rules,
)
from tests.virtual.twolinks import fleet as fleet_table
from zacoustic.core.base.stats import NO_STREAM, Cause
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    DeliveryEnded,
    DeliveryOutcome,
    GoalFailed,
    GoalFailure,
    LinkStateChanged,
    ObjectProgress,
    PeerFound,
    PeerLost,
    ResponseReceived,
    ResultReceived,
    SampleReceived,
)
from zacoustic.core.linktypes import LinkCapabilities, LinkState, ReceivedFrame
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.schedule.access.spec import TdmaSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import ConfigError, LocalError

PHOTO = random.Random(7).randbytes(3000)


@pytest.mark.parametrize("nodes", [2, 4])
def test_each_stream_goes_by_its_link(nodes: int) -> None:
    fleet = TwoLinks(nodes)
    fleet.use_all(b"1", PHOTO)
    fleet.network.apply(1, lambda engine, now: engine.subscriptions.want(VIEW + BESIDE, now, {2}))
    fleet.network.run(until_s=60.0)
    fleet.network.publish(2, VIEW + BESIDE, b"view")
    fleet.network.publish(2, VIEW, b"nobody wants it")
    fleet.network.run(until_s=1800.0)
    for first in (0, BESIDE):
        for node in range(1, nodes + 1):
            if node != 2:
                assert fleet.got(node, first + FIX) == [b"fix1"]
                assert fleet.got(node, first + PLAN) == [b"plan1", PHOTO + b"1"]
                assert fleet.got(node, first + KEPT) == [b"kept1"]
        assert fleet.served[first + ARM, b"arm1"] == fleet.served[first + MOVE, b"move1"] == 1
    assert fleet.got(1, VIEW + BESIDE) == [b"view"]
    assert not fleet.got(1, VIEW)
    assert sorted(each.stream_id for each in fleet.told(2, ResponseReceived)) == [4, 14]
    assert sorted(each.goal.stream_id for each in fleet.told(2, ResultReceived)) == [5, 15]
    ended = fleet.told(2, DeliveryEnded)
    assert len({each.delivery_id for each in ended}) == len(ended) == 6
    assert {each.outcome for each in ended} == {DeliveryOutcome.DELIVERED}
    for node in fleet.network.addresses:
        stats = fleet.network.engine(node).stats
        for link, first in zip(LINKS, (0, BESIDE), strict=True):
            ids = {entry.stream_id for entry in stats.links[link].ledger()}
            assert ids <= {NO_STREAM, *range(first + 1, first + 7)}, link
    assert {each.link for each in fleet.told(1, ObjectProgress)} == set(LINKS)


def test_everything_is_booked_once_and_for_its_link() -> None:
    fleet = TwoLinks(3, loss=(0.2, 0.2))
    fleet.use_all(b"1", PHOTO)
    fleet.network.run(until_s=1200.0)
    for node in fleet.network.addresses:
        whole = fleet.network.engine(node).stats
        for link in LINKS:
            stats = whole.links[link]
            frames = [frame for source, _, frame in fleet.sent(link) if source == node]
            assert stats.frames_transmitted == len(frames) == sum(stats.reports.values())
            assert stats.bytes_transmitted == sum(map(len, frames))
            assert stats.bytes_transmitted == sum(e.transmitted_bytes for e in stats.ledger())
            assert stats.airtime_ns == sum(e.airtime_ns for e in stats.ledger())
        for name in ("frames_transmitted", "bytes_transmitted", "airtime_ns", "frames_received"):
            shares = [getattr(each, name) for each in whole.links.values()]
            assert getattr(whole, name) == sum(shares), name
        envelope = {each.cause for each in whole.links[RADIO].ledger()}
        assert Cause.ENVELOPE in envelope
        assert Cause.ENVELOPE not in {each.cause for each in whole.links[SOUND].ledger()}


@pytest.mark.parametrize("lost", LINKS)
def test_loss_of_one_link_changes_no_frame_of_the_other(lost: str) -> None:
    kept = SOUND if lost == RADIO else RADIO
    runs: list[list[tuple[int, int, bytes]]] = []
    for is_lost in (False, True):
        fleet = TwoLinks(3, loss=(0.1, 0.1))
        fleet.acquaint(400.0)
        begin = len(fleet.sent(kept))
        if is_lost:
            for node in fleet.network.addresses:
                fleet.network.set_link(node, up=False, link=lost)
        for at_s in (410.0, 500.0):
            fleet.network.at(at_s, partial(fleet.use_all, str(at_s).encode(), PHOTO))
        fleet.network.run(until_s=900.0)
        runs.append(fleet.sent(kept)[begin:])
        first = 0 if kept == SOUND else BESIDE
        assert len(fleet.got(1, first + PLAN)) == 4
        assert len(fleet.got(1, BESIDE - first + PLAN)) == (0 if is_lost else 4)
        # What waited goes when the link is back, once and in order.
        for node in fleet.network.addresses:
            fleet.network.set_link(node, up=True, link=lost)
        fleet.network.run(until_s=3600.0)
        other = BESIDE - first
        plans = [b"plan410.0", PHOTO + b"410.0", b"plan500.0", PHOTO + b"500.0"]
        assert fleet.got(1, other + PLAN) == plans
        assert fleet.got(3, other + KEPT) == [b"kept410.0", b"kept500.0"]
        assert fleet.served[other + ARM, b"arm410.0"] == 1
    assert runs[0] == runs[1]
    assert runs[0]


def test_what_is_agreed_by_one_link_spares_introductions_on_the_other() -> None:
    fleet = TwoLinks()
    for at_s in range(0, 100, 10):
        for node in (1, 2):
            fleet.network.at(at_s + node, partial(fleet.network.publish, node, FIX + BESIDE, b"x"))
    fleet.network.run(until_s=200.0)
    assert not fleet.sent(SOUND)
    fleet.network.publish(1, FIX, b"y")
    fleet.network.run(until_s=210.0)
    assert [frame for _, _, frame in fleet.sent(SOUND)] == [bytes((FIX,)) + b"y"]
    assert fleet.got(2, FIX) == [b"y"]


def test_bare_frames_of_a_link_that_comes_late_are_read_when_it_is_settled() -> None:
    near, far = (
        Engine(address=n, table=fleet_table(), epoch=5, rng=random.Random(n), rules=rules())
        for n in (1, 2)
    )
    radio = LinkCapabilities(mtu_bytes=512, bit_rate_bps=1e6, propagation_s=0.1)
    sound = LinkCapabilities(mtu_bytes=64, bit_rate_bps=500.0, propagation_s=2.0)
    for engine in (near, far):
        engine.handle_link_state(LinkState.UP, 0, radio, RADIO)
        while (write := engine.poll_journal()) is not None:
            engine.handle_journal_committed(write.write_id, 0)
    far.publish(FIX + BESIDE, b"x", 0)
    hello = far.poll_transmit(0)
    assert hello is not None
    assert hello.link == RADIO
    frame = ReceivedFrame(frame_bytes=hello.frame_bytes, received_at=0, source=2)
    near.handle_frame(frame, 0, RADIO)
    # A minute later the modem is there, and with it what a former life of node 2 has said by it.
    at_once, later = 60 * NS_PER_S, 90 * NS_PER_S
    near.handle_link_state(LinkState.UP, at_once, sound, SOUND)
    for at in (at_once, later):
        former = ReceivedFrame(frame_bytes=bytes((FIX,)) + b"old", received_at=at, source=2)
        near.handle_frame(former, at, SOUND)
        assert near.stats.links[SOUND].dropped == {"unconfirmed": 1}
    samples = []
    while (event := near.poll_event()) is not None:
        samples += [event.value] if isinstance(event, SampleReceived) else []
    assert samples == [b"x", b"old"]


def test_crash_of_a_node_loses_nothing_that_was_kept_on_either_link() -> None:
    fleet = TwoLinks(loss=(0.2, 0.2))
    fleet.acquaint()
    network = fleet.network
    for node in (1, 2):
        network.set_link(node, up=False)
        network.set_link(node, up=False, link=RADIO)
    for first in (0, BESIDE):
        network.publish(2, first + KEPT, b"first")
        network.publish(2, first + KEPT, PHOTO)
        fleet.send_goal(2, first + MOVE, b"go")
    network.run(until_s=130.0)
    keys = set(network.journal(2).entries)
    assert any(key.startswith(f"@{RADIO}/") for key in keys)
    network.restart(2)
    network.restart(1)
    for node in (1, 2):
        network.set_link(node, up=True)
        network.set_link(node, up=True, link=RADIO)
    network.run(until_s=3600.0)
    for first in (0, BESIDE):
        assert fleet.got(1, first + KEPT) == [b"first", PHOTO]
    # Of a goal that nobody has answered its client's next life knows that it was sent, no more.
    failed = [(each.goal.stream_id, each.failure) for each in fleet.told(2, GoalFailed)]
    assert sorted(failed) == [(each, GoalFailure.UNKNOWN) for each in (MOVE, MOVE + BESIDE)]


def test_node_is_forgotten_on_both_links_and_found_again() -> None:
    fleet = TwoLinks()
    fleet.use_all(b"1", PHOTO)
    fleet.network.run(until_s=300.0)
    fleet.network.apply(1, lambda engine, now: engine.forget(2, now))
    assert fleet.network.engine(1).peers() == {}
    fleet.network.run(until_s=310.0)
    assert not [key for key in fleet.network.journal(1).entries if "/2/" in key]
    fleet.use_all(b"2", PHOTO)
    fleet.network.run(until_s=900.0)
    for first in (0, BESIDE):
        assert fleet.got(1, first + PLAN)[-2:] == [b"plan2", PHOTO + b"2"]
        assert fleet.served[first + ARM, b"arm2"] == 1


def test_node_is_lost_when_no_link_hears_it() -> None:
    contact = ContactRules(heartbeat_s=60.0, others_lost_after_s=200.0)
    fleet = TwoLinks(rules=rules(contact=contact))
    fleet.network.run(until_s=600.0)
    assert {link for link, *_ in fleet.frames} == set(LINKS)
    fleet.network.set_link(2, up=False)
    fleet.network.run(until_s=1800.0)
    assert not fleet.told(1, PeerLost)
    fleet.network.set_link(2, up=False, link=RADIO)
    fleet.network.run(until_s=2400.0)
    assert [each.address for each in fleet.told(1, PeerLost)] == [2]
    fleet.network.set_link(2, up=True, link=RADIO)
    fleet.network.run(until_s=3000.0)
    assert [each.address for each in fleet.told(1, PeerFound)] == [2]


def test_radio_does_not_wait_for_the_slots_of_sound() -> None:
    slots = TdmaSpec(slots=(1, 2), slot_s=30.0, guard_s=1.0, clock_error_s=0.0)
    fleet = TwoLinks(rules=rules(LinkRules(name=SOUND, access=slots)))
    fleet.network.run(until_s=70.0)
    for first in (0, BESIDE):
        fleet.network.publish(1, first + FIX, b"now")
    fleet.network.run(until_s=75.0)
    assert fleet.got(2, FIX + BESIDE) == [b"now"]


def test_states_name_their_link() -> None:
    fleet = TwoLinks()
    fleet.network.set_link(1, up=False, link=RADIO)
    engine = fleet.network.engine(1)
    assert engine.links == LINKS
    assert (engine.state_of(SOUND), engine.state_of(RADIO)) == (LinkState.UP, LinkState.DOWN)
    assert engine.link_state is LinkState.UP
    assert engine.capabilities == engine.capabilities_of(SOUND) != engine.capabilities_of(RADIO)
    assert (engine.link_of(FIX), engine.link_of(FIX + BESIDE)) == LINKS
    states = [(each.link, each.state) for each in fleet.told(1, LinkStateChanged)]
    assert states == [
        (SOUND, LinkState.UP), (RADIO, LinkState.UP), (RADIO, LinkState.DOWN),
    ]  # fmt: skip
    with pytest.raises(LocalError, match="no link 'sonar'; allowed: sound, radio"):
        engine.handle_carrier(True, fleet.network.now, "sonar")


def test_ids_of_two_links_are_not_confused() -> None:
    fleet = TwoLinks()
    network = fleet.network
    for node in (1, 2):
        network.set_link(node, up=False)
        network.set_link(node, up=False, link=RADIO)
    ids = [network.publish(2, first + PLAN, b"x") for first in (0, BESIDE)]
    calls = [fleet.call(2, first + ARM, b"x") for first in (0, BESIDE)]
    assert len({*ids}) == len({*calls}) == 2
    engine = network.engine(2)
    network.apply(2, lambda engine, now: engine.cancel_delivery(ids[1], now))
    network.apply(2, lambda engine, now: engine.cancel(calls[0], now))
    assert [engine.is_delivering(each) for each in ids] == [True, False]
    assert not engine.is_delivering(12345 << 60)
    network.set_link(1, up=True)
    network.set_link(2, up=True)
    network.set_link(1, up=True, link=RADIO)
    network.set_link(2, up=True, link=RADIO)
    network.run(until_s=300.0)
    assert fleet.got(1, PLAN) == [b"x"]
    assert fleet.got(1, PLAN + BESIDE) == []
    assert [each.call_id for each in fleet.told(2, ResponseReceived)] == [calls[1]]


@pytest.mark.parametrize(
    ("rules", "message"),
    [
        (
            TransmitRules(links=(LinkRules(name="a"), LinkRules(name="a"))),
            "two have the name 'a'",
        ),
        (
            TransmitRules(links=(LinkRules(name="a"),), links_of_streams={7: "b"}),
            "stream 7: link is 'b'; allowed: a",
        ),
        (TransmitRules(links_of_streams={7: "b"}), "stream 7: link is 'b'; allowed: link"),
    ],
)
def test_rules_that_cannot_work_are_refused(rules: TransmitRules, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        Engine(address=1, table=StreamTable(), epoch=1, rng=random.Random(1), rules=rules)


def test_any_weather_on_both_links(count: Callable[[int], int]) -> None:
    for seed in range(count(300)):
        _scenario(seed)


def test_an_answer_to_a_former_life_is_no_round_trip() -> None:
    """It comes just behind a request of this life, on a fast link with a long way."""
    _scenario(14)


def _scenario(seed: int) -> None:
    """Losses, unplugged modems and crashes on both links; all that is kept arrives once."""
    rng = random.Random(seed)
    loss = (rng.choice((0.0, 0.2, 0.4)), rng.choice((0.0, 0.2, 0.4)))
    fleet = TwoLinks(rng.choice((2, 3)), loss=loss, seed=seed)
    network = fleet.network
    published: dict[int, list[bytes]] = {KEPT: [], KEPT + BESIDE: []}

    def publish(stream_id: int, value: bytes) -> None:
        if network.is_running(2):
            published[stream_id].append(value)
            network.publish(2, stream_id, value)

    def ask(first: int, number: int) -> None:
        if network.is_running(2):
            fleet.call(2, first + ARM, b"call%d" % number)
            fleet.send_goal(2, first + MOVE, b"goal%d" % number)

    for number in range(8):
        for first in (0, BESIDE):
            value = b"%d" % number + (PHOTO[: rng.randrange(600)] if rng.random() < 0.3 else b"")
            network.at(rng.uniform(0, 600), partial(publish, first + KEPT, value))
            network.at(rng.uniform(0, 600), partial(ask, first, number))
    for _ in range(4):
        node, link, at_s = rng.choice(network.addresses), rng.choice(LINKS), rng.uniform(0, 500)
        network.at(at_s, partial(network.set_link, node, up=False, link=link))
        network.at(at_s + rng.uniform(1, 200), partial(network.set_link, node, up=True, link=link))
    for _ in range(rng.randrange(3)):
        node, at_s = rng.choice(network.addresses), rng.uniform(50, 500)
        network.at(at_s, partial(network.crash, node))
        network.at(at_s + rng.uniform(0, 60), partial(network.start, node))
    network.run(until_s=6000.0)
    for node in network.addresses:
        for stream_id, values in published.items():
            if node != 2:
                got = fleet.got(node, stream_id)
                assert got == values, (seed, node, stream_id)
    again = {key: times for key, times in fleet.served.items() if times > 1}
    assert not again, (seed, again)
    for node in network.addresses:
        assert network.engine(node).is_idle, (seed, node)
