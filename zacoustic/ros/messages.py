"""`RosMessage`: CDR to values of a type and back.

`header.stamp` of a message with a header is special: eight bytes with the instant of the message,
by a clock that the other end may not share. `HeaderStamp` defines its treatment: it crosses
unchanged; it does not cross; or the sender turns it into an age, which crosses in one byte, and the
receiver computes a stamp by its own clock.
"""

import enum
import struct
from typing import Any, Final

from rosbags.serde import SerdeError

from zacoustic.core.values.types import TypeSpec
from zacoustic.errors import ConfigError, PayloadInvalidError
from zacoustic.ros.interfaces import Interfaces, has_header
from zacoustic.ros.mapping import TypeMapper
from zacoustic.ros.names import UNSTAMPED
from zacoustic.ros.overlays import OverlayField

TIME: Final = "builtin_interfaces/msg/Time"

_NS_PER_S: Final = 1_000_000_000
_LAST_S: Final = 2**31 - 1


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
            that it does not have.
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
        if stamp is HeaderStamp.EXACT:
            mapped = mapper.map(name)
        else:
            if not has_header(interfaces, name):
                raise ConfigError(f'stamp: "{stamp.value}"; allowed: exact, {name} has no header')
            omitted = OverlayField(field="header.stamp", omit=True)
            mapped = mapper.map(name, called=name + UNSTAMPED, extra=[omitted])
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
        stamp_ns = None
        if self.stamp is HeaderStamp.AGE:
            stamp = message.header.stamp
            stamp_ns = stamp.sec * _NS_PER_S + stamp.nanosec
        return self._read(message), stamp_ns

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
            seconds, nanoseconds = divmod(max(stamp_ns, 0), _NS_PER_S)
            stamp: Any = self._time(min(seconds, _LAST_S), nanoseconds)
            # This header may be the object shared by all headers that do not cross.
            message.header = type(message.header)(stamp, message.header.frame_id)
        try:
            return bytes(self._store.serialize_cdr(message, self.name, little_endian=True))
        except (SerdeError, struct.error, ValueError, TypeError) as error:
            raise PayloadInvalidError(f"no {self.name}: {error}") from error
