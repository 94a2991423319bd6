"""Streams over a list of links: nothing is lost or doubled when a vehicle surfaces and dives."""

import itertools
import random
from collections import Counter
from collections.abc import Callable
from functools import partial

import msgspec
import pytest

from tests.virtual.sealed import SealedFleet
from tests.virtual.surfacing import (
    ARM,
    ASK,
    AUV,
    BOND,
    LOG,
    PERIOD_S,
    PHOTO,
    REPORT,
    SHORE,
    STOP,
    UP_S,
    Surfacing,
    is_up,
    rules,
    table,
)
from tests.virtual.twolinks import RADIO, SOUND
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.stats import Cause
from zacoustic.core.bond.reach import Reach
from zacoustic.core.bond.spec import Bond, BondLink
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    DeliveryOutcome,
    Event,
    RequestReceived,
    ResponseReceived,
)
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.relay.route import Route
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.bond import Bonded, decode, decode_answers
from zacoustic.core.wire.envelope import Envelope
from zacoustic.errors import ConfigError
from zacoustic.testing.virtual import VirtualNetwork


def test_a_frame_goes_by_radio_at_the_surface_and_by_sound_below() -> None:
    trial = Surfacing()
    for number in range(40):
        trial.publish_at(15.0 + 30.0 * number, REPORT, b"r%d" % number)
    trial.network.run(until_s=1300.0)
    assert len(trial.got_s) == 40
    assert {len(each) for each in trial.got_s.values()} == {1}
    by_radio = [at for at, _, link, _ in trial.frames if link == RADIO]
    by_sound = [at for at, _, link, _ in trial.frames if link == SOUND]
    deep = [at for at in by_radio if at % PERIOD_S > UP_S + 60.0]
    assert len(by_radio) > 15
    assert all(at % PERIOD_S > 14.0 for at in by_sound)
    # The better link is tried with each report at most, and nobody answers.
    assert len(deep) <= len([at for at in by_sound if at % PERIOD_S > UP_S + 60.0])
    assert max(trial.delays_s(REPORT, is_at_surface=True)[:6]) < 0.5


@pytest.mark.parametrize("seed", range(3))
def test_best_effort_has_no_gap_at_a_switch(seed: int) -> None:
    trial = Surfacing(seed)
    for number in range(400):
        trial.publish_at(30.0 + 5.0 * number, REPORT, b"r%d" % number)
    trial.network.run(until_s=2100.0)
    came = sorted(at[0] for at in trial.got_s.values())
    assert len(came) == 400
    # By sound a report takes 1.2 s longer.
    assert max(later - at for at, later in itertools.pairwise(came)) <= 5.0 + 1.0 + 1.2


def test_all_is_delivered_once_in_order_whenever_the_vehicle_dives(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(400)):
        dive(seed)


def dive(seed: int, make: Callable[..., Engine] = Engine) -> None:
    """Use every kind of stream while the vehicle surfaces, and either node restarts.

    Args:
        seed: Everything follows from it; an odd one is sealed.
        make: Makes the engines.
    """
    rng = random.Random(seed)
    trial = Surfacing(
        seed,
        loss=rng.choice((0.0, 0.1, 0.3)),
        radio_loss=rng.choice((0.0, 0.0, 0.2)),
        hears_above=rng.random() < 0.5,
        copies=rng.choice(((), (0.3,), (2.0, 20.0))),
        build=SealedFleet(make=make) if seed % 2 else make,
    )
    for number in range(40):
        trial.publish_at(rng.uniform(10.0, 3000.0), LOG, b"l%d" % number)
    for number in range(8):
        trial.call_at(rng.uniform(10.0, 3000.0), ARM, b"a%d" % number)
        trial.call_at(rng.uniform(10.0, 3000.0), ASK, b"b%d" % number)
    for number in range(4):
        trial.send_goal_at(rng.uniform(10.0, 3000.0), b"g%d" % number)
    if rng.random() < 0.5:
        trial.publish_at(rng.uniform(10.0, 2000.0), PHOTO, rng.randbytes(2000))
    for node in (SHORE, AUV):
        for _ in range(rng.randrange(3)):
            trial.restart_at(rng.uniform(100.0, 2500.0), node)
    trial.network.run(until_s=6000.0)
    logged = [key for key in trial.given_s if key[0] == LOG]
    assert [key for key in logged if len(trial.got_s.get(key, ())) != 1] == []
    given = sorted(logged, key=lambda key: trial.given_s[key])
    assert given == sorted(logged, key=lambda key: trial.got_s[key][0])
    assert set(trial.served.values()) <= {1}
    assert trial.ended.keys() <= {DeliveryOutcome.DELIVERED}


