"""Completes the vectors of payloads: `payload_cbor.json` and `payload_packed.json`.

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
from zacoustic.core.values.payload import CborCodec, PackedCodec, TypedCodec
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable

FOLDER: Final = Path(__file__).parent
CODECS: Final[dict[str, type[TypedCodec]]] = {
    "payload_cbor.json": CborCodec,
    "payload_packed.json": PackedCodec,
}


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
        "name": re.sub(r"\W+", "_", vector["meaning"].lower()).strip("_"),
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
