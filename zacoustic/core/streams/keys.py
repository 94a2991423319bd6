"""Names of streams with placeholders, and the keys that they produce.

A name is a key expression without Zenoh's wildcards. A chunk may hold ``{node}``, the name of the
node that a frame came from, which costs nothing because the frame has a known source; or a wildcard
of the stream with a list of values, which costs one byte. A name with its placeholders filled in is
a *key*; the tuple of value numbers that fills its wildcards is its *instance*. A latched topic may
tell apart the publishers of a node: the number of the publisher is then the last of the instance,
costs one byte as well, and is not in the key.
"""

import re
from collections.abc import Mapping
from typing import Annotated, Final

import msgspec
from msgspec import Meta

from zacoustic.errors import ConfigError, UnknownStreamError
from zacoustic.text.allowed import check_fields

NODE_PLACEHOLDER: Final = "node"
"""Name of the placeholder for the source of the frame."""
PUBLISHER_PLACEHOLDER: Final = ""
"""Name of the wildcard that is in no name: the publisher of a sample, on its node."""

MOST_VALUES: Final = 255
"""The most values of a wildcard: its number is one byte."""

_PLACEHOLDER: Final = re.compile(r"\{([^{}]*)\}")

Instance = tuple[int, ...]
"""The value number of each wildcard, in the order of the name; ``()`` for a name without any."""


