"""Values that are more than their type says, cut down to it before they are checked.

A firmware update adds a member, a list grows, a state gets a new name: with `outside: "clamp"` none
of this costs the sample. Unknown members are left out, long lists and texts are cut, and an unknown
name becomes the default of its enum, or is missing. What is wrong in another way stays as it is:
the check behind refuses it.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import msgspec

from zacoustic.core.values.types.fields import FieldSpec
from zacoustic.core.values.types.scalars import enum_of

if TYPE_CHECKING:
    from zacoustic.core.values.types.spec import TypeSpec

Trim = Callable[[Any], Any]
"""Takes an unchecked value and returns what is left of it; changes nothing in place."""

Note = Callable[[str], None]
"""Takes the path of each value that was cut or left out."""


def compile_trim(type_spec: "TypeSpec", note: Note, path: str = "") -> Trim | None:
    """Make the function that cuts values of a type.

    Args:
        type_spec: The type, resolved.
        note: Called with the path of the field, for an unknown member that of its name.
        path: Prefix of the paths.

    Returns:
        None: all of the type refuses.
    """
    trims = {
        field.name: trim
        for field in type_spec.fields
        if (trim := _of_field(type_spec, field, note, f"{path}{field.name}")) is not None
    }
    if not trims and not type_spec.drops_unknown:
        return None
    names = {field.name for field in type_spec.fields}

    def apply(value: Any) -> Any:  # noqa: ANN401 (unchecked)
        if isinstance(value, msgspec.Struct):
            value = {name: getattr(value, name) for name in value.__struct_fields__}
        if not isinstance(value, Mapping):
            return value
        given = dict(value)
        if type_spec.drops_unknown and not given.keys() <= names:
            for name in [name for name in given if name not in names]:
                note(f"{path}{name}")
                del given[name]
        for name, trim in trims.items():
            if given.get(name) is not None:
                given[name] = trim(given[name])
        return given

    return apply


def _of_field(type_spec: "TypeSpec", field: FieldSpec, note: Note, path: str) -> Trim | None:
    each: Trim | None = None
    if field.is_nested:
        prefix = f"{path}[]." if field.is_array else f"{path}."
        each = compile_trim(type_spec.nested_type(field.type), note, prefix)
    elif field.outside == "clamp":
        each = _of_scalar(field, note, f"{path}[]" if field.is_array else path)
    if not field.is_array:
        return each
    longest = field.capacity if field.outside == "clamp" and field.is_bounded_array else None
    return None if each is None and longest is None else _of_list(each, longest, note, path)


def _of_list(each: Trim | None, longest: int | None, note: Note, path: str) -> Trim:
    def apply(elements: Any) -> Any:  # noqa: ANN401
        if not isinstance(elements, list | tuple):
            return elements
        if longest is not None and len(elements) > longest:
            note(path)
            elements = elements[:longest]
        return elements if each is None else [each(element) for element in elements]

    return apply


def _of_scalar(field: FieldSpec, note: Note, path: str) -> Trim | None:
    if field.type == "enum":
        return _of_enum(field, note, path)
    if field.type not in ("string", "bytes") or field.max_length is None:
        return None
    longest = field.max_length

    def apply(value: Any) -> Any:  # noqa: ANN401
        if isinstance(value, str) and len(content := value.encode(errors="replace")) > longest:
            note(path)
            return content[:longest].decode(errors="ignore")  # never half a character
        if isinstance(value, bytes | bytearray | memoryview) and len(value) > longest:
            note(path)
            return bytes(value)[:longest]
        return value

    return apply


def _of_enum(field: FieldSpec, note: Note, path: str) -> Trim:
    def apply(value: Any) -> Any:  # noqa: ANN401
        name = enum_of(value)
        if not isinstance(name, str) or name in field.values:
            return value
        note(path)
        return field.default

    return apply
