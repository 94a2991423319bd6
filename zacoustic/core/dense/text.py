"""Log lines, by what letters followed the same letters before.

The problem: a line of text of a vehicle is the same few dozen sentences with other numbers in
them, and costs a byte a letter. The idea (prediction by partial matching): look at the six letters
before; what followed them in the texts known to both ends? If the next letter is among it, it costs
a fraction of a bit; if not, say so (*escape*) and look at the five letters before, and so on down
to any letter. What an escape is worth follows from how many different letters were seen, and how
often.

Known to both ends are the lines of the model (those that a fit has found, or the shipped ones), and
the last lines of this stream that the reference had, which count more.

Integers only, and bounded: a table per context of the known lines, a letter at most seven lookups.
"""

from collections.abc import Iterable
from typing import Final

from zacoustic.core.dense.arithmetic import Coder
from zacoustic.core.payload import PayloadError

LONGEST_BYTES: Final = 1024
"""Longest text that is modelled, bytes: it bounds what a short frame can cost to read."""

RECENT_LINES: Final = 8
"""How many of a stream's last lines are kept for the next."""

_ORDER: Final = 6
_END: Final = 256
_SYMBOLS: Final = 257
# Longer contexts that were seen only once say little where numbers stand.
_LEAST_SEEN: Final = 2
_RECENT_COUNTS: Final = 3

Counts = dict[bytes, dict[int, int]]


class TextModel:
    """Texts, given the lines that both ends know.

    Args:
        lines: Any order, each as often as it is likely.
    """

    def __init__(self, lines: Iterable[bytes] = ()) -> None:
        self._known: Counts = {}
        for line in lines:
            _learn(self._known, line, 1)

    def code(
        self, coder: Coder, content: bytes, recent: Iterable[bytes], longest: int | None
    ) -> bytes:
        """Write or read a text.

        Args:
            coder: Where.
            content: To be written, at most `LONGEST_BYTES`; a reader passes b"".
            recent: The last lines of the stream.
            longest: Most bytes there can be; None: `LONGEST_BYTES`.

        Raises:
            PayloadError: What is read is too long.
        """
        fresh: Counts = {}
        for line in recent:
            _learn(fresh, line, _RECENT_COUNTS)
        limit = LONGEST_BYTES if longest is None else min(longest, LONGEST_BYTES)
        written = bytearray()
        for octet in (*content, _END) if not coder.is_reader else iter(int, 1):
            symbol = self._code_symbol(coder, octet, _contexts(written), fresh)
            if symbol == _END:
                break
            if len(written) >= limit:
                raise PayloadError(f"a text longer than {limit} bytes")
            written.append(symbol)
        return bytes(written)

    def _code_symbol(self, coder: Coder, symbol: int, contexts: list[bytes], fresh: Counts) -> int:
        excluded: set[int] = set()
        for context in contexts:
            counts = self._known.get(context, {})
            if context in fresh:
                counts = dict(counts)
                for octet, count in fresh[context].items():
                    counts[octet] = counts.get(octet, 0) + count
            candidates = sorted(octet for octet in counts if octet not in excluded)
            seen = sum(counts[octet] for octet in candidates)
            if not candidates or (len(context) > 1 and seen < _LEAST_SEEN):
                continue
            different = len(candidates)
            shares = [2 * counts[octet] * (2 * seen - different) for octet in candidates]
            shares.append(2 * seen * different)
            found = coder.choice(
                shares, candidates.index(symbol) if symbol in candidates else different
            )
            if found < different:
                return candidates[found]
            excluded.update(candidates)
        others = [octet for octet in range(_SYMBOLS) if octet not in excluded]
        if not others:
            raise PayloadError("a text of no letter")
        place = others.index(symbol) if symbol in others else 0
        return others[coder.uniform(len(others), place)]


def _contexts(written: bytes | bytearray) -> list[bytes]:
    """The contexts of the next letter, the longest first; one that begins the text is marked."""
    tail = bytes(written[-_ORDER:])
    contexts = [tail[start:] for start in range(len(tail) + 1)]
    if len(written) <= _ORDER:
        contexts[0] = b"\0" + tail
        if tail:
            contexts.insert(1, tail)
        else:
            contexts.append(b"")
    return contexts


def _learn(counts: Counts, line: bytes, weight: int) -> None:
    for place, octet in enumerate((*line, _END)):
        for context in _contexts(line[:place]):
            table = counts.setdefault(context, {})
            table[octet] = table.get(octet, 0) + weight
