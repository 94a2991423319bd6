"""The arithmetic coder: what is written is read, to a fraction of a bit, and nothing else is."""

import random
from collections.abc import Callable
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.values.dense.coder.arithmetic import Coder
from zacoustic.core.values.dense.coder.curve import MOST_HOLD, Curve
from zacoustic.core.values.dense.coder.reader import Reader
from zacoustic.core.values.dense.coder.shares import MARKER
from zacoustic.core.values.dense.coder.writer import Writer
from zacoustic.core.values.payload import PayloadError

Symbol = tuple[str, int, int, int]


@st.composite
def symbols(draw: st.DrawFn) -> Symbol:
    """A symbol of any kind: kind, value, and two parameters."""
    kind = draw(st.sampled_from(("flag", "uniform", "raw", "choice", "number")))
    if kind == "flag":
        return kind, draw(st.integers(0, 1)), draw(st.integers(1, (1 << 16) - 1)), 0
    if kind == "raw":
        width = draw(st.integers(0, 70))
        return kind, draw(st.integers(0, (1 << width) - 1)), width, 0
    size = draw(st.integers(2, 1 << 22) if kind != "choice" else st.integers(2, 40))
    center = draw(st.integers(-size * 16, size * 32))
    return kind, draw(st.integers(0, size - 1)), size, center


def code(coder: Coder, symbol: Symbol) -> int:
    """Write a symbol, or read one."""
    kind, value, size, center = symbol
    match kind:
        case "flag":
            return int(coder.flag(size, bool(value)))
        case "uniform":
            return coder.uniform(size, value)
        case "raw":
            return coder.raw(size, value)
        case "choice":
            return coder.choice([1 + n % 5 for n in range(size)], value)
        case _:
            hold = abs(center) * 7 % MOST_HOLD
            curve = Curve(size, center, 1 + abs(center) % 90_000, size // 3, hold)
            return coder.number(curve, value)


@given(st.lists(symbols(), max_size=40), st.integers(1, 64), st.integers(0, 1 << 32))
def test_every_symbol_is_read_as_it_was_written(
    written: list[Symbol], ways: int, check: int
) -> None:
    writer = Writer()
    for symbol in written:
        code(writer, symbol)
    block = writer.finish(ways, check)
    assert block[0] & 0xC0 == MARKER
    reader = Reader(block)
    for symbol in written:
        assert code(reader, (symbol[0], 0, *symbol[2:])) == symbol[1]
    reader.check(ways, check)
    assert reader.bits == writer.bits


def test_a_block_is_as_long_as_its_symbols_are_improbable() -> None:
    writer = Writer()
    for _ in range(1000):
        writer.flag(536, False)
    assert len(writer.finish(1, 0)) == 2  # 1000 flags of 0.0118 bits each: 11.8 bits and the marker
    for _ in range(1000):
        writer.flag(1 << 15, False)
    assert 126 <= len(writer.finish(1, 0)) <= 128


def test_a_rewound_writer_has_forgotten() -> None:
    writer, other = Writer(), Writer()
    for each in (writer, other):
        each.uniform(1000, 7)
    mark = writer.mark()
    writer.raw(60, 12345)
    writer.rewind(mark)
    for each in (writer, other):
        each.uniform(50, 49)
    assert writer.finish(8, 5) == other.finish(8, 5)


def test_another_check_is_refused_as_often_as_there_are_ways() -> None:
    rng, accepted = random.Random(5), 0
    for _ in range(2000):
        writer = Writer()
        writer.raw(20, rng.getrandbits(20))
        block = writer.finish(8, rng.getrandbits(32))
        reader = Reader(block)
        reader.raw(20)
        try:
            reader.check(8, rng.getrandbits(32))
        except PayloadError:
            continue
        accepted += 1
    assert accepted < 2000 / 8


def test_a_longer_block_for_the_same_symbols_is_refused() -> None:
    writer = Writer()
    writer.raw(30, 123456)
    block = writer.finish(1, 0) + b"\0"
    reader = Reader(block)
    reader.raw(30)
    with pytest.raises(PayloadError):
        reader.check(1, 0)


def test_a_short_block_does_not_make_its_reader_work_for_long() -> None:
    reader, read = Reader(b"\xc0"), 0
    with suppress(PayloadError):
        for _ in range(1000):
            reader.raw(1)
            read += 1
    assert 6 < read <= 6 + 64 + 2


def test_random_blocks_are_read_or_refused(count: Callable[[int], int]) -> None:
    rng = random.Random(2)
    for _ in range(count(100_000)):
        reader = Reader(rng.randbytes(rng.randint(1, 9)))
        try:
            for _ in range(12):
                kind = rng.choice(("flag", "uniform", "raw", "choice", "number"))
                code(reader, (kind, 0, rng.randint(2, 40), rng.randint(-99, 999)))
        except PayloadError:
            continue
