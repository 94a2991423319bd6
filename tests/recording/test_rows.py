"""Rows of numbers: they come back as they went in, in any order, from memory and from the disk."""

import random
import struct
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from zacoustic.app.tools.inspect.recordings.facts import rows as rows_module
from zacoustic.app.tools.inspect.recordings.facts.facts import Delivery, Facts, Sample
from zacoustic.app.tools.inspect.recordings.facts.matching import match
from zacoustic.app.tools.inspect.recordings.facts.rows import Row, Rows, in_order
from zacoustic.errors import ConfigError

STREAM, PUBLISHER = 7, 1


class Pair(Row, frozen=True):
    layout = struct.Struct("<Bd")
    one: int
    other: float


@pytest.fixture
def on_disk(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a hundred rows be many blocks and many runs."""
    monkeypatch.setattr(rows_module, "BLOCK_BYTES", 64)
    monkeypatch.setattr(rows_module, "MERGED_BYTES", 20)
    monkeypatch.setattr(rows_module, "RUN_ROWS", 7)


def drawn(count: int, seed: int) -> Iterator[Pair]:
    rng = random.Random(seed)
    return (Pair(rng.randrange(4), rng.random()) for _ in range(count))


@pytest.mark.usefixtures("on_disk")
@pytest.mark.parametrize("count", [0, 1, 6, 7, 8, 14, 500])
def test_rows_come_back_in_their_order_and_in_the_order_of_their_fields(count: int) -> None:
    told = list(drawn(count, seed=count))
    rows = Rows(Pair)
    for number, each in enumerate(told):
        rows.append(each)
        if number % 50 == 3:
            assert list(rows) == told[: number + 1]
    assert len(rows) == count
    assert list(zip(rows, rows, strict=True)) == list(zip(told, told, strict=True))
    assert list(in_order(Pair, rows)) == sorted(told, key=lambda each: (each.one, each.other))


def test_number_out_of_range_is_an_error_of_the_recording() -> None:
    with pytest.raises(ConfigError, match="a recording has a number out of range") as caught:
        Rows(Pair).append(Pair(256, 1.0))
    assert "damaged" in (caught.value.hint or "")


@pytest.mark.usefixtures("on_disk")
def test_folder_that_cannot_be_used_is_told_with_what_to_do(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("TMPDIR", "set")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    rows = Rows(Pair)
    with pytest.raises(ConfigError, match="No such file or directory") as caught:
        rows.extend((1, 2.0) for _ in range(100))
    assert "TMPDIR" in (caught.value.hint or "")


def by_definition(samples: list[Sample]) -> list[tuple[int, int]]:
    """Return publication and arrival of each delivery, searched among all publications."""
    taken: set[tuple[int, int]] = set()
    found = []
    arrivals = [each for each in samples if each.is_arrival]
    for arrival in sorted(arrivals, key=lambda each: each.at_ns):
        candidates = [
            each
            for each in samples
            if not each.is_arrival
            and (each.place, each.content) == (arrival.place, arrival.content)
            and each.at_ns <= arrival.at_ns
            and (each.number, arrival.node) not in taken
        ]
        if candidates:
            newest = max(candidates, key=lambda each: (each.at_ns, each.number))
            taken.add((newest.number, arrival.node))
            found.append((newest.number, arrival.number))
    return sorted(found)


@pytest.mark.usefixtures("on_disk")
@pytest.mark.parametrize("seed", range(40))
def test_arrival_has_the_newest_publication_of_its_value_that_its_node_lacks(seed: int) -> None:
    rng = random.Random(seed)
    samples = []
    for number in range(rng.randrange(120)):
        is_arrival = rng.random() < 0.5
        samples.append(
            Sample(
                rng.choice((b"a", b"b")).ljust(12, b"\0"),
                rng.choice((b"x", b"y", b"z")).ljust(12, b"\0"),
                rng.randrange(rng.choice((10, 1000))),
                is_arrival,
                number,
                STREAM,
                PUBLISHER,
                rng.choice((2, 3)) if is_arrival else PUBLISHER,
            )
        )
    facts = Facts()
    for each in samples:
        facts.samples.append(each)
        if each.is_arrival:
            facts.counts_of(STREAM).receivers.add(each.node)
    for _ in range(2):
        match(facts)
        told: list[Delivery] = list(facts.deliveries)
        assert sorted((each.number, each.arrival) for each in told) == by_definition(samples)
        assert all(
            (each.begun_ns, each.at_ns) == (samples[each.number].at_ns, samples[each.arrival].at_ns)
            for each in told
        )