def test_an_idle_node_transmits_nothing_on_any_link() -> None:
    trial = Surfacing()
    trial.publish_at(10.0, LOG, b"l")
    trial.network.run(until_s=300.0)
    count = len(trial.frames)
    assert count > 0
    trial.network.run(until_s=300.0 + 86_400.0)
    assert len(trial.frames) == count


def test_a_vehicle_that_surfaces_is_reached_by_radio_within_ten_seconds() -> None:
    trial = Surfacing(hears_above=False, loss=1.0)  # nothing gets through by sound
    trial.publish_at(200.0, LOG, b"l")
    trial.network.run(until_s=PERIOD_S + 10.0)
    assert [round(at[0] - PERIOD_S) for at in trial.got_s.values()] in (
        [0],
        [1],
        [2],
        [3],
        [4],
        [5],
    )
    assert [each.reach for _, each in trial.reach if each.link == RADIO][-1] is Reach.UP


def test_an_urgent_frame_goes_by_both_links_unless_one_was_just_answered() -> None:
    trial = Surfacing()
    trial.publish_at(10.0, LOG, b"l")
    trial.publish_at(60.0, STOP, b"stop")
    trial.publish_at(UP_S + 20.0, STOP, b"again")  # it has dived since
    trial.network.run(until_s=200.0)
    links = [link for at, node, link, _ in trial.frames if node == SHORE and 60.0 <= at < 60.5]
    assert set(links) == {RADIO, SOUND}
    assert max(trial.delays_s(STOP)) < 3.0


def test_commands_go_by_the_list_as_well() -> None:
    trial = Surfacing(loss=0.3)
    ask = RemoteCommand(kind=CommandKind.ASK)
    for at_s in (30.0, 300.0):
        trial.network.at(
            at_s,
            lambda: trial.network.apply(
                SHORE, lambda engine, now: engine.commands.send(AUV, ask, now)
            ),
        )
    trial.network.run(until_s=500.0)
    engine = trial.network.engine(SHORE)
    assert engine.stats.links[BOND.name].frames_received > 0
    assert not engine.stats.links[RADIO].ledger() or {
        each.cause for each in engine.stats.links[RADIO].ledger()
    } <= {Cause.RELAY, Cause.ENVELOPE}


@pytest.mark.parametrize("at_s", [60.0, 300.0])
def test_a_commanded_silence_is_answered_and_kept_on_every_link(at_s: float) -> None:
    trial = Surfacing()
    for number in range(5):  # they know each other
        trial.publish_at(10.0 + number, LOG, b"l%d" % number)
        trial.call_at(20.0 + number, ARM, b"a%d" % number)
    silence = RemoteCommand(kind=CommandKind.SILENCE, for_s=600.0)
    trial.network.at(
        at_s,
        lambda: trial.network.apply(
            SHORE, lambda engine, now: engine.commands.send(AUV, silence, now)
        ),
    )
    for number in range(20):
        trial.publish_at(at_s + 20.0 + 10.0 * number, REPORT, b"r%d" % number)
        trial.publish_at(at_s + 25.0 + 10.0 * number, STOP, b"s%d" % number)
    trial.network.run(until_s=at_s + 300.0)
    assert trial.network.engine(AUV).silence.is_silent(trial.network.local_ns(AUV))
    assert trial.answers["answered"] == 6
    assert not [at for at, node, _, _ in trial.frames if node == AUV and at > at_s + 10.0]


