"""Makes the vectors of dense frames: `tests/golden/dense_frames.json`.

All values are counts of steps out of a little generator of integers, so that no floating-point
library has a say. After adding one: ``python -m tests.golden.dense`` from the project's root.
"""

import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from tests.golden.fields import in_json
from tests.golden.tables import fields_of, lines
from zacoustic.core.values.dense import (
    DenseCodec,
    DenseSample,
    Listener,
    Model,
    Speaker,
    StreamPrior,
)
from zacoustic.core.values.dense.model.prior import Companion, First
from zacoustic.core.values.dense.stream.packedbytes import PackedBytesCodec
from zacoustic.core.values.types import FieldSpec, TypeSpec

VECTORS: Final = Path(__file__).parent / "dense_frames.json"
ROOM: Final = 4096
DIGEST: Final = bytes.fromhex("01020304")
"""Digest of the table to which the types belong."""


def _number(name: str, low: float, high: float, step: float, **more: Any) -> FieldSpec:
    return FieldSpec(name=name, type="float64", range=(low, high), step=step, **more)


NAV: Final = TypeSpec(
    name="Nav",
    fields=(
        _number("lat", -90, 90, 1e-6),
        _number("lon", -180, 180, 1e-6),
        _number("depth", 0, 1000, 0.25),
        _number("heading", 0, 360, 0.125, wraps=True),
        _number("pitch", -45, 45, 0.125),
        _number("speed", -1, 4, 0.0625),
        _number("altitude", 0, 200, 0.125, optional=True),
        FieldSpec(name="mode", type="enum", values=("idle", "survey", "abort")),
        FieldSpec(name="leak", type="bool"),
    ),
)
LOG: Final = TypeSpec(name="Log", fields=(FieldSpec(name="text", type="string"),))
BITS: Final = TypeSpec(
    name="Bits",
    fields=(
        _number("level", 0, 10, 0.5, outside="escape"),
        FieldSpec(name="exact", type="float64"),
        FieldSpec(name="raw", type="bytes", max_length=8),
        FieldSpec(name="counts", type="uint8", max_length=4),
        FieldSpec(name="big", type="uint64"),
    ),
)
TYPES: Final = {5: NAV, 6: LOG, 9: BITS}
MODEL: Final = Model(
    streams={
        "5": StreamPrior(
            sizes=(180_000_001, 360_000_001, 4001, 2880, 721, 81, 2, 1601, 3, 2),
            firsts=(
                First(center=133_000_000 << 4, scale=20_000 << 12),
                First(center=195_000_000 << 4, scale=20_000 << 12),
                First(center=160 << 4, scale=40 << 12, held=0, hold=6000,
                      companion=Companion(stream_id=5, column=7, slope=-(1 << 15),
                                          offset=280 << 4, scale=3 << 12)),
                First(center=0, scale=0),
                First(center=360 << 4, scale=24 << 12),
                First(center=40 << 4, scale=4 << 12),
                First(center=0, scale=0, held=1, hold=60000),
                First(center=240 << 4, scale=80 << 12),
                First(center=0, scale=0, held=1, hold=50000),
                First(center=0, scale=0, held=0, hold=64000),
            ),
            steadiness=(62000,) * 10,
            present=60000,
            more=(40000, 9000),
        )
    },
    single=20000,
)  # fmt: skip


class _Numbers:
    """A generator of integers."""

    def __init__(self) -> None:
        self._state = 12345

    def below(self, size: int) -> int:
        self._state = (self._state * 6364136223846793005 + 1442695040888963407) % (1 << 64)
        return (self._state >> 33) % size


def nav_samples(count: int) -> list[dict[str, Any]]:
    """A vehicle that goes straight, turns, and loses the bottom."""
    rng, heading, lat, lon, depth = _Numbers(), 300, 43_165_000, 15_180_000, 160
    samples = []
    for tick in range(count):
        turn = 120 if tick % 20 in (7, 8, 9) else 0
        heading = (heading + turn + rng.below(9) - 4) % 2880
        speed = 16 + rng.below(5)
        east, north = heading % 720 - 360, 360 - abs(heading % 1440 - 720)
        lat, lon = lat + north * speed // 60 + rng.below(5), lon + east * speed // 60
        depth = max(0, depth + rng.below(5) - 2)
        samples.append(
            {
                "lat": lat * 1e-6,
                "lon": lon * 1e-6,
                "depth": depth * 0.25,
                "heading": heading * 0.125,
                "pitch": (rng.below(33) - 16) * 0.125,
                "speed": speed * 0.0625,
                "altitude": None if tick % 11 == 10 else (560 - 2 * depth + rng.below(9)) * 0.125,
                "mode": "abort" if tick == 30 else "survey",
                "leak": tick == 31,
            }
        )
    return samples


