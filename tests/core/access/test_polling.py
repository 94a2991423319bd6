"""Polling: nobody speaks unasked."""

import random

from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.schedule.access import PollingSpec, Wanted, choose
from zacoustic.core.schedule.access.polling import Polled, Poller
from zacoustic.core.wire.access import NOBODY, Turn

LINK = LinkCapabilities(mtu_bytes=64, bit_rate_bps=640, preamble_s=0.1, propagation_s=0.5)
SPEC = PollingSpec(poller=1, nodes=(2, 3), turn_s=3.0, idle_s=10.0)
S = NS_PER_S


def poller() -> Poller:
    access = choose(SPEC, LINK, 1, random.Random(1))
    assert isinstance(access, Poller)
    return access


def polled(address: int = 2) -> Polled:
    access = choose(SPEC, LINK, address, random.Random(1))
    assert isinstance(access, Polled)
    return access


def asked(access: Poller, now: int) -> Turn:
    """Let the poller speak."""
    speak_at = access.speak_at(now)
    assert speak_at is not None
    assert speak_at <= now
    access.handle_timeout(now)
    turn = Turn.decode(access.controls(64, now, alone=True)[1:])
    access.handle_transmitted(now)
    return turn


def test_poller_goes_round_and_rests_after_an_empty_round() -> None:
    access = poller()
    assert asked(access, 0) == Turn(2, 3 * S)
    assert access.ready_at(Wanted(0, True), S) is None
    access.handle_heard(2, S)
    access.handle_control(2, Turn(NOBODY, 0), S, 0, S)
    assert asked(access, S) == Turn(3, 3 * S)
    access.handle_heard(3, 2 * S)
    access.handle_control(3, Turn(NOBODY, 0), 2 * S, 0, 2 * S)
    assert access.speak_at(2 * S) == 12 * S
    assert access.ready_at(Wanted(5 * S), 2 * S) == 5 * S
    assert asked(access, 12 * S) == Turn(2, 3 * S)


def test_round_in_which_somebody_spoke_is_followed_by_the_next() -> None:
    access = poller()
    asked(access, 0)
    access.handle_heard(2, S)
    access.handle_heard(2, 2 * S)
    access.handle_control(2, Turn(NOBODY, 0), 2 * S, 0, 2 * S)
    asked(access, 2 * S)
    access.handle_heard(3, 3 * S)
    access.handle_control(3, Turn(NOBODY, 0), 3 * S, 0, 3 * S)
    assert access.ready_at(Wanted(0), 3 * S) == 3 * S
    assert access.speak_at(3 * S) == 3 * S


def test_node_that_is_not_heard_loses_its_turn() -> None:
    access = poller()
    asked(access, 0)
    over_at = access.speak_at(0)
    assert over_at is not None
    assert 3 * S + S < over_at < 6 * S  # its turn, and the way there and back
    assert asked(access, over_at) == Turn(3, 3 * S)


def test_turn_given_back_by_another_node_is_ignored() -> None:
    access = poller()
    asked(access, 0)
    access.handle_control(3, Turn(NOBODY, 0), S, 0, S)
    assert access.ready_at(Wanted(0), S) is None


def test_own_frame_at_rest_begins_a_round() -> None:
    access = poller()
    assert access.ready_at(Wanted(0), 0) == 0
    access.handle_transmitted(S)
    assert access.speak_at(S) == S
    assert asked(access, S) == Turn(2, 3 * S)


def test_polled_node_speaks_within_its_turn_only() -> None:
    access = polled()
    assert access.ready_at(Wanted(0, True), 0) is None
    assert access.speak_at(0) is None
    access.handle_control(3, Turn(2, 3 * S), 0, 0, 0)
    assert access.ready_at(Wanted(0), 0) is None  # only the poller gives turns
    access.handle_control(1, Turn(3, 3 * S), 0, 0, 0)
    assert access.ready_at(Wanted(0), 0) is None  # that of another node, in a frame for all
    access.handle_control(1, Turn(2, 3 * S), 0, 0, 0)
    assert access.ready_at(Wanted(0), S) == S
    # The largest frame takes 0.9 s, giving back 0.25 s.
    assert access.ready_at(Wanted(0), 2 * S) is None
    assert access.speak_at(2 * S) == 0
    assert access.controls(64, 2 * S, alone=False) == b""
    assert access.controls(64, 2 * S, alone=True) == Turn(NOBODY, 0).encode()
    assert access.speak_at(2 * S) is None
    assert access.answers_to == 1
