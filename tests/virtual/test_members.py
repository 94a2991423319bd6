"""A fleet whose nodes have a key each: what holds with one key for all holds with identities."""

from collections.abc import Callable, Mapping
from typing import Any

import msgspec
import pytest

from tests.virtual.fleet import line
from tests.virtual.test_sealed import ARM, CALM_S, LOG, NAV, QUIET, table
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import RequestReceived
from zacoustic.seal.ccm import MemberCipher
from zacoustic.seal.identities import Identity, Members, new_identity
from zacoustic.testing.scenarios import draw_scenario, run_scenario
from zacoustic.testing.virtual import VirtualNetwork

IDENTITIES = {address: new_identity("tests", address) for address in range(1, 20)}


def members_of(identities: Mapping[int, Identity]) -> Members:
    """Return a list on which every source has wrapped its broadcasts."""
    made = Members(network="tests")
    for identity in identities.values():
        made = made.joined(identity)
    return made.rotated(identities.values()).settled()


class MemberFleet:
    """Makes the engines of a fleet; each start of a node is a life of its own."""

    def __init__(self, lists: Mapping[int, Members] | None = None) -> None:
        self._lists = lists or {}
        self._whole = members_of(IDENTITIES)
        self._lives: dict[int, int] = {}

    def __call__(self, *, address: int, epoch: int, **settings: Any) -> Engine:
        life = self._lives[address] = self._lives.get(address, epoch - 1) + 1
        members = self._lists.get(address, self._whole)
        settings["cipher"] = MemberCipher(IDENTITIES[address], members)
        return Engine(address=address, epoch=life, **settings)


def test_all_holds_in_any_random_scenario(count: Callable[[int], int]) -> None:
    for seed in range(count(300)):
        drawn = msgspec.structs.replace(draw_scenario(seed), calm_s=CALM_S)
        violations = run_scenario(drawn, build=MemberFleet()).violations
        assert not violations, f"{seed}: {len(violations)} complaints, {violations[0]}"


@pytest.mark.parametrize("is_revoked", [False, True])
def test_a_revoked_node_is_neither_heard_nor_followed(is_revoked: bool) -> None:
    left = members_of(IDENTITIES).without(3, IDENTITIES.values())
    lists = {1: left, 2: left} if is_revoked else {}
    network = VirtualNetwork(line(0, 400, 800, **QUIET), table(3), build=MemberFleet(lists))
    network.at(5.0, lambda: network.publish(1, NAV, b"of one"))
    network.at(10.0, lambda: network.publish(3, NAV, b"of three"))
    network.at(15.0, lambda: network.publish(1, LOG, b"log"))
    network.at(20.0, lambda: network.apply(3, lambda each, now: each.call(ARM, b"lost", now)))
    network.at(40.0, lambda: network.apply(1, lambda each, now: each.call(ARM, b"shore", now)))
    network.run(until_s=300.0)
    heard = {
        address: {event.value for event in network.samples(address, NAV)} for address in (1, 2, 3)
    }
    asked = {event.value for _, event in network.events if isinstance(event, RequestReceived)}
    if is_revoked:
        assert heard == {1: set(), 2: {b"of one"}, 3: set()}
        assert asked == {b"shore"}
    else:
        assert heard == {1: {b"of three"}, 2: {b"of one", b"of three"}, 3: {b"of one"}}
        assert asked == {b"lost", b"shore"}
    assert {event.value for event in network.samples(2, LOG)} == {b"log"}
