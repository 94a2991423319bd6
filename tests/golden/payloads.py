"""Completes the vectors of payloads, and makes those of refused ones.

Types, value and meaning are written by hand. ``python -m tests.golden.payloads`` adds the rest: a
name, the bytes, what a receiver decodes, and the description of the types that a digest is computed
over. It refuses to change bytes that are there.
"""

import json
import re
from pathlib import Path
from typing import Any, Final

import msgspec

from tests.golden.fields import in_json
from zacoustic.core.values.payload import CborCodec, PackedCodec, PayloadError, TypedCodec
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable

FOLDER: Final = Path(__file__).parent
CODECS: Final[dict[str, type[TypedCodec]]] = {
    "payload_cbor.json": CborCodec,
    "payload_packed.json": PackedCodec,
}


REFUSED: Final = FOLDER / "payload_refused.json"
_ESCAPE: Final = {"type": "float32", "range": [0, 100], "step": 0.5, "outside": "escape"}
_SHORT: Final = {"type": "int16", "range": [0, 100], "step": 10, "outside": "escape"}
_REFUSED: Final[tuple[tuple[str, str, str, dict[str, Any]], ...]] = (
    ("cbor", "1817", "an integer in a longer form", {"type": "uint8"}),
    ("cbor", "190100", "an integer above its type", {"type": "uint8"}),
    ("cbor", "20", "an integer below its type", {"type": "uint8"}),
    ("cbor", "f93c00", "a float in place of an integer", {"type": "uint8"}),
    ("cbor", "01", "an integer in place of a float", {"type": "float64"}),
    ("cbor", "fa3f800000", "a float that is exact as half", {"type": "float64"}),
    ("cbor", "fb3fb999999999999a", "a double in a float32", {"type": "float32"}),
    ("cbor", "fa7fc00000", "not a number in a longer form", {"type": "float64"}),
    ("cbor", "f97e01", "not a number with content", {"type": "float64"}),
    ("cbor", "18c9", "a multiple above the range", _ESCAPE),
    ("cbor", "f93c00", "a float inside the range, escaped", _ESCAPE),
    ("cbor", "1b0004000000000001", "a multiple above 2^50", {"type": "float64", "step": 0.25}),
    ("cbor", "390ccd", "a multiple beyond its integer type", _SHORT),
    ("cbor", "61ff", "a text that is no UTF-8", {"type": "string"}),
    ("cbor", "7f6161ff", "a text of indefinite length", {"type": "string"}),
    ("cbor", "656162636465", "a text that is too long", {"type": "string", "max_length": 4}),
    ("cbor", "f7", "another simple value in place of a bool", {"type": "bool"}),
    ("cbor", "f6", "nothing, and the field is not optional", {"type": "bool"}),
    ("cbor", "02", "an enum above its values", {"type": "enum", "values": ["a", "b"]}),
    ("cbor", "020102ff", "bytes left over", {"type": "uint8", "max_length": 4}),
    ("cbor", "050102030405", "too many elements", {"type": "uint8", "max_length": 4}),
    ("cbor", "0201", "an element is missing", {"type": "uint8", "max_length": 4}),
    (
        "cbor",
        "190e10",
        "the upper end of a range that wraps",
        {"type": "float32", "range": [0, 360], "step": 0.1, "wraps": True},
    ),
    ("packed", "81", "padding that is not zero", {"type": "bool"}),
    ("packed", "8000", "a byte left over", {"type": "bool"}),
    ("packed", "c0", "an enum above its values", {"type": "enum", "values": ["a", "b", "c"]}),
    ("packed", "ff80000000", "an index above the last", _ESCAPE),
    ("packed", "cc00000000000080", "a multiple above 2^50", {"type": "float64", "step": 0.25}),
    ("packed", "c93f800000", "a number inside the range, in full width", _ESCAPE),
    ("packed", "c97fc00001", "not a number with content", _ESCAPE),
    ("packed", "0000", "an empty text that is not marked as ASCII", {"type": "string"}),
    ("packed", "00c280", "a text of one byte marked as no ASCII", {"type": "string"}),
    ("packed", "01ff00", "a text that is no UTF-8", {"type": "string"}),
    ("packed", "0c", "a payload that ends inside a number", {"type": "float64", "step": 0.25}),
    ("packed", "8100", "a length beyond the payload", {"type": "string"}),
)


def refused() -> str:
    """Return the file of payloads that a receiver must refuse.

    Raises:
        SystemExit: A codec reads one.
    """
    vectors = []
    for codec, octets, meaning, field in _REFUSED:
        vector = {
            "name": f"{codec}_{_name(meaning)}",
            "meaning": meaning,
            "codec": codec,
            "types": [{"name": "T", "fields": [{"name": "f", **field}]}],
            "hex": octets,
        }
        make = CODECS[f"payload_{codec}.json"]
        try:
            value = make(type_of(vector)).decode(bytes.fromhex(octets))
        except PayloadError:
            vectors.append(vector)
        else:
            raise SystemExit(f"{codec} {octets}, {meaning}: is read as {value}")
    listed = ",\n".join(json.dumps(each, ensure_ascii=False) for each in vectors)
    about = "Payloads that a receiver must refuse."
    return f'{{\n"about": "{about}",\n"vectors": [\n{listed}\n]\n}}\n'


def _name(meaning: str) -> str:
    return re.sub(r"\W+", "_", meaning.lower()).strip("_")


def completed(name: str) -> dict[str, Any]:
    """Return the content of a file with all that follows from what is written by hand."""
    file: dict[str, Any] = json.loads((FOLDER / name).read_text(encoding="utf-8"))
    vectors = [_completed(each, CODECS[name]) for each in file["vectors"]]
    return {**file, "vectors": vectors}


def text(name: str) -> str:
    """Return a file, a vector a line."""
    file = completed(name)
    vectors = ",\n".join(json.dumps(each, ensure_ascii=False) for each in file["vectors"])
    about = json.dumps(file["about"], ensure_ascii=False)
    return f'{{\n"about": {about},\n"vectors": [\n{vectors}\n]\n}}\n'


def type_of(vector: dict[str, Any]) -> TypeSpec:
    """Return the type of a vector's payload, which is the first of its types."""
    specs = [
        TypeSpec(name=each["name"], fields=msgspec.convert(each["fields"], tuple[FieldSpec, ...]))
        for each in vector["types"]
    ]
    return TypeTable(specs)[specs[0].name]


def _completed(vector: dict[str, Any], make: type[TypedCodec]) -> dict[str, Any]:
    spec = type_of(vector)
    codec = make(spec)
    payload = bytes.fromhex(vector["hex"]) if "hex" in vector else codec.encode(vector["value"])
    if "value" in vector and codec.encode(vector["value"]) != payload:
        raise SystemExit(f"{vector['meaning']}: its bytes have changed")
    return {
        "name": _name(vector["meaning"]),
        **{key: each for key, each in vector.items() if key not in _MADE},
        "decoded": in_json(codec.decode(payload)),
        "hex": payload.hex(),
        "description": spec.canonical().decode(),
    }


_MADE: Final = ("name", "decoded", "hex", "description")


if __name__ == "__main__":
    for each in CODECS:
        made = text(each)
        (FOLDER / each).write_text(made, encoding="utf-8")
    REFUSED.write_text(refused(), encoding="utf-8")
