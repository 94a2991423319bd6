"""Vectors of sealed frames: frames of node 1 in life 7 of a fleet whose key is not secret.

`python -m tests.golden.sealed` prints them as they stand in docs/wire.md.
"""

import json
from pathlib import Path
from typing import Final

import msgspec

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
VECTORS: Final = Path(__file__).parent / "wire_sealed.json"


class Vector(msgspec.Struct, frozen=True):
    """One frame."""

    name: str
    frame: str
    meaning: str


def make() -> list[Vector]:
    """Seal the frames."""
    seal = Seal(1, LIFE, FleetCipher(KEY), JournalPort(), {}, lambda source: b"")
    readable = FleetCipher(KEY, mode=Mode.AUTHENTICATE)
    other = Seal(1, LIFE, readable, JournalPort(), {}, lambda source: b"")
    nav = bytes.fromhex("0a1a02b4bfc0187b190a9b01")
    hello = bytes.fromhex("b0020007a1b2c3d4")

    def vector(name: str, frame: bytes, meaning: str) -> Vector:
        return Vector(name, frame.hex(), meaning)

    return [
        vector(
            "sealed_introduction",
            seal.seal(hello + nav, BROADCAST, NO_TABLE, 0),
            "first frame of the life to all: long head, counter 0, no digest; HELLO and a sample",
        ),
        vector(
            "sealed_short",
            seal.seal(nav, BROADCAST, DIGEST, 0),
            "the next one: short head, counter 1, digest a1b2c3d4; the sample alone",
        ),
        vector(
            "sealed_unicast",
            seal.seal(nav, 2, DIGEST, 0, port=1),
            "to node 2 by link 1: counters of its own, so the head is long",
        ),
        vector(
            "sealed_strong",
            seal.seal(bytes.fromhex("af020000"), 2, NO_TABLE, 0, strong=True),
            "a remote command to node 2: long head with s, tag of 8 bytes, no digest",
        ),
        vector(
            "sealed_readable",
            other.seal(nav, BROADCAST, DIGEST, 0),
            "mode authenticate: the records as they are, and a tag",
        ),
    ]


def text(vectors: list[Vector]) -> str:
    """Return them as the page has them."""
    return "\n".join(f"{each.name}\n    {each.frame}\n    {each.meaning}" for each in vectors)


if __name__ == "__main__":
    VECTORS.write_text(json.dumps(msgspec.to_builtins(make()), indent=1) + "\n", encoding="utf-8")
    print(text(make()))
