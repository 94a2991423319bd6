"""A submerged node gets the key for the broadcasts of a node that its list has no key for."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import pytest

from tests.virtual.fleet import line
from tests.virtual.test_members import members_of
from tests.virtual.test_sealed import NAV, QUIET, table
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, KeyDelivered, ResponseReceived, SealAlarm
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.keydelivery import KEYS_STREAM_ID
from zacoustic.errors import LocalError
from zacoustic.seal.ccm import FleetCipher, MemberCipher
from zacoustic.seal.deliveredkeys import DeliveredKeys
from zacoustic.seal.identities import Identity, Members, broadcast_secret, new_identity
from zacoustic.seal.keys import new_key
from zacoustic.testing.virtual import VirtualNetwork

SHORE, AUV, NEW = 1, 2, 3
IDENTITIES: Final = {each: new_identity("tests", each) for each in (SHORE, AUV, NEW)}
ALL: Final = members_of(IDENTITIES)
OLD: Final = members_of({each: IDENTITIES[each] for each in (SHORE, AUV)})


class Fleet:
    """The vehicle dived before the third node was put on the list."""

    def __init__(
        self, tmp_path: Path, *, of_auv: Members = OLD, rules: TransmitRules | None = None
    ) -> None:
        self.sent: list[bytes] = []
        self.path = tmp_path / "node-2.delivered"
        self._lists: Mapping[int, Members] = {SHORE: ALL, AUV: of_auv, NEW: ALL}
        self.network = VirtualNetwork(
            line(0, 500, 900, **QUIET),
            table(3),
            build=self._make,
            rules={SHORE: TransmitRules(), AUV: rules or TransmitRules(), NEW: TransmitRules()},
            trace=lambda record: self.sent.append(bytes.fromhex(record.frame or "")),
        )

    def _make(self, *, address: int, **settings: Any) -> Engine:
        of = self._lists[address]
        path = self.path if address == AUV else None
        settings["cipher"] = MemberCipher(
            IDENTITIES[address], of, delivered=DeliveredKeys(of.network, of.generation, path)
        )
        return Engine(address=address, **settings)

    def deliver(self, at_s: float, source: int = NEW) -> None:
        """Let the shore send the vehicle a source's key."""
        self.network.at(
            at_s,
            lambda: self.network.apply(
                SHORE, lambda each, now: each.keys.send(AUV, source, now, timeout_s=100.0)
            ),
        )

    def publish(self, at_s: float, value: bytes) -> None:
        """Let the new node publish to all."""
        self.network.at(at_s, lambda: self.network.publish(NEW, NAV, value))

    def of(self, node: int, kind: type) -> list[Any]:
        """Return a node's events of a type."""
        return [
            event for at, event in self.network.events if at == node and isinstance(event, kind)
        ]


def test_the_broadcasts_are_heard_from_then_on_also_after_a_restart(tmp_path: Path) -> None:
    fleet = Fleet(tmp_path)
    for number in range(4):
        fleet.publish(10.0 + 10 * number, b"before")
    fleet.deliver(60.0)
    for number in range(20):  # one frame in sixteen shows the counter in full
        fleet.publish(120.0 + 10 * number, b"after")
    fleet.network.run(until_s=400.0)
    heard = {sample.value for sample in fleet.network.samples(AUV, NAV)}
    assert heard == {b"after"}
    assert [each.call_id for each in fleet.of(SHORE, ResponseReceived)]
    (taken,) = fleet.of(AUV, KeyDelivered)
    assert (taken.source, taken.delivered_by, taken.refusal) == (NEW, SHORE, "")
    fleet.network.restart(AUV)
    for number in range(20):
        fleet.publish(410.0 + 10 * number, b"again")
    fleet.network.run(until_s=700.0)
    assert b"again" in {sample.value for sample in fleet.network.samples(AUV, NAV)}
    assert fleet.path.stat().st_mode & 0o077 == 0


def test_no_key_is_in_a_frame_in_the_file_or_in_an_event(tmp_path: Path) -> None:
    fleet = Fleet(tmp_path)
    fleet.deliver(10.0)
    fleet.network.run(until_s=100.0)
    secret = broadcast_secret(IDENTITIES[NEW], ALL, NEW)
    assert secret is not None
    assert fleet.of(AUV, KeyDelivered)
    shown = repr(fleet.network.events).encode() + fleet.path.read_bytes() + b"".join(fleet.sent)
    for part in (secret, secret.hex().encode(), secret[:8]):
        assert part not in shown
    journal = b"".join(fleet.network.journal(AUV).entries.values())
    assert secret[:8] not in journal


@pytest.mark.parametrize(
    ("of_auv", "rules", "text"),
    [
        (ALL, TransmitRules(), "the list has a key for broadcasts of node 3"),
        (OLD, TransmitRules(commands_from=frozenset({3})), "node 2 takes no keys from node 1"),
    ],
)
def test_a_refused_key_changes_nothing_and_says_why(
    tmp_path: Path, of_auv: Members, rules: TransmitRules, text: str
) -> None:
    fleet = Fleet(tmp_path, of_auv=of_auv, rules=rules)
    fleet.deliver(10.0)
    fleet.network.run(until_s=100.0)
    (failed,) = fleet.of(SHORE, CallFailed)
    (taken,) = fleet.of(AUV, KeyDelivered)
    assert text in failed.text
    assert text in taken.refusal
    assert not fleet.path.exists()
    alarms = [(each.address, each.stream_id) for each in fleet.of(AUV, SealAlarm)]
    assert alarms == ([(SHORE, KEYS_STREAM_ID)] if rules.commands_from else [])


def test_what_was_wrapped_for_another_node_or_by_another_one_is_refused() -> None:
    shore = MemberCipher(IDENTITIES[SHORE], ALL)
    auv = MemberCipher(IDENTITIES[AUV], OLD)
    wrapped = shore.wrap_key(NEW, AUV)
    for source, sender, body in ((SHORE + 9, SHORE, wrapped), (NEW, SHORE, wrapped[::-1])):
        with pytest.raises(LocalError, match="was not wrapped by node 1"):
            auv.take_key(source, sender, body)
    with pytest.raises(LocalError, match="not in the list"):
        auv.take_key(NEW, NEW, wrapped)
    with pytest.raises(LocalError, match="does not open broadcasts of node 3"):
        auv.wrap_key(NEW, SHORE)
    with pytest.raises(LocalError, match="one key for all nodes"):
        FleetCipher(new_key("tests")).wrap_key(NEW, AUV)
    auv.take_key(NEW, SHORE, wrapped)
    assert auv.wrap_key(NEW, SHORE)


def test_keys_of_another_generation_are_not_used(tmp_path: Path) -> None:
    path = tmp_path / "node-2.delivered"
    first = MemberCipher(
        IDENTITIES[AUV], OLD, delivered=DeliveredKeys(OLD.network, OLD.generation, path)
    )
    first.take_key(NEW, SHORE, MemberCipher(IDENTITIES[SHORE], ALL).wrap_key(NEW, AUV))
    assert DeliveredKeys(OLD.network, OLD.generation, path).of
    assert not DeliveredKeys(OLD.network, OLD.generation + 1, path).of


def test_a_node_without_a_seal_sends_no_key() -> None:
    network = VirtualNetwork(line(0, 500), table(2))
    with pytest.raises(LocalError, match="has no identity"):
        network.apply(1, lambda each, now: each.keys.send(2, 3, now))
    identity: Identity = IDENTITIES[SHORE]
    assert "private" not in repr(identity)
