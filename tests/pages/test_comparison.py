"""The cells of docs/comparison.md are what its command finds: those of them that are quick."""

import math
import re
from pathlib import Path
from typing import Final

import pytest

from tests.benchmarks import bench_comparison as bench
from tests.pages.blocks import ROOT
from tests.telemetry.baselines import cbor_map_bytes, dccl_bytes, rmw_desert_bytes
from tests.telemetry.recording import Recording, recordings_in

TEXT: Final = Path(ROOT, "docs", "comparison.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def missions() -> list[Recording]:
    return recordings_in(bench.HELD_OUT)


def cell(row: str) -> float:
    """The figure of a row that begins so."""
    lines = [line for line in TEXT.splitlines() if line.startswith(f"| {row}")]
    return float(lines[0].split("|")[2])


def test_the_sizes_of_others_are_those_of_their_rules(missions: list[Recording]) -> None:
    found = {size: bench.mean_size(missions, size) for size in (dccl_bytes, rmw_desert_bytes)}
    assert round(found[dccl_bytes]) == cell("Goby3, DCCL") == cell("ros_acomms, ltcodecs")
    assert f"| rmw_desert | {found[rmw_desert_bytes]:.0f} |" in TEXT


def test_the_report_of_others_is_that_of_their_rules(missions: list[Recording]) -> None:
    rows = {
        "fields of fixed width": dccl_bytes,
        "rmw_desert's rules": rmw_desert_bytes,
        "CBOR maps": cbor_map_bytes,
    }
    for row, size in rows.items():
        found = bench.mean(bench.report(mission, size) for mission in missions)
        assert round(found) == cell(row), row


def test_the_seconds_are_those_of_the_bytes() -> None:
    rows = re.findall(r"^\| [^|]*?, (\d+) bytes \| ([\d.]+) \|", TEXT, re.MULTILINE)
    assert [int(size) for size, _ in rows] == [
        math.ceil(cell("zacoustic, dense, acknowledged")),
        15,
        49,
    ]
    for size, seconds in rows:
        assert f"{bench.MODEM.airtime_s(int(size)):.2f}" == seconds


def test_the_plain_protocol_and_the_lines_are_as_calculated() -> None:
    assert round(bench.mean(map(bench.arq, range(400)))) == cell("a plain protocol")
    assert bench.lines_of_the_front_page() == cell("zacoustic, Python with a file")
