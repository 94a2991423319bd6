"""A ROS message as a `TypeSpec`, and the conversion between values and objects of `rosbags`.

=======================================  ======================================================
ROS                                      on the channel
=======================================  ======================================================
``bool``, integers, floats, ``string``   the same
``byte``, ``char``                       ``uint8``
array, bounded sequence                  a list of that many, of at most that many
sequence without a bound                 a list of at most `LONGEST_SEQUENCE`
several ``uint8``, ``byte``, ``char``    ``bytes``, as many or at most as many
sequence of ``string``                   a list of ``{text}``
another message                          another type; one without members is left out
sequence of messages without members     their number, ``uint16``
=======================================  ======================================================

Overlays add their rules. What they leave out is known to both ends: a constant, or zero. If a rule
of an outer type changes members of a type, that type gets a name of its own,
``geometry_msgs/msg/Twist.linear``; names do not cross.

For rmw_desert a type has the members that rmw_desert sends, one by one: fixed arrays of ``uint8``
and ``char`` are lists of that length, ``byte`` members are left out, and no others may be left out.
"""

from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import Any, Final, NoReturn

import msgspec
import numpy as np
from rosbags.serde.utils import ndtype

from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.core.values.types.fields import MAX_LENGTH
from zacoustic.core.values.types.scalars import shown
from zacoustic.errors import ConfigError, PayloadInvalidError
from zacoustic.ros.interfaces import Interfaces
from zacoustic.ros.members import NO_MEMBER, Member
from zacoustic.ros.overlays import (
    Overlay,
    OverlayField,
    Rule,
    applied,
    constant_of,
    rules_of,
)

LONGEST_SEQUENCE: Final = MAX_LENGTH
"""Default bound of a sequence; bytes and texts have none."""

_OCTETS: Final = ("uint8", "byte", "char")
_ALIASES: Final = {"byte": "uint8", "char": "uint8"}
_ZEROS: Final[dict[str, Any]] = {"bool": False, "string": "", "float32": 0.0, "float64": 0.0}

Convert = Callable[[Any], Any]
"""Converts a value of `rosbags` to one of `TypeSpec`, or back."""


class Mapped(msgspec.Struct, frozen=True, kw_only=True):
    """One message, mapped."""

    spec: TypeSpec
    """The type that crosses, with resolved nested types."""
    read: Convert
    """Object of `rosbags` → dict; `PayloadInvalidError`: a constant has another value.
    """
    write: Convert
    """Validated dict → object of `rosbags`, missing members are zero; `PayloadInvalidError`: a
    length does not fit."""


class _Part(msgspec.Struct, frozen=True, kw_only=True):
    """One member, mapped."""

    attribute: str
    field: FieldSpec | None = None
    read: Convert | None = None
    write: Convert | None = None
    standing_in: Any = None
    """The value of a member that does not cross, or that is not set."""
    check: Convert | None = None
    """Refuses any other value than the constant."""


