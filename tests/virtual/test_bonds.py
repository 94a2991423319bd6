"""Streams over a list of links: nothing is lost or doubled when a vehicle surfaces and dives."""

import itertools
import random
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
)
from tests.virtual.twolinks import RADIO, SOUND
from zacoustic.core.base.stats import Cause
from zacoustic.core.bond.reach import Reach
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import DeliveryOutcome
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.streams.commands import CommandKind, RemoteCommand
from zacoustic.core.wire.bond import Bonded
from zacoustic.core.wire.envelope import Envelope
from zacoustic.errors import ConfigError


def test_a_frame_goes_by_radio_at_the_surface_and_by_sound_below() -> None:
    water = Surfacing()
    for number in range(40):
        water.publish_at(15.0 + 30.0 * number, REPORT, b"r%d" % number)
    water.network.run(until_s=1300.0)
    assert len(water.got_s) == 40
    assert {len(each) for each in water.got_s.values()} == {1}
    by_radio = [at for at, _, link, _ in water.frames if link == RADIO]
    by_sound = [at for at, _, link, _ in water.frames if link == SOUND]
    deep = [at for at in by_radio if at % PERIOD_S > UP_S + 60.0]
    assert len(by_radio) > 15
    assert all(at % PERIOD_S > 14.0 for at in by_sound)
    # The better link is tried with each report at most, and nobody answers.
    assert len(deep) <= len([at for at in by_sound if at % PERIOD_S > UP_S + 60.0])
    assert max(water.delays_s(REPORT, is_at_surface=True)[:6]) < 0.5


@pytest.mark.parametrize("seed", range(3))
def test_best_effort_has_no_gap_at_a_switch(seed: int) -> None:
    water = Surfacing(seed)
    for number in range(400):
        water.publish_at(30.0 + 5.0 * number, REPORT, b"r%d" % number)
    water.network.run(until_s=2100.0)
    came = sorted(at[0] for at in water.got_s.values())
    assert len(came) == 400
    # By sound a report takes 1.2 s longer.
    assert max(later - at for at, later in itertools.pairwise(came)) <= 5.0 + 1.0 + 1.2


def test_all_is_delivered_once_in_order_whenever_the_vehicle_dives(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(400)):
        dive(seed)


def dive(seed: int) -> None:
    """Use every kind of stream while the vehicle surfaces, and either node restarts."""
    rng = random.Random(seed)
    water = Surfacing(
        seed,
        loss=rng.choice((0.0, 0.1, 0.3)),
        radio_loss=rng.choice((0.0, 0.0, 0.2)),
        hears_above=rng.random() < 0.5,
        copies=rng.choice(((), (0.3,), (2.0, 20.0))),
        build=SealedFleet() if seed % 2 else Engine,
    )
    for number in range(40):
        water.publish_at(rng.uniform(10.0, 3000.0), LOG, b"l%d" % number)
    for number in range(8):
        water.call_at(rng.uniform(10.0, 3000.0), ARM, b"a%d" % number)
        water.call_at(rng.uniform(10.0, 3000.0), ASK, b"b%d" % number)
    for number in range(4):
        water.send_goal_at(rng.uniform(10.0, 3000.0), b"g%d" % number)
    if rng.random() < 0.5:
        water.publish_at(rng.uniform(10.0, 2000.0), PHOTO, rng.randbytes(2000))
    for node in (SHORE, AUV):
        for _ in range(rng.randrange(3)):
            water.restart_at(rng.uniform(100.0, 2500.0), node)
    water.network.run(until_s=6000.0)
    logged = [key for key in water.given_s if key[0] == LOG]
    assert [key for key in logged if len(water.got_s.get(key, ())) != 1] == []
    given = sorted(logged, key=lambda key: water.given_s[key])
    assert given == sorted(logged, key=lambda key: water.got_s[key][0])
    assert set(water.served.values()) <= {1}
    assert water.ended.keys() <= {DeliveryOutcome.DELIVERED}


def test_an_idle_node_transmits_nothing_on_any_link() -> None:
    water = Surfacing()
    water.publish_at(10.0, LOG, b"l")
    water.network.run(until_s=300.0)
    count = len(water.frames)
    assert count > 0
    water.network.run(until_s=300.0 + 86_400.0)
    assert len(water.frames) == count


