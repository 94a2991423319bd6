"""Annex B: texts. Written from docs/wire.md alone."""

import json
import math
import struct
from collections import Counter
from collections.abc import Iterable
from functools import cache
from pathlib import Path

from tests.independent.arithmetic import Coder, Sink, Source
from tests.independent.errors import ReadError

MOST = 1024
_END = 256
_DIGIT = 0x30
_LETTERS = [each for each in range(_END + 1) if not _DIGIT < each <= _DIGIT + 9]
_FORMS = {0xFA: ">f", 0xFB: ">d"}
_LINE_FEED = 0x0A
_NO_FLOAT = 0x21


def spelled(text: bytes) -> bytes:
    """Spell the floats in a text."""
    found, place = bytearray(), 0
    while place < len(text):
        byte = text[place]
        found.append(byte)
        place += 1
        if byte not in _FORMS:
            continue
        size = struct.calcsize(_FORMS[byte])
        raw = text[place : place + size]
        digits = _digits(byte, raw) if len(raw) == size else None
        if digits is None:
            found.append(_NO_FLOAT)
        else:
            found += digits + bytes((_LINE_FEED,))
            place += size
    return bytes(found)


def _digits(kind: int, raw: bytes) -> bytes | None:
    (number,) = struct.unpack(_FORMS[kind], raw)
    if not math.isfinite(number):
        return None
    if kind == 0xFB:
        return repr(number).encode()
    for k in range(1, 10):
        digits = f"{number:.{k}g}"
        try:
            if struct.pack(">f", float(digits)) == raw:
                return digits.encode()
        except OverflowError:
            continue
    return None


def read_spelling(text: bytes) -> bytes:
    """Return the text that is spelled so."""
    found, place = bytearray(), 0
    while place < len(text):
        byte = text[place]
        found.append(byte)
        place += 1
        if byte not in _FORMS:
            continue
        if text[place : place + 1] == bytes((_NO_FLOAT,)):
            place += 1
            continue
        end = text.find(_LINE_FEED, place)
        try:
            found += struct.pack(_FORMS[byte], float(text[place : max(end, place)]))
        except (ValueError, OverflowError) as error:
            raise ReadError("no float") from error
        place = end + 1
    if spelled(bytes(found)) != text:
        raise ReadError("not the spelling of a text")
    return bytes(found)


def letter(byte: int) -> int:
    return _DIGIT if _DIGIT <= byte <= _DIGIT + 9 else byte


def contexts(before: bytes) -> list[bytes]:
    """Return the contexts of the letter behind these bytes."""
    a = bytes(map(letter, before))
    b = bytearray()
    for each in a:
        if each != _DIGIT or b[-1:] != bytes((_DIGIT,)):
            b.append(each)
    found = []
    if len(b) >= 6 and a[-1] != _DIGIT:
        found.append(b"\x01" + b[-9:])
    if len(a) <= 6:
        found.append(b"\x00" + a)
    last = a[-6:]
    return [*found, *(last[place:] for place in range(len(last) + 1))]


def _digit_contexts(before: bytes) -> list[bytes]:
    return [before[-size:] for size in (6, 3) if len(before) >= size]


class Counts:
    """How often which letters and digits followed which contexts."""

    def __init__(self) -> None:
        self.letters: dict[bytes, Counter[int]] = {}
        self.digits: dict[bytes, Counter[int]] = {}

    def learn(self, text: bytes, times: int) -> None:
        """Count a spelled text."""
        for place, byte in enumerate((*text, _END)):
            self.count(text[:place], byte, times)

    def count(self, before: bytes, byte: int, times: int) -> None:
        for context in contexts(before):
            self.letters.setdefault(context, Counter())[letter(byte)] += times
        if letter(byte) == _DIGIT:
            for context in _digit_contexts(before):
                self.digits.setdefault(context, Counter())[byte - _DIGIT] += 1


@cache
def known_texts() -> Counts:
    """Learn the texts that both ends know."""
    path = Path(__file__).parent.parent / "golden" / "arithmetic.json"
    counts = Counts()
    for each in json.loads(path.read_text(encoding="utf-8"))["texts"]:
        counts.learn(each.encode() if isinstance(each, str) else bytes.fromhex(each["hex"]), 1)
    return counts


def known(texts: Iterable[str]) -> Counts:
    """Learn the texts of a model."""
    counts = Counts()
    for each in texts:
        counts.learn(each.encode(), 1)
    return counts


def fits(text: bytes) -> bool:
    return len(spelled(text)) <= MOST


def code(coder: Coder, counts: Counts, recent: Iterable[bytes] = (), text: bytes = b"") -> bytes:
    """Read a text, or write it."""
    own = Counts()
    for each in recent:
        own.learn(spelled(each), 3)
    wanted = (*spelled(text), _END)
    before = b""
    while True:
        byte = wanted[min(len(before), len(wanted) - 1)]
        found = _letter(coder, before, counts, own, letter(byte))
        if found == _END:
            return read_spelling(before)
        if len(before) == MOST:
            raise ReadError("too long")
        if found == _DIGIT:
            found += _digit(coder, before, counts, own, byte - _DIGIT)
        own.count(before, found, 1)
        before += bytes((found,))


def _letter(coder: Coder, before: bytes, counts: Counts, own: Counts, wanted: int) -> int:
    past: set[int] = set()
    for context in contexts(before):
        times = Counter(counts.letters.get(context, {}))
        times.update(own.letters.get(context, {}))
        candidates = sorted(times.keys() - past)
        if not candidates:
            continue
        many = len(candidates)
        shares = [*(3 * times[each] for each in candidates), 1 if many == 1 else 2 * many]
        index = candidates.index(wanted) if wanted in candidates else many
        index = coder.shares(shares, index)
        if index < many:
            return candidates[index]
        past.update(candidates)
    others = [each for each in _LETTERS if each not in past]
    if not others:
        raise ReadError("no letter")
    return others[coder.one_of(len(others), others.index(wanted) if wanted in others else 0)]


def _digit(coder: Coder, before: bytes, counts: Counts, own: Counts, wanted: int) -> int:
    shares = [4] * 10
    for context in _digit_contexts(before):
        for memory in (counts, own):
            for digit, times in memory.digits.get(context, {}).items():
                shares[digit] += 4 * times
    return coder.shares(shares, wanted)


def read_block(data: bytes) -> bytes:
    """Read bytes without a type (section 7.1)."""
    source = Source(data)
    text = code(source, known_texts())
    source.end(0)
    return text


def write_block(text: bytes) -> bytes:
    """Return the block of bytes without a type."""
    sink = Sink()
    code(sink, known_texts(), text=text)
    return sink.end(0)
