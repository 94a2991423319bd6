"""Types and enums to test with."""

import enum
from typing import Any

from zacoustic.core.values.types import FieldSpec, TypeSpec


def spec_of(*fields: FieldSpec, name: str = "T") -> TypeSpec:
    return TypeSpec(name=name, fields=fields)


def one(**keys: Any) -> TypeSpec:
    return spec_of(FieldSpec(name="f", **keys))


class Mode(enum.Enum):
    IDLE = "idle"
    SURVEY = "survey"


class Level(enum.IntEnum):
    LOW = 10
    HIGH = 20
