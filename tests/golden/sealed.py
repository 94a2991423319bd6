"""Vectors of sealed frames: frames of node 1 in life 7 of a fleet whose key is not secret.

`python -m tests.golden.sealed` prints them as they stand in docs/wire.md.
"""

from pathlib import Path
from typing import Final

import msgspec

from tests.golden.fields import Fields, Reader
from tests.golden.tables import TABLES, lines
from zacoustic.core.base.journal import JournalPort
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.peers.sealing import Seal
from zacoustic.core.wire.seal import NO_TABLE
from zacoustic.seal.ccm import FleetCipher
from zacoustic.seal.keys import FleetKey
from zacoustic.seal.spec import Mode

KEY: Final = FleetKey(network="harbour", generation=3, secret=bytes(range(32)))
DIGEST: Final = bytes.fromhex("a1b2c3d4")
LIFE: Final = 7
LAST_LIFE: Final = 0xF7FF
VECTORS: Final = Path(__file__).parent / "wire_sealed.json"


class Vector(msgspec.Struct, frozen=True):
    """One frame."""

    name: str
    frame: str
    meaning: str
    key: dict[str, str | int]
    """Network, generation and secret of the fleet."""
    mode: str
    """Whether records are encrypted."""
    source: int
    destination: int
    port: int
    """Number of the link."""
    life: int
    counter: int
    strong: bool
    """Whether the tag has eight bytes."""
    digest: str
    """Of the sender's table; zeros: none is needed."""
    records: str
    """The records inside."""
    fields: list[Fields]
    """Those records; of the command only its stream, call and age, since it is cut off."""


def make() -> list[Vector]:
    """Seal the frames."""
    seal = Seal(1, LIFE, FleetCipher(KEY), JournalPort(), {}, lambda source: b"")
    readable = FleetCipher(KEY, mode=Mode.AUTHENTICATE)
    other = Seal(1, LIFE, readable, JournalPort(), {}, lambda source: b"")
    nav = bytes.fromhex("0a1a02b4bfc0187b190a9b01")
    hello = bytes.fromhex("b0020007a1b2c3d4")

    def vector(name: str, way: _Way, records: bytes, meaning: str) -> Vector:
        makes = other if way.mode is Mode.AUTHENTICATE else seal
        if way.life != LIFE:
            makes = Seal(1, way.life, FleetCipher(KEY), JournalPort(), {}, lambda source: b"")
        for _ in range(way.after):
            makes.seal(records, way.destination, way.digest, 0, port=way.port, strong=way.strong)
        sealed = makes.seal(
            records, way.destination, way.digest, 0, port=way.port, strong=way.strong
        )
        return Vector(
            name=name,
            frame=sealed.hex(),
            meaning=meaning,
            key={
                "network": KEY.network,
                "generation": KEY.generation,
                "secret": KEY.secret.hex(),
            },
            mode=way.mode.value,
            source=1,
            destination=way.destination,
            port=way.port,
            life=way.life,
            counter=way.counter,
            strong=way.strong,
            digest=way.digest.hex(),
            records=records.hex(),
            fields=Reader(TABLES["base"]).read(records, 1, way.destination),
        )

    return [
        vector(
            "sealed_introduction",
            _Way(digest=NO_TABLE),
            hello + nav,
            "first frame of the life to all: long head, counter 0, no digest; HELLO and a sample",
        ),
        vector(
            "sealed_short",
            _Way(counter=1),
            nav,
            "the next one: short head, counter 1, digest a1b2c3d4; the sample alone",
        ),
        vector(
            "sealed_unicast",
            _Way(destination=2, port=1),
            nav,
            "to node 2 by link 1: counters of its own, so the head is long",
        ),
        vector(
            "sealed_strong",
            _Way(destination=2, digest=NO_TABLE, strong=True),
            bytes.fromhex("af020000"),
            "to node 2 the beginning of a command: long head with s, tag of 8 bytes, no digest",
        ),
        vector(
            "sealed_readable",
            _Way(mode=Mode.AUTHENTICATE),
            nav,
            "mode authenticate: the records as they are, and a tag",
        ),
        vector(
            "sealed_later",
            _Way(after=63, counter=65),
            nav,
            "63 frames later: short head, counter 65, of which it has 1",
        ),
        vector(
            "sealed_long_again",
            _Way(after=14, counter=80),
            nav,
            "14 frames later: the 16th after the last long head, counter 80, has one",
        ),
        vector(
            "sealed_last_life",
            _Way(destination=2, life=LAST_LIFE),
            nav,
            "the last life, f7ff",
        ),
    ]


class _Way(msgspec.Struct, frozen=True, kw_only=True):
    """How a frame is sealed."""

    destination: int = BROADCAST
    port: int = 0
    counter: int = 0
    digest: bytes = DIGEST
    strong: bool = False
    mode: Mode = Mode.ENCRYPT
    life: int = LIFE
    after: int = 0
    """Frames in between, which are no vectors."""


def text(vectors: list[Vector]) -> str:
    """Return them as the page has them."""
    return "\n".join(f"{each.name}\n    {each.frame}\n    {each.meaning}" for each in vectors)


if __name__ == "__main__":
    VECTORS.write_text(lines(msgspec.to_builtins(make())) + "\n", encoding="utf-8")
    print(text(make()))
