"""Floats within CBOR, spelled as digits.

The problem: a position with six decimals is eight octets in CBOR that look like noise, although
eight digits would express it. The idea: before a payload is modelled, every float in it is spelled
as the shortest digits that mean exactly that float, as in JSON; the reader converts them back. A
payload that is no CBOR has these octets by chance, if at all, and gets longer: then it may be too
long to be modelled (`zacoustic.core.values.dense.text.text`). Text in UTF-8 never has them.

::

    FB, 8 octets  →  FB, digits, LF        also FA, 4 octets: a single
    FB            →  FB, "!"               where no finite float follows

The digits are those of Python's `repr`, which are the same everywhere: the shortest that read as
the float, rounded correctly.
"""

import math
import struct
from typing import Final

from zacoustic.core.values.payload import PayloadError

_FORMATS: Final = {0xFA: struct.Struct(">f"), 0xFB: struct.Struct(">d")}
_NO_FLOAT: Final = ord("!")
_END: Final = b"\n"
_LONGEST: Final = 24  # longest spelled float: -2.2250738585072014e-308
_SINGLE_DIGITS: Final = 9  # enough to tell any single from its neighbours


def spelled(payload: bytes) -> bytes:
    """Return a payload with its floats as digits."""
    if 0xFA not in payload and 0xFB not in payload:
        return payload
    found, place = bytearray(), 0
    while place < len(payload):
        head = payload[place]
        found.append(head)
        place += 1
        layout = _FORMATS.get(head)
        if layout is None:
            continue
        digits = _digits(layout, payload[place : place + layout.size])
        if digits is None:
            found.append(_NO_FLOAT)
        else:
            found += digits + _END
            place += layout.size
    return bytes(found)


def unspelled(text: bytes) -> bytes:
    """Return the payload with this spelling.

    Raises:
        PayloadError: There is none.
    """
    if 0xFA not in text and 0xFB not in text:
        return text
    found, place = bytearray(), 0
    while place < len(text):
        head = text[place]
        found.append(head)
        place += 1
        layout = _FORMATS.get(head)
        if layout is None:
            continue
        if text[place : place + 1] == b"!":
            place += 1
            continue
        end = text.find(_END, place, place + _LONGEST + 1)
        try:
            found += layout.pack(float(text[place : max(end, place)]))
        except (ValueError, OverflowError):
            raise PayloadError("digits that are no float") from None
        place = end + 1
    payload = bytes(found)
    if spelled(payload) != text:
        raise PayloadError("a float in another spelling than the shortest")
    return payload


def _digits(layout: struct.Struct, octets: bytes) -> bytes | None:
    if len(octets) < layout.size:
        return None
    number: float = layout.unpack(octets)[0]
    if not math.isfinite(number):
        return None
    if layout.size == 8:
        return repr(number).encode()
    for places in range(1, _SINGLE_DIGITS + 1):
        digits = f"{number:.{places}g}"
        try:
            if layout.pack(float(digits)) == octets:
                return digits.encode()
        except OverflowError:  # rounded up beyond the largest single
            continue
    return None
