"""Sections 16 and 17: every vector of routes, floods and bonds. Written from docs/wire.md alone."""

from collections.abc import Callable
from typing import Any

import pytest

from tests.independent import fleet, frame, relay, sealed
from tests.independent.errors import ReadError
from tests.independent.record import Way

VECTORS = fleet.load("wire_relayed.json")
READ = [one for one in VECTORS if "fields" in one]
REFUSED = [one for one in VECTORS if "fields" not in one]
SEALED = [one for one in VECTORS if "sealed" in one]


def _of_bond(data: bytes) -> relay.Bonded | relay.Answer:
    """Read a frame of a bond, or the only item of a frame inside, which answers one."""
    if data[0] == relay.RELAY:
        return relay.read_bonded(data)
    (item,) = frame.read(data, Way(fleet.BASE, 1, 2)).items
    assert isinstance(item, frame.Extension)
    assert item.code == relay.ANSWER
    return relay.read_answer(item.body)


READINGS: dict[str, Callable[[bytes], Any]] = {
    "route": relay.read,
    "flood": relay.read,
    "bond": _of_bond,
}


def _fields(item: Any) -> dict[str, Any]:
    match item:
        case relay.Relayed():
            way = {"route": item.route, "back": item.back, "number": item.number}
            more = {"more": item.more, "urgent": item.urgent, "age_code": item.age}
            return {"relayed": "frame", **way, **more, "frame": item.frame.hex()}
        case relay.HopAcknowledgement(marks, more):
            frames = [{"route": one.route, "back": one.back, "number": one.number} for one in marks]
            return {"relayed": "hop acknowledgement", "frames": frames, "more": more}
        case relay.Probe(run, number):
            return {"relayed": "probe", "run": run, "number": number}
        case relay.Flooded():
            front = {"relayed": "flooded", "left": item.left, "origin": item.origin}
            more = {"number": item.number, "age_code": item.age}
            inside = item.frame.hex()
            return {**front, "destination": item.destination, **more, "frame": inside}
        case relay.Bonded(bond, number, inside, answered, age):
            front = {"relayed": "bonded" if inside else "question", "bond": bond}
            front |= {} if age is None else {"age_code": age}
            return {**front, "number": number, "answered": answered, "frame": inside.hex()}
        case relay.Answer(arrived):
            answers = [{"link": link, "number": number} for link, number in arrived]
            return {"relayed": "answer", "answers": answers}
    raise TypeError(item)


@pytest.mark.parametrize("one", READ, ids=lambda one: one["name"])
def test_relayed(one: dict[str, Any]) -> None:
    data = bytes.fromhex(one["hex"])
    item = READINGS[one["link"]](data)
    assert _fields(item) == one["fields"]
    assert item.write() == data


@pytest.mark.parametrize("one", REFUSED, ids=lambda one: one["name"])
def test_refused(one: dict[str, Any]) -> None:
    with pytest.raises(ReadError):
        READINGS[one["link"]](bytes.fromhex(one["hex"]))


@pytest.mark.parametrize("one", SEALED, ids=lambda one: one["name"])
def test_what_is_inside_is_sealed_with_the_port_of_its_link(one: dict[str, Any]) -> None:
    seal, inside = one["sealed"], bytes.fromhex(one["fields"]["frame"])
    way = sealed.Way(seal["source"], seal["destination"], seal["port"])
    key = sealed.FleetKey.of_plain(seal["key"])
    said = {"life": seal["life"], "counter": seal["counter"]}
    digest = bytes.fromhex(seal["digest"])
    records = sealed.open_frame(inside, way, key, digest=digest, encrypted=True, **said)
    assert records.hex() == seal["records"]
    fields = one["fields"]
    number = 96 + fields.get("route", fields.get("bond", 0))
    assert seal["port"] == number
    other = sealed.Way(seal["source"], seal["destination"], 0)
    with pytest.raises(ReadError):
        sealed.open_frame(inside, other, key, digest=digest, encrypted=True, **said)
