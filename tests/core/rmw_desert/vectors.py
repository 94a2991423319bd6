"""Packets that left the socket of rmw_desert 4.0.2, as types and values of ours."""

import json
import math
import struct
from pathlib import Path
from typing import Any, Final, NamedTuple

from zacoustic.core.values.rmw_desert.codec import RmwDesertCodec
from zacoustic.core.values.rmw_desert.messages import Kind, encode_head
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable

_SCALARS: Final = {
    "u8": "uint8", "u16": "uint16", "u32": "uint32", "u64": "uint64",
    "i8": "int8", "i16": "int16", "i32": "int32", "i64": "int64",
    "f32": "float32", "f64": "float64", "bool": "bool",
    "str": "string", "wstr": "string", "char": "string", "strhex": "string",
}  # fmt: skip
_TEXT: Final = TypeSpec(name="Text", fields=(FieldSpec(name="text", type="string"),))


class Vector(NamedTuple):
    """One packet."""

    name: str
    kind: Kind
    stream_id: int
    sequence: int | None
    packet: bytes
    type_spec: TypeSpec
    value: dict[str, Any]
    heard: list[Any] | None
    """What its own receiver made of it; None: that was not tried."""

    @property
    def payload(self) -> bytes:
        """What is in the packet."""
        return self.packet[3:-1]

    def encode(self) -> bytes:
        """Make the packet, limits or not."""
        fields = RmwDesertCodec(self.type_spec).write(self.value)
        payload = bytes((self.kind,)) + encode_head(self.stream_id, self.sequence) + fields
        return b"\x99\x99" + bytes((len(payload) % 256,)) + payload + b"\x55"


def read_vectors() -> list[Vector]:
    """Read all that this project can say; the one that is not UTF-8 it can not."""
    written = json.loads(Path(__file__).with_name("vectors.json").read_text(encoding="utf-8"))
    return [_vector(each) for each in written if each["name"] != "string_invalid_utf8"]


def _vector(written: dict[str, Any]) -> Vector:
    fields, value = [], {}
    nested: tuple[TypeSpec, ...] = ()
    for index, (kind, content) in enumerate(written["fields"]):
        name, (shape, _, scalar) = f"f{index}", kind.rpartition("_")
        field_type = _SCALARS[scalar]
        length = max_length = None
        if shape == "vec":
            max_length = 1000
            if field_type == "string":
                field_type, nested = _TEXT.name, (_TEXT,)
                content = [{"text": each} for each in content]
        elif shape == "arr":
            length = len(content)
        fields.append(FieldSpec(name=name, type=field_type, length=length, max_length=max_length))
        value[name] = [_number(each) for each in content] if shape else _number(content)
    spec = TypeSpec(name="T", fields=tuple(fields))
    heard = written["real_decoded"]
    return Vector(
        name=written["name"],
        kind=Kind(written["stream_type"]),
        stream_id=written["stream_id"],
        sequence=written["sequence_id"],
        packet=bytes.fromhex(written["frame_hex"]),
        type_spec=TypeTable([spec, *nested]).by_name("T"),
        value=value,
        heard=heard.get("values") if isinstance(heard, dict) else None,
    )


def _number(content: Any) -> Any:
    """Numbers that JSON lacks are texts there."""
    if not isinstance(content, str):
        return content
    if content.startswith("bits"):
        return struct.unpack(">f", bytes.fromhex(content[4:]))[0]
    special = {"nan": math.nan, "inf": math.inf, "-inf": -math.inf, "-0.0": -0.0}
    return special.get(content, content)
