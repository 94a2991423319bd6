"""What a node transmits to one that has crashed, and how soon all arrives when it is back.

    .venv/bin/python tests/benchmarks/bench_absent.py [SEEDS]

Ten minutes, 1500 m, S2C; one of each kind waits, each alone and all together. At first with instant
messages only, which is all that a virtual network's modems have; then with the driver on emulated
modems, which have burst data for the object, and of which that of the absent node goes on: over so
many guesses at what a modem does with burst data.

Must hold: for one of everything at most 40 frames and 30 s of airtime; after the return an
emergency within 10 s, all else within 60 s, at the 95th percentile.
"""

import sys
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.links.evologics.driver.absent import Absence
from tests.virtual.absent import EVERYTHING, Kind, Outcome, run

SEEDS: Final = 40


def main() -> int:
    """Print the table."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    print(f"mean of {seeds} runs; the arrival is that of the last kind, p95")
    for title, play in (
        ("instant messages only", partial(run, announces=True)),
        ("with burst data", lambda seed, kinds: Absence(seed, kinds).run()),
    ):
        print(f"\n{title:21}  frames  airtime s  arrival s")
        table(play, seeds)
    return 0


def table(play: Callable[[int, Iterable[Kind]], Outcome], seeds: int) -> None:
    """Print what it costs to let a node be absent."""
    cases: dict[str, tuple[Kind, ...]] = {kind.value: (kind,) for kind in Kind}
    cases |= {"one of everything": EVERYTHING, "and an emergency": tuple(Kind)}
    for name, kinds in cases.items():
        outcomes = [play(seed, kinds) for seed in range(seeds)]
        frames = sum(each.frames for each in outcomes) / seeds
        airtime_s = sum(each.airtime_s for each in outcomes) / seeds
        last_s = _p95([max(each.arrived_s.values(), default=0.0) for each in outcomes])
        print(f"{name:20}  {frames:7.1f}  {airtime_s:9.1f}  {last_s:9.1f}", flush=True)
        if Kind.EMERGENCY in kinds:
            first_s = _p95([each.arrived_s[Kind.EMERGENCY] for each in outcomes])
            print(f"    of which the emergency {first_s:.1f} s")


def _p95(values: list[float]) -> float:
    return sorted(values)[int(0.95 * len(values))]


if __name__ == "__main__":
    sys.exit(main())
