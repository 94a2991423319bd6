"""What two real ROS 2 programs and their tools put on Zenoh, read and written again.

`recorded.jsonl.xz` holds records of rclpy 9.1.2 on rmw_zenoh_cpp 0.6.7 (Kilted): the names and
hashes of all types, the tokens, and each payload with the value that the real one gave or read.
Floats are texts; what are bytes here are hex digits there.
"""

import json
import lzma
from pathlib import Path
from typing import Any, Final

import pytest

from zacoustic.core.values.payload import CborCodec, PackedCodec
from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.errors import ConfigError
from zacoustic.ros.attachment import read_attachment
from zacoustic.ros.interfaces import Interfaces
from zacoustic.ros.mapping import TypeMapper
from zacoustic.ros.messages import RosMessage
from zacoustic.ros.names import dds_type, interface_of, read_key
from zacoustic.ros.tokens import Entity, gid_of, read_token

Record = dict[str, Any]

WIDE: Final = "test_msgs/msg/WStrings"
"""The only type that cannot cross: it has wide strings."""

_WORDS: Final = {
    2: "int8", 3: "uint8", 4: "int16", 5: "uint16", 6: "int32", 7: "uint32", 8: "int64",
    9: "uint64", 10: "float32", 11: "float64", 15: "bool", 16: "byte", 17: "string",
    18: "wstring", 21: "string", 22: "wstring",
}  # fmt: skip
_EMPTY: Final = "structure_needs_at_least_one_member"


def records(kind: str) -> list[Record]:
    path = Path(__file__).with_name("recorded.jsonl.xz")
    lines = lzma.decompress(path.read_bytes()).decode().splitlines()
    return [record for line in lines if (record := json.loads(line))["kind"] == kind]


MESSAGES: Final = records("message")


@pytest.fixture(scope="module")
def interfaces(tmp_path_factory: pytest.TempPathFactory) -> Interfaces:
    """Kilted, with the package of the recording's own messages."""
    folder = tmp_path_factory.mktemp("packages")
    members = {record["name"]: definition(record["fields"]) for record in records("description")}
    action = "test_msgs/action/Fibonacci"
    parts = [members.pop(f"{action}_{part}") for part in ("Goal", "Result", "Feedback")]
    for name, text in (members | {action: "\n---\n".join(parts)}).items():
        if "/action/" in name and name != action:
            continue
        path = folder / f"{name}.{name.split('/')[1]}"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return Interfaces("kilted", folder)


def definition(fields: list[list[Any]]) -> str:
    """Write the members of a type, given by the numbers of type descriptions, as a definition."""
    lines = []
    for name, number, capacity, characters, nested in fields:
        base, container = (number - 1) % 48 + 1, (number - 1) // 48
        word = nested or _WORDS[base]
        if characters:
            word += f"<={characters}"
        lines.append(f"{word}{('', f'[{capacity}]', f'[<={capacity}]', '[]')[container]} {name}")
    return "\n".join(line for line in lines if not line.endswith(_EMPTY))


def test_all_types_have_the_hashes_of_the_real_one(interfaces: Interfaces) -> None:
    types = records("type")
    assert len(types) > 150
    for record in types:
        if record["name"] == WIDE:
            with pytest.raises(ConfigError, match="wstring"):
                interfaces.hash_of(WIDE)
        else:
            assert interfaces.hash_of(record["name"]) == record["hash"], record["name"]


def test_all_tokens_are_read_and_written(interfaces: Interfaces) -> None:
    tokens = [record["key"] for record in records("token") if "/@adv/" not in record["key"]]
    assert len(tokens) > 100
    for key in tokens:
        token = read_token(key)
        assert token is not None, key
        assert str(token) == key
        name = interface_of(token.type)
        if token.kind is not Entity.NODE and name != WIDE:
            assert (dds_type(name), interfaces.hash_of(name)) == (token.type, token.hash)


def test_all_attachments_name_an_endpoint() -> None:
    gids = {gid_of(record["key"]) for record in records("token")}
    for record in MESSAGES:
        content = bytes.fromhex(record["attachment"])
        attachment = read_attachment(content)
        assert attachment is not None
        assert attachment.encode() == content
        assert attachment.gid in gids


def test_all_payloads_cross_and_are_written_as_the_real_one_wrote_them(
    interfaces: Interfaces,
) -> None:
    mapper = TypeMapper(interfaces)
    crossed = 0
    for number, record in enumerate(MESSAGES):
        name = record["type"]
        key = read_key(record["key"])
        assert key is not None
        assert str(key) == record["key"]
        if name == WIDE:
            continue
        ros = RosMessage(interfaces, mapper, name)
        given = ros.read(bytes.fromhex(record["payload"]))[0]
        value = ros.spec.validate(given)
        # As texts, in which NaN is NaN, and zeros have their signs.
        assert repr(value) == repr(as_ours(ros.spec, record["value"])), (number, name)
        for codec in (CborCodec(ros.spec), PackedCodec(ros.spec)):
            payload = codec.encode(value)
            assert codec.measure(payload, 0) == len(payload)
            written = ros.write(codec.decode(payload))
            assert masked(written, record) == masked(bytes.fromhex(record["payload"]), record)
        crossed += 1
    assert crossed == len(MESSAGES) - sum(record["type"] == WIDE for record in MESSAGES)
    assert crossed >= 280


def as_ours(spec: TypeSpec, recorded: Record) -> Record:
    """Return a recorded value in our form."""
    return {field.name: ours(spec, field, recorded[field.name]) for field in spec.fields}


def ours(spec: TypeSpec, field: FieldSpec, recorded: Any) -> Any:
    if field.type == "bytes":
        return bytes.fromhex(recorded)
    if isinstance(recorded, list):
        if not field.is_array:  # of messages without members
            return len(recorded)
        return [one(spec, field, each) for each in recorded]
    return one(spec, field, recorded)


def one(spec: TypeSpec, field: FieldSpec, recorded: Any) -> Any:
    if field.is_nested:
        nested = spec.nested_type(field.type)
        return {"text": recorded} if isinstance(recorded, str) else as_ours(nested, recorded)
    if field.type.startswith("float"):
        return float(recorded)
    if field.is_integer and isinstance(recorded, str):
        return int(recorded, 16)  # a single byte
    return recorded


def masked(payload: bytes, record: Record) -> bytes:
    """Return a payload with zeros for its padding, in which the real one leaves anything."""
    found = bytearray(payload)
    for offset, length in record["pad"]:
        found[offset : offset + length] = bytes(length)
    return bytes(found)
