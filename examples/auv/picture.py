"""A photo of the sea bed: a picture that no compression makes small, as those of the sea are.

PNG of grey levels by the standard library: the picture is a stand-in for a camera's file, and
nothing else of an imaging library would be used.
"""

import math
import random
import struct
import zlib
from typing import Final

from examples.auv.world import World

WIDTH: Final = 128
HEIGHT: Final = 128
FIELD_M: Final = 60.0
"""Edge of the visible square, m."""
LEAST_BYTES: Final = 10 * 1024


def photo_of(world: World, north_m: float, east_m: float, rng: random.Random) -> bytes:
    """Return a PNG of the bed below a place: light on its slopes, particles in the water."""
    rows = bytearray()
    for row in range(HEIGHT):
        rows.append(0)  # filter of the row: none
        north = north_m + FIELD_M * (0.5 - row / HEIGHT)
        for column in range(WIDTH):
            east = east_m + FIELD_M * (column / WIDTH - 0.5)
            slope = world.bed_depth_m(north, east) - world.bed_depth_m(north - 1.0, east - 1.0)
            ripples = 10.0 * math.sin(north * 1.3 + 0.7 * math.sin(east * 0.5))
            level = 110.0 + 300.0 * slope + ripples + rng.gauss(0, 8.0)
            rows.append(int(min(255.0, max(0.0, level))))
    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 0, 0, 0, 0)
    picture = b"".join(
        (
            b"\x89PNG\r\n\x1a\n",
            _chunk(b"IHDR", header),
            _chunk(b"IDAT", zlib.compress(bytes(rows), 9)),
            _chunk(b"IEND", b""),
        )
    )
    assert len(picture) >= LEAST_BYTES
    return picture


def _chunk(kind: bytes, content: bytes) -> bytes:
    check = zlib.crc32(kind + content)
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", check)
