"""What `zacoustic sim campaign` takes beside the runs that it does.

    .venv/bin/python tests/benchmarks/bench_campaign.py [--cells 1000] [--workers 2] [--minutes 10]

A campaign of as many cells, one seed each, of five nodes in the sea; then the runs of every tenth
cell once more, one after the other in this process. The first ratio is the wall time of the
campaign, from its start to its page, over that of the single runs divided by the workers; it means
something on an idle computer only. The second one is the processor time of all processes of the
campaign over that of the runs in them, whatever else the computer does.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Final

import msgspec

sys.path.insert(0, str(Path(__file__).parents[2]))

from zacoustic.app.tools.design.campaign.campaign import campaign_of
from zacoustic.app.tools.design.campaign.running import row_of, version
from zacoustic.app.tools.design.campaign.spec import read_spec

MOST: Final = 1.1
"""At 1000 cells of ten minutes on two cores."""
SCENARIO: Final = {
    "nodes": [
        {"address": 1, "position": [0, 0, 10]},
        {"address": 2, "position": [800, 0, 40]},
        {"address": 3, "position": [0, 1200, 60]},
        {"address": 4, "position": [-900, 300, 30]},
        {"address": 5, "position": [400, -1000, 80]},
    ],
    "traffic": [
        {"node": node, "topic": f"auv{node}/nav", "every_s": 60, "pattern": "random",
         "size_bytes": 12}
        for node in range(1, 6)
    ],
}  # fmt: skip


def main() -> int:
    """Print the ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cells", type=int, default=1000)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--minutes", type=float, default=10.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "campaign.json5"
        _write(path, arguments.cells, arguments.minutes * 60.0)
        before, began_s = os.times(), time.monotonic()
        command = [sys.executable, "-m", "zacoustic", "sim", "campaign", str(path), "--json"]
        told = subprocess.run(
            [*command, "--workers", str(arguments.workers)], check=True, stdout=subprocess.PIPE
        ).stdout
        whole_s, after = time.monotonic() - began_s, os.times()
        used_s = sum(after[2:4]) - sum(before[2:4])
        campaign = campaign_of(read_spec(path), path, version())
        sample = range(0, campaign.runs, 10)
        began_s, began_cpu_s = time.monotonic(), time.process_time()
        digests = {run: row_of(campaign, run).digest for run in sample}
        factor = campaign.runs / len(sample)
        alone_s = (time.monotonic() - began_s) * factor
        alone_cpu_s = (time.process_time() - began_cpu_s) * factor
        lines = (Path(folder) / "campaign.results" / "runs.jsonl").read_bytes().splitlines()[1:]
        rows = [msgspec.json.decode(line) for line in lines]
    assert json.loads(told)["ran"] == campaign.runs
    assert digests.items() <= {row["run"]: row["digest"] for row in rows}.items()
    inside_s = sum(row["took_s"] for row in rows)
    wall, cpu = whole_s * arguments.workers / alone_s, used_s / inside_s
    print(f"{campaign.runs} runs of {arguments.minutes:g} min, {arguments.workers} workers")
    print(f"single runs, one after the other: {alone_s:.1f} s, {alone_cpu_s:.1f} s of a processor")
    print(f"the campaign: {whole_s:.1f} s, {used_s:.1f} s of processors, {inside_s:.1f} s in runs")
    print(f"wall time × workers / single runs: {wall:.3f}")
    print(f"processor time / that of the runs in it: {cpu:.3f} (at most {MOST})")
    return int(cpu > MOST)


def _write(path: Path, cells: int, until_s: float) -> None:
    """Write a campaign of two parameters, and its scenario."""
    first = max(each for each in range(1, int(cells**0.5) + 1) if cells % each == 0)
    sweep = [
        {"key": "loss.frame", "values": [0.5 * index / first for index in range(first)]},
        {"key": "traffic[*].every_s", "values": [60 + index for index in range(cells // first)]},
    ]
    campaign = {"scenario": "water.json5", "until_s": until_s, "seeds": 1, "sweep": sweep}
    path.write_text(json.dumps(campaign), encoding="utf-8")
    path.with_name("water.json5").write_text(json.dumps(SCENARIO), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
