"""The erasure code: any K fragments of a block, of whichever kind, give it back."""

import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.transport.objects.code.code import (
    BLOCK_FRAGMENTS,
    LAST_INDEX,
    MOST_FRAGMENTS,
    Block,
    Fragments,
    Layout,
    coefficients,
)
from zacoustic.core.transport.objects.code.galois import combine, inverse, products


@given(st.integers(1, 255), st.integers(0, 255), st.integers(0, 255))
def test_field_is_a_field(factor: int, one: int, other: int) -> None:
    table = products(factor)
    assert table[one] ^ table[other] == table[one ^ other]
    assert products(one)[factor] == table[one]
    assert table[inverse(factor)] == 1


def test_polynomial() -> None:
    assert products(2)[0x80] == 0x1D


def test_combination_of_rows() -> None:
    rows = [b"\x01\x02", b"\x80\x00"]
    assert combine(b"\x01\x02", rows) == int.from_bytes(b"\x1c\x02", "big")
    assert combine(b"\x00\x01", rows) == 0x8000


@given(st.integers(1, 60), st.integers(1, 20), st.randoms(use_true_random=False))
def test_any_fragments_give_the_block_back(size: int, width: int, rng: random.Random) -> None:
    coded = rng.randbytes(size * width)
    whole = Fragments(coded, width)
    layout = whole.layout
    block = Block(0, size, width)
    offered = [*range(size), *(layout.repair(0, seed) for seed in range(3 * size + 8))]
    rng.shuffle(offered)
    taken = 0
    for index in offered:
        if not block.lacking:
            break
        if index < size:
            assert block.add_source(index, whole.fragment(index))
        else:
            block.add_repair(layout.seed(index), whole.fragment(index))
        taken += 1
    assert block.content() == coded
    assert taken <= size + 4


def test_hardly_a_fragment_is_too_many() -> None:
    rng = random.Random(5)
    coded = rng.randbytes(40 * 8)
    whole = Fragments(coded, 8)
    superfluous = 0
    for trial in range(300):
        block = Block(0, 40, 8)
        for seed in range(trial, trial + 60):
            if not block.lacking:
                break
            block.add_repair(seed, whole.fragment(whole.layout.repair(0, seed)))
            superfluous += seed - trial >= 40
        assert block.content() == coded
    assert superfluous <= 6


def test_a_fragment_counts_once() -> None:
    whole = Fragments(bytes(range(40)), 10)
    block = Block(0, 4, 10)
    assert block.is_empty
    assert block.add_source(1, whole.fragment(1))
    assert not block.add_source(1, whole.fragment(1))
    assert block.add_repair(7, whole.fragment(whole.layout.repair(0, 7)))
    assert not block.add_repair(7, whole.fragment(whole.layout.repair(0, 7)))
    assert block.lacking == 2


@pytest.mark.parametrize("fragments", [1, 2, 254, 255, 256, 510, 511, 1000, 17_477, MOST_FRAGMENTS])
def test_layout(fragments: int) -> None:
    layout = Layout(fragments, 60)
    sizes = [layout.size(block) for block in range(layout.blocks)]
    assert sum(sizes) == fragments
    assert max(sizes) <= BLOCK_FRAGMENTS
    assert max(sizes) - min(sizes) <= 1
    assert layout.seeds >= 256
    for block in range(layout.blocks):
        first = layout.first(block)
        assert layout.block_of(first) == block
        assert layout.block_of(first + layout.size(block) - 1) == block
        for seed in (0, 1, layout.seeds - 1):
            index = layout.repair(block, seed)
            assert fragments <= index <= LAST_INDEX
            assert (layout.block_of(index), layout.seed(index)) == (block, seed)
        assert layout.repair(block, layout.seeds) == layout.repair(block, 0)


def test_last_fragment_is_filled_up() -> None:
    assert Fragments(b"abcde", 3).fragment(1) == b"de\0"


def test_coefficients_never_change() -> None:
    assert coefficients(0, 0, 8).hex() == "34ba6d1ff307c1cd"
    assert coefficients(3, 258, 6).hex() == "985daced8f24"
    whole = Fragments(bytes(range(256)) * 2, 16)
    layout = whole.layout
    assert whole.fragment(layout.repair(0, 0)).hex() == "5c00e4b8316d89d586da3e62ebb7530f"
    assert whole.fragment(layout.repair(0, 1)).hex() == "76088af493ed6f11a1df5d23443ab8c6"
