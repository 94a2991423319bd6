"""`RosMessage`: CDR to values of a type and back.

`header.stamp` of a message with a header is special: eight bytes with the instant of the message,
by a clock that the other end may not share. `HeaderStamp` defines its treatment: it crosses
unchanged; it does not cross; or the sender turns it into an age, which crosses in one byte, and the
receiver computes a stamp by its own clock.

A message without a header may have a list of messages with one, as TF has. Its age is the age of
the newest stamp in the list. The other stamps cross as milliseconds before that one, if they are
not all the same.
"""

import enum
import struct
from typing import Any, Final

import msgspec
from rosbags.serde import SerdeError

from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.errors import ConfigError, PayloadInvalidError
from zacoustic.ros.interfaces import Interfaces, has_header, stamped_list
from zacoustic.ros.mapping import LONGEST_SEQUENCE, Mapped, TypeMapper
from zacoustic.ros.names import UNSTAMPED
from zacoustic.ros.overlays import OverlayField

TIME: Final = "builtin_interfaces/msg/Time"

_NS_PER_S: Final = 1_000_000_000
_NS_PER_MS: Final = 1_000_000
_LAST_S: Final = 2**31 - 1
_BEFORE: Final = "stamps_before_ms"
"""Member of a value with the stamps of a list; empty: all are the same."""
_UNSET_MS: Final = 2**32 - 1
"""Stands for a stamp of zero among others."""


class HeaderStamp(enum.Enum):
    """Treatment of `header.stamp`."""

    EXACT = "exact"
    """It crosses unchanged: eight bytes, fewer if packed."""
    DROP = "drop"
    """It does not cross; the receiver writes zero."""
    AGE = "age"
    """The receiver computes it from the age of the sample, one byte."""


class RosMessage:
    """One message, for one stream.

    Args:
        interfaces: The definitions.
        mapper: Maps them.
        name: The interface.
        stamp: Treatment of its `header.stamp`.

    Raises:
        ConfigError: It is unknown, a rule of an overlay does not fit, or `stamp` needs a header
            that it does not have; for ages a list of messages with one is enough.
    """

    def __init__(
        self,
        interfaces: Interfaces,
        mapper: TypeMapper,
        name: str,
        stamp: HeaderStamp = HeaderStamp.EXACT,
    ) -> None:
        self.name = name
        self.stamp = stamp
        self._store = interfaces.store(name)
        self._list = ""
        """Attribute of the list whose stamps are ages; empty: the message has a header."""
        if stamp is HeaderStamp.EXACT:
            mapped = mapper.map(name)
        elif has_header(interfaces, name):
            mapped = _without(mapper, name, "header.stamp")
        else:
            member = stamped_list(interfaces, name)
            if member is None or stamp is HeaderStamp.DROP:
                raise ConfigError(f'stamp: "{stamp.value}"; allowed: exact, {name} has no header')
            mapped = _without(mapper, name, f"{member.name}.header.stamp")
            most = member.count or LONGEST_SEQUENCE
            before = FieldSpec(name=_BEFORE, type="uint32", max_length=most, unit="ms")
            whole = mapped.spec
            spec = TypeSpec(name=whole.name, fields=(*whole.fields, before), nested=whole.nested)
            mapped = msgspec.structs.replace(mapped, spec=spec)
            self._list = member.name
        self.spec: TypeSpec = mapped.spec
        """The type that crosses."""
        self._read, self._write = mapped.read, mapped.write
        self._time = self._store.types.get(TIME)

    def definition(self) -> str:
        """Return the definition with all that it uses, in the form of `ros2 bag` files."""
        return self._store.generate_msgdef(self.name, ros_version=2)[0]

    def read(self, cdr: bytes) -> tuple[dict[str, Any], int | None]:
        """Read a message.

        Returns:
            The values, not validated yet, and `header.stamp`, ns since 1970, if it is to become an
            age.

        Raises:
            PayloadInvalidError: It is not such a message, or violates an overlay.
        """
        try:
            message: Any = self._store.deserialize_cdr(cdr, self.name)
        except (SerdeError, struct.error, ValueError, IndexError) as error:
            reason = " ".join(str(error).split())
            raise PayloadInvalidError(f"no {self.name} in CDR: {reason}") from error
        if self.stamp is not HeaderStamp.AGE:
            return self._read(message), None
        if not self._list:
            return self._read(message), _ns_of(message)
        stamps_ns = [_ns_of(each) for each in getattr(message, self._list)]
        newest_ns = max(stamps_ns, default=None)
        value = self._read(message)
        value[_BEFORE] = [] if len({*stamps_ns}) < 2 else _before(stamps_ns)
        return value, newest_ns

    def write(self, value: Any, stamp_ns: int | None = None) -> bytes:  # noqa: ANN401 (a dict)
        """Write a message.

        Args:
            value: The values, as returned by `TypeSpec.validate`.
            stamp_ns: The `header.stamp` to write if it crossed as an age, ns since 1970.

        Raises:
            PayloadInvalidError: It cannot be written.
        """
        message = self._write(value)
        if stamp_ns is not None and self.stamp is HeaderStamp.AGE and self._time is not None:
            stamped = getattr(message, self._list) if self._list else [message]
            before_ms = (value[_BEFORE] if self._list else ()) or [0] * len(stamped)
            if len(before_ms) != len(stamped):
                raise PayloadInvalidError(
                    f"no {self.name}: {len(stamped)} of {self._list}, {len(before_ms)} stamps"
                )
            for each, ms in zip(stamped, before_ms, strict=True):
                if ms != _UNSET_MS:
                    self._stamp(each, stamp_ns - ms * _NS_PER_MS)
        try:
            return bytes(self._store.serialize_cdr(message, self.name, little_endian=True))
        except (SerdeError, struct.error, ValueError, TypeError) as error:
            raise PayloadInvalidError(f"no {self.name}: {error}") from error

    def _stamp(self, message: Any, stamp_ns: int) -> None:  # noqa: ANN401 (made by rosbags)
        assert self._time is not None
        seconds, nanoseconds = divmod(max(stamp_ns, 0), _NS_PER_S)
        stamp: Any = self._time(min(seconds, _LAST_S), nanoseconds)
        # This header may be the object shared by all headers that do not cross.
        message.header = type(message.header)(stamp, message.header.frame_id)


def _without(mapper: TypeMapper, name: str, field: str) -> Mapped:
    omitted = OverlayField(field=field, omit=True)
    return mapper.map(name, called=name + UNSTAMPED, extra=[omitted])


def _ns_of(message: Any) -> int:  # noqa: ANN401 (made by rosbags)
    stamp = message.header.stamp
    return int(stamp.sec) * _NS_PER_S + int(stamp.nanosec)


def _before(stamps_ns: list[int]) -> list[int]:
    """Return how long before the newest stamp each one is, ms.

    Raises:
        PayloadInvalidError: That is too long.
    """
    newest_ns = max(stamps_ns)
    found = [
        _UNSET_MS if not each else round((newest_ns - each) / _NS_PER_MS) for each in stamps_ns
    ]
    too_old = [ms for ms, each in zip(found, stamps_ns, strict=True) if each and ms >= _UNSET_MS]
    if too_old:
        days = too_old[0] / 86_400_000
        raise PayloadInvalidError(f"its stamps are {days:.0f} days apart; allowed: 49")
    return found
