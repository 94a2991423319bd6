"""`TypeTable`: all types of a config by name, the nested ones resolved."""

from collections.abc import Iterable, Iterator
from difflib import get_close_matches

from zacoustic.core.values.types.fields import SCALAR_TYPES
from zacoustic.core.values.types.spec import MAX_DEPTH, TypeSpec
from zacoustic.errors import ConfigError


class TypeTable:
    """Types by name; immutable.

    Args:
        types: The types in the order in which they are written; their fields may name other types
            of the list. A type that is resolved already (made from a Python class) keeps its nested
            types.
        path: Path of the list in the config, prepended to the key in errors.

    Raises:
        ConfigError: A duplicate name, an unknown type, or a cycle; states the key path, the value
            and what is allowed.
    """

    def __init__(self, types: Iterable[TypeSpec] = (), *, path: str = "types") -> None:
        self._path = path
        self._written: dict[str, TypeSpec] = {}
        self._resolved: dict[str, TypeSpec] = {}
        for index, spec in enumerate(types):
            if spec.name in self._written:
                raise ConfigError(
                    f'{path}[{index}].name: "{spec.name}" a second time; allowed: once'
                )
            self._written[spec.name] = spec
        for name in self._written:
            self._resolve(name, ())

    def __getitem__(self, name: str) -> TypeSpec:
        """Return the resolved type; raise KeyError if there is none."""
        return self._resolved[name]

    def by_name(self, name: str) -> TypeSpec:
        """Return the resolved type with a name.

        Raises:
            ConfigError: There is none; lists the known names.
        """
        spec = self._resolved.get(name)
        if spec is None:
            raise _unknown(f'type "{name}"', name, self._written)
        return spec

    def __contains__(self, name: object) -> bool:
        return name in self._resolved

    def __iter__(self) -> Iterator[TypeSpec]:
        """Iterate over the resolved types in the order in which they are written."""
        return (self._resolved[name] for name in self._written)

    def __len__(self) -> int:
        return len(self._resolved)

    def _resolve(self, name: str, outer: tuple[str, ...]) -> TypeSpec:
        if name in self._resolved:
            return self._resolved[name]
        spec = self._written[name]
        position = list(self._written).index(name)
        nested = {inner.name: inner for inner in spec.nested}
        for index, field in enumerate(spec.fields):
            if not field.is_nested or field.type in nested:
                continue
            key = f"{self._path}[{position}].fields[{index}].type"
            if field.type not in self._written:
                raise _unknown(
                    f'{key}: "{field.type}"', field.type, [*SCALAR_TYPES, *self._written]
                )
            if field.type in (*outer, name):
                chain = " → ".join([*outer, name, field.type])
                raise ConfigError(f"{key}: a cycle, {chain}; allowed: types that end")
            if len(outer) + 1 >= MAX_DEPTH:
                raise ConfigError(f"{key}: nested too deep; allowed: {MAX_DEPTH} types")
            nested[field.type] = self._resolve(field.type, (*outer, name))
        try:
            # Constructed, since `structs.replace` of older versions does not check its result.
            resolved = TypeSpec(
                name=name,
                fields=spec.fields,
                nested=tuple(nested.values()),
                drops_unknown=spec.drops_unknown,
                is_hidden=spec.is_hidden,
            )
        except ConfigError as error:
            raise ConfigError(f"{self._path}[{position}].{error}") from None
        self._resolved[name] = resolved
        return resolved


def _unknown(what: str, name: str, known: Iterable[str]) -> ConfigError:
    names = list(known)
    close = get_close_matches(name, names, 1)
    return ConfigError(
        f"{what} is not known; allowed: {', '.join(names) or 'none, types is empty'}",
        hint=f'did you mean "{close[0]}"?' if close else "",
    )
