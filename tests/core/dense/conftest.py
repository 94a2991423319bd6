"""Types and values that the tests of dense frames share."""

import pytest

from zacoustic.core.values.types import FieldSpec, TypeSpec


@pytest.fixture(scope="session")
def nav_type() -> TypeSpec:
    """A vehicle's report, by hand: few fields, each of another kind."""
    return TypeSpec(
        name="Nav",
        fields=(
            FieldSpec(name="lat", type="float64", range=(43.0, 43.2), step=1e-6),
            FieldSpec(name="lon", type="float64", range=(15.0, 15.2), step=1e-6),
            FieldSpec(name="heading", type="float32", range=(0, 360), step=0.1, wraps=True),
            FieldSpec(name="speed", type="float32", range=(-1, 4), step=0.01),
            FieldSpec(name="depth", type="float32", range=(0, 1000), step=0.1, outside="clamp"),
            FieldSpec(name="altitude", type="float32", range=(0, 200), step=0.1, optional=True),
            FieldSpec(name="mode", type="enum", values=("idle", "survey", "abort")),
            FieldSpec(name="leak", type="bool"),
        ),
    )


@pytest.fixture(scope="session")
def log_type() -> TypeSpec:
    """Lines of text."""
    return TypeSpec(name="Log", fields=(FieldSpec(name="text", type="string", max_length=120),))