def test_an_urgent_frame_is_under_no_cap_of_a_link() -> None:
    capped = rules()
    links = tuple(msgspec.structs.replace(each, max_airtime=1e-6) for each in capped.links)
    trial = Surfacing(rules=msgspec.structs.replace(capped, links=links))
    trial.publish_at(190.0, LOG, b"l")
    trial.publish_at(200.0, STOP, b"stop")
    trial.network.run(until_s=210.0)
    assert max(trial.delays_s(STOP)) < 3.0


def test_a_node_without_radio_uses_the_list_on_its_one_link() -> None:
    trial = Surfacing(rules={SHORE: rules(), AUV: rules(links=(SOUND,))})
    trial.publish_at(20.0, LOG, b"l")
    trial.call_at(40.0, ARM, b"a")
    trial.network.run(until_s=400.0)
    assert len(trial.got_s) == 1
    assert trial.answers == {"answered": 1}
    [status] = trial.network.engine(AUV).bonds
    assert status.links == (SOUND,)
    assert status.in_use == SOUND


def test_a_modem_that_dies_leaves_the_other_link() -> None:
    trial = Surfacing(hears_above=False)
    trial.network.at(100.0, partial(trial.network.set_link, AUV, up=False, link=SOUND))
    trial.publish_at(300.0, LOG, b"l")
    trial.network.run(until_s=PERIOD_S + 20.0)
    assert [round(at[0]) // 10 for at in trial.got_s.values()] == [60]


def test_every_byte_of_every_link_is_in_the_ledger() -> None:
    trial = Surfacing(loss=0.2, radio_loss=0.2)
    for number in range(60):
        trial.publish_at(20.0 + 17.0 * number, REPORT, b"r%d" % number)
        trial.publish_at(25.0 + 17.0 * number, LOG, b"l%d" % number)
    trial.network.run(until_s=2000.0)
    for node in (SHORE, AUV):
        stats = trial.network.engine(node).stats
        assert sum(each.transmitted_bytes for each in stats.ledger()) == stats.bytes_transmitted
        assert sum(each.airtime_ns for each in stats.ledger()) == stats.airtime_ns
        assert stats.bytes_transmitted == sum(
            len(frame) for _, at, _, frame in trial.frames if at == node
        )


def test_a_forged_question_has_no_effect_that_lasts() -> None:
    trial = Surfacing()
    trial.publish_at(200.0, LOG, b"l")
    trial.network.run(until_s=300.0)
    frames = len(trial.frames)
    capabilities = trial.network.capabilities(SHORE, RADIO)
    envelope = Envelope(capabilities, AUV)

    def forge(seq: int, content: bytes) -> None:
        frame = ReceivedFrame(
            frame_bytes=envelope.wrap(content, SHORE), received_at=trial.network.now
        )

        def hear(engine: Engine, now: int) -> None:
            engine.handle_frame(frame, now, RADIO)

        trial.network.apply(SHORE, hear)

    question = Bonded(BOND.number, 9, b"", wants_answer=True).encode()
    for seq in range(100):
        trial.network.at(300.0 + seq, partial(forge, seq, question))
    trial.network.run(until_s=500.0)
    assert len(trial.frames) == frames + 100  # an answer each, where that costs nothing
    assert {link for _, _, link, _ in trial.frames[frames:]} == {RADIO}
    [status] = trial.network.engine(SHORE).bonds
    assert status.reach[AUV][SOUND] is Reach.UP
    assert status.reach[AUV][RADIO] is not Reach.UP


def test_whoever_forges_a_radio_takes_no_frame_from_the_sound_of_a_sealed_fleet() -> None:
    """A stranger repeats all that he hears by sound as datagrams, and answers each question."""
    trial = Surfacing(build=SealedFleet())
    capabilities = trial.network.capabilities(SHORE, RADIO)
    heard = 0

    def forge() -> None:
        nonlocal heard
        for _, node, link, frame in trial.frames[heard:]:
            other = SHORE + AUV - node
            envelope = Envelope(capabilities, node)
            said = [Bonded(BOND.number, heard % 256, b"", wants_answer=True).encode()]
            if link == SOUND:
                said.append(frame)
            for content in said:
                arrived = ReceivedFrame(
                    frame_bytes=envelope.wrap(content, other), received_at=trial.network.now
                )
                trial.network.apply(other, partial(_hear, arrived))
        heard = len(trial.frames)

    # Between two times at the surface.
    trial.network.at(UP_S + 20.0, partial(trial.network.every, 1.0, forge))
    for number in range(40):
        trial.publish_at(UP_S + 30.0 + 10.0 * number, REPORT, b"r%d" % number)
    trial.network.run(until_s=PERIOD_S - 20.0)
    assert len(trial.got_s) == 40
    assert {len(each) for each in trial.got_s.values()} == {1}
    assert max(trial.delays_s(REPORT)) < 5.0


def _reply(event: RequestReceived, engine: Engine, now: int) -> bool:
    return engine.reply(event.call, b"", now)


def _hear(arrived: ReceivedFrame, engine: Engine, now: int) -> None:
    engine.handle_frame(arrived, now, RADIO)


def _call(stream_id: int, request: bytes, engine: Engine, now: int) -> int:
    return engine.call(stream_id, request, now)


def diamond(seed: int, kills: list[tuple[float, float, int]]) -> tuple[list[int], list[str]]:
    """Let 1 and 4 reach each other over 2 or 3, which are down at times; calls go both ways.

    Returns:
        How often each call ran, and how each of them ended.
    """
    link = "link"
    two = Route(route_id=1, name="by2", path=(1, 2, 4), link=link)
    three = Route(route_id=2, name="by3", path=(1, 3, 4), link=link)
    both = Bond(number=31, links=(two.name, three.name))
    services = StreamTable(
        [
            ServiceSpec(stream_id=1, name="a", server=4, timeout_s=1800.0),
            ServiceSpec(stream_id=2, name="b", server=1, timeout_s=1800.0),
        ],
        nodes={each: f"n{each}" for each in (1, 2, 3, 4)},
    )
    rules_of = TransmitRules(
        routes=(two, three),
        bonds=(both,),
        bonded_routes=dict.fromkeys(both.links, BondLink(down_after_s=90.0, probe_s=120.0)),
        links_of_streams={1: both.name, 2: both.name},
    )
    places = {1: (0, 0), 2: (1200, 900), 3: (1200, -900), 4: (2400, 0)}
    scenario = scenario_from_mapping(
        {
            "seed": seed,
            "channel": "none",
            "loss": {"frame": 0.1},
            "links": [{"from": a, "to": b, "loss": {"frame": 1.0}} for a, b in ((1, 4), (4, 1))],
            "nodes": [{"address": each, "position": [*at, 10]} for each, at in places.items()],
        },
        source="a test",
    )
    served: Counter[tuple[int, bytes]] = Counter()
    ended: list[str] = []

    def happened(node: int, event: Event) -> None:
        if isinstance(event, RequestReceived):
            served[event.call.stream_id, bytes(event.value)] += 1
            network.at(
                network.now / NS_PER_S,
                partial(network.apply, node, partial(_reply, event)),
            )
        elif isinstance(event, ResponseReceived | CallFailed):
            ended.append(type(event).__name__)

    network = VirtualNetwork(scenario, services, rules=rules_of, deliver=happened, digest=False)
    rng = random.Random(seed)
    for number in range(20):
        for node, stream_id in ((1, 1), (4, 2)):
            request = b"%d" % number
            network.at(
                rng.uniform(10.0, 3600.0),
                partial(network.apply, node, partial(_call, stream_id, request)),
            )
    for from_s, to_s, node in kills:
        network.at(from_s, partial(network.crash, node))
        network.at(to_s, partial(network.start, node))
    network.run(until_s=6000.0)
    return list(served.values()), ended


def test_of_two_routes_the_one_that_works_is_used(count: Callable[[int], int]) -> None:
    """Each relay is down for ten minutes in twenty, in turns."""
    for seed in range(count(100)):
        kills = [(600.0 * turn + 5.0, 600.0 * turn + 595.0, 2 + turn % 2) for turn in range(6)]
        times, ended = diamond(seed, kills)
        assert times == [1] * 40, seed
        assert ended == ["ResponseReceived"] * 40, seed


def test_a_node_that_no_stream_concerns_keeps_nobody_on_the_slow_link() -> None:
    """All streams have the default list, and go between shore and vehicle."""
    listed = rules()
    trial = Surfacing(
        table=table((SHORE, AUV, 3)), rules=msgspec.structs.replace(listed, links_of_streams={})
    )
    trial.publish_at(20.0, LOG, b"l")
    trial.network.run(until_s=60.0)
    [status] = trial.network.engine(AUV).bonds
    assert set(status.reach) == {SHORE}
    assert status.in_use == RADIO


def test_noise_does_not_keep_a_link_that_brings_nothing() -> None:
    """Where receivers do not answer, a frame must open before it shows that a link works."""
    scarce = rules()
    links = tuple(
        msgspec.structs.replace(each, bonded=BondLink(down_after_s=20.0)) for each in scarce.links
    )
    trial = Surfacing(
        build=SealedFleet(), rules=msgspec.structs.replace(scarce, links=links), loss=0.1
    )
    envelope = Envelope(trial.network.capabilities(SHORE, RADIO), AUV)

    def forge(seq: int) -> None:
        noise = Bonded(BOND.number, seq % 256, trial.rng.randbytes(20)).encode()
        arrived = ReceivedFrame(
            frame_bytes=envelope.wrap(noise, SHORE), received_at=trial.network.now
        )
        trial.network.apply(SHORE, partial(_hear, arrived))

    for number in range(300):
        trial.network.at(UP_S + number, partial(forge, number))
    for number in range(30):
        trial.call_at(UP_S + 10.0 * number, ARM, b"a%d" % number)
    trial.network.run(until_s=UP_S + 400.0)
    [status] = trial.network.engine(SHORE).bonds
    assert status.reach[AUV][RADIO] is Reach.DOWN
    assert trial.answers["answered"] == 30


def test_more_frames_than_one_answer_names_are_all_answered() -> None:
    trial = Surfacing()
    envelope = Envelope(trial.network.capabilities(SHORE, RADIO), AUV)

    def burst() -> None:
        questions = [
            ReceivedFrame(
                frame_bytes=envelope.wrap(
                    Bonded(BOND.number, seq, b"", wants_answer=True).encode(), SHORE
                ),
                received_at=trial.network.now,
            )
            for seq in range(40)
        ]

        def hear(engine: Engine, now: int) -> None:
            for each in questions:
                _hear(each, engine, now)

        trial.network.apply(SHORE, hear)

    trial.network.at(20.0, burst)
    trial.network.run(until_s=40.0)
    answered: set[int] = set()
    for _, node, _, frame in trial.frames:
        bonded = decode(frame[2:-4])
        assert node == SHORE
        assert bonded is not None
        extension = bonded.content.index(b"\xff", 0)
        answers = decode_answers(bonded.content[extension + 1 :])
        assert answers is not None
        answered |= {seq for _, seq in answers}
    assert answered == set(range(40))


def test_wrong_rules_are_refused() -> None:
    with pytest.raises(ConfigError, match="two or more, each once"):
        type(BOND)(number=1, links=(RADIO,))
    with pytest.raises(ConfigError, match=r"allowed: 1\.\.31"):
        type(BOND)(number=32, links=(RADIO, SOUND))


def test_the_vehicle_is_up_when_the_harness_says_so() -> None:
    assert is_up(int(PERIOD_S * NS_PER_S))
    assert not is_up(int((PERIOD_S + UP_S) * NS_PER_S))
