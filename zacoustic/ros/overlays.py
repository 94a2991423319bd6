"""Overlays: what a ROS definition lacks: bounds, steps, constants.

A `float64` of a message may be anything; a rudder goes to 35 degrees, and nobody cares for less
than a tenth of one. An overlay says so for the members of one type, by their path from there
(``linear.*``: a star stands for one member). It holds wherever the type is used; what the overlay
of an outer type says of the same member comes first, and of two rules for one member the later.
"""

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

import msgspec

from zacoustic.core.values.types import FieldSpec

Constant = bool | int | float | str


class OverlayField(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A rule for the members that a path names; the rest stays as the definition has it."""

    field: str
    """Path of the members, by dots; ``*`` stands for any one name."""
    range: tuple[int | float, int | float] | None = None
    """As in `FieldSpec`."""
    step: int | float | None = None
    """As in `FieldSpec`."""
    unit: str | None = None
    """As in `FieldSpec`."""
    wraps: bool | None = None
    """As in `FieldSpec`."""
    outside: str | None = None
    """As in `FieldSpec`."""
    values: tuple[str, ...] = ()
    """The texts that a string can be: it becomes an enum."""
    max_length: int | None = None
    """Largest number of elements of a sequence, or of bytes of a string."""
    constant: Constant | None = None
    """The only value: it does not cross, others are refused."""
    omit: bool = False
    """The member does not cross, and is zero or empty on the other side."""


class Overlay(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rules for one ROS type."""

    type: str
    """Its name."""
    fields: tuple[OverlayField, ...]
    """The rules, the later one first."""


class Rule:
    """One rule on its way down a type.

    Args:
        said: The rule.
        rest: What is left of its path, as chunks.
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
    """Return the constant that the last rule which says what a member can be makes of it."""
    for rule in reversed(rules):
        if rule.said.constant is not None or rule.said.values:
            return rule.said.constant
    return None


def applied(field: FieldSpec, rules: Iterable[Rule]) -> FieldSpec:
    """Return a field with its rules applied.

    Raises:
        ConfigError: The field cannot be so; the message starts with the key.
    """
    changes: dict[str, object] = {}
    for rule in rules:
        for key in ("range", "step", "unit", "wraps", "outside", "max_length"):
            value = getattr(rule.said, key)
            if value is not None:
                changes[key] = value
        if rule.said.values:
            changes["values"] = rule.said.values
    if not changes:
        return field
    if "values" in changes and field.type == "string":
        changes["type"] = "enum"
    kept = {key: getattr(field, key) for key in FieldSpec.__struct_fields__}
    return FieldSpec(**(kept | changes))  # constructed: `structs.replace` would not check
