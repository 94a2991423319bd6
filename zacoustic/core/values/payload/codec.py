"""`PayloadCodec`, the contract of every codec, and the codec that carries bytes as they are."""

from abc import ABC, abstractmethod

import msgspec

from zacoustic.core.values.types.scalars import shown
from zacoustic.errors import PayloadInvalidError


class PayloadError(Exception):
    """A received payload that its codec refuses; never leaves the core."""


class ReferenceUnknownError(PayloadError):
    """The payload refers to a block of its source that is not held here."""


class PayloadCodec(ABC):
    """Encodes values of one stream as the bytes that cross the channel, and decodes them.

    A codec's only state is what it counts: one codec serves all sources of a stream.
    """

    delimits_itself: bool
    """Whether `measure` finds the end of a payload by itself."""
    smallest_bytes: int
    """Size of the smallest payload, bytes, ≥ 0."""
    largest_bytes: int | None
    """Size of the largest payload, bytes; None: no bound."""

    @abstractmethod
    def encode(self, value: object) -> bytes:
        """Return the payload of an application's value.

        Raises:
            PayloadInvalidError: The value is not of the stream's type.
        """

    @abstractmethod
    def decode(self, payload: bytes) -> object:
        """Return the value of a payload; all of it must belong to the value.

        Raises:
            PayloadError: It does not, or the value is out of bounds.
        """

    @abstractmethod
    def measure(self, buffer: bytes, offset: int) -> int | None:
        """Return the offset after the payload that starts at `offset`; None if it shows no end.

        None is also the answer when no payload of this codec starts there. Only the structure is
        checked: `decode` may still refuse the payload. Never raises.
        """

    def decode_as(self, payload: bytes, cls: type[msgspec.Struct]) -> msgspec.Struct:
        """Return the value of a payload as an instance of the stream's Python class.

        Raises:
            PayloadError: As `decode`.
            PayloadInvalidError: The stream's type is not that class.
        """
        raise PayloadInvalidError(f"{cls.__name__} is not the type of this stream, which has none")


class OpaqueCodec(PayloadCodec):
    """Carries bytes unchanged; the end of a payload must be known from elsewhere.

    Args:
        largest_bytes: Size of the largest payload that is accepted either way; None: no bound.
    """

    delimits_itself = False
    smallest_bytes = 0

    def __init__(self, *, largest_bytes: int | None = None) -> None:
        self.largest_bytes = largest_bytes

    def encode(self, value: object) -> bytes:
        """Return `value`, which is bytes, a bytearray or a memoryview, as bytes."""
        if not isinstance(value, bytes | bytearray | memoryview):
            raise PayloadInvalidError(f"payload is {shown(value)}; allowed: bytes")
        payload = bytes(value)
        if self.largest_bytes is not None and len(payload) > self.largest_bytes:
            raise PayloadInvalidError(
                f"payload has {len(payload)} bytes; allowed: at most {self.largest_bytes} bytes"
            )
        return payload

    def decode(self, payload: bytes) -> bytes:
        """Return the payload."""
        if self.largest_bytes is not None and len(payload) > self.largest_bytes:
            raise PayloadError(f"{len(payload)} bytes; allowed: at most {self.largest_bytes}")
        return bytes(payload)

    def measure(self, buffer: bytes, offset: int) -> None:
        """Return None: bytes do not show where they end."""
        return
