"""The rest of a sample, all parts that are no integers, as symbols.

Most of it is the same as in the sample before (a name, a list that seldom changes), which costs a
fraction of a bit. `text` codes new texts and bytes, with the lines that both ends know and typical
payloads in JSON and CBOR. That is a guess: other octets cost more that way than plainly, and so
does a text in another language; `StreamCodec` then codes the whole sample plainly. Long texts are
always plain, since modelling takes time for every letter.
"""

from collections.abc import Sequence
from typing import Any, Final

from zacoustic.core.values.dense.coder.arithmetic import Coder
from zacoustic.core.values.dense.coder.reader import Reader
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.dense.model.layout import Content, Remainder, Row
from zacoustic.core.values.dense.text.text import RECENT_LINES, TextModel, shipped_model
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.payload.bits import BitSink, BitSource

_SAME: Final = 1 << 13  # how often the rest equals that of the reference, 2**-16
_LONG: Final = 1 << 11  # how often a text is too long to be modelled


class RestCodec:
    """Writes and reads the rest of a stream's samples.

    Args:
        remainders: The parts of the rest.
        lines: Typical texts of the stream; none: the shipped ones.
    """

    def __init__(self, remainders: Sequence[Remainder], lines: Sequence[str] = ()) -> None:
        self._remainders = remainders
        self._models: dict[Content, TextModel] = {}
        if any(remainder.content is not Content.OTHER for remainder in remainders):
            shipped = shipped_model()
            fitted = TextModel(line.encode() for line in lines) if lines else shipped
            self._models = {Content.TEXT: fitted, Content.BYTES: shipped}

    def code(
        self, coder: Coder, row: Row, rest: list[Any], known: list[Any], *, plainly: bool
    ) -> list[Any]:
        """Write or read the rest of a sample.

        Args:
            coder: The writer or reader.
            row: The sample's row, complete.
            rest: The sample's rest; a reader fills it in.
            known: What is known of the rest of the sample before; not changed.
            plainly: Whether to use no model.

        Returns:
            What the next sample gets as `known`.

        Raises:
            PayloadError: What is read is not of the type.
        """
        if not self._remainders:
            return known
        known = list(known)
        for place, remainder in enumerate(self._remainders):
            guard = remainder.guard
            if guard is not None and row[guard[0]] != guard[1]:
                continue
            value, before = rest[place], known[place] or ()
            if plainly:
                value = _code_plainly(coder, remainder, value)
            elif remainder.content is Content.OTHER:
                if not before or not coder.flag(_SAME, _is_same(value, before[-1])):
                    value = _code_plainly(coder, remainder, value)
                else:
                    value = before[-1]
            else:
                value = self._code_octets(coder, remainder, value, before)
            rest[place] = value
            kept = 1 if remainder.content is Content.OTHER else RECENT_LINES
            known[place] = (*before, _octets(value))[-kept:]
        return known

    def _code_octets(
        self,
        coder: Coder,
        remainder: Remainder,
        value: Any,  # noqa: ANN401
        before: tuple[Any, ...],
    ) -> Any:  # noqa: ANN401
        octets = b"" if value is None else _octets(value)
        if before and coder.flag(_SAME, octets == before[-1]):
            octets = before[-1]
        else:
            model = self._models[remainder.content]
            if coder.flag(_LONG, not model.takes(octets)):
                return _code_plainly(coder, remainder, value)
            octets = model.code(coder, octets, before, remainder.longest)
            if len(octets) < remainder.shortest:
                raise PayloadError(f"a text shorter than {remainder.shortest} bytes")
        if remainder.content is Content.BYTES:
            return octets
        try:
            return octets.decode()
        except UnicodeDecodeError:
            raise PayloadError("a text that is not UTF-8") from None


def plain_bits(rest: Sequence[Any]) -> int:
    """Return the approximate cost of texts and bytes when coded plainly, bits."""
    return sum(7 * len(value) for value in rest if isinstance(value, (str, bytes)))


def _octets(value: Any) -> Any:  # noqa: ANN401
    return value.encode() if isinstance(value, str) else value


def _code_plainly(coder: Coder, remainder: Remainder, value: Any) -> Any:  # noqa: ANN401
    """Write or read a part of the rest as `packed` does."""
    if isinstance(coder, Reader):
        return remainder.packing.read(_Source(coder))
    remainder.packing.write(_Sink(coder), value)
    return value


def _is_same(value: Any, old: Any) -> bool:  # noqa: ANN401
    """Return whether both are the same payload: zeros differ by sign, and NaN equals itself."""
    return bool(value == old) and repr(value) == repr(old)


class _Sink(BitSink):
    """A writer as the destination of a packing's bits."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer

    def write(self, number: int, width: int) -> None:
        self._writer.raw(width, number)


class _Source(BitSource):
    """A reader as the source of a packing's bits."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader

    @property
    def bits_left(self) -> int:
        return self._reader.bits_left

    def read(self, width: int) -> int:
        return self._reader.raw(width)

    def skip(self, width: int) -> int:
        return self._reader.raw(width)
