"""The vectors of sealed frames are those of the page, and another implementation opens them."""

import hashlib
import hmac
from pathlib import Path

import msgspec
import pytest
from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from tests.golden.sealed import DIGEST, KEY, VECTORS, Vector, make, text

PAGE = Path(__file__).parents[2] / "docs" / "wire.md"


def test_vectors_are_as_they_were_and_stand_in_the_page() -> None:
    kept = msgspec.json.decode(VECTORS.read_bytes(), type=list[Vector])
    assert make() == kept
    assert text(kept) in PAGE.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "destination", "port", "digest", "tag_bytes", "records"),
    [
        ("sealed_introduction", 255, 0, bytes(4), 4, "b0020007a1b2c3d40a1a02b4bfc0187b190a9b01"),
        ("sealed_unicast", 2, 1, DIGEST, 4, "0a1a02b4bfc0187b190a9b01"),
        ("sealed_strong", 2, 0, bytes(4), 8, "af020000"),
    ],
)
def test_a_reader_of_the_page_opens_them(
    name: str, destination: int, port: int, digest: bytes, tag_bytes: int, records: str
) -> None:
    """Written from docs/wire.md alone, with nothing of `zacoustic`."""
    frame = bytes.fromhex(next(each.frame for each in make() if each.name == name))
    head, body = frame[:5], frame[5:]
    number = int.from_bytes(head, "big") & (1 << 37) - 1
    life, counter = number >> 21, number & (1 << 21) - 1
    network = KEY.network.encode()
    info = b"zacoustic frame\0" + bytes((len(network),)) + network
    info += b"\2" + (3).to_bytes(4, "big") + b"\1"
    key = hmac.digest(KEY.secret, info + b"\1", hashlib.sha256)[:16]
    strong = 0x80 if tag_bytes == 8 else 0
    nonce = bytes((1, destination, port | strong)) + life.to_bytes(2, "big")
    nonce += counter.to_bytes(3, "big") + bytes(5)
    associated = head + bytes((1, destination)) + digest
    opened = AESCCM(key, tag_length=tag_bytes).decrypt(nonce, body, associated)
    assert opened.hex() == records
