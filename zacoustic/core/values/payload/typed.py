"""`TypedCodec`: the common part of the codecs of typed values."""

from abc import abstractmethod
from typing import Any

import msgspec

from zacoustic.core.values.payload.codec import PayloadCodec, PayloadError
from zacoustic.core.values.types import (
    OutsideValues,
    TypeSpec,
    check_agreement,
    struct_builder,
    type_from_struct,
)
from zacoustic.core.values.types.structs import BuildStruct
from zacoustic.errors import ConfigError, PayloadInvalidError


class TypedCodec(PayloadCodec):
    """Values of one type as bytes.

    Args:
        type_spec: The type, resolved.

    Raises:
        ConfigError: The type is not resolved.
    """

    delimits_itself = True

    def __init__(self, type_spec: TypeSpec) -> None:
        self.type_spec = type_spec
        self.outside = OutsideValues(type_spec)
        """How many values were cut, clamped or escaped so far."""
        self._builders: dict[type[msgspec.Struct], BuildStruct] = {}

    def normalised(self, value: object) -> dict[str, Any]:
        """Return an application's value ready for encoding: checked, clamped, counted.

        Raises:
            PayloadInvalidError: It is not of the type.
        """
        return self.outside.normalised(value)

    def encode(self, value: object) -> bytes:
        """Return the payload of a Mapping of field names to values, or of a `msgspec.Struct`."""
        return self.write(self.normalised(value))

    @abstractmethod
    def write(self, normal: dict[str, Any]) -> bytes:
        """Return the payload of a value that `normalised` returned."""

    @abstractmethod
    def decode(self, payload: bytes) -> dict[str, Any]:
        """Return the value as a dict with every field, as `TypeSpec.validate` normalises it."""

    def decode_as(self, payload: bytes, cls: type[msgspec.Struct]) -> msgspec.Struct:
        """Return the value as an instance of `cls`, whose fields must be those of the type."""
        build = self._builders.get(cls)
        if build is None:
            build = self._builders[cls] = self._builder(cls)
        value = self.decode(payload)
        try:
            return build(value)
        except (ValueError, TypeError) as error:  # from a __post_init__ of the application
            raise PayloadError(f"{cls.__name__} refuses the value: {error}") from error

    def _builder(self, cls: type[msgspec.Struct]) -> BuildStruct:
        try:
            check_agreement(self.type_spec, type_from_struct(cls), path=self.type_spec.name)
        except ConfigError as error:
            raise PayloadInvalidError(
                f"{cls.__name__} is not this stream's type: {error}"
            ) from None
        return struct_builder(cls)
