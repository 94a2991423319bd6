"""Log lines and payloads, predicted from what followed the same octets before.

The problem: a vehicle's log lines are a few dozen sentences with different numbers in them, and its
payloads in JSON or CBOR the same names with different numbers after them; both cost a byte a
letter. The idea (prediction by partial matching): look at the last six letters; what followed them
in the texts known to both ends? If the next letter is among these, it costs a fraction of a bit. If
not, write an *escape* and look at the last five letters, and so on down to any letter. The share of
an escape follows from how many different letters were seen, and how often.

Numbers have the same form and differ in digits. So contexts and letters only record that a digit is
one: how many digits come before and after the point is learnt from any number in that position.
Which digit it is costs a symbol of its own, whose shares follow what came after the same octets
before. The first context of all treats a number of any length as one digit: it predicts which name
follows the value of which other. Floats of CBOR are spelled as digits, too (`spelling`).

Both ends know the lines of the model (those that a fit has found, or the shipped ones), the
stream's last lines at the reference, which count more, and the text itself as far as it is written.

Integers only, and bounded: a table per context of the known lines, and at most nine lookups for a
letter.
"""

from collections.abc import Iterable
from functools import cache
from typing import Final

from zacoustic.core.values.dense.coder.arithmetic import Coder
from zacoustic.core.values.dense.text.examples import payload_examples
from zacoustic.core.values.dense.text.lines import LINES
from zacoustic.core.values.dense.text.spelling import spelled, unspelled
from zacoustic.core.values.payload import PayloadError

LONGEST_BYTES: Final = 1024
"""Longest modelled text, spelled, bytes: it bounds how long reading a short frame can take."""

RECENT_LINES: Final = 8
"""How many of a stream's last lines are kept for the next one."""

_ORDER: Final = 6
_LONG_ORDER: Final = 9  # of the context in which numbers are one digit
_DIGIT: Final = ord("0")
_END: Final = 256
_LETTERS: Final[list[int]] = [*range(_DIGIT + 1), *range(_DIGIT + 10, _END + 1)]
# Shares: for each time a letter was seen; escape after one letter, and for each of several.
_SEEN, _ESCAPE_ONE, _ESCAPE = 3, 1, 2
_RECENT_COUNTS: Final = 3
_DIGIT_ORDERS: Final = (6, 3)
_DIGIT_BASE, _DIGIT_SEEN = 4, 4

Counts = dict[bytes, dict[int, int]]


class TextModel:
    """Codes texts, given the lines that both ends know.

    Args:
        lines: In any order, each as often as it is likely; spelled.
    """

    def __init__(self, lines: Iterable[bytes] = ()) -> None:
        self._known = _Memory()
        for line in lines:
            self._known.learn(line, 1)

    def takes(self, content: bytes) -> bool:
        """Return whether `code` can write a text."""
        return len(content) <= LONGEST_BYTES and len(spelled(content)) <= LONGEST_BYTES

    def code(
        self, coder: Coder, content: bytes, recent: Iterable[bytes], longest: int | None
    ) -> bytes:
        """Write or read a text.

        Args:
            coder: The writer or reader.
            content: The text to write, one that it `takes`; a reader passes b"".
            recent: The last lines of the stream.
            longest: The most bytes; None: only the general bound.

        Raises:
            PayloadError: What is read is too long, or no text.
        """
        fresh = _Memory()
        for line in recent:
            fresh.learn(spelled(line), _RECENT_COUNTS)
        trail = _Trail()
        for octet in (*spelled(content), _END) if not coder.is_reader else iter(int, 1):
            contexts = trail.contexts()
            letter = self._code_letter(coder, _letter(octet), contexts, fresh.letters)
            fresh.count(contexts, letter, 1)
            if letter == _END:
                break
            if len(trail.octets) >= LONGEST_BYTES:
                raise PayloadError(f"a text longer than {LONGEST_BYTES} bytes")
            if letter == _DIGIT:
                letter += self._code_digit(coder, octet - _DIGIT, trail.octets, fresh)
            trail.append(letter)
        found = unspelled(bytes(trail.octets))
        if longest is not None and len(found) > longest:
            raise PayloadError(f"a text longer than {longest} bytes")
        return found

    def _code_letter(self, coder: Coder, letter: int, contexts: list[bytes], fresh: Counts) -> int:
        known = self._known.letters
        excluded: set[int] = set()
        for context in contexts:
            counts, more = known.get(context), fresh.get(context)
            if counts is None:
                if more is None:
                    continue
                counts = more
            elif more is not None:
                counts = dict(counts)
                for each, count in more.items():
                    counts[each] = counts.get(each, 0) + count
            candidates = sorted(counts.keys() - excluded)
            if not candidates:
                continue
            different = len(candidates)
            shares = [_SEEN * counts[each] for each in candidates]
            shares.append(_ESCAPE_ONE if different == 1 else _ESCAPE * different)
            place = candidates.index(letter) if letter in candidates else different
            found = coder.choice(shares, place)
            if found < different:
                return candidates[found]
            excluded.update(candidates)
        others = [each for each in _LETTERS if each not in excluded]
        if not others:
            raise PayloadError("a text of no letter")
        place = others.index(letter) if letter in others else 0
        return others[coder.uniform(len(others), place)]

    def _code_digit(self, coder: Coder, digit: int, before: bytearray, fresh: "_Memory") -> int:
        shares = [_DIGIT_BASE] * 10
        contexts = _digit_contexts(before)
        for context in contexts:
            for memory in (self._known, fresh):
                for each, count in memory.digits.get(context, {}).items():
                    shares[each] += _DIGIT_SEEN * count
        found = coder.choice(shares, digit)
        fresh.count_digit(contexts, found)
        return found


