"""ALOHA: at once, or at the next slot; a back-off after losses."""

import random

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.schedule.access import Aloha, AlohaSpec, Wanted

LINK = LinkCapabilities(mtu_bytes=64, bit_rate_bps=640, preamble_s=0.1)
LARGEST_NS = LINK.airtime_ns(64)


def aloha(slot_s: float | None = None, *, back_off: bool = True, seed: int = 1) -> Aloha:
    return Aloha(AlohaSpec(slot_s=slot_s, back_off=back_off), LINK, random.Random(seed))


def test_frame_goes_when_it_is_due_whoever_is_heard() -> None:
    access = aloha()
    access.handle_carrier(True, 0)
    assert access.ready_at(Wanted(7), 3) == 7
    assert access.ready_at(Wanted(7), 9) == 7


@given(
    slot_ms=st.integers(900, 5000),
    offset_ns=st.integers(-(10**18), 10**18),
    due_at=st.integers(0, 10**15),
    now=st.integers(0, 10**15),
)
def test_slotted_frame_starts_at_a_multiple_of_the_slot(
    slot_ms: int, offset_ns: int, due_at: int, now: int
) -> None:
    access = aloha(slot_ms / 1000)
    access.handle_clock(offset_ns, 0, 0)
    slot_ns = slot_ms * NS_PER_S // 1000
    ready_at = access.ready_at(Wanted(due_at), now)
    assert ready_at is not None
    assert ready_at >= now
    assert ready_at < max(due_at, now) + slot_ns
    # The timer comes back, perhaps a little after the slot has begun: then it goes.
    begun_at = ready_at - (ready_at + offset_ns) % slot_ns
    for late_ns in (0, NS_PER_S // 100):
        at = max(ready_at, begun_at + late_ns)
        again_at = access.ready_at(Wanted(due_at), at)
        assert again_at is not None
        assert again_at <= at
    if (ready_at + offset_ns) % slot_ns:
        assert ready_at == now  # late, and not by more than a fiftieth
        assert (ready_at + offset_ns) % slot_ns <= slot_ns // 50


def test_without_a_clock_that_is_sure_slots_are_left_out() -> None:
    access = aloha(2.0)
    assert access.ready_at(Wanted(0), 5) == 0
    access.handle_clock(0, 0, 0)
    assert access.ready_at(Wanted(NS_PER_S), 0) == 2 * NS_PER_S
    access.handle_clock(10**15, 0, NS_PER_S // 2)  # a jump
    assert access.ready_at(Wanted(NS_PER_S), NS_PER_S // 2) == NS_PER_S


def test_losses_double_the_wait_and_an_arrival_ends_it() -> None:
    largest = [0] * 7
    for seed in range(300):
        access = aloha(seed=seed)
        for loss in range(7):
            access.handle_outcome(False, 0)
            ready_at = access.ready_at(Wanted(0), 0)
            assert ready_at is not None
            largest[loss] = max(largest[loss], ready_at)
        assert access.ready_at(Wanted(0, True), 0) == 0
        access.handle_outcome(True, 0)
        assert access.ready_at(Wanted(0), 0) == 0
    for loss, waited in enumerate(largest):
        window = min(2**loss, 32) * LARGEST_NS
        assert window // 2 < waited <= window


def test_back_off_can_be_switched_off() -> None:
    access = aloha(back_off=False)
    access.handle_outcome(False, 0)
    assert access.ready_at(Wanted(0), 0) == 0
