"""Which link of a list a frame goes by beside what reaches: lifespans, and the size of messages."""

from collections import Counter
from functools import partial
from typing import Any, Final

import msgspec

from tests.virtual.twolinks import RADIO_MODEM, SOUND, medium
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.bond.spec import Bond, BondLink, LinkCost, Tariff
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

SHORE, AUV = 1, 2
SATELLITE: Final = "satellite"
FIX, STATE, LOG = 1, 2, 3
"""Worthless after 10 s; never; reliable."""
BY_SATELLITE: Final = BondLink(cost=LinkCost.MONEY, tariff=Tariff(per_byte=0.01, quantum=50))
MESSAGE_BYTES: Final = 270
SOUND_BYTES: Final = 64


class AtSea:
    """Shore and vehicle with sound, and a satellite that takes 20 s.

    Args:
        order: The list of links, the best one first.
        is_heard: Whether the modems hear each other.
    """

    def __init__(self, order: tuple[str, ...], *, is_heard: bool = True) -> None:
        self.is_heard = is_heard
        self.frames: list[tuple[float, str, int]] = []
        """Instant, s, link and size of each frame of the vehicle."""
        reliable = Qos(reliability=Reliability.RELIABLE, depth=100)
        by_auv: dict[str, Any] = {"publishers": (AUV,), "subscribers": (SHORE,)}
        table = StreamTable(
            [
                TopicSpec(stream_id=FIX, name="fix", qos=Qos(lifespan_s=10.0), **by_auv),
                TopicSpec(stream_id=STATE, name="state", qos=Qos(depth=50), **by_auv),
                TopicSpec(stream_id=LOG, name="log", qos=reliable, **by_auv),
            ],
            nodes={SHORE: "shore", AUV: "auv"},
        )
        bond = Bond(number=31, links=order)
        links = {
            SOUND: LinkRules(name=SOUND, bonded=BondLink(down_after_s=60.0)),
            SATELLITE: LinkRules(name=SATELLITE, bonded=BY_SATELLITE),
        }
        self.network = VirtualNetwork(
            medium(2, apart_m=1000.0, profile="evologics_s2c_18_34", loss=0.0, seed=1),
            table,
            rules=TransmitRules(
                links=tuple(links.values()),
                bonds=(bond,),
                default_link=bond.name,
                contact=ContactRules(heartbeat_s=50.0),
            ),
            trace=self._traced,
            disturb=lambda source, node, now: (0.0,) if self.is_heard else (),
        )
        sky = medium(2, apart_m=30_000.0, profile="ideal", loss=0.0, seed=2)
        modem = msgspec.structs.replace(RADIO_MODEM, mtu_bytes=MESSAGE_BYTES)
        self.network.add_link(SATELLITE, sky, modem=modem)

    def publish_at(self, at_s: float, stream_id: int, value: bytes) -> None:
        """Let the vehicle publish."""
        self.network.at(at_s, partial(self.network.publish, AUV, stream_id, value))

    def came(self, stream_id: int) -> dict[bytes, float]:
        """Return when each sample of a stream arrived, s."""
        return {
            bytes(each.value): each.received_at / NS_PER_S
            for each in self.network.samples(SHORE, stream_id)
        }

    def links_since(self, from_s: float) -> set[str]:
        """Return the links by which the vehicle has transmitted since an instant."""
        return {link for at_s, link, _ in self.frames if at_s >= from_s}

    def _traced(self, record: TraceRecord) -> None:
        of_links = (SOUND, SATELLITE)
        if record.what == "transmit" and record.node == AUV and record.link in of_links:
            self.frames.append((record.at / NS_PER_S, record.link, record.size_bytes))


def test_a_sample_goes_by_the_first_link_that_brings_it_within_its_lifespan() -> None:
    trial = AtSea((SATELLITE, SOUND))
    for number in range(10):
        trial.publish_at(100.0 + 60.0 * number, FIX, b"f%d" % number)
        trial.publish_at(130.0 + 60.0 * number, STATE, b"s%d" % number)
    trial.network.run(until_s=800.0)
    fixes, states = trial.came(FIX), trial.came(STATE)
    assert len(fixes) == len(states) == 10
    for number in range(10):
        assert fixes[b"f%d" % number] - (100.0 + 60.0 * number) < 10.0
        assert states[b"s%d" % number] - (130.0 + 60.0 * number) > 20.0


