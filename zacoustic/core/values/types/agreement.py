"""Whether a type in the config and a Python class are the same type."""

from typing import Final

from zacoustic.core.values.types.fields import FieldSpec
from zacoustic.core.values.types.spec import TypeSpec
from zacoustic.errors import ConfigError

_COMPARED: Final = (
    "range", "step", "wraps", "values", "length", "max_length", "optional", "outside",
    "min_length", "nan",
)  # fmt: skip
# What these are in a class that does not state them.
_UNSAID: Final = {"wraps": False, "outside": "reject", "nan": False}


def check_agreement(configured: TypeSpec, python: TypeSpec, *, path: str) -> None:
    """Check that a type in the config and the type of a Python class are the same.

    Names and their order must be equal; kinds must fit (``float`` in Python is either float type);
    a range, step, length or list of values that the class states must be the configured one. The
    config may state more; it is what counts.

    Args:
        configured: The type in the config, resolved.
        python: `type_from_struct` of its class.
        path: The path of the type, prepended to the key in errors.

    Raises:
        ConfigError: States the first field that differs, and both values.
    """
    for index, (field, stated) in enumerate(zip(configured.fields, python.fields, strict=False)):
        key = f"{path}.fields[{index}]"
        if field.name != stated.name:
            raise ConfigError(
                f'{key}.name: "{field.name}"; allowed: "{stated.name}", as the Python class says'
            )
        _check_field_agreement(configured, python, (field, stated), key)
    if len(configured.fields) != len(python.fields):
        raise ConfigError(
            f"{path}.fields: {len(configured.fields)} fields; allowed: {len(python.fields)} "
            f"({', '.join(field.name for field in python.fields)}), as the Python class says"
        )


def _check_field_agreement(
    configured: TypeSpec, python: TypeSpec, pair: tuple[FieldSpec, FieldSpec], key: str
) -> None:
    field, stated = pair
    if _family(field) != _family(stated):
        raise ConfigError(
            f'{key}.type: "{field.type}"; allowed: "{stated.type}", as the Python class says'
        )
    for part in _COMPARED:
        written, said = getattr(field, part), getattr(stated, part)
        is_stated = said is not None or part == "length" or field.is_array
        if is_stated and said not in (written, _UNSAID.get(part, written)):
            raise ConfigError(f"{key}.{part}: {written}; allowed: {said}, as the Python class says")
    if field.is_nested:
        inner, inner_python = configured.nested_type(field.type), python.nested_type(stated.type)
        check_agreement(inner, inner_python, path=f"{key}.{field.type}")


def _family(field: FieldSpec) -> str:
    if field.is_integer:
        return "integer"
    if field.is_numeric:
        return "float"
    return "nested" if field.is_nested else field.type
