"""1000 calls at 30 % loss and 2 s delay: how many are answered, how late, and what one costs.

    .venv/bin/python tests/benchmarks/bench_calls.py [SEEDS] [--sealed]

Request and response of 12 bytes, a call every 10 s on average, a handler that takes up to 1 s, both
ends with a journal, frames of 64 bytes as an S2C modem sends them, half-duplex; deadline 600 s.
Exits 1 when a call is executed twice, or less than 99.9 % are answered. With a key (`--sealed`),
the last two columns are the mean bytes of a seal, and what they are where nothing is repeated.
"""

import argparse
import sys
from pathlib import Path

# Run as a file, the project's root is not on the path.
sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.callload import Load, carry_calls

CALLS = 1000
PROMISED = 0.999
LOSSES = (0.0, 0.1, 0.3, 0.5)


def main() -> int:
    """Print a table and return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seeds", type=int, nargs="?", default=5)
    parser.add_argument("--sealed", action="store_true", help="the nodes have a key")
    arguments = parser.parse_args()
    seeds, sealed = arguments.seeds, arguments.sealed
    kept = True
    print(
        f"{'loss':>5}  {'answered':>8}  {'twice':>5}  {'p50 s':>6}  {'p95 s':>6}  {'p99 s':>6}  "
        f"{'max s':>6}  {'frames':>6}  {'bytes':>6}  {'airtime s':>9}"
        + ("   seal  expected" if sealed else "")
    )
    for loss in LOSSES:
        loads = [
            carry_calls(seed, calls=CALLS, loss=loss, delay_s=2.0, sealed=sealed)
            for seed in range(seeds)
        ]
        calls = CALLS * seeds
        latencies = sorted(late for load in loads for late in load.answered.values())
        twice = sum(times > 1 for load in loads for times in load.executed.values())
        answered = len(latencies) / calls
        if loss <= 0.3:
            kept = kept and not twice and answered >= PROMISED
        print(
            f"{loss:5.0%}  {answered:8.2%}  {twice:5d}  {_share(latencies, 0.5):6.1f}  "
            f"{_share(latencies, 0.95):6.1f}  {_share(latencies, 0.99):6.1f}  "
            f"{latencies[-1]:6.1f}  {_total(loads, 'frames') / calls:6.2f}  "
            f"{_total(loads, 'bytes_sent') / calls:6.1f}  "
            f"{_total(loads, 'airtime_s') / calls:9.3f}" + (_seals(loads) if sealed else "")
        )
    return 0 if kept else 1


def _share(latencies: list[float], share: float) -> float:
    return latencies[min(len(latencies) - 1, int(share * len(latencies)))]


def _seals(loads: list[Load]) -> str:
    frames = _total(loads, "frames")
    seal, expected = (_total(loads, each) / frames for each in ("sealed_bytes", "expected_seals"))
    return f"  {seal:5.2f}  {expected:8.2f}"


def _total(loads: list[Load], name: str) -> float:
    return sum(float(getattr(load, name)) for load in loads)


if __name__ == "__main__":
    sys.exit(main())