class Wildcard(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A placeholder of a topic's name and the values it can take."""

    name: str
    """The name between the braces."""
    values: Annotated[
        tuple[str, ...],
        Meta(
            min_length=1,
            max_length=MOST_VALUES,
            title="a list of chunks of a key",
            extra={"unique": True},
        ),
    ]
    """Key chunks; their position, from 0, crosses the channel."""


class KeyPattern:
    """A name, its wildcards, and the values of ``{node}``.

    Args:
        name: The name.
        wildcards: Its placeholders without `{node}`, in any order.
        node_names: Name of each node by address.
        publishers: How many publishers of a node have samples of their own under each key; the
            number of one is then the last of an instance.

    Raises:
        ConfigError: The name is no key expression, or its placeholders and wildcards do not match.
    """

    def __init__(
        self,
        name: str,
        wildcards: tuple[Wildcard, ...],
        node_names: Mapping[int, str],
        publishers: int = 1,
    ) -> None:
        check_name(name, wildcards)
        self.publishers = publishers
        """How many publishers of a node are told apart."""
        self.name = name
        self.node_names = dict(node_names)
        self.is_named_by_node = f"{{{NODE_PLACEHOLDER}}}" in name
        """Whether the name holds ``{node}``."""
        by_name = {wildcard.name: wildcard for wildcard in wildcards}
        found = [part for part in _PLACEHOLDER.findall(name) if part != NODE_PLACEHOLDER]
        named = tuple(by_name[part] for part in found)
        self.has_wildcards = bool(named)
        """Whether the name has placeholders other than ``{node}``."""
        self.wildcards: tuple[Wildcard, ...] = named
        """The wildcards in the order of the name; then that of the publisher, if there is one."""
        if publishers > 1:
            numbers = tuple(map(str, range(publishers)))
            self.wildcards = (*named, Wildcard(name=PUBLISHER_PLACEHOLDER, values=numbers))
        self._named = named
        self._numbers = [
            {value: number for number, value in enumerate(wildcard.values)} for wildcard in named
        ]
        self._parts = _PLACEHOLDER.split(name)

    def key(self, source: int, instance: Instance) -> str:
        """Fill in the placeholders.

        Raises:
            UnknownStreamError: The node has no name, or a number is beyond the listed values.
        """
        if len(self._parts) == 1 and len(instance) == len(self.wildcards) == 0:
            return self.name
        try:
            values = [
                wildcard.values[number]
                for wildcard, number in zip(self.wildcards, instance, strict=True)
            ]
            node = self.node_names[source] if self.is_named_by_node else ""
        except (KeyError, IndexError, ValueError) as error:
            raise UnknownStreamError(
                f"{self.name}: no key for node {source} and values {instance}"
            ) from error
        remaining = iter(values)
        return _PLACEHOLDER.sub(
            lambda found: node if found[1] == NODE_PLACEHOLDER else next(remaining), self.name
        )

    def match(self, key: str, source: int) -> Instance | None:
        """Return the instance of a key that `source` publishes; None: not a key of this name."""
        pattern = re.escape(self._parts[0])
        for placeholder, text in zip(self._parts[1::2], self._parts[2::2], strict=True):
            if placeholder == NODE_PLACEHOLDER:
                pattern += re.escape(self.node_names.get(source, ""))
            else:
                pattern += f"(?P<{placeholder}>[^/]+)"
            pattern += re.escape(text)
        found = re.fullmatch(pattern, key)
        if found is None:
            return None
        numbers = [
            known.get(found[wildcard.name])
            for wildcard, known in zip(self._named, self._numbers, strict=True)
        ]
        if None in numbers:
            return None
        return self.of_publisher(tuple(number for number in numbers if number is not None), 0)

    def of_publisher(self, instance: Instance, number: int) -> Instance:
        """Return the instance of a key for one publisher of a node.

        Args:
            instance: The numbers of the placeholders, perhaps with that of another publisher.
            number: The publisher's.
        """
        if self.publishers == 1:
            return instance
        return (*instance[: len(self._named)], number)

    def publisher(self, instance: Instance) -> int:
        """Return the number of the publisher of a sample."""
        return instance[-1] if self.publishers > 1 else 0

    def expression(self, source: int | None) -> str:
        """Return the Zenoh key expression of the keys of `source`; None: of any node.

        It may cover more keys: Zenoh's wildcards have no lists of values, so match what arrives.
        """
        node = self.node_names.get(source, "*") if source is not None else "*"
        chunks = []
        for chunk in self.name.split("/"):
            filled = chunk.replace(f"{{{NODE_PLACEHOLDER}}}", node)
            chunks.append("*" if "*" in filled or _PLACEHOLDER.search(filled) else filled)
        return "/".join(chunks)


def check_name(name: str, wildcards: tuple[Wildcard, ...]) -> None:
    """Check a name and its wildcards.

    Raises:
        ConfigError: States the wrong key, its value and the allowed values.
    """
    wrong = fault_of_name(name)
    if wrong:
        raise ConfigError(f'name: "{name}" {wrong}')
    placeholders = _PLACEHOLDER.findall(name)
    if len(placeholders) != len(set(placeholders)):
        raise ConfigError(f'name: "{name}" uses a placeholder twice; allowed: once each')
    listed = {NODE_PLACEHOLDER, *(wildcard.name for wildcard in wildcards)}
    for placeholder in placeholders:
        if placeholder not in listed:
            raise ConfigError(
                f'name: "{name}" has {{{placeholder}}}, which is not listed; '
                f"allowed: {', '.join(sorted(listed))}",
                hint=f'add wildcards: [{{ name: "{placeholder}", values: […] }}]',
            )
    for index, wildcard in enumerate(wildcards):
        _check_wildcard(f"wildcards[{index}]", wildcard, placeholders)


def fault_of_name(name: str) -> str | None:
    """Return the fault of a name as a Zenoh key expression without wildcards, or None."""
    if not name:
        return "is empty; allowed: a key expression"
    if name.startswith("/"):
        return f'starts with "/"; allowed: Zenoh keys, which do not: "{name.lstrip("/")}"'
    if name.endswith("/") or "//" in name:
        return 'has an empty chunk; allowed: chunks separated by single "/"'
    for mark in "*#?$":
        if mark in name:
            return f'contains "{mark}"; allowed: no wildcards, or {{name}} with its values listed'
    if name.startswith("@"):
        return 'starts with "@", which Zenoh and zacoustic keep for themselves'
    if set("{}") & set(_PLACEHOLDER.sub("", name)):
        return "has a brace without its partner; allowed: {name}"
    return None


def _check_wildcard(where: str, wildcard: Wildcard, placeholders: list[str]) -> None:
    name, values = wildcard.name, wildcard.values
    if not name.isidentifier() or name == NODE_PLACEHOLDER:
        raise ConfigError(f'{where}.name: "{name}"; allowed: letters, digits and _, not "node"')
    if name not in placeholders:
        raise ConfigError(f'{where}.name: "{name}" does not occur in the name of the stream')
    try:
        check_fields(wildcard, ConfigError)
    except ConfigError as error:
        raise ConfigError(f"{where}.{error}") from None
    for value in values:
        if fault_of_name(value) or "/" in value or "{" in value:
            raise ConfigError(f'{where}.values: "{value}"; allowed: one chunk of a key')
