"""TDMA: in the slots of this node, muted where its clock is not sure."""

import random

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.schedule.access import TdmaSpec, Wanted, choose
from zacoustic.core.schedule.access.networktime import SETTLING_NS
from zacoustic.core.schedule.access.tdma import Tdma
from zacoustic.core.wire.access import ClockTime

LINK = LinkCapabilities(mtu_bytes=64, bit_rate_bps=640, preamble_s=0.1)
LARGEST_NS = LINK.airtime_ns(64)
MS = NS_PER_S // 1000


def tdma(address: int = 1, **settings: object) -> Tdma:
    sound: dict[str, object] = {
        "slots": (1, 2, 1), "slot_s": 3.0, "clock_error_s": 0.01, "max_range_m": 1400.0,
    }  # fmt: skip
    spec = TdmaSpec(**(sound | settings))  # type: ignore[arg-type]
    access = choose(spec, LINK, address, random.Random(1))
    assert isinstance(access, Tdma)
    return access


def test_frame_starts_in_an_own_slot_and_ends_before_its_guard() -> None:
    access = tdma()
    access.handle_clock(0, 0, 0)
    # Guard: 1 s of sound, and twice 10 ms and the drift of 10 s. The largest frame takes 0.9 s.
    last_start = seconds_to_ns(3.0 - 1.021 - 0.9)
    for due_at, ready_at in (
        (0, 0),
        (last_start, last_start),
        (last_start + MS, 6 * NS_PER_S),
        (4 * NS_PER_S, 6 * NS_PER_S),
        (7 * NS_PER_S, 7 * NS_PER_S),
        (8 * NS_PER_S, 9 * NS_PER_S),
    ):
        assert access.ready_at(Wanted(due_at), 0) == ready_at


@given(
    slots=st.lists(st.integers(1, 4), min_size=1, max_size=12),
    slot_ms=st.integers(2000, 9000),
    offset_ns=st.integers(-(10**12), 2 * 10**18),
    due_at=st.integers(0, 10**14),
)
def test_windows_of_two_nodes_never_touch(
    slots: list[int], slot_ms: int, offset_ns: int, due_at: int
) -> None:
    slot_ns = slot_ms * MS
    for address in range(1, 5):
        access = tdma(address, slots=tuple(slots), slot_s=slot_ms / 1000)
        access.handle_clock(offset_ns, 0, due_at)
        ready_at = access.ready_at(Wanted(due_at), due_at)
        if address not in slots:
            assert ready_at is None
            continue
        assert ready_at is not None
        assert due_at <= ready_at <= due_at + (len(slots) + 1) * slot_ns
        index, within_ns = divmod(ready_at + offset_ns, slot_ns)
        assert slots[index % len(slots)] == address
        assert within_ns + LARGEST_NS <= slot_ns - seconds_to_ns(1.021)
        assert access.ready_at(Wanted(due_at), ready_at) == ready_at


def test_without_a_time_nothing_goes() -> None:
    assert tdma().ready_at(Wanted(0, True), 5) is None


def test_error_beyond_the_stated_one_mutes_until_the_time_is_told_again() -> None:
    access = tdma()
    access.handle_clock(0, 11 * MS, 0)
    assert access.ready_at(Wanted(0), 0) is None
    access.handle_clock(0, 10 * MS, 0)
    assert access.ready_at(Wanted(0), 0) == 0
    assert access.ready_at(Wanted(0), 10 * NS_PER_S) == 10 * NS_PER_S
    assert access.ready_at(Wanted(0), 11 * NS_PER_S) is None
    access.handle_clock(0, 10 * MS, 11 * NS_PER_S)
    assert access.ready_at(Wanted(0), 15 * NS_PER_S) == 15 * NS_PER_S


def test_jump_mutes_until_the_new_time_has_held() -> None:
    access = tdma()
    access.handle_clock(0, 0, 0)
    access.handle_clock(10**15, 0, NS_PER_S)
    assert access.ready_at(Wanted(0), NS_PER_S) == NS_PER_S + SETTLING_NS
    assert access.ready_at(Wanted(0), NS_PER_S + SETTLING_NS) is None
    access.handle_clock(10**15, 0, NS_PER_S + SETTLING_NS)
    assert access.ready_at(Wanted(0), NS_PER_S + SETTLING_NS) is not None


def test_reference_tells_its_time_once_a_minute_where_there_is_room() -> None:
    access = tdma(clock=1)
    assert access.controls(64, 0, alone=False) == b""
    access.handle_clock(10**18, NS_PER_S, 0)
    assert access.controls(7, 0, alone=False) == b""
    told = access.controls(8, 5 * NS_PER_S, alone=False)
    assert told == ClockTime(10**18 + 5 * NS_PER_S, 250_000 * 10).encode() or len(told) == 8
    assert access.controls(64, 64 * NS_PER_S, alone=False) == b""
    assert access.controls(64, 65 * NS_PER_S, alone=False) != b""
    assert access.speak_at(70 * NS_PER_S) is None


def test_beacon_speaks_in_a_slot_of_its_own_when_nothing_else_did() -> None:
    access = tdma(clock=1, beacon_s=120.0)
    access.handle_clock(0, 0, 0)
    assert access.speak_at(0) == 0
    assert len(access.controls(64, 0, alone=True)) == 8
    assert access.speak_at(NS_PER_S) == 123 * NS_PER_S  # the first own slot from then on
    assert tdma(2, clock=1, beacon_s=120.0).speak_at(0) is None


def test_others_take_the_time_of_the_reference_and_of_nobody_else() -> None:
    access = tdma(2, clock=1)
    access.handle_clock(0, 0, 0)
    assert access.ready_at(Wanted(0), 0) is None
    time = ClockTime(12 * NS_PER_S, 0)
    access.handle_control(3, time, 2 * NS_PER_S, MS, 3 * NS_PER_S)
    assert access.ready_at(Wanted(0), 3 * NS_PER_S) is None
    access.handle_control(1, time, 2 * NS_PER_S, 20 * MS, 3 * NS_PER_S)
    assert access.ready_at(Wanted(0), 3 * NS_PER_S) is None  # too uncertain
    access.handle_control(1, time, 2 * NS_PER_S, 5 * MS, 3 * NS_PER_S)
    # Network time is 10 s ahead: 13 s, in slot 1 of the second cycle, which is node 2's.
    assert access.ready_at(Wanted(0), 3 * NS_PER_S) == 3 * NS_PER_S
    # 5 ms of 10.5 are left, so the drift of 50 ppm mutes it after 108 s.
    assert access.ready_at(Wanted(0), 100 * NS_PER_S) is not None
    assert access.ready_at(Wanted(0), 120 * NS_PER_S) is None


def test_time_of_unknown_error_is_not_taken() -> None:
    access = tdma(2, clock=1)
    access.handle_control(1, ClockTime(0, None), 0, 0, 0)
    assert access.ready_at(Wanted(0), 0) is None
