"""The vectors of rules that no other file decides, read from docs/wire.md alone."""

from typing import Any

import pytest

from tests.independent import blocks, cborpos, fields, fleet, packed, table
from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

EDGES = fleet.load("edges.json")
READ = {"cbor": cborpos.read, "packed": packed.read}
WRITE = {"cbor": cborpos.write, "packed": packed.write}


def _read(one: dict[str, Any]) -> Any:
    cursor = Cursor(bytes.fromhex(one["hex"]))
    value = READ[one["codec"]](table.types_of(one["types"]), "T", cursor)
    cursor.end()
    return value


@pytest.mark.parametrize("one", EDGES["payloads"], ids=lambda one: one["meaning"])
def test_payload(one: dict[str, Any]) -> None:
    assert fields.plain(_read(one)) == one["decoded"]
    defaults = {each["name"]: each.get("default") for each in one["types"][0]["fields"]}
    value = {**defaults, **one["value"]}
    (field,) = one["types"][0]["fields"]
    if isinstance(value["f"], str) and field["type"] != "string":
        value["f"] = bytes.fromhex(value["f"]) if field["type"] == "bytes" else float(value["f"])
    assert WRITE[one["codec"]](table.types_of(one["types"]), "T", value).hex() == one["hex"]


@pytest.mark.parametrize("one", EDGES["refused payloads"], ids=lambda one: one["meaning"])
def test_refused_payload(one: dict[str, Any]) -> None:
    with pytest.raises(ReadError):
        _read(one)


@pytest.mark.parametrize("one", EDGES["bytes without a type, packed"])
def test_bytes_without_a_type(one: dict[str, str]) -> None:
    plain, payload = bytes.fromhex(one["bytes"]), bytes.fromhex(one["payload"])
    assert packed.read_bytes(payload) == plain
    if len(payload) <= len(plain):
        assert packed.write_bytes(plain) == payload


def _reader(scene: dict[str, Any]) -> blocks.Reader:
    streams = {int(stream_id): name for stream_id, name in scene["streams"].items()}
    digest = bytes.fromhex(scene["table_digest"])
    return blocks.Reader(
        table.types_of(scene["types"]), streams, digest, scene.get("model_text", "{}")
    )


def _rounded(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 6)
    if isinstance(value, dict):
        return {name: _rounded(each) for name, each in value.items()}
    return [_rounded(each) for each in value] if isinstance(value, list) else value


@pytest.mark.parametrize("scene", EDGES["scenes"], ids=lambda scene: scene["meaning"])
def test_scene(scene: dict[str, Any]) -> None:
    reader = _reader(scene)
    mark: str | None = None
    for each in scene["blocks"]:
        samples, block = reader.read(bytes.fromhex(each["block"]))
        plain = [[stream_id, fields.plain(value)] for stream_id, value in samples]
        assert (_rounded(plain) if scene.get("rounded") else plain) == each["samples"]
        if reader.is_held(block):
            mark = f"{block.mark:04x}"
        assert mark == each["mark"]


@pytest.mark.parametrize("one", EDGES["refused blocks"], ids=lambda one: one["meaning"])
def test_refused_block(one: dict[str, Any]) -> None:
    with pytest.raises(ReadError):
        _reader(one).read(bytes.fromhex(one["block"]))
