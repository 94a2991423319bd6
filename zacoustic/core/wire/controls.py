"""The table of controls: each component reads its own, and `frame` knows none of them.

Agreement, medium access, objects and subscriptions each have a `Form` for each of their codes,
beside the control itself. A profile puts the forms of all its components into one table, which
`frame` uses to decode frames.

An `Extension` is a control of a transport that this wire does not know. It follows LEN, so that any
receiver can skip it.
"""

from collections.abc import Callable
from typing import Final, TypeAlias

import msgspec

FIRST_CODE: Final = 0xB0
LAST_CODE: Final = 0xBF
"""Controls begin with a byte from `FIRST_CODE` to `LAST_CODE`."""
FIRST_EXTENSION: Final = 0xE0
"""An extension begins, after LEN, with a byte from here to `LAST_EXTENSION`."""
LAST_EXTENSION: Final = 0xFF
"""The last byte with which an extension can begin."""
LONGEST_EXTENSION_BYTES: Final = 254
"""Longest body of an extension, bytes: LEN delimits one byte more."""
EXTENSION_HEADER_BYTES: Final = 3
"""Bytes for LEN, its length and the code."""
_LEN: Final = 0xB2

Item: TypeAlias = msgspec.Struct
"""An item of a frame."""
ReadControl = Callable[[bytes, int], tuple[Item, int] | None]
"""``(buffer, offset of the code)`` → the item there and its end; None: it is cut off or invalid."""


class Form(msgspec.Struct, frozen=True):
    """How to decode a control."""

    code: int
    """Its first byte, `FIRST_CODE`…`LAST_CODE`."""
    name: str
    """Its name in docs/wire.md."""
    read: ReadControl
    """Decodes it."""
    shows_end: bool = True
    """False: it extends to the end of the frame, or of what LEN delimits."""


def fixed(code: int, name: str, size_bytes: int, decode: Callable[[bytes], Item]) -> Form:
    """Return the form of a control of fixed size.

    Args:
        code: Its first byte.
        name: Its name.
        size_bytes: Size with the code, bytes.
        decode: Decodes the bytes after the code.
    """

    def read(buffer: bytes, offset: int) -> tuple[Item, int] | None:
        end = offset + size_bytes
        return None if end > len(buffer) else (decode(buffer[offset + 1 : end]), end)

    return Form(code, name, read)


class Controls(dict[int, Form]):
    """Forms by code.

    Args:
        forms: The forms of all controls in use.

    Raises:
        ValueError: Two have the same code, or the code of one is out of range.
    """

    def __init__(self, *forms: Form) -> None:
        super().__init__()
        for form in forms:
            if form.code in self or not FIRST_CODE <= form.code <= LAST_CODE:
                raise ValueError(
                    f"control {form.name} has the code {form.code:02X}; allowed: one of "
                    f"{FIRST_CODE:02X}..{LAST_CODE:02X} that no other control has"
                )
            self[form.code] = form


class Extension(msgspec.Struct, frozen=True):
    """A control of a transport outside of this wire."""

    code: int
    """`FIRST_EXTENSION`…`LAST_EXTENSION`."""
    body: bytes
    """0…254 bytes."""

    def encode(self) -> bytes:
        """Return the control with its LEN.

        Raises:
            ValueError: The code or the body is out of bounds.
        """
        if not FIRST_EXTENSION <= self.code <= LAST_EXTENSION:
            allowed = f"{FIRST_EXTENSION:02X}..{LAST_EXTENSION:02X}"
            raise ValueError(f"extension code is {self.code:02X}; allowed: {allowed}")
        if len(self.body) > LONGEST_EXTENSION_BYTES:
            raise ValueError(
                f"extension has {len(self.body)} bytes; allowed: 0..{LONGEST_EXTENSION_BYTES}"
            )
        return bytes((_LEN, 1 + len(self.body), self.code)) + self.body
