"""The vector of an object, and a reader of section 9 with nothing of `zacoustic`."""

import hashlib
import json
from typing import Any

from tests.golden.objects import OBJECTS, text

FILE: dict[str, Any] = json.loads(OBJECTS.read_text(encoding="utf-8"))


def test_file_is_written_as_the_script_writes_it() -> None:
    assert OBJECTS.read_text(encoding="utf-8") == text()


def test_the_manifest_is_that_of_the_page() -> None:
    coded, payload = bytes.fromhex(FILE["coded"]), bytes.fromhex(FILE["payload"])
    head = bytes((FILE["stream"], 0x81)) + FILE["lineage"].to_bytes(2, "big")
    head += FILE["number"].to_bytes(3, "big") + bytes(FILE["wildcards"])
    head += bytes((4, len(payload) & 0x7F | 0x80, len(payload) >> 7))
    digest = hashlib.sha256(head + payload).digest()[:8]
    assert digest.hex() == FILE["digest"]
    assert coded == head + digest + payload
    assert len(head + digest) == FILE["manifest_bytes"]


def test_repair_fragments_are_those_of_the_page() -> None:
    source = bytes.fromhex(FILE["coded"])
    count, blocks = len(source), FILE["blocks"]
    assert (count, blocks) == (FILE["source_fragments"], 2)
    sizes = [count // blocks + (block < count % blocks) for block in range(blocks)]
    for index, fragment in FILE["repair_fragments"].items():
        seed, block = divmod(int(index) - count, blocks)
        begin = sum(sizes[:block])
        named = bytes((block,)) + seed.to_bytes(2, "big")
        coefficients = hashlib.shake_128(named).digest(sizes[block])
        total = 0
        for coefficient, octet in zip(
            coefficients, source[begin : begin + sizes[block]], strict=True
        ):
            total ^= times(coefficient, octet)
        assert f"{total:02x}" == fragment


def times(one: int, other: int) -> int:
    """Multiply in GF(256) with the polynomial 11D."""
    product = 0
    while other:
        product ^= one if other & 1 else 0
        one <<= 1
        one ^= 0x11D if one & 0x100 else 0
        other >>= 1
    return product
