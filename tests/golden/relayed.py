"""Makes the vectors of sections 16 and 17 of docs/wire.md: `tests/golden/wire_relayed.json`.

Frames of routes, floods and bonds as they are on a hop, without its envelope. After adding one:
``python -m tests.golden.relayed`` from the project's root.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec

from tests.golden.sealed import KEY, LIFE
from tests.golden.tables import lines
from zacoustic.core.base.journal import JournalPort
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.peers.sealing import Seal
from zacoustic.core.wire import bond, flood, relay
from zacoustic.core.wire.seal import NO_TABLE
from zacoustic.seal.ccm import FleetCipher

VECTORS: Final = Path(__file__).parent / "wire_relayed.json"
SAMPLE: Final = bytes.fromhex("0117")
ROUTE, BOND, FLOOD = 1, 31, 96


class Vector(msgspec.Struct, frozen=True, omit_defaults=True):
    """One frame on a hop, or one control."""

    name: str
    hex: str
    meaning: str
    link: str
    """What the link carries: `route`, `flood` or `bond`."""
    fields: dict[str, Any] = {}
    """What it says; nothing: it is refused."""
    sealed: dict[str, Any] = {}
    """What seals the frame inside: key, life, source, destination, port, counter, digest."""


def _number(number: relay.Number) -> dict[str, Any]:
    return {"route": number.route, "back": number.is_back, "number": number.seq}


def _routed(name: str, content: relay.RelayContent, meaning: str) -> Vector:
    if isinstance(content, relay.Relayed):
        fields = {
            "relayed": "frame",
            **_number(content.number),
            "more": content.more,
            "urgent": content.is_urgent,
            "age_code": content.age,
            "frame": content.content.hex(),
        }
    else:
        frames = [_number(each) for each in content.numbers]
        fields = {"relayed": "hop acknowledgement", "frames": frames, "more": content.more}
    data = content.encode()
    assert relay.decode(data) == content
    return Vector(name, data.hex(), meaning, "route", fields)


def _bonded(name: str, content: bond.Bonded, meaning: str) -> Vector:
    fields = {
        "relayed": "bonded" if content.content else "question",
        "bond": content.number,
        "number": content.seq,
        "answered": content.wants_answer,
        **({"age_code": content.age} if content.content else {}),
        "frame": content.content.hex(),
    }
    data = content.encode()
    assert bond.decode(data) == content
    return Vector(name, data.hex(), meaning, "bond", fields)


def _flooded(name: str, content: flood.Flooded, meaning: str) -> Vector:
    fields = {
        "relayed": "flooded",
        "left": content.left,
        "origin": content.origin,
        "destination": content.destination,
        "number": content.seq,
        "age_code": content.age,
        "frame": content.content.hex(),
    }
    data = content.encode()
    assert flood.decode(data) == content
    return Vector(name, data.hex(), meaning, "flood", fields)


def _sealed(port: int, destination: int) -> tuple[bytes, dict[str, Any]]:
    """Seal a frame of node 1, the first of its life for that destination and port."""
    seal = Seal(1, LIFE, FleetCipher(KEY), JournalPort(), {}, lambda source: b"")
    data = seal.seal(SAMPLE, destination, NO_TABLE, 0, port=port, strong=False)
    key = {"network": KEY.network, "generation": KEY.generation, "secret": KEY.secret.hex()}
    way = {"life": LIFE, "source": 1, "destination": destination, "port": port, "counter": 0}
    return data, {"key": key, **way, "digest": NO_TABLE.hex(), "records": SAMPLE.hex()}


def vectors() -> list[Vector]:
    """Make all of them; those of the page have its words."""
    number = relay.Number(ROUTE, False, 63)
    probe = relay.Probe(7, 2)
    assert relay.decode_probe(probe.encode()) == probe
    routed, route_seal = _sealed(96 + ROUTE, 3)
    bonded, bond_seal = _sealed(96 + BOND, 2)
    flooded, flood_seal = _sealed(FLOOD, BROADCAST)
    inside = "the frame inside is sealed, the hop is not"
    return [
        _routed(
            "relayed",
            relay.Relayed(number, SAMPLE, age=13),
            "route 1, number 63, towards the last node: a frame `01 17`, 1.3 s old",
        ),
        _routed(
            "relayed_back",
            relay.Relayed(relay.Number(2, True, 0), SAMPLE, more=True),
            "route 2, number 0, towards the first node, more follow",
        ),
        _routed(
            "relayed_urgent",
            relay.Relayed(relay.Number(ROUTE, False, 5), b"\x02", is_urgent=True),
            "route 1, number 5, towards the last node, urgent: a frame `02`",
        ),
        _routed(
            "hop_acknowledgement",
            relay.HopAcks((number, relay.Number(2, True, 7))),
            "hop acknowledgement of 63 of route 1 there, and of 7 of route 2 back",
        ),
        _routed(
            "hop_acknowledgement_more",
            relay.HopAcks((number,), more=True),
            "the same of the first, and a relayed frame follows",
        ),
        Vector(
            "probe",
            probe.encode().hex(),
            "the third probe of run 7",
            "route",
            {"relayed": "probe", "run": 7, "number": 2},
        ),
        msgspec.structs.replace(
            _routed("relayed_sealed", relay.Relayed(number, routed), f"route 1: {inside}"),
            sealed=route_seal,
        ),
        _flooded(
            "flooded",
            flood.Flooded(1, BROADCAST, 5, 2, SAMPLE, 0),
            "frame 5 of node 1 for all: `01 17`; two further nodes may pass it on",
        ),
        msgspec.structs.replace(
            _flooded("flooded_sealed", flood.Flooded(1, BROADCAST, 5, 0, flooded), inside),
            sealed=flood_seal,
        ),
        _bonded(
            "bonded",
            bond.Bonded(BOND, 7, SAMPLE, wants_answer=True, age=0),
            "bond 31, number 7, answer wanted: a frame `01 17`",
        ),
        _bonded(
            "bonded_again",
            bond.Bonded(BOND, 7, SAMPLE, age=21),
            "the same by another link, without an answer, 2.1 s later",
        ),
        _bonded("question", bond.Bonded(BOND, 8, b"", wants_answer=True), "who hears this?"),
        msgspec.structs.replace(
            _bonded("bonded_sealed", bond.Bonded(BOND, 9, bonded), f"bond 31: {inside}"),
            sealed=bond_seal,
        ),
        Vector(
            "answer",
            bond.encode_answers([(0, 7)]).hex(),
            "number 7 has come by the first link of the list",
            "bond",
            {"relayed": "answer", "answers": [{"link": 0, "number": 7}]},
        ),
        *_refused(),
    ]


def _refused() -> list[Vector]:
    """Give frames that a receiver ignores, whichever routes and bonds it has."""
    readers: dict[str, Callable[[bytes], object]] = {
        "route": lambda data: relay.decode(data) or relay.decode_probe(data),
        "flood": flood.decode,
        "bond": bond.decode,
    }
    found = []
    for name, link, octets, meaning in (
        ("relayed_cut_off", "route", "bf01", "the number is missing"),
        ("relayed_without_age", "route", "bf013f", "the age is missing"),
        ("relayed_empty", "route", "bf013f05", "no frame is inside"),
        ("probe_beyond_its_run", "route", "bf200720", "a run has 32 probes"),
        ("hop_acknowledgement_of_nothing", "route", "bf00", "no frame is acknowledged"),
        ("hop_acknowledgement_cut_off", "route", "bf00013f82", "the last number is missing"),
        ("hop_acknowledgement_of_no_route", "route", "bf00003f", "there is no route 0"),
        ("hop_acknowledgement_reserved", "route", "bf00413f", "a bit is set that has no meaning"),
        ("flooded_of_nobody", "flood", "bf8000ff05000117", "its origin is 0"),
        ("flooded_of_all", "flood", "bf80ff0205000117", "its origin is 255"),
        (
            "flooded_to_its_origin",
            "flood",
            "bf80010105000117",
            "origin and destination are the same",
        ),
        ("flooded_empty", "flood", "bf8001ff0500", "no frame is inside"),
        ("bonded_cut_off", "bond", "bf1f", "the number is missing"),
        ("bonded_of_nothing", "bond", "bf1f07", "neither a frame nor a question"),
        ("bonded_empty", "bond", "bf5f0700", "no frame is behind the age"),
        ("bonded_reserved", "bond", "bf9f07000117", "a bit is set that has no meaning"),
    ):
        if readers[link](bytes.fromhex(octets)):
            raise SystemExit(f"{name}: is read")
        found.append(Vector(name, octets, f"refused: {meaning}", link))
    return found


def text() -> str:
    """Return the file."""
    return lines([msgspec.to_builtins(each) for each in vectors()]) + "\n"


if __name__ == "__main__":
    VECTORS.write_text(text(), encoding="utf-8")