def test_where_no_link_brings_it_in_time_the_order_holds() -> None:
    trial = AtSea((SOUND, SATELLITE), is_heard=False)
    for number in range(60):
        trial.publish_at(20.0 * number, FIX, b"f%d" % number)
    trial.network.run(until_s=1300.0)
    since = Counter(link for at_s, link, _ in trial.frames if at_s >= 600.0)
    assert since[SATELLITE] == 30
    assert since[SOUND] <= 4  # a try in ten minutes, and a heartbeat after the last sample
    late = [each for each in trial.came(FIX) if int(each[1:]) > 40]
    assert len(late) == 19


def test_a_link_that_came_back_is_used_again_without_a_word_by_satellite() -> None:
    """Both nodes think that the other one is not heard by sound."""
    trial = AtSea((SOUND, SATELLITE), is_heard=False)
    for number in range(400):
        trial.publish_at(10.0 * number, STATE, b"s%d" % number)
    trial.network.at(1800.0, partial(setattr, trial, "is_heard", True))
    trial.network.run(until_s=4000.0)
    assert trial.links_since(1000.0) == {SOUND, SATELLITE}
    assert trial.links_since(1800.0 + 100.0) == {SOUND}
    # Best effort: some spread samples meet a heartbeat or an answer on the half-duplex modem.
    assert len(trial.came(STATE)) >= 385


def test_a_heartbeat_costs_no_money() -> None:
    trial = AtSea((SOUND, SATELLITE), is_heard=False)
    for number in range(40):
        trial.publish_at(10.0 * number, STATE, b"s%d" % number)
    trial.network.run(until_s=4000.0)
    assert trial.links_since(600.0) == {SOUND}
    paid_bytes = sum(-(-size // 50) * 50 for _, link, size in trial.frames if link == SATELLITE)
    [stats] = trial.network.stats_of(AUV)
    assert stats.links[SATELLITE].paid_bytes == paid_bytes > 0
    assert 60 <= len([each for each in trial.frames if each[0] > 600.0]) <= 110


def test_where_only_the_satellite_is_left_there_are_no_heartbeats() -> None:
    trial = AtSea((SOUND, SATELLITE))
    trial.publish_at(100.0, STATE, b"s")
    trial.network.at(200.0, partial(trial.network.set_link, AUV, up=False))
    trial.network.run(until_s=4000.0)
    assert trial.links_since(210.0) == set()
    trial.publish_at(4000.0, LOG, b"l")
    trial.network.run(until_s=4200.0)
    assert trial.came(LOG).keys() == {b"l"}


def test_a_message_by_satellite_is_filled_and_a_frame_by_sound_fits_it() -> None:
    trial = AtSea((SOUND, SATELLITE), is_heard=False)
    for number in range(40):
        trial.publish_at(10.0 * number, STATE, b"s%d" % number)
    for number in range(12):
        trial.publish_at(900.0, LOG, b"record %5d" % number)
    trial.network.at(1200.0, partial(setattr, trial, "is_heard", True))
    for number in range(40, 140):
        trial.publish_at(900.0 + 10.0 * number, STATE, b"s%d" % number)
    for number in range(12, 24):
        trial.publish_at(2400.0, LOG, b"record %5d" % number)
    trial.network.run(until_s=2600.0)
    assert trial.came(LOG).keys() == {b"record %5d" % number for number in range(24)}
    large = [each for each in trial.frames if each[2] > SOUND_BYTES + 16]
    assert [int(at_s) for at_s, _, _ in large if at_s < 950.0] == [900]
    assert {link for _, link, _ in large} == {SATELLITE}
    assert all(size <= MESSAGE_BYTES for _, _, size in trial.frames)
    assert trial.links_since(2400.0) == {SOUND}
