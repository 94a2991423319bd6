"""Is a secret in what a program has written? In files, recordings, logs and answers."""

import base64
import lzma
import zlib
from collections.abc import Iterable, Iterator
from pathlib import Path

from zacoustic.run.recording.reading import RecordingReader, is_recording

_LEAST_BYTES = 8
"""Half of a key is as bad as all of it to who has to guess the rest."""


def forms_of(secret: bytes) -> set[bytes]:
    """Return what a secret looks like: raw, in hexadecimal, in base64 at any place in a text.

    Pieces of eight bytes count, so that one that was cut off is found too.
    """
    forms: set[bytes] = set()
    for start in range(0, len(secret) - _LEAST_BYTES + 1, _LEAST_BYTES):
        piece = secret[start : start + _LEAST_BYTES]
        forms |= {piece, repr(piece)[2:-1].encode()}
        for text in (piece.hex(), piece.hex(" "), piece.hex(":")):
            forms |= {text.encode(), text.upper().encode()}
        for shift in range(3):
            # Digits that the bytes before or behind have a part in are left out.
            digits = base64.b64encode(bytes(shift) + piece)
            inner = digits[-(-shift * 8 // 6) : (shift + len(piece)) * 8 // 6]
            forms |= {inner, inner.translate(bytes.maketrans(b"+/", b"-_"))}
        forms.add(b", ".join(str(each).encode() for each in piece))
    return forms


def found_in(
    folder: Path, secrets: Iterable[bytes], *, apart_from: Iterable[Path] = ()
) -> list[str]:
    """Return the files below a folder that have a secret in them."""
    forms = set().union(*map(forms_of, secrets))
    passed = {path.resolve() for path in apart_from}
    return [
        str(path)
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.resolve() not in passed
        if any(form in content for content in _contents(path) for form in forms)
    ]


def _contents(path: Path) -> Iterator[bytes]:
    """Return what a file holds, as it is and unpacked."""
    content = path.read_bytes()
    yield content
    for unpack in (lzma.decompress, zlib.decompress):
        try:
            yield unpack(content)
        except (lzma.LZMAError, zlib.error):
            continue
    if is_recording(path):
        for message in RecordingReader(path):
            yield message.data
