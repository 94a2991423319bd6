"""Sizes and checks of values that have a least length or may be no value."""

import math

from zacoustic.app.tools.design.check.bits import usual_bytes
from zacoustic.app.tools.design.telemetry.values import is_right
from zacoustic.config import config_from_mapping
from zacoustic.core.values.types import FieldSpec, TypeSpec


def test_bytes_of_a_fixed_length_are_as_usual_as_large() -> None:
    section = {
        "address": 1,
        "streams": [
            {"id": 1, "topic": "/id", "type": "unique_identifier_msgs/msg/UUID", "ros": {},
             "codec": "packed"},
        ],
    }  # fmt: skip
    (stream,) = config_from_mapping(section, source="test").table
    assert usual_bytes(stream) == 16


def test_no_value_is_right_if_it_is_the_same() -> None:
    spec = TypeSpec(
        name="T", fields=(FieldSpec(name="a", type="float32", range=(0, 1), step=0.5, nan=True),)
    )
    for sent, found, right in (
        (math.nan, math.nan, True),
        (math.inf, math.inf, True),
        (math.inf, -math.inf, False),
        (math.nan, 0.5, False),
        (0.5, math.nan, False),
        (0.5, 0.5, True),
    ):
        assert is_right(spec, {"a": sent}, {"a": found}) is right
