"""The minimal node in the place of one node of a conversation: it is told the same."""

import random
from typing import Any

import pytest

from tests.independent import calls, fields, fleet
from tests.independent.envelope import Capabilities, Opened
from tests.independent.minimal import Answered, Delivered, Ended, Link, Node, Requested

NS = 1_000_000_000
TOLD = ("sample", "request", "response", "call_failed", "delivery")


def _link(plain: dict[str, Any]) -> Link:
    def airtime_s(size: int) -> float:
        return float(plain["preamble_s"] + 8 * size / plain["bit_rate_bps"])

    return Link(
        mtu=plain["mtu_bytes"],
        unit_s=airtime_s(plain["mtu_bytes"]) + plain["propagation_s"],
        linger_s=plain["gap_s"] + plain["preamble_s"] / 2,
        turn_s=airtime_s(5) + plain["gap_s"],
        capabilities=Capabilities(plain["addressed"], plain["checked"], plain["framed"]),
    )


def _give(node: Node, gives: dict[str, Any], asked: list[Requested], now: float) -> None:
    ((word, said),) = gives.items()
    value = said["value"] if "value" in said else bytes.fromhex(said["payload"])
    if word == "publish":
        node.publish(said["stream"], value, now)
    elif word == "call":
        node.call(said["stream"], value, now)
    elif word == "reply":
        (request,) = [one for one in asked if one.number == said["call"]]
        node.respond(request, value, now)
    else:
        pytest.fail(word)


def _told(event: object) -> dict[str, Any] | None:
    """Return what an event tells the application, as the conversations have it."""
    if isinstance(event, Delivered):
        said = {"stream": event.sample.stream, "source": event.source}
        return {"sample": {**said, "value": fields.plain(event.sample.payload)}}
    if isinstance(event, Requested):
        said = {"client": event.client, "epoch": event.epoch, "stream": event.stream}
        return {"request": {**said, "call": event.number, "value": fields.plain(event.payload)}}
    if isinstance(event, Answered):
        assert not isinstance(event.result, calls.Failure)
        return {"response": {"stream": event.stream, "value": fields.plain(event.result)}}
    if isinstance(event, Ended):
        outcome = "delivered" if event.delivered else "superseded"
        return {"delivery": {"stream": event.stream, "outcome": outcome, "missing": []}}
    return None


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("address", [1, 2])
@pytest.mark.parametrize("name", ["contact", "call", "reliable", "tables"])
def test_the_node_is_told_the_same(name: str, address: int, seed: int) -> None:
    talk = fleet.load(f"conversations/{name}.json")
    table = fleet.TABLES[talk["tables"][str(address)]]
    epoch = talk["epochs"][str(address)]
    node = Node(address, table, epoch, _link(talk["link"]), random.Random(seed), 0.0)
    node.handlers[20] = lambda _: None
    frames = {line["sends"]: line for line in talk["lines"] if "sends" in line}
    asked: list[Requested] = []
    told: list[dict[str, Any]] = []
    expected: list[dict[str, Any]] = []
    now = 0.0

    def note() -> None:
        asked.extend(event for event in node.events if isinstance(event, Requested))
        told.extend(one for one in map(_told, node.events) if one is not None)
        node.events.clear()

    for line in talk["lines"]:
        at = line["at_ns"] / NS
        while (due := node.next_due()) is not None and max(due, now) < at:
            now = max(due, now) + 0.7
            node.poll_opened(now)
        if line["node"] != address:
            continue
        now = max(now, at)
        if "gives" in line:
            _give(node, line["gives"], asked, now)
        elif "hears" in line:
            sent = frames[line["hears"]]
            node.handle_opened(Opened(sent["node"], sent["to"], bytes.fromhex(sent["hex"])), now)
        elif "receives" in line and next(iter(line["receives"])) in TOLD:
            expected.append(line["receives"])
        note()
    assert expected
    assert told == expected
