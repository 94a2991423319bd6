"""The cipher is the one of RFC 3610, and that of a fleet has its tags and nonces."""

from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from zacoustic.core.wire.seal import Way, nonce
from zacoustic.seal.ccm import FleetCipher
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


def test_packet_vectors_of_rfc_3610() -> None:
    for tag_bytes, number, packet, clear_bytes, result in _VECTORS:
        content = bytes.fromhex(packet)
        cipher = AESCCM(_KEY, tag_length=tag_bytes)
        made = cipher.encrypt(bytes.fromhex(number), content[clear_bytes:], content[:clear_bytes])
        assert made.hex() == result


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
