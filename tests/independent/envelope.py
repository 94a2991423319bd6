"""Section 2: what is added around the records. Written from docs/wire.md alone."""

import zlib
from dataclasses import dataclass

from tests.independent.errors import ReadError

BROADCAST = 255


@dataclass(frozen=True)
class Capabilities:
    """What the link does by itself."""

    addresses: bool = False
    checks: bool = False
    delimits: bool = False


@dataclass(frozen=True)
class Opened:
    """The records of a frame, with its two addresses."""

    source: int
    destination: int
    records: bytes


def wrap(opened: Opened, link: Capabilities, *, sealed: bool = False) -> bytes:
    """Add what the link lacks; the tag of a sealed frame stands in for the check."""
    addresses = bytes((opened.destination, opened.source))
    frame = opened.records if link.addresses else addresses + opened.records
    if not link.checks and not sealed:
        frame += zlib.crc32(addresses + opened.records).to_bytes(4, "big")
    return frame if link.delimits else b"\0" + cobs(frame) + b"\0"


def unwrap(
    frame: bytes,
    link: Capabilities,
    *,
    addresses: tuple[int, int] | None = None,
    sealed: bool = False,
) -> Opened:
    """Take the envelope off. `addresses`: destination and source, where the link carries them."""
    if not link.delimits:
        if len(frame) < 2 or frame[0] or frame[-1]:
            raise ReadError("not between two zero bytes")
        frame = uncobs(frame[1:-1])
    if not link.addresses:
        if len(frame) < 2:
            raise ReadError("no addresses")
        addresses = (frame[0], frame[1])
        frame = frame[2:]
    if addresses is None:
        raise ReadError("the link gave no addresses")
    if not link.checks and not sealed:
        frame, check = frame[:-4], frame[-4:]
        if zlib.crc32(bytes(addresses) + frame).to_bytes(4, "big") != check:
            raise ReadError("check")
    destination, source = addresses
    if not 1 <= source <= 254 or not destination:
        raise ReadError("addresses are 1…254, and 255 to all")
    return Opened(source, destination, frame)


def is_for(opened: Opened, node: int) -> bool:
    """Tell whether a node takes the frame: not its own, and not one for another node."""
    return opened.source != node and opened.destination in (node, BROADCAST)


def cobs(data: bytes) -> bytes:
    """Remove zero bytes: each group begins with the distance to the next one."""
    out = bytearray()
    groups = data.split(b"\0")
    for index, group in enumerate(groups):
        while len(group) >= 254:
            out += b"\xff" + group[:254]
            group = group[254:]
            if not group and index == len(groups) - 1:
                return bytes(out)
        out += bytes((len(group) + 1,)) + group
    return bytes(out)


def uncobs(data: bytes) -> bytes:
    """Put the zero bytes back."""
    out = bytearray()
    position = 0
    while position < len(data):
        code = data[position]
        group = data[position + 1 : position + code]
        if not code or len(group) != code - 1 or 0 in group:
            raise ReadError("COBS")
        out += group
        position += code
        if code != 255 and position < len(data):
            out.append(0)
    return bytes(out)


def stream_frames(data: bytes, mtu: int = 0) -> list[bytes]:
    """Cut a byte stream into frames, each with its two zero bytes; longer pieces are skipped."""
    parts = [part for part in data.split(b"\0") if part]
    return [b"\0" + part + b"\0" for part in parts if len(part) <= max(mtu, 4096)]
