"""What a node transmits to one that has crashed, and how soon all arrives when it is back.

    .venv/bin/python tests/benchmarks/bench_absent.py [SEEDS]

Ten minutes, 1500 m, S2C; one of each kind waits, each alone and all together.
"""

import sys
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.absent import EVERYTHING, Kind, Outcome, run

SEEDS: Final = 40


def main() -> int:
    """Print the table."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    print(f"mean of {seeds} runs; the arrival is that of the last kind, p95")
    print("waiting                frames  airtime s  arrival s")
    cases: dict[str, tuple[Kind, ...]] = {kind.value: (kind,) for kind in Kind}
    cases |= {"one of everything": EVERYTHING, "and an emergency": tuple(Kind)}
    for name, kinds in cases.items():
        outcomes = [run(seed, kinds, announces=True) for seed in range(seeds)]
        frames = sum(each.frames for each in outcomes) / seeds
        airtime_s = sum(each.airtime_s for each in outcomes) / seeds
        last_s = _p95([max(each.arrived_s.values(), default=0.0) for each in outcomes])
        print(f"{name:20}  {frames:7.1f}  {airtime_s:9.1f}  {last_s:9.1f}", flush=True)
    first_s = _p95([_emergency(run(seed, Kind, announces=True)) for seed in range(seeds)])
    print(f"an emergency beside everything arrives within {first_s:.1f} s, p95")
    return 0


def _emergency(outcome: Outcome) -> float:
    return outcome.arrived_s[Kind.EMERGENCY]


def _p95(values: list[float]) -> float:
    return sorted(values)[int(0.95 * len(values))]


if __name__ == "__main__":
    sys.exit(main())
