"""Recording: what it costs a simulation and the disk, and how fast it is checked.

    .venv/bin/python tests/benchmarks/bench_recording.py [HOURS]

Three nodes with dense telemetry, an object, restarts, 10 % loss. Exits 1 when a replay differs, or
a ledger does not sum to its frames. The report is the one of the verb, without a page.
"""

import sys
import tempfile
import time
import tracemalloc
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.recording.test_exact import run_survey, survey
from tests.virtual.fleet import line
from zacoustic.app.tools.design.sim.recorder import recorded_to
from zacoustic.app.tools.inspect.recordings.facts.gathering import gather
from zacoustic.app.tools.inspect.recordings.replaying.checking import check_recording
from zacoustic.app.tools.inspect.recordings.report.figures import Figures, figures_of
from zacoustic.testing.virtual import VirtualNetwork

HOURS = 1.0
FEW, MANY = 4, 16
"""The report is of so many copies: what it takes for few is its base."""


def reported(paths: list[Path]) -> Figures:
    return figures_of(gather(paths, lean=True))


def peak_bytes(paths: list[Path]) -> int:
    """Return the most memory that a report has used at once."""
    tracemalloc.start()
    try:
        reported(paths)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def main() -> int:
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else HOURS
    until_s = hours * 3600
    medium = line(0, 800, 1500, loss={"frame": 0.1})
    begun = time.perf_counter()
    plain = VirtualNetwork(medium, survey())
    run_survey(plain, until_s=until_s)
    plain_s = time.perf_counter() - begun
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "survey.mcap"
        begun = time.perf_counter()
        with recorded_to(path) as recorder:
            assert recorder is not None
            network = VirtualNetwork(medium, survey(), build=recorder.make)
            recorder.network = network
            run_survey(network, until_s=until_s)
        recorded_s = time.perf_counter() - begun
        size_bytes = path.stat().st_size
        begun = time.perf_counter()
        verdict = check_recording(path)
        checked_s = time.perf_counter() - begun
        figures = reported([path])
        begun = time.process_time()
        reported([path] * FEW)
        per_mb_s = (time.process_time() - begun) / FEW / size_bytes * 1e6
        few_bytes, many_bytes = peak_bytes([path] * FEW), peak_bytes([path] * MANY)
    calls = sum(life.calls for life in verdict.epochs)
    frames = sum(life.frames for life in verdict.epochs)
    frame_bytes = sum(life.frame_bytes for life in verdict.epochs)
    ledger_bytes = sum(life.ledger_bytes for life in verdict.epochs)
    node_hours = hours * len(network.addresses)
    print(f"{hours:g} h of 3 nodes, {frames} frames, {calls} calls of engines")
    print(f"simulated           {plain_s:8.2f} s")
    per_call_us = (recorded_s - plain_s) / calls * 1e6
    print(f"and recorded        {recorded_s:8.2f} s, {per_call_us:.0f} µs a call")
    print(f"on the disk         {size_bytes / node_hours / 1024:8.1f} KiB an hour and node")
    print(f"checked             {checked_s:8.2f} s, {calls / checked_s:.0f} calls/s")
    growth = (many_bytes - few_bytes) / (MANY - FEW) / size_bytes
    print(f"reported            {per_mb_s:8.3f} s of processor a MB")
    print(f"in memory           {few_bytes / 1e6:8.2f} MB, and {growth:.3f} MB a MB from there on")
    print(f"frames {frame_bytes} bytes, ledgers {ledger_bytes} bytes")
    exact = all(node.ledger_is_exact for node in figures.nodes)
    if not verdict.is_same or not exact or frame_bytes != ledger_bytes:
        print("the replay differs, or a ledger does not sum")
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
