"""Routes over relays, with the real engines: what arrives, how often, and what it costs.

`tests/benchmarks/bench_routes.py` prints the figures that docs/network.md promises; here is what
must never happen.
"""

import random
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.virtual.lineoffive import (
    ARM,
    BACK,
    FIX,
    KEPT,
    MOVE,
    NODES,
    PLAN,
    STOP,
    STREAMS,
    LineOfFive,
    route,
)
from tests.virtual.sealed import SealedFleet
from zacoustic.core.base.stats import NO_STREAM, Cause
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, PeerFound, PeerLost
from zacoustic.core.linktypes import LinkState, ReceivedFrame
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.relay import RelayRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import ConfigError
from zacoustic.testing.virtual import Modem

HOUR_S = 3600.0
RELAYS = (2, 3, 4)


def _is_quiet(line: LineOfFive) -> bool:
    return all(line.network.engine(each).is_idle for each in line.network.addresses)


@pytest.mark.parametrize("loss", [None, 0.3])
def test_reports_arrive_once_and_in_order(loss: float | None, count: Callable[[int], int]) -> None:
    published = arrived = 0
    for seed in range(count(200)):
        line = LineOfFive(loss, seed=seed)
        act = lambda number: line.publish(FIX, b"report %d" % number)  # noqa: B023, E731
        published += line.every(120.0, HOUR_S, random.Random(seed), act)
        line.network.run(until_s=HOUR_S + 600.0)
        values = line.values(FIX)
        assert len(set(values)) == len(values), f"seed {seed}: twice"
        arrived += len(values)
        assert _is_quiet(line), f"seed {seed}: it does not end"
    assert arrived >= 0.97 * published


def test_an_idle_line_is_silent() -> None:
    line = LineOfFive()
    line.network.run(until_s=24 * HOUR_S)
    assert line.frames == 0


def test_the_ledger_has_every_byte_and_names_what_relays_do() -> None:
    line = LineOfFive(seed=3)
    for number in range(5):
        line.network.at(60.0 * number, partial(line.publish, PLAN, b"plan %d" % number))
    line.network.run(until_s=HOUR_S)
    assert len(line.values(PLAN)) == 5
    for address in line.network.addresses:
        stats = line.network.engine(address).stats
        assert sum(each.transmitted_bytes for each in stats.ledger()) == stats.bytes_transmitted
        assert sum(each.airtime_ns for each in stats.ledger()) == stats.airtime_ns
        causes = {each.cause for each in stats.ledger()}
        assert Cause.RELAY in causes
        if address in RELAYS:
            assert causes == {Cause.RELAY}
            assert {each.stream_id for each in stats.ledger()} == {NO_STREAM}
    hops = line.network.engine(3).hops
    assert [(each.route, each.next_node) for each in hops] == [("far", 4), ("far", 2)]
    assert all(each.passed_on and each.transmissions >= each.passed_on for each in hops)


@pytest.mark.parametrize("loss", [0.1, 0.3])
def test_reliable_samples_arrive_once_whatever_relays_forget(
    loss: float, count: Callable[[int], int]
) -> None:
    for seed in range(count(200)):
        rng = random.Random(seed)
        line = LineOfFive(loss, seed=seed)
        act = lambda number: line.publish(KEPT, b"%d" % number)  # noqa: B023, E731
        published = line.every(150.0, HOUR_S, rng, act)
        for _ in range(6):
            at_s = rng.uniform(60.0, HOUR_S)
            line.network.at(at_s, partial(line.network.crash, node := rng.choice((*RELAYS, NODES))))
            line.network.at(at_s + rng.choice((0.1, 5, 60)), partial(line.network.start, node))
        line.network.run(until_s=4 * HOUR_S)
        wanted = [b"%d" % number for number in range(published)]
        assert line.values(KEPT) == wanted, f"seed {seed}"


