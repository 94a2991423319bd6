"""The Python form of a stream's values: a class, a dict, or bytes.

The engine and the codecs know dicts and bytes. A *form* is the Python side of one stream: the class
of its values, the type on the wire that follows from the class, and the way from a decoded value to
an instance. If the configuration defines the stream, the class must agree with it; this is checked
when an endpoint is created, not when the first sample is lost.
"""

from collections.abc import Callable
from typing import Any, Generic, TypeVar

import msgspec

from zacoustic.core.values.types import TypeSpec, check_agreement, struct_builder, type_from_struct
from zacoustic.errors import ConfigError
from zacoustic.ros.names import UNSTAMPED, is_interface
from zacoustic.ros.types import ros_type
from zacoustic.zenoh.session.values import read_value, write_value

T = TypeVar("T")

_ALLOWED = "a msgspec.Struct class, the name of a type of the config, or bytes"


class Form(Generic[T]):
    """The Python side of the values of one stream.

    Args:
        spec: Their type; None: opaque bytes.
        build: Makes a value from a decoded one; may raise whatever the class raises.
    """

    def __init__(self, spec: TypeSpec | None, build: Callable[[Any], T]) -> None:
        self.spec = spec
        self.build = build

    def write(self, value: object, encoding: str) -> bytes:
        """Encode a value of the application for the local network.

        Raises:
            PayloadInvalidError: The type does not allow the value, or it is opaque and not bytes.
        """
        checked = value if self.spec is None else self.spec.validate(value)
        return write_value(checked, self.spec, encoding)

    def read(self, payload: bytes, encoding: str) -> object:
        """Decode a local payload, for `build`.

        Raises:
            PayloadInvalidError: The payload is not of the type.
        """
        value = read_value(payload, self.spec, encoding)
        return value if self.spec is None else self.spec.validate(value)


def free_form(value_type: object, *, where: str) -> Form[Any]:
    """Return the form of a stream that no configuration defines.

    Args:
        value_type: A `msgspec.Struct` class, the name of a ROS message, or `bytes`.
        where: The stream, named in errors.

    Raises:
        ConfigError: Anything else, or a class without a meaning on the wire.
    """
    if isinstance(value_type, str) and is_interface(value_type):
        return Form(ros_type(value_type), _same)
    if isinstance(value_type, str):
        raise ConfigError(
            f'{where}: the type "{value_type}" is given by name, and there is no config that '
            "defines it",
            hint="give config=FILE, or a msgspec.Struct class",
        )
    if value_type is bytes:
        return Form(None, bytes)
    cls = _struct_class(value_type, where)
    return Form(type_from_struct(cls, name=type_name(cls)), struct_builder(cls))


def configured_form(value_type: object, spec: TypeSpec | None, *, where: str) -> Form[Any]:
    """Return the form of a stream that is already defined.

    Args:
        value_type: A `msgspec.Struct` class, the name of the type, or `bytes`.
        spec: The type of the stream; None: opaque bytes.
        where: The stream, named in errors.

    Raises:
        ConfigError: The code's type and the defined one differ.
    """
    defined = "opaque bytes" if spec is None else f'the type "{spec.name}"'
    if isinstance(value_type, str):
        # The type of a ROS topic may lack the stamp of its header.
        if spec is None or value_type not in (spec.name, spec.name.removesuffix(UNSTAMPED)):
            raise ConfigError(f'{where}: the type "{value_type}"; allowed: {defined}')
        return Form(spec, _same)
    if (value_type is bytes) is not (spec is None):
        given = getattr(value_type, "__name__", repr(value_type))
        raise ConfigError(f"{where}: {given}; allowed: {defined}")
    if spec is None:
        return Form(None, bytes)
    cls = _struct_class(value_type, where)
    check_agreement(spec, type_from_struct(cls), path=f"{where}: {spec.name}")
    return Form(spec, struct_builder(cls))


def type_name(cls: type) -> str:
    """Name a class as a type: `Arm.Request` for a class inside another one."""
    return cls.__qualname__.rpartition("<locals>.")[2]


def _struct_class(value_type: object, where: str) -> type[msgspec.Struct]:
    if isinstance(value_type, type) and issubclass(value_type, msgspec.Struct):
        return value_type
    raise ConfigError(f"{where}: {value_type!r}; allowed: {_ALLOWED}")


def _same(value: Any) -> Any:  # noqa: ANN401 (a dict, as it was decoded)
    return value
