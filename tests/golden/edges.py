"""Makes the vectors of rules that no other file decides: `tests/golden/edges.json`.

A reader of docs/wire.md found places with several readings, and wrote which of them no vector told
apart. Here each has one. After adding one: ``python -m tests.golden.edges`` from the project's
root. `edgeblocks` makes those of annex C.
"""

import json
import math
from pathlib import Path
from typing import Any, Final

from tests.golden.edgeblocks import scenes
from tests.golden.edgemodels import refused_blocks
from tests.golden.fields import in_json
from tests.golden.payloads import type_of
from tests.golden.tables import lines
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.stream.packedbytes import PackedBytesCodec
from zacoustic.core.values.dense.text.text import shipped_model
from zacoustic.core.values.payload import CborCodec, PackedCodec, PayloadError, TypedCodec

VECTORS: Final = Path(__file__).parent / "edges.json"
_CODECS: Final[dict[str, type[TypedCodec]]] = {"cbor": CborCodec, "packed": PackedCodec}
_BOTH: Final = ("cbor", "packed")

Field = dict[str, Any]


def _float(low: float, high: float, step: float | None = None, **more: Any) -> Field:
    return {"type": "float64", "range": [low, high], "step": step, **more}


_TENS: Final[Field] = {"type": "int16", "range": [0, 100], "step": 10}
_TENTH: Final[Field] = {"type": "float32", "range": [0, 0.1]}
_SIXTEEN: Final[Field] = {"min_length": 16, "max_length": 16}
_NAN_OR_MORE: Final[Field] = {"nan": True, "outside": "escape"}
_MAYBE: Final[tuple[tuple[str, Field], ...]] = (
    ("range and step", _float(-5, 5, 0.5)),
    ("a range of singles", {"type": "float32", "range": [-5, 5]}),
    ("a circle", {"type": "float32", "range": [0, 360], "step": 0.5, "wraps": True}),
    ("a circle of doubles", _float(0, 360, wraps=True)),
    ("a step alone", {"type": "float64", "step": 0.25}),
    ("nothing else", {"type": "float32"}),
    ("what escapes", _float(-5, 5, 0.5, outside="escape")),
)
_PAYLOADS: Final[tuple[tuple[str, Field, Any], ...]] = (
    # The multiple of a value: two roundings, in this order.
    ("value times denominator is rounded", _float(0, 1, 0.01), 0.575),
    ("then the quotient is rounded", _float(0, 10, 0.3), 9.45),
    ("half of the way, in decimals only", _float(0, 0.9, 0.1), 0.35),
    ("a tie of doubles that is none of decimals", _float(0, 100, 0.3), 37.95),
    ("a range end with its multiple rounded down", _float(0, 1.275, 0.01), 1.275),
    ("a range end with its multiple rounded up", _float(0, 153.45, 0.3), 153.45),
    ("a range end, escaping", _float(0, 1.275, 0.01, outside="escape"), 1.5),
    ("a range end in a circle", _float(0, 153.45, 0.3, wraps=True), 153.4),
    ("a multiple below the least value", _float(0.07, 1, 0.1), 0.08),
    # Steps.
    ("a step that is no short decimal", _float(0, 1, 1 / 60000), 8.4e-05),
    ("a step that is no fraction", _float(0, 3.2, math.pi / 1800), 0.117),
    ("a step above 2^53", _float(0, 1e25, 1e23), 3.1e23),
    # Circles.
    ("an integer outside of a circle", {"type": "int16", "range": [-180, 180], "wraps": True}, 190),
    ("a float below a circle", _float(0, 1, wraps=True), -0.25),
    ("a tiny negative number is the lower end", _float(0, 360, 0.5, wraps=True), -1e-20),
    ("a circle of several rounds", _float(-180, 180, 0.5, wraps=True), 1000.25),
    ("a circle whose last multiple is below its end", _float(0, 360, 7.0, wraps=True), 359.9),
    ("a circle whose last multiple is beyond its end", _float(0, 360, 100.0, wraps=True), 355.0),
    (
        "a single that is rounded up to the end of a circle",
        {"type": "float32", "range": [0, 360], "wraps": True},
        359.99999999,
    ),
    # Integers.
    ("a tie of an integer is the greater multiple", _TENS, 25),
    ("and so below 0", {"type": "int16", "step": 10}, -25),
    ("an integer that escapes, and is no multiple", {**_TENS, "outside": "escape"}, 123),
    ("an integer that escapes, with a multiple in range", {**_TENS, "outside": "escape"}, 104),
    (
        "an integer that escapes to the end of its type",
        {"type": "uint8", "range": [122, 213], "step": 71, "outside": "escape"},
        253,
    ),
    ("an integer at the end of its type", {"type": "int16", "step": 64}, 32767),
    # Singles.
    ("an end of the range that is no single", {"type": "float32", "range": [0, 0.1]}, 0.1),
    (
        "a single that is rounded into its range",
        {"type": "float32", "range": [0, 0.5], "step": 0.125, "outside": "escape"},
        0.500000001,
    ),
    (
        "the single of a range end beyond it",
        {"type": "float32", "range": [-math.pi, math.pi], "step": 0.001},
        3.1415927410125732,
    ),
    (
        "the single of a range end beyond it, in a double",
        _float(-0.05, 0.05),
        -0.05000000074505806,
    ),
    (
        "the single of a range end beyond it does not escape",
        {"type": "float32", "range": [0, 0.05], "step": 0.01, "outside": "escape"},
        0.05000000074505806,
    ),
    (
        "the single of the end of a circle",
        {"type": "float32", "range": [-math.pi, math.pi], "step": 0.001, "wraps": True},
        3.1415927410125732,
    ),
    (
        "a single that is rounded to that of a range end",
        {**_TENTH, "range": [0, 0.05]},
        0.0500000006,
    ),
    # No value.
    *(
        (f"{value} with {meaning}", {**field, "nan": True}, value)
        for value in (1.5, math.nan, math.inf, -math.inf)
        for meaning, field in _MAYBE
    ),
    ("an escaped number that might be none", {**_float(0, 1, 0.5), **_NAN_OR_MORE}, 7.25),
    # Fewest bytes.
    ("as many bytes as it must have", {"type": "bytes", **_SIXTEEN}, bytes(range(16))),
    ("a text of at least two bytes", {"type": "string", "min_length": 2, "max_length": 5}, "abc"),
    ("a text without a most", {"type": "string", "min_length": 2}, "a" * 130),
    # What a sender does.
    ("the default of a value that is not given", {"type": "uint8", "default": 7}, None),
    ("text of 128 bytes without a bound", {"type": "string"}, "a" * 128),
)
_REFUSED: Final[tuple[tuple[str, str, str, Field], ...]] = (
    ("packed", "8000", "a length with a group too many", {"type": "bytes"}),
    ("packed", "c00000", "a length of a text with a group too many", {"type": "string"}),
    ("packed", "b80320", "an integer of the range in full width", {**_TENS, "outside": "escape"}),
    ("packed", "3dcccccf", "beyond the single of a range end", _TENTH),
    ("cbor", "fa3dcccccf", "beyond the single of a range end", _TENTH),
    (
        "cbor",
        "05",
        "a multiple beyond that of the end of the type",
        {"type": "uint8", "range": [122, 213], "step": 71, "outside": "escape"},
    ),
    ("cbor", "1880", "a multiple that the range end does not have", _float(0, 1.275, 0.01)),
    (
        "cbor",
        "fa3d4ccccd",
        "the single of a range end, escaped",
        {"type": "float32", "range": [0, 0.05], "step": 0.01, "outside": "escape"},
    ),
    (
        "packed",
        "c7a99999a0",
        "the single of a range end, escaped",
        {"type": "float32", "range": [0, 0.05], "step": 0.01, "outside": "escape"},
    ),
    ("cbor", "f97e00", "no value in a range", _float(0, 1, 0.5)),
    ("cbor", "f93c00", "a number beside no value that is no multiple", _float(0, 1, 0.5, nan=True)),
    ("packed", "bfe0000000", "no value in a longer form", {"type": "float32", "nan": True}),
    ("packed", "effe00000000000000", "no value, escaped", {**_float(0, 1, 0.5), **_NAN_OR_MORE}),
    ("cbor", "4f000102030405060708090a0b0c0d0e", "too few bytes", {"type": "bytes", **_SIXTEEN}),
    ("cbor", "60", "an empty text that must not be", {"type": "string", "min_length": 1}),
)
_OCTETS: Final = (
    b"leak " * 204 + b"1234",
    b"leak " * 204 + b"12345",
    b"aaaaaa",
    b"aaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaaa",
    b"depth 12, depth 34, depth 56, depth 789, depth 12",
    b'{"depth":123,"depth":123,"depth":123}',
    bytes.fromhex("fb4415af1d78b58c40 fb3f1a36e2eb1c432d fb3ee4f8b588e368f1 fbfff0000000000000"),
)
"""Bytes without a type; the second is too long for a block."""
_FLOATS: Final = b"".join(
    bytes.fromhex(each)
    for each in (
        "fa7f7fffff fb7fefffffffffffff fb0000000000000001 fa00000001 fb8000000000000000",
        "fa3dcccccd fa80000000 fa4b800000 fa501502f9 fbbff0000000000000 fb4341c37937e08000",
        "fa7f800000 fb7ff8000000000000 fb3f1a36e2eb1c432d fb3ee4f8b588e368f1 fa00",
    )
)
"""Floats that are spelled, and some that are not: in a block, although that is longer."""