LINES: Final = ("INF mission: leg 1 of 12 started", "INF mission: leg 2 of 12 started", "Öl €", "")
OCTETS: Final = (
    b"",
    b"\x00",
    b"\x80\x81",
    b"\xc0\xc1\xc2",
    b"INF battery: 26.3 V, 3.4 A, 82 %",
    b'{"lat":54.3,"lon":10.2,"depth":12.5}',
    bytes.fromhex("a2 63 6c6174 fb 404b266666666666 65 6465707468 fa 41480000"),
    b"Zw\xc3\xb6lf Boxk\xc3\xa4mpfer",
)
ODD: Final = (
    {"level": 4.5, "exact": 0.1, "raw": b"\x00\xff", "counts": [1, 2, 3], "big": 1 << 63},
    {"level": -3.25, "exact": -0.0, "raw": b"", "counts": [], "big": 0},
    {"level": 4.5, "exact": 1e300, "raw": b"12345678", "counts": [255] * 4, "big": 1},
)


def _frames(codec: DenseCodec, *, acknowledged: bool) -> Iterator[bytes]:
    speaker, listener = Speaker(codec), Listener(codec)
    for tick, value in enumerate(nav_samples(60)):
        samples = [DenseSample(5, value, tick)]
        if tick % 15 == 3:
            samples.append(DenseSample(6, {"text": LINES[tick // 15]}, tick // 15))
        if tick % 20 == 5:
            samples.append(DenseSample(9, ODD[tick // 20], tick // 20))
        encoded = speaker.encode(samples, ROOM, {1} if acknowledged else ())
        assert encoded is not None
        speaker.sent(encoded)
        yield encoded.frame
        listener.decode(encoded.frame)
        if tick % 3 == 2 and listener.mark is not None:
            speaker.acknowledged(1, listener.mark)


def _read(codec: DenseCodec, frames: list[bytes]) -> dict[str, Any]:
    """What a receiver reads in blocks, and by which mark it would acknowledge each."""
    listener, samples, marks = Listener(codec), [], []
    for frame in frames:
        decoded = listener.decode(frame)
        samples.append([[stream_id, in_json(value)] for stream_id, value in decoded.samples])
        marks.append(f"{listener.mark or 0:04x}")
    return {"samples": samples, "marks": marks}


def _together(codec: DenseCodec) -> bytes:
    samples = [DenseSample(5, value, tick) for tick, value in enumerate(nav_samples(20))]
    samples += [DenseSample(6, {"text": line}, tick) for tick, line in enumerate(LINES)]
    encoded = codec.encode(samples, ROOM)
    assert encoded is not None
    return encoded.frame


def _long_run(codec: DenseCodec) -> str:
    """The digest of the frames of a long mission: weights have moved far by then."""
    speaker, digest = Speaker(codec), hashlib.sha256()
    for tick, value in enumerate(nav_samples(1500)):
        encoded = speaker.encode([DenseSample(5, value, tick)], ROOM, {1})
        assert encoded is not None
        speaker.sent(encoded)
        digest.update(encoded.frame)
        if tick % 2:
            speaker.acknowledged(1, encoded.snapshot.mark)
    return digest.hexdigest()


def vectors() -> dict[str, Any]:
    """Make all of them."""
    codecs: dict[str, Callable[[], DenseCodec]] = {
        "no model": lambda: DenseCodec(TYPES, digest=DIGEST),
        "model": lambda: DenseCodec(TYPES, model=MODEL, digest=DIGEST),
    }
    found: dict[str, Any] = {
        "about": "Dense frames, made by tests/golden/dense.py; a changed one is a changed wire. "
        "`acknowledged`: 60 blocks one after the other; the receiver acknowledges every third, the "
        "sender refers to the last that it has acknowledged. `samples` and `marks`: what it reads "
        "in each, and the mark of the block that it holds then. `together`: one block of 24 "
        "samples.",
        "table_digest": DIGEST.hex(),
        "types": {str(stream_id): fields_of(each) for stream_id, each in TYPES.items()},
        "model_text": msgspec.json.encode(MODEL, order="sorted").decode(),
        "model_digest": MODEL.digest.hex(),
    }
    for name, make in codecs.items():
        acknowledged = list(_frames(make(), acknowledged=True))
        found[name] = {
            "each for itself": [frame.hex() for frame in _frames(make(), acknowledged=False)][:12],
            "acknowledged": [frame.hex() for frame in acknowledged],
            "together": _together(make()).hex(),
            "sha256 of 1500 frames": _long_run(make()),
            "marks": _read(make(), acknowledged)["marks"],
        }
    frames = list(_frames(codecs["no model"](), acknowledged=True))
    found["samples"] = _read(codecs["no model"](), frames)["samples"]
    together = [_together(codecs["no model"]())]
    found["samples together"] = _read(codecs["no model"](), together)["samples"][0]
    found["bytes without a type, packed"] = {
        octets.hex(): PackedBytesCodec().encode(octets).hex() for octets in OCTETS
    }
    return found


if __name__ == "__main__":
    VECTORS.write_text(lines(vectors()) + "\n", encoding="utf-8")