class TypeMapper:
    """Maps the messages of one distribution.

    Args:
        interfaces: The definitions.
        overlays: Rules for some of the types.
        wire: The wire profile of the link.
    """

    def __init__(
        self,
        interfaces: Interfaces,
        overlays: Sequence[Overlay] = (),
        *,
        wire: WireProfile = WireProfile.NATIVE,
    ) -> None:
        self._interfaces = interfaces
        self._on_desert = wire is WireProfile.RMW_DESERT
        self._overlays: dict[str, list[OverlayField]] = {}
        for overlay in overlays:
            self._overlays.setdefault(overlay.type, []).extend(overlay.fields)
        self._plain: dict[str, Mapped] = {}
        self._zeros: dict[str, Any] = {}
        self.used: set[int] = set()
        """Ids of the `OverlayField` records that have matched a member so far."""

    def map(self, name: str, *, called: str = "", extra: Sequence[OverlayField] = ()) -> Mapped:
        """Map a message.

        Args:
            name: The interface.
            called: Name of its type; by default that of the interface.
            extra: Further rules, after those of the overlays.

        Raises:
            ConfigError: It is unknown, or a rule does not fit.
        """
        self._interfaces.store(name)  # checks that all types that it uses are known
        return self._map(name, called or name, rules_of(extra))

    # Below the methods above

    def _map(self, name: str, called: str, outer: list[Rule]) -> Mapped:
        if not outer and name == called and name in self._plain:
            return self._plain[name]
        rules = rules_of(self._overlays.get(name, ())) + outer
        store = self._interfaces.store(name)
        definition = store.get_msgdef(name)
        nested: dict[str, TypeSpec] = {}
        parts: list[_Part] = []
        attributes = [attribute for attribute, _ in definition.fields]
        members = self._interfaces.members(name)
        has_members = [member.name != NO_MEMBER for member in members]
        for member, attribute in zip(members, attributes, strict=True):
            here = [below for rule in rules if (below := rule.below(member.name))]
            parts.append(self._part(member, attribute, called, here, nested))
        fields = tuple(part.field for part in parts if part.field is not None)
        try:
            spec = TypeSpec(
                name=called,
                fields=fields,
                nested=tuple(nested.values()),
                is_hidden=self._on_desert and not fields and all(has_members),
            )
        except ConfigError as error:
            raise ConfigError(f"{called}: {error.args[0]}", hint=error.hint) from None
        mapped = Mapped(spec=spec, read=_reader(parts), write=_writer(parts, definition.cls))
        if not outer and name == called:
            self._plain[name] = mapped
        return mapped

    def _part(
        self,
        member: Member,
        attribute: str,
        called: str,
        rules: list[Rule],
        nested: dict[str, TypeSpec],
    ) -> _Part:
        ended = [rule for rule in rules if not rule.rest]
        self.used.update(id(rule.said) for rule in ended)
        if self._on_desert and member.type == "byte":
            return _Part(attribute=attribute, standing_in=self._zero(member))
        constant = constant_of(ended)
        is_omitted = any(rule.said.omit for rule in ended)
        if self._on_desert and (is_omitted or constant is not None):
            self._refuse(f"{called}.{member.name}: left out by an overlay")
        if member.name == NO_MEMBER or is_omitted:
            return _Part(attribute=attribute, standing_in=self._zero(member))
        if constant is not None:
            return self._constant(member, attribute, called, constant)
        deeper = [rule for rule in rules if rule.rest]
        if not member.is_nested:
            is_texts = member.type == "string" and member.is_sequence
            part = (
                _texts_part(member, attribute, called, ended, nested)
                if is_texts
                else _scalar_part(
                    member, attribute, called, ended, is_listed=self._on_desert and member.is_array
                )
            )
            return msgspec.structs.replace(part, standing_in=self._zero(member))
        name = f"{called}.{member.name}" if deeper else member.type
        inner = self._map(member.type, name, deeper)
        read, write = inner.read, inner.write
        is_several = member.is_array or member.is_sequence
        made: Any = write({})
        if is_several:
            made = [made] * (member.count if member.is_array else 0)
        if not inner.spec.fields:
            if self._on_desert and not inner.spec.is_hidden:
                self._refuse(f"{called}.{member.name}: a message without members in another one")
            if member.is_sequence:
                return _counted_part(member, attribute, ended, read, write({}))
            check: Convert = (lambda each: [*map(read, each)]) if is_several else read
            return _Part(attribute=attribute, standing_in=made, check=check)
        nested[name] = inner.spec
        field = FieldSpec(name=member.name, type=name, **_lengths(member))
        field = _applied(field, ended, called)
        if is_several:
            return _Part(
                attribute=attribute,
                field=field,
                read=lambda objects: [read(each) for each in objects],
                write=lambda values: [write(each) for each in values],
                standing_in=made,
            )
        return _Part(attribute=attribute, field=field, read=read, write=write, standing_in=made)

    def _refuse(self, what: str) -> NoReturn:
        wire = WireProfile.RMW_DESERT.value
        raise ConfigError(f'{what} with wire: "{wire}"; allowed: what that has')

    def _constant(self, member: Member, attribute: str, called: str, constant: Any) -> _Part:  # noqa: ANN401
        part = _scalar_part(member, attribute, called, [])
        field, read, write = part.field, part.read or _same, part.write or _same
        if member.is_nested or member.is_array or member.is_sequence or field is None:
            raise ConfigError(f"{called}.{member.name}: constant; allowed: for single values")
        check = TypeSpec(name=called, fields=(field,)).validate
        try:
            value = check({member.name: constant})[member.name]
        except PayloadInvalidError as error:
            raise ConfigError(f"constant: {error}") from None

        def refuse(given: object) -> None:
            if read(given) != value:
                raise PayloadInvalidError(
                    f"{attribute} is {shown(read(given))}; "
                    f"allowed: {shown(value)}, the constant of its overlay"
                )

        return _Part(attribute=attribute, standing_in=write(value), check=refuse)

    def _zero(self, member: Member) -> Any:  # noqa: ANN401 (of any type)
        """Return the value of a member that is not set."""
        if member.is_sequence:
            return [] if member.is_nested or member.type == "string" else _array(member)([])
        if member.is_nested:
            single = self._zeros.get(member.type)
            if single is None:
                cls = self._interfaces.store(member.type).types[member.type]
                members = self._interfaces.members(member.type)
                single = self._zeros[member.type] = cls(*map(self._zero, members))
        else:
            single = _ZEROS.get(member.type, 0)
        if not member.is_array:
            return single
        several = [single] * member.count
        return several if member.is_nested or member.type == "string" else _array(member)(several)


def _same(value: Any) -> Any:  # noqa: ANN401 (of any type)
    return value


