"""Log lines and payloads, by what octets followed the same octets before.

The problem: a line of text of a vehicle is the same few dozen sentences with other numbers in
them, a payload in JSON or CBOR the same names with other numbers behind them; both cost a byte a
letter. The idea (prediction by partial matching): look at the six letters before; what followed
them in the texts known to both ends? If the next letter is among it, it costs a fraction of a bit;
if not, say so (*escape*) and look at the five letters before, and so on down to any letter. What an
escape is worth follows from how many different letters were seen, and how often.

Numbers are the same in form and differ in digits. So contexts and letters know of a digit only that
it is one: how many there are before and behind the point is learnt from any number in that place.
Which digit it is costs a symbol of its own, whose shares follow what stood behind the same octets
before. First of all stands a context in which a number, however long, is one digit: it tells which
name follows the value of which other. Floats of CBOR are spelled as digits, too (`spelling`).

Known to both ends are the lines of the model (those that a fit has found, or the shipped ones), the
last lines of this stream that the reference had, which count more, and the text itself as far as it
is written.

Integers only, and bounded: a table per context of the known lines, a letter at most nine lookups.
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
"""Longest text that is modelled, spelled, bytes: it bounds what a short frame can cost to read."""

RECENT_LINES: Final = 8
"""How many of a stream's last lines are kept for the next."""

_ORDER: Final = 6
_LONG_ORDER: Final = 9  # of the context in which numbers are one digit
_DIGIT: Final = ord("0")
_END: Final = 256
_LETTERS: Final[list[int]] = [*range(_DIGIT + 1), *range(_DIGIT + 10, _END + 1)]
# Shares: each time a letter was seen; escape where one letter was seen, and for each of several.
_SEEN, _ESCAPE_ONE, _ESCAPE = 3, 1, 2
_RECENT_COUNTS: Final = 3
_DIGIT_ORDERS: Final = (6, 3)
_DIGIT_BASE, _DIGIT_SEEN = 4, 4

Counts = dict[bytes, dict[int, int]]


class TextModel:
    """Texts, given the lines that both ends know.

    Args:
        lines: Any order, each as often as it is likely; spelled.
    """

    def __init__(self, lines: Iterable[bytes] = ()) -> None:
        self._known = _Memory()
        for line in lines:
            self._known.learn(line, 1)

    def takes(self, content: bytes) -> bool:
        """Tell whether `code` can write a text."""
        return len(content) <= LONGEST_BYTES and len(spelled(content)) <= LONGEST_BYTES

    def code(
        self, coder: Coder, content: bytes, recent: Iterable[bytes], longest: int | None
    ) -> bytes:
        """Write or read a text.

        Args:
            coder: Where.
            content: To be written, one that it `takes`; a reader passes b"".
            recent: The last lines of the stream.
            longest: Most bytes there can be; None: no bound but that.

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
    """What is known of texts of which nothing is known; made when it is needed first."""
    return TextModel([*(line.encode() for line in LINES), *payload_examples()])


class _Memory:
    """What followed what."""

    def __init__(self) -> None:
        self.letters: Counts = {}
        self.digits: Counts = {}

    def learn(self, line: bytes, weight: int) -> None:
        """Take a line in that counts as so many."""
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
        octets: They, with their digits.
    """

    def __init__(self) -> None:
        self.octets = bytearray()
        self._letters = bytearray()
        self._short = bytearray()  # where a number is one digit

    def append(self, octet: int) -> None:
        """Go on."""
        letter = _letter(octet)
        self.octets.append(octet)
        self._letters.append(letter)
        if letter != _DIGIT or self._short[-1:] != b"0":
            self._short.append(letter)

    def contexts(self) -> list[bytes]:
        """The contexts of the next letter, the longest first; one that begins a text is marked."""
        tail = bytes(self._letters[-_ORDER:])
        found = []
        if len(self._short) >= _ORDER and tail[-1] != _DIGIT:
            found.append(b"\1" + self._short[-_LONG_ORDER:])
        if len(self._letters) <= _ORDER:
            found.append(b"\0" + tail)
        found += [tail[start:] for start in range(len(tail) + 1)]
        return found


def _letter(octet: int) -> int:
    """A letter, in which all digits are alike."""
    return _DIGIT if _DIGIT < octet < _DIGIT + 10 else octet


def _digit_contexts(before: bytearray) -> list[bytes]:
    return [bytes(before[-order:]) for order in _DIGIT_ORDERS if len(before) >= order]