def test_a_vehicle_that_surfaces_is_reached_by_radio_within_ten_seconds() -> None:
    water = Surfacing(hears_above=False, loss=1.0)  # nothing gets through by sound
    water.publish_at(200.0, LOG, b"l")
    water.network.run(until_s=PERIOD_S + 10.0)
    assert [round(at[0] - PERIOD_S) for at in water.got_s.values()] in (
        [0],
        [1],
        [2],
        [3],
        [4],
        [5],
    )
    assert [each.reach for _, each in water.reach if each.link == RADIO][-1] is Reach.UP


def test_an_urgent_frame_goes_by_both_links_unless_one_was_just_answered() -> None:
    water = Surfacing()
    water.publish_at(10.0, LOG, b"l")
    water.publish_at(60.0, STOP, b"stop")
    water.publish_at(UP_S + 20.0, STOP, b"again")  # it has dived since
    water.network.run(until_s=200.0)
    links = [link for at, node, link, _ in water.frames if node == SHORE and 60.0 <= at < 60.5]
    assert set(links) == {RADIO, SOUND}
    assert max(water.delays_s(STOP)) < 3.0


def test_commands_go_by_the_list_as_well() -> None:
    water = Surfacing(loss=0.3)
    ask = RemoteCommand(kind=CommandKind.ASK)
    for at_s in (30.0, 300.0):
        water.network.at(
            at_s,
            lambda: water.network.apply(
                SHORE, lambda engine, now: engine.commands.send(AUV, ask, now)
            ),
        )
    water.network.run(until_s=500.0)
    engine = water.network.engine(SHORE)
    assert engine.stats.links[BOND.name].frames_received > 0
    assert not engine.stats.links[RADIO].ledger() or {
        each.cause for each in engine.stats.links[RADIO].ledger()
    } <= {Cause.RELAY, Cause.ENVELOPE}


@pytest.mark.parametrize("at_s", [60.0, 300.0])
def test_a_commanded_silence_is_answered_and_kept_on_every_link(at_s: float) -> None:
    water = Surfacing()
    for number in range(5):  # they know each other
        water.publish_at(10.0 + number, LOG, b"l%d" % number)
        water.call_at(20.0 + number, ARM, b"a%d" % number)
    silence = RemoteCommand(kind=CommandKind.SILENCE, for_s=600.0)
    water.network.at(
        at_s,
        lambda: water.network.apply(
            SHORE, lambda engine, now: engine.commands.send(AUV, silence, now)
        ),
    )
    for number in range(20):
        water.publish_at(at_s + 20.0 + 10.0 * number, REPORT, b"r%d" % number)
        water.publish_at(at_s + 25.0 + 10.0 * number, STOP, b"s%d" % number)
    water.network.run(until_s=at_s + 300.0)
    assert water.network.engine(AUV).silence.is_silent(water.network.local_ns(AUV))
    assert water.answers["answered"] == 6
    assert not [at for at, node, _, _ in water.frames if node == AUV and at > at_s + 10.0]


def test_an_urgent_frame_is_under_no_cap_of_a_link() -> None:
    capped = rules()
    links = tuple(msgspec.structs.replace(each, max_airtime=1e-6) for each in capped.links)
    water = Surfacing(rules=msgspec.structs.replace(capped, links=links))
    water.publish_at(190.0, LOG, b"l")
    water.publish_at(200.0, STOP, b"stop")
    water.network.run(until_s=210.0)
    assert max(water.delays_s(STOP)) < 3.0


def test_a_node_without_radio_uses_the_list_on_its_one_link() -> None:
    water = Surfacing(rules={SHORE: rules(), AUV: rules(links=(SOUND,))})
    water.publish_at(20.0, LOG, b"l")
    water.call_at(40.0, ARM, b"a")
    water.network.run(until_s=400.0)
    assert len(water.got_s) == 1
    assert water.answers == {"answered": 1}
    [status] = water.network.engine(AUV).bonds
    assert status.links == (SOUND,)
    assert status.in_use == SOUND