def _type(field: Field) -> list[Field]:
    stated = {key: value for key, value in field.items() if value is not None}
    return [{"name": "T", "fields": [{"name": "f", **stated}]}]


def _payload(codec: str, meaning: str, field: Field, value: Any) -> dict[str, Any]:
    types = _type(field)
    spec = type_of({"types": types})
    made = _CODECS[codec](spec)
    given = {} if value is None else {"f": value}
    payload = made.encode(given)
    decoded = in_json(made.decode(payload))
    return {
        "meaning": f"{codec}: {meaning}",
        "codec": codec,
        "types": types,
        "value": in_json(given),
        "decoded": decoded,
        "hex": payload.hex(),
    }


def _refused(codec: str, octets: str, meaning: str, field: Field) -> dict[str, Any]:
    types = _type(field)
    try:
        value = _CODECS[codec](type_of({"types": types})).decode(bytes.fromhex(octets))
    except PayloadError:
        return {"meaning": f"{codec}: {meaning}", "codec": codec, "types": types, "hex": octets}
    raise SystemExit(f"{codec} {octets}, {meaning}: is read as {value}")


def _block(octets: bytes) -> bytes:
    writer = Writer()
    shipped_model().code(writer, octets, (), None)
    block = writer.finish(1, 0)
    assert PackedBytesCodec().decode(block) == octets
    return block


