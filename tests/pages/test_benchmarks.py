"""Benchmarks start as the pages say, and what they compare with is right."""

import ast
import random
from pathlib import Path
from typing import Final

import pytest

from tests.pages.blocks import ROOT
from tests.telemetry.bound import bound_bytes
from tests.telemetry.recording import recordings_in
from tests.telemetry.streams import number
from zacoustic.core.values.types import TypeSpec

SCRIPTS: Final = sorted((ROOT / "tests" / "benchmarks").glob("bench_*.py"))
NOT_INSTALLED: Final = {"examples", "tests"}
HELD_OUT: Final = ROOT / "tests" / "telemetry" / "heldout"


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_a_benchmark_runs_as_a_file(path: Path) -> None:
    """`python tests/benchmarks/bench_….py` needs no PYTHONPATH: the script finds the root first."""
    finds = False
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Expr) and ast.unparse(node).startswith("sys.path.insert(0, "):
            finds = True
        named = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
        named += [each.name for each in node.names] if isinstance(node, ast.Import) else []
        assert finds or not NOT_INSTALLED & {name.partition(".")[0] for name in named}, path.name


def test_the_bound_of_what_can_be_foretold_is_nothing() -> None:
    fields = (number("x", 0, 1000, 1), number("y", 0, 360, 1, wraps=True))
    values = [{"x": 3 * n, "y": 7 * n % 360} for n in range(300)]
    assert bound_bytes(TypeSpec(name="Way", fields=fields), values) == pytest.approx(0, abs=1e-6)


def test_the_bound_of_noise_is_its_entropy() -> None:
    rng = random.Random(7)
    spec = TypeSpec(name="Noise", fields=(number("x", 0, 15, 1),))
    values = [{"x": rng.randrange(16)} for _ in range(4000)]
    assert bound_bytes(spec, values) == pytest.approx(4.0 / 8, abs=0.05)


def test_held_out_missions_are_an_hour_of_every_stream() -> None:
    missions = recordings_in(HELD_OUT)
    assert len(missions) == 3
    for mission in missions:
        assert mission.samples[-1][0] > 3500
        assert {name for _, name, _ in mission.samples} == {*mission.types}
