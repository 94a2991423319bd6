"""Every frame of refusals.json and ends.json: as much of it is lost as stated, the rest is read."""

import random
from typing import Any

import pytest

from tests.independent import describe, fields, fleet, frame, sealed
from tests.independent.envelope import BROADCAST, Capabilities, Opened
from tests.independent.errors import ReadError
from tests.independent.fleet import TABLES
from tests.independent.minimal import Link, Node, NotRead
from tests.independent.record import Way

VECTORS = [*fleet.load("refusals.json"), *fleet.load("ends.json")]
_DELIMITED = Capabilities(addresses=True, checks=True, delimits=True)


def _link(one: dict[str, Any]) -> Link:
    plain = one.get("link")
    capabilities = _DELIMITED
    if plain is not None:
        capabilities = Capabilities(plain["addressed"], plain["checked"], plain["framed"])
    return Link(mtu=64, unit_s=1.0, capabilities=capabilities)


def _node(one: dict[str, Any]) -> Node:
    """Return the receiver, with what it has heard and sent before."""
    receiver, table = one["receiver"], TABLES[one["table"]]
    node = Node(receiver, table, 1, _link(one), random.Random(1), 0.0)
    other = 3 - receiver
    now = 0.0
    if one["introduced"]:
        hello = b"\xb0\x02\x00\x01" + describe.table_digest(table)
        node.handle_opened(Opened(other, receiver, hello), now)
        while (due := node.next_due()) is not None and due < 100:
            now = max(now, due)
            node.poll_opened(now)
        confirm = bytes((0xB5, 0, 0, 1))
        node.handle_opened(Opened(other, receiver, confirm), 200.0)
    if "called" in one:
        node.call(20, bytes.fromhex(one["called"]), 300.0)
        node.poll_opened(300.0)
    for before in one.get("before", ()):
        opened = Opened(one["source"], one["destination"], bytes.fromhex(before))
        node.handle_opened(opened, 301.0)
    node.events.clear()
    return node


@pytest.mark.parametrize(
    "one", [one for one in VECTORS if "key" not in one], ids=lambda one: one["name"]
)
def test_refused_frame(one: dict[str, Any]) -> None:
    node = _node(one)
    data = bytes.fromhex(one["hex"])
    if "link" in one:
        node.handle(data, 301.0)
        assert [event.data for event in node.events if isinstance(event, NotRead)] == [data]
        assert len(node.events) == 1
        return
    node.handle_opened(Opened(one["source"], one["destination"], data), 301.0)
    refused = [event for event in node.events if isinstance(event, NotRead)]
    assert b"".join(event.data for event in refused).hex() == one["lost"]
    way = Way(node.table, one["source"], one["destination"])
    assert [fields.of(placed, way) for placed in node.taken] == one["read"]


@pytest.mark.parametrize(
    "one", [one for one in VECTORS if "key" in one], ids=lambda one: one["name"]
)
def test_refused_sealed_frame(one: dict[str, Any]) -> None:
    digest = describe.table_digest(TABLES[one["table"]])
    receiver = sealed.Receiver(one["receiver"], sealed.FleetKey.of_plain(one["key"]), digest)
    for before in one.get("before", ()):
        receiver.open(bytes.fromhex(before), one["source"], BROADCAST)
    data = bytes.fromhex(one["hex"])
    if one["reason"] != "weak":
        assert one["lost"] == one["hex"]
        with pytest.raises(ReadError):
            receiver.open(data, one["source"], one["destination"])
        return
    opening = receiver.open(data, one["source"], one["destination"])
    way = Way(TABLES[one["table"]], one["source"], one["destination"])
    (item,) = frame.read(opening.records, way, life=opening.life, weak=not opening.strong).items
    assert item == frame.Unread(bytes.fromhex(one["lost"]), "weak")