def test_a_relay_without_airtime_holds_no_frame_for_longer_than_its_hop_may_take() -> None:
    """Held for longer, it is a new frame to a node that has forgotten it by then."""
    begun: dict[tuple[str, int], int] = {}
    held_ns = [0]

    def look(record: TraceRecord) -> None:
        if record.what == "transmit" and record.link == "link" and b"report".hex() in record.frame:
            content = record.frame[8:]  # without the header
            begun.setdefault((content, record.node), record.at)
            if record.node > 1:
                held_ns.append(record.at - begun[content, record.node - 1])

    rules = TransmitRules(relay=RelayRules(max_airtime=0.005))
    line = LineOfFive(0.0, rules=rules, trace=look)
    for number in range(200):
        line.network.at(60.0 + 5.0 * number, partial(line.publish, FIX, b"report %d" % number))
    line.network.run(until_s=HOUR_S)
    values = line.values(FIX)
    assert len(set(values)) == len(values)
    assert line.dropped("relay_given_up") > 10
    hop_s = route(1, 2, 3, 4, 5).longest_s / 4
    assert max(held_ns) / 1e9 < hop_s + 2.0


def test_who_has_passed_a_frame_on_arms_no_timer_for_it() -> None:
    line = LineOfFive(0.0)
    line.network.at(10.0, partial(line.publish, FIX, b"report"))
    line.network.run(until_s=60.0)
    assert line.values(FIX) == [b"report"]
    assert all(line.network.engine(each).is_idle for each in (1, *RELAYS))


