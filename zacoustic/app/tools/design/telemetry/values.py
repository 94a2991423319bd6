"""The content of a line as a value of its type, and the check of a decoded value.

A recording may write a flag as 0 or 1, an enum by its position, an integer as 3.0, bytes as base64
text, and the value of a type with one field without a list around it.
"""

import base64
import binascii
import math
from collections.abc import Mapping
from typing import Any, Final

from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.errors import ConfigError

# Half a step, and what the arithmetic of floats adds.
_HALF: Final = 0.5 + 1e-6
_FLOAT32: Final = 2.0**-23
_FLOAT64: Final = 2.0**-51


def value_of(type_spec: TypeSpec, content: object) -> dict[str, Any]:
    """Assign names to the parts of a value; does not check the contents of fields.

    Raises:
        ConfigError: Another number of values than fields, or unknown names.
    """
    fields = type_spec.fields
    if isinstance(content, Mapping):
        known = {field.name: field for field in fields}
        unknown = [name for name in content if name not in known]
        if unknown:
            raise ConfigError(f'v: unknown field "{unknown[0]}"; allowed: {", ".join(known)}')
        return {name: _field_value(type_spec, known[name], part) for name, part in content.items()}
    values = content if isinstance(content, list) else [content]
    if len(values) != len(fields):
        names = ", ".join(field.name for field in fields)
        allowed = f"{len(fields)} of {type_spec.name}: {names}"
        raise ConfigError(f"v: {len(values)} values; allowed: {allowed}")
    return {
        field.name: _field_value(type_spec, field, part)
        for field, part in zip(fields, values, strict=True)
    }


def is_right(type_spec: TypeSpec, sent: Mapping[str, Any], found: object) -> bool:
    """Tell whether the decoded value matches the sent one: within half a step, or equal."""
    if not isinstance(found, Mapping) or found.keys() != sent.keys():
        return False
    return all(
        _is_right(type_spec, field, sent[field.name], found[field.name])
        for field in type_spec.fields
    )


def _field_value(type_spec: TypeSpec, field: FieldSpec, content: Any) -> Any:  # noqa: ANN401
    if field.is_array and isinstance(content, list):
        return [_element(type_spec, field, each) for each in content]
    return _element(type_spec, field, content)


def _element(type_spec: TypeSpec, field: FieldSpec, content: Any) -> Any:  # noqa: ANN401
    if field.is_nested and isinstance(content, Mapping | list):
        return value_of(type_spec.nested_type(field.type), content)
    if field.type == "bool" and content in (0, 1):
        return bool(content)
    if field.type == "bytes" and isinstance(content, str):
        try:
            return base64.b64decode(content, validate=True)
        except (binascii.Error, ValueError):
            return content
    if field.is_integer and isinstance(content, float) and content.is_integer():
        return int(content)
    if field.type == "enum" and isinstance(content, int) and 0 <= content < len(field.values):
        return field.values[content]
    return content


def _is_right(type_spec: TypeSpec, field: FieldSpec, sent: Any, found: Any) -> bool:  # noqa: ANN401
    if sent is None or found is None:
        return sent is found
    if field.is_array:
        return len(sent) == len(found) and all(
            _is_right_element(type_spec, field, one, other)
            for one, other in zip(sent, found, strict=True)
        )
    return _is_right_element(type_spec, field, sent, found)


def _is_right_element(type_spec: TypeSpec, field: FieldSpec, sent: Any, found: Any) -> bool:  # noqa: ANN401
    if field.is_nested:
        return is_right(type_spec.nested_type(field.type), sent, found)
    if not field.is_numeric:
        return bool(sent == found)
    if not math.isfinite(sent):
        return repr(sent) == repr(found)
    distance = abs(sent - found)
    if field.wraps and field.range is not None:
        distance = min(distance, abs(field.range[1] - field.range[0] - distance))
    allowed = abs(sent) * (_FLOAT32 if field.type == "float32" else _FLOAT64)
    if field.is_integer and field.step is None:
        allowed = 0
    if field.step is not None:
        allowed += field.step * _HALF
    return bool(distance <= allowed)
