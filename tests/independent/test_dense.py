"""Annexes A to C: every vector of texts and dense blocks, read from docs/wire.md alone."""

import hashlib
from typing import Any

import pytest

from tests.independent import blocks, curves, fields, fleet, rows, table, texts
from tests.independent.arithmetic import Source
from tests.independent.errors import ReadError

DENSE = fleet.load("dense_frames.json")
ANNEXES = fleet.load("arithmetic.json")
MODELS = ["no model", "model"]
GRADES = 672


def _reader(model: str) -> blocks.Reader:
    names = {int(stream_id): one["name"] for stream_id, one in DENSE["types"].items()}
    digest = bytes.fromhex(DENSE["table_digest"])
    model_text = DENSE["model_text"] if model == "model" else "{}"
    return blocks.Reader(table.types_of(list(DENSE["types"].values())), names, digest, model_text)


def _plain(samples: list[tuple[int, dict[str, Any]]]) -> list[Any]:
    return [[stream_id, fields.plain(value)] for stream_id, value in samples]


@pytest.mark.parametrize("model", MODELS)
def test_blocks_one_after_the_other(model: str) -> None:
    reader, marks = _reader(model), []
    for place, data in enumerate(DENSE[model]["acknowledged"]):
        samples, block = reader.read(bytes.fromhex(data))
        assert _plain(samples) == DENSE["samples"][place]
        marks.append(f"{block.mark:04x}")
    assert marks == DENSE[model]["marks"]


@pytest.mark.parametrize("model", MODELS)
def test_a_block_of_many_samples(model: str) -> None:
    samples, _ = _reader(model).read(bytes.fromhex(DENSE[model]["together"]))
    assert _plain(samples) == DENSE["samples together"]


@pytest.mark.parametrize("model", MODELS)
def test_blocks_that_refer_to_nothing(model: str) -> None:
    for place, data in enumerate(DENSE[model]["each for itself"]):
        samples, _ = _reader(model).read(bytes.fromhex(data))
        assert _plain(samples) == DENSE["samples"][place]


def _digest(numbers: list[int]) -> str:
    return hashlib.sha256("".join(f"{each}\n" for each in numbers).encode()).hexdigest()


def test_digests_of_the_tables() -> None:
    lists = [
        each
        for grade in range(32, curves.LISTED)
        for position in range(16)
        for each in curves.sums(grade, position)[1]
    ]
    assert ANNEXES["digests"] == {
        "lists of the curves": _digest(lists),
        "scales of the grades": _digest([curves.scale_of(grade) for grade in range(GRADES)]),
        "sines": _digest([sine for _, sine in rows.directions()]),
    }


def _widths(source: Source) -> list[tuple[str, int]]:
    """Note the width and the doublings after each symbol from now on."""
    found: list[tuple[str, int]] = []
    take = source.part

    def part(unit: int, ends: Any, index: int) -> int:
        index = take(unit, ends, index)
        found.append((f"{source.width:012x}", source.doublings))
        return index

    source.part = part  # type: ignore[method-assign]
    return found


def _noted(example: dict[str, Any]) -> list[tuple[str, int]]:
    return [(width, count) for *_, width, count in example["steps"]]


def test_symbols_of_the_text() -> None:
    example = ANNEXES["text"]
    block = bytes.fromhex(example["block"])
    source = Source(block)
    noted = _widths(source)
    assert texts.code(source, texts.known_texts()) == example["text"].encode()
    source.end(0)
    assert noted == _noted(example)
    assert texts.write_block(example["text"].encode()) == block


def test_symbols_of_the_dense_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    reader = _example_reader()
    for example in ANNEXES["dense"]["blocks"]:
        noted: list[tuple[str, int]] = []
        take = Source.part

        def part(
            self: Source, unit: int, ends: Any, index: int, noted: Any = noted, take: Any = take
        ) -> int:
            index = take(self, unit, ends, index)
            noted.append((f"{self.width:012x}", self.doublings))
            return index

        with monkeypatch.context() as patch:
            patch.setattr(Source, "part", part)
            samples, block = reader.read(bytes.fromhex(example["block"]))
        assert samples == [(ANNEXES["dense"]["stream"], example["value"])]
        assert (block.digest.hex(), block.name) == (example["digest"], example["name"])
        assert f"{block.mark:04x}" == example["mark"]
        assert _state(reader, block) == example["state"]
        # Several bits are several symbols here, and one there.
        assert set(_noted(example)) <= set(noted)
        assert noted[-1] == _noted(example)[-1]


def _state(reader: blocks.Reader, block: blocks.Block) -> dict[str, Any]:
    ((state, habit),) = block.streams
    assert state is not None
    count = reader.streams[0].rows.count
    return {
        "row": state.row,
        "velocity": state.velocity,
        "steadiness": list(state.steadiness),
        "adaptations": {
            str(place): {
                "weights": _by_quantity(each.weights, count),
                "energies": list(each.energies),
                "log_scales": [manner.log_scale for manner in each.manners],
                "nearer": [manner.nearer for manner in each.manners],
                "holds": [manner.hold for manner in each.manners],
                "widths": list(each.widths),
            }
            for place, each in state.adaptations.items()
        },
        "single": block.single,
        "chances": list(block.chances),
        "in_turn": block.in_turn,
        "more": list(habit.more),
        "regular": habit.regular,
        "steps": list(habit.steps),
    }


def _by_quantity(weights: tuple[int, ...], count: int) -> list[list[int]]:
    """Return the weights of each quantity for those before it, each with its sign."""
    found: list[list[int]] = [[] for _ in range(count)]
    for i, whole in enumerate(weights):
        left = whole
        for k in range(count - 1, i, -1):
            weight = (left + (1 << 95)) % (1 << 96) - (1 << 95)
            found[k].append(weight)
            left = (left - weight) >> 96
    return found


def _example_reader() -> blocks.Reader:
    dense = ANNEXES["dense"]
    names = {dense["stream"]: dense["type"]["name"]}
    return blocks.Reader(
        table.types_of([dense["type"]]), names, bytes.fromhex(dense["table_digest"])
    )


@pytest.mark.parametrize("why", ANNEXES["refused texts"])
def test_refused_text(why: str) -> None:
    with pytest.raises(ReadError):
        texts.read_block(bytes.fromhex(ANNEXES["refused texts"][why]))


@pytest.mark.parametrize("why", ANNEXES["refused blocks"])
def test_refused_block(why: str) -> None:
    with pytest.raises(ReadError):
        _example_reader().read(bytes.fromhex(ANNEXES["refused blocks"][why]))
