"""Overlays: bounds, steps and constants that a ROS definition lacks.

A `float64` of a message may have any value; a rudder moves within 35 degrees, and a tenth of a
degree is precise enough. An overlay sets such rules for the members of one type, by their path from
there (``linear.*``: a star stands for one member). It applies wherever the type is used. Rules of
an outer type for the same member come first, and of two rules for one member the later one wins.
"""

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from typing import Annotated

import msgspec
from msgspec import Meta

from zacoustic.core.values.types import FieldSpec
from zacoustic.core.values.types.fields import Length, Names, Outside, Span, Step
from zacoustic.errors import ConfigError

Constant = bool | int | float | str


class OverlayField(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A rule for the members that a path names; the rest stays as defined."""

    field: Annotated[str, Meta(title="members, parted by dots; * stands for any one")]
    """Path of the members, by dots; ``*`` stands for any one name."""
    range: Span | None = None
    """As in `FieldSpec`."""
    step: Step | None = None
    """As in `FieldSpec`."""
    unit: str | None = None
    """As in `FieldSpec`."""
    wraps: bool | None = None
    """As in `FieldSpec`."""
    outside: Outside | None = None
    """As in `FieldSpec`."""
    nan: bool | None = None
    """As in `FieldSpec`."""
    values: Names = ()
    """The values that a string can have: it becomes an enum."""
    max_length: Length | None = None
    """Largest number of elements of a sequence, or of bytes of a string."""
    constant: Annotated[Constant, Meta(description="a value")] | None = None
    """The only allowed value: it does not cross."""
    omit: bool = False
    """The member does not cross, and is zero or empty at the receiver."""


class Overlay(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rules for one ROS type."""

    type: Annotated[str, Meta(title="a text, the name of a ROS type")]
    """Name of the type."""
    fields: tuple[OverlayField, ...]
    """The rules; a later one wins."""


class Rule:
    """One rule on its way into nested types.

    Args:
        said: The rule.
        rest: The rest of its path, as chunks.
    """

    def __init__(self, said: OverlayField, rest: Sequence[str]) -> None:
        self.said = said
        self.rest = tuple(rest)

    def below(self, name: str) -> "Rule | None":
        """Return the rest of the rule at a member; None if it does not cover the member."""
        if not self.rest or not fnmatchcase(name, self.rest[0]):
            return None
        return Rule(self.said, self.rest[1:])


def rules_of(fields: Iterable[OverlayField]) -> list[Rule]:
    """Return the rules of an overlay."""
    return [Rule(said, said.field.split(".")) for said in fields]


def constant_of(rules: Sequence[Rule]) -> Constant | None:
    """Return the constant by the last rule that restricts the member, or None."""
    for rule in reversed(rules):
        if rule.said.constant is not None or rule.said.values:
            return rule.said.constant
    return None


def applied(field: FieldSpec, rules: Iterable[Rule]) -> FieldSpec:
    """Return a field with its rules applied.

    Raises:
        ConfigError: The result is no valid field; the message starts with the key.
    """
    changes: dict[str, object] = {}
    for rule in rules:
        for key in ("range", "step", "unit", "wraps", "outside", "nan", "max_length"):
            value = getattr(rule.said, key)
            if value is not None:
                changes[key] = value
        if rule.said.values:
            changes["values"] = rule.said.values
    if not changes:
        return field
    longest = changes.get("max_length")
    if isinstance(longest, int) and longest > (field.max_length or longest):
        raise ConfigError(
            f"max_length: {longest}; allowed: at most {field.max_length}, as its definition says"
        )
    if "values" in changes and field.type == "string":
        changes["type"] = "enum"
    kept = {key: getattr(field, key) for key in FieldSpec.__struct_fields__}
    return FieldSpec(**(kept | changes))  # the constructor checks, `structs.replace` does not
