"""The golden vectors: frames are the same to the last bit, everywhere and for ever."""

import json
from typing import Any

import pytest

from tests.golden.dense import MODEL, TYPES, VECTORS, nav_samples, vectors
from zacoustic.core.values.dense import DenseCodec, Listener
from zacoustic.core.values.dense.stream.packedbytes import PackedBytesCodec


@pytest.fixture(scope="module")
def stored() -> dict[str, Any]:
    found: dict[str, Any] = json.loads(VECTORS.read_text(encoding="utf-8"))
    return found


def test_frames_are_those_of_the_vectors(stored: dict[str, Any]) -> None:
    assert json.loads(json.dumps(vectors())) == stored


@pytest.mark.parametrize("name", ["no model", "model"])
def test_stored_frames_are_read(stored: dict[str, Any], name: str) -> None:
    model = MODEL if name == "model" else None
    listener = Listener(DenseCodec(TYPES, model=model, digest=b"\x01\x02\x03\x04"))
    for frame, expected in zip(stored[name]["acknowledged"], nav_samples(60), strict=True):
        value = dict(listener.decode(bytes.fromhex(frame)).samples)[5]
        for key in ("heading", "pitch", "speed", "altitude", "mode", "leak", "depth"):
            assert value[key] == expected[key]
        assert value["lat"] == pytest.approx(expected["lat"], abs=0.5e-6)


def test_stored_bytes_are_read(stored: dict[str, Any]) -> None:
    for octets, payload in stored["bytes without a type, packed"].items():
        assert PackedBytesCodec().decode(bytes.fromhex(payload)).hex() == octets