def test_calls_and_goals_run_once_and_end_once(count: Callable[[int], int]) -> None:
    """Relays are killed, and the channel repeats frames as late as a route lives."""
    each = count(1000)
    hours = 2 * each * 180.0 / HOUR_S
    rng = random.Random(11)
    line = LineOfFive(0.3, seed=11, disturb=_repeats_late(random.Random(12)))
    wanted: Counter[tuple[int, object]] = Counter()  # numbers of goals come round

    def act(number: int) -> None:
        if number % 2:
            wanted[ARM, line.call(b"call %d" % number)] += 1
        else:
            wanted[MOVE, line.send_goal(b"goal %d" % number)] += 1

    line.every(180.0, hours * HOUR_S, rng, act)
    for _ in range(count(1000) // 10 or 1):
        at_s = rng.uniform(60.0, hours * HOUR_S)
        line.network.at(at_s, partial(line.network.crash, node := rng.choice(RELAYS)))
        line.network.at(at_s + rng.choice((0.1, 5, 60)), partial(line.network.start, node))
    line.network.run(until_s=(hours + 2) * HOUR_S)
    assert not [each for each, times in line.served.items() if times > 1]
    assert line.ended == wanted
    assert len(line.served) == wanted.total()


def _repeats_late(rng: random.Random) -> Callable[[int, int, int], tuple[float, ...]]:
    lifetime_s = route(1, 2, 3, 4, 5).longest_s

    def disturb(source: int, node: int, now: int) -> tuple[float, ...]:
        return (0.0, rng.uniform(0.0, lifetime_s)) if rng.random() < 0.2 else (0.0,)

    return disturb


def test_what_is_repeated_late_is_handed_on_once(count: Callable[[int], int]) -> None:
    for seed in range(count(200)):
        line = LineOfFive(0.1, seed=seed, disturb=_repeats_late(random.Random(seed)))
        act = lambda number: line.publish(FIX, b"report %d" % number)  # noqa: B023, E731
        line.every(60.0, HOUR_S, random.Random(seed), act)
        line.network.run(until_s=HOUR_S + 900.0)
        values = line.values(FIX)
        assert len(values) > 50
        assert len(set(values)) == len(values), f"seed {seed}: twice"


def test_a_large_sample_arrives_whole_though_a_relay_restarts(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        rng = random.Random(seed)
        photo = rng.randbytes(4096)
        line = LineOfFive(0.1, seed=seed)
        line.publish(PLAN, photo)
        line.network.at(rng.uniform(30.0, 300.0), partial(line.network.restart, rng.choice(RELAYS)))
        line.network.run(until_s=2 * HOUR_S)
        assert line.values(PLAN) == [photo], f"seed {seed}"
        assert _is_quiet(line)


def test_a_stop_overtakes_a_photo(count: Callable[[int], int]) -> None:
    delays_s = []
    for seed in range(count(200)):
        rng = random.Random(seed)
        line = LineOfFive(0.1, seed=seed)
        line.publish(PLAN, rng.randbytes(8000))
        stop_s = rng.uniform(100.0, 500.0)
        line.network.at(stop_s, partial(line.publish, STOP, b"stop"))
        line.network.run(until_s=600.0)
        found = [at for at, stream_id, _ in line.received if stream_id == STOP]
        assert len(found) == 1, f"seed {seed}"
        delays_s.append(found[0] / 1e9 - stop_s)
    assert sorted(delays_s)[int(0.95 * len(delays_s))] < 60.0


def test_both_ends_speak_at_once(count: Callable[[int], int]) -> None:
    for seed in range(count(200)):
        line = LineOfFive(0.1, seed=seed)
        there = line.every(
            60.0,
            HOUR_S,
            random.Random(seed),
            lambda n: line.publish(FIX, b"%d" % n),  # noqa: B023
        )
        back = line.every(
            60.0,
            HOUR_S,
            random.Random(-seed),
            lambda n: line.publish(BACK, b"%d" % n),  # noqa: B023
        )
        line.network.run(until_s=HOUR_S + 600.0)
        assert len(line.values(FIX)) >= 0.9 * there
        assert len(line.values(BACK)) >= 0.9 * back


def test_a_sealed_fleet_uses_routes_and_no_relay_reads_them() -> None:
    fleet = SealedFleet()
    line = LineOfFive(0.1, seed=4, build=fleet)
    for number in range(10):
        line.network.at(60.0 * number, partial(line.publish, KEPT, b"secret %d" % number))
        line.network.at(60.0 * number + 30.0, partial(line.publish, FIX, b"report %d" % number))
    line.network.at(700.0, partial(line.call, b"arm"))
    line.network.run(until_s=HOUR_S)
    assert line.values(KEPT) == [b"secret %d" % number for number in range(10)]
    assert len(line.values(FIX)) >= 9
    assert line.served[ARM, b"arm"] == 1
    assert set(line.ended.values()) == {1}
    for relay in RELAYS:
        assert not line.network.engine(relay).peers()


def test_a_relay_with_the_key_forwards_no_forged_and_no_replayed_frame(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(50)):
        rng = random.Random(seed)
        heard: list[bytes] = []

        def note(record: TraceRecord) -> None:
            if record.what == "transmit" and record.node == 1 and record.link == "link":
                heard.append(bytes.fromhex(record.frame or ""))  # noqa: B023

        line = LineOfFive(0.1, seed=seed, build=SealedFleet(), trace=note)
        for number in range(10):
            line.network.at(60.0 * number, partial(line.publish, KEPT, b"%d" % number))
        line.network.run(until_s=HOUR_S)
        assert len(heard) >= 10
        # A genuine frame that was lost is new to the relay an hour later, too; once.
        for at, frame_bytes in enumerate(heard):
            line.network.at(HOUR_S + 3.0 * at, partial(_hear, line, 2, 1, frame_bytes))
        line.network.run(until_s=2 * HOUR_S)
        before = line.network.engine(2).stats.frames_transmitted
        dropped = Counter(line.network.engine(2).stats.dropped)
        strange = [
            *heard,  # as they were, damaged, and in clear
            *(each[:-1] + bytes((each[-1] ^ 1,)) for each in heard),
            *(bytes((0xBF, 1, rng.randrange(256))) + each for each in heard),
            *(bytes((0xBF, 1, n)) + rng.randbytes(rng.choice((1, 9, 40))) for n in range(100)),
        ]
        for at, frame_bytes in enumerate(strange):
            line.network.at(2 * HOUR_S + 3.0 * at, partial(_hear, line, 2, 1, frame_bytes))
        line.network.run(until_s=3 * HOUR_S)
        assert line.network.engine(2).stats.frames_transmitted == before, f"seed {seed}"
        dropped = Counter(line.network.engine(2).stats.dropped) - dropped
        refused = sum(dropped[each] for each in ("forged", "replayed", "unsealed", "out_of_step"))
        assert refused == len(strange)
        line.publish(KEPT, b"last")
        line.network.run(until_s=4 * HOUR_S)
        assert line.values(KEPT) == [*(b"%d" % number for number in range(10)), b"last"]


@pytest.mark.parametrize("table_of_relays", ["same", "another"])
def test_a_sealed_route_survives_restarts_of_its_ends_and_relays(
    table_of_relays: str, count: Callable[[int], int]
) -> None:
    """A relay that knows nothing of lives and tables of the ends lets them pass."""
    for seed in range(count(50)):
        rng = random.Random(seed)
        line = LineOfFive(0.1, seed=seed, build=_with_table(table_of_relays))
        times = line.every(90.0, HOUR_S, rng, lambda n: line.publish(KEPT, b"%d" % n))  # noqa: B023
        for _ in range(8):
            node = rng.choice((*RELAYS, NODES))
            line.network.at(rng.uniform(60.0, HOUR_S), partial(line.network.restart, node))
        line.network.run(until_s=3 * HOUR_S)
        assert line.values(KEPT) == [b"%d" % number for number in range(times)], f"seed {seed}"


def _with_table(of_relays: str) -> Callable[..., Engine]:
    """Return what makes sealed engines whose relays have the same or another table."""
    fleet = SealedFleet()

    def make(**arguments: Any) -> Engine:
        if of_relays == "another" and arguments["address"] in RELAYS:
            arguments["table"] = StreamTable(nodes=arguments["table"].nodes)
        return fleet(**arguments)

    return make


@pytest.mark.parametrize("sealed", [False, True])
def test_all_frames_of_a_route_are_for_its_other_end(sealed: bool) -> None:
    """So the end may take them for what they were made, and its nonce is that of the seal."""
    ways: set[tuple[int, int]] = set()

    def note(record: TraceRecord) -> None:
        if record.what == "transmit" and record.link == "far":
            ways.add((record.node, record.peer))

    line = LineOfFive(0.1, seed=3, build=SealedFleet() if sealed else Engine, trace=note)
    line.publish(PLAN, random.Random(1).randbytes(2000))
    for number in range(10):
        line.network.at(60.0 * number, partial(line.publish, FIX, b"%d" % number))
        line.network.at(60.0 * number + 20.0, partial(line.publish, BACK, b"%d" % number))
    line.network.at(100.0, partial(line.call, b"arm"))
    line.network.at(120.0, partial(line.send_goal, b"move"))
    line.network.run(until_s=HOUR_S)
    assert ways == {(1, NODES), (NODES, 1)}


def test_frames_of_another_fleet_on_the_same_route_change_nothing() -> None:
    """The same addresses and the same path, but other streams."""
    foreign: list[tuple[int, bytes]] = []
    other = LineOfFive(
        0.1,
        seed=26,
        streams=StreamTable(
            [
                TopicSpec(stream_id=each, name=f"other/{each}", publishers=(1, NODES))
                for each in STREAMS
            ],
            nodes={each: f"other{each}" for each in range(1, NODES + 1)},
        ),
        trace=lambda record: (
            foreign.append((record.node, bytes.fromhex(record.frame)))
            if record.what == "transmit" and record.link == "link"
            else None
        ),
    )
    line = LineOfFive(0.1, seed=27)
    for number in range(20):
        for stream_id in (FIX, BACK):
            value = b"other %d" % number
            other.network.at(60.0 * number, partial(other.publish, stream_id, value))
        line.network.at(60.0 * number + 30.0, partial(line.publish, KEPT, b"%d" % number))
    other.network.run(until_s=HOUR_S)
    assert len(foreign) > 100
    for number, (source, frame_bytes) in enumerate(foreign):
        for node in line.network.addresses:
            if node != source:
                frame = partial(_hear, line, node, source, frame_bytes)
                line.network.at(0.3 * number + 5.0, frame)
    line.network.run(until_s=2 * HOUR_S)
    assert line.values(KEPT) == [b"%d" % number for number in range(20)]
    assert not [value for _, _, value in line.received if value.startswith(b"other")]


def _hear(line: LineOfFive, node: int, source: int, frame_bytes: bytes) -> None:
    now = line.network.local_ns(node)
    frame = ReceivedFrame(frame_bytes=frame_bytes, received_at=now, source=source, destination=255)
    line.network.apply(node, lambda engine, now: engine.handle_frame(frame, now))


def test_nobody_makes_a_relay_transmit_for_more_than_its_share() -> None:
    """A stranger between the nodes floods the route."""
    share = 0.05
    line = LineOfFive(0.1, seed=5, rules=TransmitRules(relay=RelayRules(max_airtime=share)))
    rng = random.Random(6)

    def flood() -> None:
        content = bytes((0xBF, 1, rng.randrange(256))) + rng.randbytes(50)
        frame = ReceivedFrame(
            frame_bytes=content, received_at=line.network.local_ns(3), source=2, destination=255
        )
        line.network.apply(3, lambda engine, now: engine.handle_frame(frame, now))

    line.network.every(3.0, flood)
    line.network.run(until_s=2 * HOUR_S)
    stats = line.network.engine(3).stats
    saved_s = share * 600.0  # an account saves the share of ten minutes
    assert stats.airtime_ns / 1e9 < share * 2 * HOUR_S + saved_s + 60.0
    assert stats.dropped["relay_full"] > 100
    assert sum(each.waiting for each in line.network.engine(3).hops) <= 16


def test_a_stranger_holds_a_route_for_no_longer_than_a_train() -> None:
    line = LineOfFive(0.1, seed=13)
    line.network.run(until_s=10.0)
    for seq in range(256):  # as if the next node had sent on so many
        frame = ReceivedFrame(
            frame_bytes=bytes((0xBF, 0x41, seq)) + b"forged",
            received_at=line.network.local_ns(2),
            source=3,
            destination=255,
        )
        line.network.apply(2, lambda engine, now: engine.handle_frame(frame, now))  # noqa: B023
    line.publish(FIX, b"report")
    line.network.run(until_s=80.0)
    assert line.values(FIX) == [b"report"]


def test_no_frame_raises_and_memory_is_bounded(count: Callable[[int], int]) -> None:
    line = LineOfFive(0.1, seed=7)
    line.network.run(until_s=10.0)
    rng = random.Random(8)
    for _ in range(count(200_000)):
        head = bytes((0xBF, rng.choice((0, 0x40, 1, 0x81, 0x41, 2, rng.randrange(256)))))
        frame = ReceivedFrame(
            frame_bytes=head + rng.randbytes(rng.choice((0, 1, 2, 3, 9, 61))),
            received_at=line.network.local_ns(3),
            source=rng.choice((1, 2, 4, 5, 77)),
            destination=255,
        )
        for node in (3, NODES):
            line.network.apply(node, lambda engine, now: engine.handle_frame(frame, now))  # noqa: B023
    relay = line.network.engine(3)
    assert sum(each.waiting for each in relay.hops) <= 16
    line.network.run(until_s=2 * HOUR_S)
    assert _is_quiet(line)


@pytest.mark.parametrize("sealed", [False, True])
@pytest.mark.parametrize(
    "modem",
    [
        Modem(addressed=False, checked=False),
        Modem(addressed=False, checked=False, framed=False),
        Modem(senses_carrier=False),
    ],
)
def test_routes_over_poorer_links(modem: Modem, sealed: bool) -> None:
    line = LineOfFive(0.1, seed=11, modem=modem, build=SealedFleet() if sealed else Engine)
    for number in range(8):
        line.network.at(90.0 * number, partial(line.publish, KEPT, b"%d" % number))
    line.network.at(100.0, partial(line.call, b"arm"))
    line.network.run(until_s=HOUR_S)
    assert line.values(KEPT) == [b"%d" % number for number in range(8)]
    assert line.served[ARM, b"arm"] == 1


def test_two_routes_of_different_ends_cross_at_one_relay() -> None:
    there = route(1, 2, 3, 4, 5)
    across = route(2, 3, 4, route_id=2, name="middle")
    near = route(3, 4, route_id=3, name="near")
    line = LineOfFive(0.1, seed=12, routes=(there, across, near))
    for number in range(20):
        line.network.at(60.0 * number, partial(line.publish, FIX, b"%d" % number))
        line.network.at(60.0 * number + 30.0, partial(line.publish, BACK, b"%d" % number))
    line.network.run(until_s=HOUR_S)
    assert len(line.values(FIX)) >= 18
    assert len(line.values(BACK)) >= 18
    assert line.network.engine(2).routes == (across,)
    # Of the routes that a node is not part of, it takes nothing, and nothing is wrong with them.
    assert line.dropped("relay_route") == line.dropped("reserved") == 0
    assert {each.route for each in line.network.engine(3).hops} == {"far", "middle", "near"}


def test_who_is_part_of_no_route_takes_their_frames_for_no_fault() -> None:
    line = LineOfFive(0.0, seed=16, routes=(route(1, 2, 3),))
    line.network.at(60.0, partial(line.network.publish, 1, FIX, b"for nobody here"))
    line.network.run(until_s=600.0)
    assert line.network.engine(2).stats.frames_transmitted
    assert line.network.engine(4).stats.frames_received
    assert not line.network.engine(4).stats.dropped
    assert not line.network.engine(4).hops


def test_contact_over_a_route() -> None:
    contact = ContactRules(heartbeat_s=300.0, lost_after_s={NODES: 1200.0})
    found: list[tuple[int, Event]] = []
    line = LineOfFive(
        0.1,
        seed=9,
        rules=TransmitRules(contact=contact),
        happened=lambda node, event: found.append((node, event)),
    )
    line.publish(FIX, b"hello")
    line.network.run(until_s=HOUR_S)
    line.network.crash(NODES)
    line.network.run(until_s=2 * HOUR_S)
    lost = [event.address for node, event in found if node == 1 and isinstance(event, PeerLost)]
    assert NODES in lost
    line.network.start(NODES)
    line.network.run(until_s=3 * HOUR_S)
    back = [event.address for node, event in found if node == 1 and isinstance(event, PeerFound)]
    assert NODES in back


def test_a_link_that_goes_ends_what_is_under_way() -> None:
    line = LineOfFive(0.1, seed=10)
    line.publish(PLAN, b"plan")
    line.network.set_link(1, up=False)
    engine = line.network.engine(1)
    assert engine.state_of("far") is LinkState.DOWN
    line.network.run(until_s=300.0)
    line.network.set_link(1, up=True)
    assert engine.state_of("far") is LinkState.UP
    line.network.run(until_s=HOUR_S)
    assert line.values(PLAN) == [b"plan"]


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"path": (1,)}, "path"),
        ({"path": (1, 2, 1)}, "path"),
        ({"path": (1, 255)}, "path"),
        ({"route_id": 0}, "1..31"),
        ({"lifetime_s": -1.0}, "lifetime_s"),
        ({"lifetime_s": float("nan")}, "lifetime_s"),
        ({"lifetime_s": float("inf")}, "lifetime_s"),
    ],
)
def test_wrong_routes_are_refused(wrong: dict[str, object], said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        route(**({"path": (1, 2)} | wrong))  # type: ignore[arg-type]


def test_a_route_needs_its_link_and_a_name_of_its_own() -> None:
    far = route(1, 2, 3)
    for links, said in [
        ((LinkRules(name="sound"),), "link is 'link'"),
        ((LinkRules(name="link"), LinkRules(name="far")), "two have the name 'far'"),
    ]:
        with pytest.raises(ConfigError, match=said):
            TransmitRules(links=links, routes=(far,)).of_links  # noqa: B018
