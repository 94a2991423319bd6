"""A node of rmw_desert in eighty lines, written from the measured rules alone: shares no code.

It sends what that middleware sends, and reads as it reads: shortest or not, arrays flattened, 64
items at most, texts of 127 bytes.
"""

import struct
from typing import Any, Final, NamedTuple

SAMPLE: Final = 0
REQUEST: Final = 2
RESPONSE: Final = 3


class CrashedError(Exception):
    """The original would have crashed, or read beyond its memory."""


class Heard(NamedTuple):
    """A packet that the peer has read."""

    kind: int
    stream_id: int
    items: list[Any]


def packet(kind: int, stream_id: int, *items: Any) -> bytes:
    """Return a packet as the original sends it; of a call the first item is its sequence id."""
    payload = b"".join(_item(each) for each in (kind, stream_id, *items))
    return b"\x99\x99" + bytes([len(payload) & 0xFF]) + payload + b"\x55"


def _item(value: Any) -> bytes:
    if isinstance(value, bool):
        return b"\xf5" if value else b"\xf4"
    if isinstance(value, str):
        return _head(0x60, len(value.encode())) + value.encode()
    if isinstance(value, float):
        return _float(struct.unpack(">I", struct.pack(">f", value))[0])
    return _head(0x00, value) if value >= 0 else _head(0x20, -1 - value)


def _head(major: int, number: int) -> bytes:
    if number < 24:
        return bytes([major + number])
    for size, code in ((1, 24), (2, 25), (4, 26), (8, 27)):
        if number < 256**size:
            return bytes([major + code]) + number.to_bytes(size, "big")
    raise ValueError(number)


def _float(bits: int) -> bytes:
    sign, exponent, mantissa = bits >> 31, bits >> 23 & 255, bits & 0x7FFFFF
    half = None
    if exponent == 255:
        half = 0x7C00 + (mantissa >> 13)
    elif 103 <= exponent <= 112:
        half = 0x3FF >> (112 - exponent)
    elif mantissa % 8192 == 0 and exponent == 0:
        half = 0
    elif mantissa % 8192 == 0 and 113 <= exponent <= 142:
        half = ((exponent - 112) << 10) + (mantissa >> 13)
    if half is None:
        return b"\xfa" + bits.to_bytes(4, "big")
    return b"\xf9" + (half + (sign << 15)).to_bytes(2, "big")


class Peer:
    """What arrives at such a node."""

    def __init__(self) -> None:
        self._buffer = b""
        self.heard: list[Heard] = []

    def hear(self, data: bytes) -> list[Heard]:
        """Take bytes; returns the packets that they complete."""
        self._buffer += data
        before = len(self.heard)
        while (at := self._buffer.find(b"\x99\x99")) >= 0:
            self._buffer = self._buffer[at:]
            if len(self._buffer) < 3 or len(self._buffer) < 4 + self._buffer[2]:
                break
            size = self._buffer[2]
            if self._buffer[3 + size] == 0x55:
                self.heard.append(_read(self._buffer[3 : 3 + size]))
                self._buffer = self._buffer[4 + size :]
            else:
                self._buffer = self._buffer[1:]
        return self.heard[before:]


def _read(payload: bytes) -> Heard:
    items: list[Any] = []
    at = 0
    while at < len(payload):
        initial, at = payload[at], at + 1
        major, number = initial >> 5, initial & 31
        if initial in (0xF4, 0xF5):
            items.append(initial == 0xF5)
            continue
        if major == 7:
            size = {25: 2, 26: 4}[number]
            items.append(struct.unpack(">e" if size == 2 else ">f", payload[at : at + size])[0])
            at += size
            continue
        if number > 23:
            size = 1 << (number - 24)
            number, at = int.from_bytes(payload[at : at + size], "big"), at + size
        if major == 3:
            if number > 127:
                raise CrashedError(f"text of {number} bytes")
            items.append(payload[at : at + number].decode().split("\0")[0])
            at += number
        else:
            items.append(number if major == 0 else -1 - number)
    if items[0] not in (SAMPLE, REQUEST, RESPONSE):
        raise CrashedError(f"kind {items[0]}")
    return Heard(items[0], items[1] & 255, items[2:64])
