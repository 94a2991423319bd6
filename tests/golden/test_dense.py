"""Digests of dense blocks, for a reader with `dense_frames.json` and BLAKE2s alone."""

import json
from hashlib import blake2s, sha256
from typing import Any

from tests.golden.dense import VECTORS

FILE: dict[str, Any] = json.loads(VECTORS.read_text(encoding="utf-8"))
INDEPENDENT = 3
"""The first of `acknowledged`, before anything is acknowledged."""


def test_the_digest_of_the_model_is_that_of_its_text() -> None:
    assert sha256(FILE["model_text"].encode()).digest()[:4].hex() == FILE["model_digest"]


def test_marks_of_independent_blocks_follow_from_the_digests() -> None:
    """As section 7.2 of docs/wire.md says it."""
    table, model = bytes.fromhex(FILE["table_digest"]), bytes.fromhex(FILE["model_digest"])
    for name, agreed in (("no model", table), ("model", table + model)):
        root = blake2s(agreed, digest_size=12).digest()
        for block, mark in zip(
            FILE[name]["acknowledged"][:INDEPENDENT], FILE[name]["marks"], strict=False
        ):
            digest = blake2s(root + bytes.fromhex(block), digest_size=12).digest()
            assert f"{int.from_bytes(digest[8:10], 'big') >> 2:04x}" == mark