def as_json() -> dict[str, Any]:
    """Return the content of the file."""
    octets = PackedBytesCodec()
    return {
        "about": "Rules that no other file of vectors decides, made by tests/golden/edges.py; a "
        "changed one is a changed wire. `payloads`, `refused payloads`: as in the files of that "
        "name. `bytes without a type, packed`: the bytes, and the payload. `scenes`: the dense "
        "blocks of one source in the order in which a receiver gets them; `streams`: the type of "
        "each dense stream; `samples`: what it reads in a block; `mark`: what it acknowledges "
        "then. `rounded`: values of that scene are given to six decimals. `refused blocks`: of "
        "the scene of that name, without a block held.",
        "payloads": [
            _payload(codec, meaning, field, value)
            for meaning, field, value in _PAYLOADS
            for codec in _BOTH
        ],
        "refused payloads": [_refused(*each) for each in _REFUSED],
        "bytes without a type, packed": [
            {"bytes": each.hex(), "payload": octets.encode(each).hex()} for each in _OCTETS
        ]
        + [{"bytes": _FLOATS.hex(), "payload": _block(_FLOATS).hex()}],
        "scenes": scenes(),
        "refused blocks": refused_blocks(),
    }


def text() -> str:
    """Return the file."""
    return lines(as_json()) + "\n"


if __name__ == "__main__":
    VECTORS.write_text(text(), encoding="utf-8")
    print(len(json.loads(VECTORS.read_text(encoding="utf-8"))["scenes"]), "scenes")