def test_a_modem_that_dies_leaves_the_other_link() -> None:
    water = Surfacing(hears_above=False)
    water.network.at(100.0, partial(water.network.set_link, AUV, up=False, link=SOUND))
    water.publish_at(300.0, LOG, b"l")
    water.network.run(until_s=PERIOD_S + 20.0)
    assert [round(at[0]) // 10 for at in water.got_s.values()] == [60]


def test_every_byte_of_every_link_is_in_the_ledger() -> None:
    water = Surfacing(loss=0.2, radio_loss=0.2)
    for number in range(60):
        water.publish_at(20.0 + 17.0 * number, REPORT, b"r%d" % number)
        water.publish_at(25.0 + 17.0 * number, LOG, b"l%d" % number)
    water.network.run(until_s=2000.0)
    for node in (SHORE, AUV):
        stats = water.network.engine(node).stats
        assert sum(each.transmitted_bytes for each in stats.ledger()) == stats.bytes_transmitted
        assert stats.bytes_transmitted == sum(
            len(frame) for _, at, _, frame in water.frames if at == node
        )


def test_a_forged_question_has_no_effect_that_lasts() -> None:
    water = Surfacing()
    water.publish_at(200.0, LOG, b"l")
    water.network.run(until_s=300.0)
    frames = len(water.frames)
    capabilities = water.network.capabilities(SHORE, RADIO)
    envelope = Envelope(capabilities, AUV)

    def forge(seq: int, content: bytes) -> None:
        frame = ReceivedFrame(
            frame_bytes=envelope.wrap(content, SHORE), received_at=water.network.now
        )

        def hear(engine: Engine, now: int) -> None:
            engine.handle_frame(frame, now, RADIO)

        water.network.apply(SHORE, hear)

    question = Bonded(BOND.number, 9, b"", wants_answer=True).encode()
    for seq in range(100):
        water.network.at(300.0 + seq, partial(forge, seq, question))
    water.network.run(until_s=500.0)
    assert len(water.frames) == frames + 100  # an answer each, where that costs nothing
    assert {link for _, _, link, _ in water.frames[frames:]} == {RADIO}
    [status] = water.network.engine(SHORE).bonds
    assert status.reach[AUV][SOUND] is Reach.UP
    assert status.reach[AUV][RADIO] is not Reach.UP


def test_whoever_forges_a_radio_takes_no_frame_from_the_sound_of_a_sealed_fleet() -> None:
    """A stranger repeats all that he hears by sound as datagrams, and answers each question."""
    water = Surfacing(build=SealedFleet())
    capabilities = water.network.capabilities(SHORE, RADIO)
    heard = 0

    def forge() -> None:
        nonlocal heard
        for _, node, link, frame in water.frames[heard:]:
            other = SHORE + AUV - node
            envelope = Envelope(capabilities, node)
            said = [Bonded(BOND.number, heard % 256, b"", wants_answer=True).encode()]
            if link == SOUND:
                said.append(frame)
            for content in said:
                arrived = ReceivedFrame(
                    frame_bytes=envelope.wrap(content, other), received_at=water.network.now
                )
                water.network.apply(
                    other, lambda engine, now, arrived=arrived: engine.handle_frame(
                        arrived, now, RADIO
                    )
                )  # fmt: skip
        heard = len(water.frames)

    # Between two times at the surface.
    water.network.at(UP_S + 20.0, partial(water.network.every, 1.0, forge))
    for number in range(40):
        water.publish_at(UP_S + 30.0 + 10.0 * number, REPORT, b"r%d" % number)
    water.network.run(until_s=PERIOD_S - 20.0)
    assert len(water.got_s) == 40
    assert {len(each) for each in water.got_s.values()} == {1}
    assert max(water.delays_s(REPORT)) < 5.0


def test_wrong_rules_are_refused() -> None:
    with pytest.raises(ConfigError, match="two or more, each once"):
        type(BOND)(number=1, links=(RADIO,))
    with pytest.raises(ConfigError, match=r"allowed: 1\.\.31"):
        type(BOND)(number=32, links=(RADIO, SOUND))


def test_the_vehicle_is_up_when_the_harness_says_so() -> None:
    assert is_up(int(PERIOD_S * NS_PER_S))
    assert not is_up(int((PERIOD_S + UP_S) * NS_PER_S))
