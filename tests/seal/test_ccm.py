"""The cipher is the one of RFC 3610 and NIST, and that of a fleet has its tags and nonces.

`nist_ccm.json` has vectors of the Cryptographic Algorithm Validation Program: all with the nonces
and tags of sealed frames, and of the others one for each combination of lengths.
"""

from collections import Counter
from pathlib import Path
from typing import Final

import msgspec
import pytest
from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from zacoustic.core.wire.seal import STRONG_TAG_BYTES, TAG_BYTES, Way, nonce
from zacoustic.seal.ccm import CcmCipher, FleetCipher
from zacoustic.seal.keys import new_key
from zacoustic.seal.spec import Mode

_KEY = bytes.fromhex("c0c1c2c3c4c5c6c7c8c9cacbcccdcecf")
# Packet vectors 1 and 2: length of the tag, nonce, packet, bytes of it in clear, result.
_VECTORS = (
    (
        8,
        "00000003020100a0a1a2a3a4a5",
        "".join(f"{each:02x}" for each in range(31)),
        8,
        "588c979a61c663d2f066d0c2c0f989806d5f6b61dac38417e8d12cfdf926e0",
    ),
    (
        8,
        "00000004030201a0a1a2a3a4a5",
        "".join(f"{each:02x}" for each in range(32)),
        8,
        "72c91a36e135f8cf291ca894085c87e3cc15c439c9e43a3ba091d56e10400916",
    ),
)

_NIST_FILE: Final = Path(__file__).with_name("nist_ccm.json")
_NONCE_BYTES: Final = 13
# Examples 1 to 4 of NIST SP 800-38C, appendix C: lengths of nonce, associated data, payload and
# tag, result. Each part counts its bytes up, from 10, 00 and 20; the key has 40…4f.
_EXAMPLES: Final = (
    (7, 8, 4, 4, "7162015b4dac255d"),
    (8, 16, 16, 6, "d2a1f0e051ea5f62081a7792073d593d1fc64fbfaccd"),
    (12, 20, 24, 8, "e3b201a9f5b71a7a9b1ceaeccd97e70b6176aad9a4428aa5484392fbc1b09951"),
    (
        13, 65536, 32, 14,
        "69915dad1e84c6376a68c2967e4dab615ae0fd1faec44cc484828529463ccf72"
        "b4ac6bec93e8598e7f0dadbcea5b",
    ),
)  # fmt: skip


class Vector(msgspec.Struct, frozen=True, array_like=True):
    """One line of the file, hexadecimal."""

    count: int
    tag_bytes: int
    key: str
    nonce: str
    associated: str
    payload: str | None
    """None: it must be refused."""
    sealed: str


class Vectors(msgspec.Struct, frozen=True):
    """The file."""

    origin: str
    columns: list[str]
    files: dict[str, list[Vector]]


class OneKeyCipher(CcmCipher):
    """The cipher of sealed frames, with a key that is given."""

    def __init__(self, key: bytes) -> None:
        super().__init__(0, Mode.ENCRYPT)
        self._given = key

    def _key(self, source: int, destination: int, *, former: bool) -> bytes | None:
        return self._given


def test_packet_vectors_of_rfc_3610() -> None:
    for tag_bytes, number, packet, clear_bytes, result in _VECTORS:
        content = bytes.fromhex(packet)
        cipher = AESCCM(_KEY, tag_length=tag_bytes)
        made = cipher.encrypt(bytes.fromhex(number), content[clear_bytes:], content[:clear_bytes])
        assert made.hex() == result


def test_examples_of_nist_sp_800_38c() -> None:
    def counted(first: int, size_bytes: int) -> bytes:
        return bytes((first + each) % 256 for each in range(size_bytes))

    for nonce_bytes, associated_bytes, payload_bytes, tag_bytes, result in _EXAMPLES:
        number, associated = counted(0x10, nonce_bytes), counted(0, associated_bytes)
        payload, cipher = counted(0x20, payload_bytes), AESCCM(counted(0x40, 16), tag_bytes)
        assert cipher.encrypt(number, payload, associated).hex() == result
        assert cipher.decrypt(number, bytes.fromhex(result), associated) == payload


def test_validation_vectors_of_nist() -> None:
    """Those that have the lengths of sealed frames go through the cipher of sealed frames."""
    checked: Counter[str] = Counter()
    for name, vectors in msgspec.json.decode(_NIST_FILE.read_bytes(), type=Vectors).files.items():
        for vector in vectors:
            key, number = bytes.fromhex(vector.key), bytes.fromhex(vector.nonce)
            associated, sealed = bytes.fromhex(vector.associated), bytes.fromhex(vector.sealed)
            payload = None if vector.payload is None else bytes.fromhex(vector.payload)
            if len(number) == _NONCE_BYTES and vector.tag_bytes in (TAG_BYTES, STRONG_TAG_BYTES):
                way = Way(1, 2, strong=vector.tag_bytes == STRONG_TAG_BYTES)
                frames = OneKeyCipher(key)
                assert frames.open(0, way, number, sealed, associated) == payload, (name, vector)
                if payload is not None:
                    assert frames.seal(way, number, payload, associated) == sealed, (name, vector)
                checked["accepted" if payload is not None else "refused"] += 1
                continue
            cipher = AESCCM(key, tag_length=vector.tag_bytes)
            if payload is None:
                with pytest.raises(InvalidTag):
                    cipher.decrypt(number, sealed, associated)
            else:
                assert cipher.decrypt(number, sealed, associated) == payload, (name, vector)
                assert cipher.encrypt(number, payload, associated) == sealed, (name, vector)
            checked[name] += 1
    assert checked["accepted"] >= 36
    assert checked["refused"] >= 16
    assert {"VADT128.rsp", "VNT128.rsp", "VPT128.rsp", "VTT128.rsp"} <= checked.keys()


def test_tags_have_four_bytes_and_eight_where_a_frame_is_strong() -> None:
    cipher = FleetCipher(new_key("test"))
    for way, tag_bytes in ((Way(1, 2), 4), (Way(1, 2, strong=True), 8)):
        body = cipher.seal(way, nonce(way, 1, 0), b"records", b"head")
        assert len(body) == len(b"records") + tag_bytes
        assert cipher.open(0, way, nonce(way, 1, 0), body, b"head") == b"records"
        for other in (b"", b"hea", b"Head"):
            assert cipher.open(0, way, nonce(way, 1, 0), body, other) is None
        assert cipher.open(1, way, nonce(way, 1, 0), body, b"head") is None


def test_records_stay_readable_where_they_are_only_authenticated() -> None:
    key, way, number = new_key("test"), Way(1, 2), bytes(13)
    cipher = FleetCipher(key, mode=Mode.AUTHENTICATE)
    for strong, tag_bytes in ((False, 4), (True, 8)):
        way = Way(1, 2, strong=strong)
        body = cipher.seal(way, number, b"records", b"head")
        assert body[:-tag_bytes] == b"records"
        assert cipher.open(0, way, number, body, b"head") == b"records"
        assert cipher.open(0, way, number, b"recordt" + body[-tag_bytes:], b"head") is None
        assert cipher.open(0, way, number, b"ecords" + body[-tag_bytes:], b"headr") is None
        assert FleetCipher(key).open(0, way, number, body, b"head") is None
        encrypted = FleetCipher(key).seal(way, number, b"records", b"head")
        assert cipher.open(0, way, number, encrypted, b"head") is None
