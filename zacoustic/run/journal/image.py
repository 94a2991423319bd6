"""The contents of a database's two files, read without opening the database.

SQLite writes a log of pages beside the file and copies them into the file now and then. Opening the
database triggers that copy, and so destroys evidence if one of the two is damaged. So this module
overlays the pages of the log on those of the file in memory, by SQLite's own rules: frames count
while salt and running check are right, up to the last frame that ends a commit.
"""

import struct
from typing import Final

PAGE_BYTES: Final = 4096
"""Page size of the files."""

_LOG_HEADER: Final = struct.Struct(">8I")
_FRAME_HEADER: Final = struct.Struct(">6I")
_MAGIC: Final = 0x377F0682
"""The lowest bit is the byte order of the running check: 1 is big-endian."""
_CHECKED_BYTES: Final = 24, 8
"""How many bytes of the log's header, and of each frame header, the check covers."""
_VERSIONS_AT: Final = slice(18, 20)
"""Where a database's header says whether it uses a log."""
_MOST_PAGES: Final = 1 << 18
"""A gigabyte: a log that claims more is damaged."""
_MASK: Final = 0xFFFFFFFF


def image_of(main: bytes, log: bytes, *, strict: bool = True) -> bytes:
    """Return the database as one file without a log; damage stays in it.

    Args:
        main: The file.
        log: The log; empty: none.
        strict: Frames need a right running check; otherwise the right salt is enough.
    """
    pages, pages_count = _committed(log, strict=strict)
    image = bytearray(main)
    if pages_count is not None:
        image = image[: pages_count * PAGE_BYTES].ljust(pages_count * PAGE_BYTES, b"\0")
        for number, page in pages.items():
            if number <= pages_count:
                image[(number - 1) * PAGE_BYTES : number * PAGE_BYTES] = page
    if len(image) > _VERSIONS_AT.stop:
        image[_VERSIONS_AT] = b"\1\1"
    return bytes(image)


def _committed(log: bytes, *, strict: bool) -> tuple[dict[int, bytes], int | None]:
    """Return the newest committed pages by number, and how many the database has; None: no log."""
    if len(log) < _LOG_HEADER.size:
        return {}, None
    magic, _, page_bytes, _, salt1, salt2, *check = _LOG_HEADER.unpack_from(log)
    if strict and (magic & ~1 != _MAGIC or page_bytes != PAGE_BYTES):
        return {}, None
    order = ">" if magic & 1 else "<"
    checked, checked_of_frame = _CHECKED_BYTES
    running = _check(order, log[:checked], (0, 0)) if strict else (0, 0)
    if strict and running != tuple(check):
        return {}, None
    committed: dict[int, bytes] = {}
    coming: dict[int, bytes] = {}
    pages_count: int | None = None
    at = _LOG_HEADER.size
    while at + _FRAME_HEADER.size + PAGE_BYTES <= len(log):
        number, ends_with, *rest = _FRAME_HEADER.unpack_from(log, at)
        begin = at + _FRAME_HEADER.size
        page = log[begin : begin + PAGE_BYTES]
        if strict:
            running = _check(order, log[at : at + checked_of_frame] + page, running)
            if rest != [salt1, salt2, *running] or number == 0:
                break
        elif rest[:2] != [salt1, salt2] or not 0 < number <= _MOST_PAGES:
            at = begin + PAGE_BYTES
            continue
        coming[number] = page
        if ends_with and ends_with <= _MOST_PAGES:
            committed |= coming
            coming.clear()
            pages_count = ends_with
        at = begin + PAGE_BYTES
    return committed, pages_count


def _check(order: str, data: bytes, before: tuple[int, int]) -> tuple[int, int]:
    """Continue the running check over more data."""
    first, second = before
    words = struct.unpack(f"{order}{len(data) // 4}I", data)
    for even, odd in zip(words[::2], words[1::2], strict=True):
        first = (first + even + second) & _MASK
        second = (second + odd + first) & _MASK
    return first, second
