"""Values outside of their bounds: cut, moved to the nearer end, or carried in full, and counted.

A pressure sensor that reads -0.2 dbar at the surface must not cost the operator the whole sample,
nor must a member that a new firmware adds. `FieldSpec.outside` says which field tolerates that, and
`outside` of a stream says it of its whole type. Anyone who looks for a sensor with wrong bounds
finds the counts here, under the paths of the fields (``legs[].speed``).
"""

from collections import Counter
from collections.abc import Callable
from typing import Any

from zacoustic.core.values.types.ends import Ends
from zacoustic.core.values.types.fields import FieldSpec
from zacoustic.core.values.types.spec import TypeSpec
from zacoustic.core.values.types.trimming import compile_trim

Bound = Callable[[Any], Any]
"""Takes a validated value and returns it within bounds; changes dicts and lists in place."""


class OutsideValues:
    """Counts the values of one stream that were outside of their bounds.

    Args:
        type_spec: The type of the values, resolved.
    """

    def __init__(self, type_spec: TypeSpec) -> None:
        self.clamped: Counter[str] = Counter()
        """Numbers that were moved to an end of their range, by path of the field."""
        self.escaped: Counter[str] = Counter()
        """Numbers that were carried in full width, by path of the field."""
        self.trimmed: Counter[str] = Counter()
        """Members that were left out, lists and texts that were cut, unknown names, by path."""
        trim = compile_trim(type_spec, self._note)
        self.trim: Callable[[Any], Any] = trim or _as_it_is
        """Cuts and counts what `TypeSpec.validate_trimmed` would refuse of an unchecked value."""
        self._validate = type_spec.validate_trimmed
        self.bound: Callable[[dict[str, Any]], dict[str, Any]] = (
            self._of_type(type_spec, "") or _as_it_is
        )
        """Clamps and counts the numbers of a value that `TypeSpec.validate` returned."""

    def normalised(self, value: object) -> dict[str, Any]:
        """Return an application's value ready for encoding: cut, checked, clamped, counted.

        Raises:
            PayloadInvalidError: It is not of the type.
        """
        return self.bound(self._validate(self.trim(value)))

    def _note(self, path: str) -> None:
        self.trimmed[path] += 1

    def _of_type(self, type_spec: TypeSpec, path: str) -> Bound | None:
        bounds = [
            (field.name, bound)
            for field in type_spec.fields
            if (bound := self._of_field(type_spec, field, f"{path}{field.name}")) is not None
        ]
        if not bounds:
            return None

        def apply(value: dict[str, Any]) -> dict[str, Any]:
            for name, bound in bounds:
                inner = value[name]
                if inner is not None:
                    value[name] = bound(inner)
            return value

        return apply

    def _of_field(self, type_spec: TypeSpec, field: FieldSpec, path: str) -> Bound | None:
        path = f"{path}[]" if field.is_array else path
        bound: Bound | None
        if field.is_nested:
            bound = self._of_type(type_spec.nested_type(field.type), f"{path}.")
        else:
            bound = self._of_number(field, path)
        if bound is None or not field.is_array:
            return bound
        each = bound
        return lambda elements: [each(element) for element in elements]

    def _of_number(self, field: FieldSpec, path: str) -> Bound | None:
        if field.range is None or field.outside == "reject":
            return None
        low, high = field.bounds
        clamps = field.outside == "clamp"
        counter = self.clamped if clamps else self.escaped
        stands_for = _nothing if field.is_integer else Ends(field).value

        def bound(number: float) -> float:
            if low <= number <= high or (field.nan and number - number != 0):
                return number
            end = stands_for(number)
            if end is not None:
                return end
            counter[path] += 1
            if not clamps:
                return number
            return low if number < low else high

        return bound


def _nothing(number: float) -> float | None:
    """Return None: an integer outside of its range stands for no end."""


def _as_it_is(value: Any) -> Any:  # noqa: ANN401 (of any type)
    """Return the value: the type refuses all that is outside of its bounds."""
    return value