def _scalar_part(
    member: Member, attribute: str, called: str, rules: list[Rule], *, is_listed: bool = False
) -> _Part:
    is_several = member.is_array or member.is_sequence
    if is_several and member.type in _OCTETS and not is_listed:
        field = FieldSpec(
            name=member.name,
            type="bytes",
            max_length=member.count or None,
            min_length=member.count if member.is_array else None,
        )
        return _Part(
            attribute=attribute,
            field=_applied(field, rules, called),
            read=lambda array: array.tobytes(),
            write=_octets(member),
        )
    longest = member.most_characters or None if not is_several else None
    lengths = _lengths(member) or {"max_length": longest}
    field = FieldSpec(name=member.name, type=_ALIASES.get(member.type, member.type), **lengths)
    field = _applied(field, rules, called)
    if is_several and member.type != "string":
        return _Part(
            attribute=attribute,
            field=field,
            read=lambda array: array.tolist(),
            write=_array(member),
        )
    if member.type == "byte":  # an octet, which `rosbags` takes for an int8
        return _Part(
            attribute=attribute,
            field=field,
            read=lambda octet: octet & 0xFF,
            write=lambda octet: octet - ((octet & 0x80) << 1),
        )
    return _Part(attribute=attribute, field=field)


def _counted_part(
    member: Member,
    attribute: str,
    rules: list[Rule],
    read: Convert,
    single: Any,  # noqa: ANN401
) -> _Part:
    """Map a sequence of messages of which nothing crosses but their number."""
    bounds = [rule.said.max_length for rule in rules if rule.said.max_length is not None]
    most = min([member.count or LONGEST_SEQUENCE, LONGEST_SEQUENCE, *bounds])
    return _Part(
        attribute=attribute,
        field=FieldSpec(name=member.name, type="uint16", range=(0, most)),
        read=lambda objects: len([*map(read, objects)]),
        write=lambda count: [single] * count,
        standing_in=[],
    )


def _texts_part(
    member: Member, attribute: str, called: str, rules: list[Rule], nested: dict[str, TypeSpec]
) -> _Part:
    """Map a sequence of texts, because `TypeSpec` has no lists of texts or bytes."""
    name = f"{called}.{member.name}"
    text = FieldSpec(name="text", type="string", max_length=member.most_characters or None)
    nested[name] = TypeSpec(name=name, fields=(text,))
    field = FieldSpec(name=member.name, type=name, **_lengths(member))
    return _Part(
        attribute=attribute,
        field=_applied(field, rules, called),
        read=lambda texts: [{"text": each} for each in texts],
        write=lambda values: [each["text"] for each in values],
    )


def _applied(field: FieldSpec, rules: list[Rule], called: str) -> FieldSpec:
    try:
        return applied(field, rules)
    except ConfigError as error:
        raise ConfigError(f"{called}.{field.name}: {error.args[0]}", hint=error.hint) from None


def _lengths(member: Member) -> dict[str, Any]:
    if member.is_array:
        return {"length": member.count}
    if member.is_sequence:
        return {"max_length": min(member.count or LONGEST_SEQUENCE, LONGEST_SEQUENCE)}
    return {}


def _array(member: Member) -> Convert:
    kind = np.dtype(ndtype(member.type))
    return lambda values: np.array(values, kind)


def _octets(member: Member) -> Convert:
    kind = np.dtype(ndtype(member.type))
    count = member.count if member.is_array else None

    def write(content: bytes) -> Any:  # noqa: ANN401 (an array)
        if count is not None and len(content) != count:
            raise PayloadInvalidError(
                f"{member.name} has {len(content)} bytes; allowed: {count} bytes"
            )
        return np.frombuffer(content, kind)

    return write


def _reader(parts: Sequence[_Part]) -> Convert:
    """Make the reader of an object: one access to all attributes, then the conversions."""
    checks = [(part.attribute, part.check) for part in parts if part.check is not None]
    crossing = [part for part in parts if part.field is not None]
    names = [part.field.name for part in crossing if part.field is not None]
    converts = [(index, part.read) for index, part in enumerate(crossing) if part.read]
    if not crossing:
        take: Convert = lambda _: []  # noqa: E731
    elif len(crossing) == 1:
        only = attrgetter(crossing[0].attribute)
        take = lambda message: [only(message)]  # noqa: E731
    else:
        several = attrgetter(*(part.attribute for part in crossing))
        take = lambda message: list(several(message))  # noqa: E731

    def read(message: Any) -> dict[str, Any]:  # noqa: ANN401 (an object of rosbags)
        for attribute, check in checks:
            check(getattr(message, attribute))
        values = take(message)
        for index, convert in converts:
            values[index] = convert(values[index])
        return dict(zip(names, values, strict=True))

    return read


def _writer(parts: Sequence[_Part], cls: Callable[..., Any]) -> Convert:
    plan = [
        (part.field.name if part.field is not None else None, part.write, part.standing_in)
        for part in parts
    ]

    def write(value: Mapping[str, Any]) -> Any:  # noqa: ANN401 (an object of rosbags)
        arguments = []
        for name, convert, otherwise in plan:
            given = value.get(name) if name is not None else None
            if given is None:
                arguments.append(otherwise)
            else:
                arguments.append(given if convert is None else convert(given))
        return cls(*arguments)

    return write
