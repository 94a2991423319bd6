"""Carrier sense: wait while somebody is heard, then back off by a seeded random time."""

import random

from tests.core.rig import End, link
from zacoustic.core.base.qos import Qos
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.schedule.access import CarrierSense, Wanted
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable

LINK = LinkCapabilities(mtu_bytes=64, bit_rate_bps=640, preamble_s=0.1, senses_carrier=True)
SLOT_NS = LINK.airtime_ns(8)
NOW = Wanted(0)


def ready(access: CarrierSense, now: int, *, is_urgent: bool = False) -> int:
    """Ask for a frame that has been due for long, and let it wait."""
    wanted = Wanted(0, is_urgent)
    ready_at = access.ready_at(wanted, now)
    assert ready_at is not None
    if ready_at > now:
        access.handle_waiting(wanted, now)
    return ready_at


def back_offs(seed: int, rounds: int) -> list[int]:
    """Take the channel away again and again, before the node's turn."""
    access = CarrierSense(LINK, random.Random(seed))
    drawn: list[int] = []
    now = 0
    for _ in range(rounds):
        ready(access, now)
        access.handle_carrier(True, now)
        ready(access, now)
        now += SLOT_NS
        access.handle_carrier(False, now)
        drawn.append(ready(access, now) - now)
    return drawn


def test_quiet_channel_is_free_at_once() -> None:
    assert ready(CarrierSense(LINK, random.Random(1)), 5) <= 5


def test_back_off_is_seeded() -> None:
    assert back_offs(7, 20) == back_offs(7, 20)
    assert back_offs(7, 20) != back_offs(8, 20)


def test_window_doubles_each_time_the_turn_is_lost_up_to_32_slots() -> None:
    largest = [max(back_offs(seed, 8)[round_] for seed in range(300)) for round_ in range(8)]
    for round_, drawn in enumerate(largest):
        window = min(2**round_, 32) * SLOT_NS
        assert drawn <= window
        # A draw of zero ends the turn at once, so that the window may have grown less.
        assert drawn > window // 2


def test_own_transmission_brings_the_window_back_to_one_slot() -> None:
    access = CarrierSense(LINK, random.Random(3))
    for _ in range(6):
        ready(access, 0)
        access.handle_carrier(True, 0)
        ready(access, 1)
        access.handle_carrier(False, 1)
    access.handle_transmitted(0)
    for now in range(1, 200):
        instant = now * 10**12
        access.handle_carrier(True, instant)
        ready(access, instant)
        access.handle_carrier(False, instant)
        assert instant <= ready(access, instant) <= instant + SLOT_NS


def test_who_wanted_nothing_meanwhile_does_not_back_off() -> None:
    access = CarrierSense(LINK, random.Random(3))
    access.handle_carrier(True, 0)
    access.handle_carrier(False, SLOT_NS)
    assert ready(access, SLOT_NS) <= SLOT_NS


def crowd(seed: int, unread: int, read: int = 0) -> CarrierSense:
    """Let two other nodes be heard, then sounds that give no frame, then some that do."""
    access = CarrierSense(LINK, random.Random(seed), lambda: True)
    for number in range(2 + unread + read):
        at = number * SLOT_NS
        access.handle_carrier(True, at)
        access.handle_carrier(False, at + 1)
        if not 2 <= number < 2 + unread:
            access.handle_heard(1 + number % 2, at + 1)
    return access


def longest_wait(unread: int, read: int = 0, **wanted: bool) -> int:
    """Return the longest of many waits for a frame that is due directly after an own one, ns."""
    waits = []
    for seed in range(300):
        access = crowd(seed, unread, read)
        now = 100 * SLOT_NS
        access.handle_transmitted(now)
        ready_at = access.ready_at(Wanted(now, **wanted), now)
        assert ready_at is not None
        waits.append(ready_at - now)
    return max(waits)


def test_sounds_that_give_no_frame_widen_the_window_of_a_crowd() -> None:
    for unread, slots in ((2, 2), (3, 4), (6, 32), (20, 32)):
        assert slots * SLOT_NS // 2 < longest_wait(unread) <= slots * SLOT_NS


def test_sounds_that_give_frames_narrow_it() -> None:
    assert longest_wait(20, 3) <= 8 * SLOT_NS
    assert longest_wait(20, 12) == 0


def test_frame_that_others_count_on_does_not_wait_for_a_wide_window() -> None:
    assert longest_wait(20, is_in_rhythm=True) == 0
    assert longest_wait(20, is_copy=True) == 0
    assert longest_wait(20, is_urgent=True) == 0


def test_sounds_between_two_nodes_widen_nothing() -> None:
    access = CarrierSense(LINK, random.Random(1))
    for number in range(20):
        access.handle_carrier(True, number * SLOT_NS)
        access.handle_carrier(False, number * SLOT_NS + 1)
        if number % 4 == 0:
            access.handle_heard(2, number * SLOT_NS + 1)
    access.handle_transmitted(100 * SLOT_NS)
    assert ready(access, 100 * SLOT_NS) <= 100 * SLOT_NS


def test_to_ask_changes_nothing() -> None:
    access = CarrierSense(LINK, random.Random(3))
    access.handle_carrier(True, 0)
    assert access.ready_at(NOW, 1) == 2 * LINK.airtime_ns(64)
    access.handle_carrier(False, SLOT_NS)
    assert access.ready_at(NOW, SLOT_NS) == 0, "no back-off: no frame waited"


def test_urgent_frame_waits_for_the_end_of_the_carrier_only() -> None:
    access = CarrierSense(LINK, random.Random(3))
    access.handle_carrier(True, 0)
    assert ready(access, 1, is_urgent=True) > 1
    for _ in range(5):
        ready(access, 2)
        access.handle_carrier(False, 3)
        access.handle_carrier(True, 3)
    access.handle_carrier(False, 4)
    assert ready(access, 4, is_urgent=True) <= 4


def test_carrier_whose_end_is_lost_ends_after_two_of_the_largest_frames() -> None:
    access = CarrierSense(LINK, random.Random(1))
    access.handle_carrier(True, 1000)
    assert ready(access, 2000) == 1000 + 2 * LINK.airtime_ns(64)


def test_end_of_a_carrier_that_never_began_changes_nothing() -> None:
    access = CarrierSense(LINK, random.Random(1))
    access.handle_carrier(False, 1000)
    assert ready(access, 1000) <= 1000


def test_engine_defers_while_it_receives_and_goes_on_by_its_own_timer() -> None:
    end = End(
        1,
        StreamTable([TopicSpec(stream_id=1, name="a", qos=Qos(depth=9))]),
        capabilities=link(senses_carrier=True),
    )
    end.engine.publish(1, b"x", 0)
    end.engine.handle_carrier(True, 0)
    assert end.poll(0) is None
    end.engine.handle_carrier(False, 1000)
    due_at = end.engine.poll_timeout()
    assert due_at is not None
    assert due_at <= 1000 + link().airtime_ns(8)
    end.engine.handle_timeout(due_at)
    assert end.poll(due_at) is not None


def test_engine_whose_modem_forgets_the_end_of_a_carrier_transmits_all_the_same() -> None:
    end = End(
        1,
        StreamTable([TopicSpec(stream_id=1, name="a")]),
        capabilities=link(senses_carrier=True),
    )
    end.engine.publish(1, b"x", 0)
    end.engine.handle_carrier(True, 0)
    due_at = end.engine.poll_timeout()
    assert due_at == 2 * link().airtime_ns(64)
    assert end.poll(due_at) is not None
