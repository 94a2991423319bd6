"""Texts: any text comes back, what was seen before is cheap, nothing is dearer than plainly."""

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.dense.arithmetic import Reader, Writer
from zacoustic.core.dense.lines import LINES
from zacoustic.core.dense.text import TextModel

MODEL = TextModel(LINES)


def cost(line: str, recent: tuple[bytes, ...] = ()) -> int:
    """Bits of a line, which must come back."""
    writer = Writer()
    MODEL.code(writer, line.encode(), recent, None)
    bits = writer.bits
    reader = Reader(writer.finish(1, 0))
    assert MODEL.code(reader, b"", recent, None).decode() == line
    return bits


@given(st.text(max_size=40), st.lists(st.text(max_size=20), max_size=3))
def test_any_text_comes_back(line: str, recent: list[str]) -> None:
    cost(line, tuple(each.encode() for each in recent))


def test_a_known_line_costs_little_and_an_unknown_one_no_more_than_its_letters() -> None:
    known = "INF battery: 26.3 V, 3.4 A, 82 %"
    assert cost(known) < 2 * len(known)
    other = "WRN battery low: 20.9 V, 11 %"
    assert cost(other) < 3.5 * len(other)
    fresh = "Xylophon quartz vexes jumbled glyph"
    assert cost(fresh) < 9 * len(fresh)


def test_a_line_like_the_last_ones_is_cheaper() -> None:
    line = "zq: 14 kHz ping 0047 heard"
    assert cost(line, (b"zq: 14 kHz ping 0046 heard",)) < cost(line) // 2