@cache
def shipped_model() -> TextModel:
    """Return the model for streams without known texts; made at its first use."""
    return TextModel([*(line.encode() for line in LINES), *payload_examples()])


class _Memory:
    """Which letters followed which contexts."""

    def __init__(self) -> None:
        self.letters: Counts = {}
        self.digits: Counts = {}

    def learn(self, line: bytes, weight: int) -> None:
        """Add a line with a weight."""
        trail = _Trail()
        for octet in (*line, _END):
            letter = _letter(octet)
            self.count(trail.contexts(), letter, weight)
            if letter == _DIGIT:
                self.count_digit(_digit_contexts(trail.octets), octet - _DIGIT)
            if octet != _END:
                trail.append(octet)

    def count(self, contexts: list[bytes], letter: int, weight: int) -> None:
        for context in contexts:
            counts = self.letters.get(context)
            if counts is None:
                self.letters[context] = {letter: weight}
            else:
                counts[letter] = counts.get(letter, 0) + weight

    def count_digit(self, contexts: list[bytes], digit: int) -> None:
        for context in contexts:
            counts = self.digits.setdefault(context, {})
            counts[digit] = counts.get(digit, 0) + 1


class _Trail:
    """The letters before the next one.

    Attributes:
        octets: These letters with their digits.
    """

    def __init__(self) -> None:
        self.octets = bytearray()
        self._letters = bytearray()
        self._short = bytearray()  # with each number as one digit

    def append(self, octet: int) -> None:
        """Append an octet."""
        letter = _letter(octet)
        self.octets.append(octet)
        self._letters.append(letter)
        if letter != _DIGIT or self._short[-1:] != b"0":
            self._short.append(letter)

    def contexts(self) -> list[bytes]:
        """Return the next letter's contexts, longest first; one at the start is marked."""
        tail = bytes(self._letters[-_ORDER:])
        found = []
        if len(self._short) >= _ORDER and tail[-1] != _DIGIT:
            found.append(b"\1" + self._short[-_LONG_ORDER:])
        if len(self._letters) <= _ORDER:
            found.append(b"\0" + tail)
        found += [tail[start:] for start in range(len(tail) + 1)]
        return found


def _letter(octet: int) -> int:
    """Return an octet as a letter, in which all digits are alike."""
    return _DIGIT if _DIGIT < octet < _DIGIT + 10 else octet


def _digit_contexts(before: bytearray) -> list[bytes]:
    return [bytes(before[-order:]) for order in _DIGIT_ORDERS if len(before) >= order]
