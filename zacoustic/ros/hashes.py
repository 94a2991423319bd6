"""RIHS01: the hash of a ROS type, which is part of the key of each topic.

It is the SHA-256 of a JSON text: the type with its members, then all types that it uses, by name.
The form is that of ROS 2 (REP 2011): blanks behind ``:`` and ``,``, and for each member the number
of its type, plus 48 for an array, 96 for a bounded sequence or 144 for an unbounded one. A ``char``
has the number of a ``uint8``, as in ROS 2.
"""

import hashlib
import json
from collections.abc import Callable
from typing import Any, Final

from zacoustic.ros.members import Member, Members

_NUMBERS: Final = {
    "int8": 2,
    "uint8": 3,
    "char": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "string": 17,
}
_NESTED: Final = 1
_BOUNDED_STRING: Final = 21
_ARRAY: Final = 48
_BOUNDED_SEQUENCE: Final = 96
_SEQUENCE: Final = 144


def rihs01(name: str, members_of: Callable[[str], Members]) -> str:
    """Return the hash of an interface.

    Args:
        name: Its name.
        members_of: Returns the members of each interface.
    """
    described: dict[str, dict[str, Any]] = {}

    def describe(each: str) -> None:
        if each in described:
            return
        members = members_of(each)
        described[each] = {"type_name": each, "fields": [_field(member) for member in members]}
        for member in members:
            if member.is_nested:
                describe(member.type)

    describe(name)
    text = json.dumps(
        {
            "type_description": described[name],
            "referenced_type_descriptions": [
                described[each] for each in sorted(described) if each != name
            ],
        }
    )
    return f"RIHS01_{hashlib.sha256(text.encode()).hexdigest()}"


def _field(member: Member) -> dict[str, Any]:
    number = _NESTED if member.is_nested else _NUMBERS[member.type]
    if member.most_characters:
        number = _BOUNDED_STRING
    if member.is_array:
        number += _ARRAY
    elif member.is_sequence:
        number += _BOUNDED_SEQUENCE if member.count else _SEQUENCE
    return {
        "name": member.name,
        "type": {
            "type_id": number,
            "capacity": member.count,
            "string_capacity": member.most_characters,
            "nested_type_name": member.type if member.is_nested else "",
        },
    }
