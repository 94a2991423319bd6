"""How long two mechanisms take that have something for the same node, beside each of them alone.

    .venv/bin/python tests/benchmarks/bench_together.py [SEEDS]

1000 m, S2C, 0 to 60 % of the frames lost, as the seed says. Exits 1 when a pair takes longer than
1.2 times the sum of both alone.
"""

import statistics
import sys
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.together import PAIRS, Load, finished_s

SEEDS: Final = 70
MOST: Final = 1.2


def main() -> int:
    """Print the table."""
    seeds = range(int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS)
    alone_s = {load: [finished_s(seed, (load,)) for seed in seeds] for load in Load}
    print(f"mean of {len(seeds)} runs, s")
    for load, times_s in alone_s.items():
        print(f"{load.value:16}  {statistics.fmean(times_s):7.1f}", flush=True)
    print("together                              s  of the sum")
    worst = 0.0
    for pair in PAIRS:
        together_s = [finished_s(seed, pair) for seed in seeds]
        ratio = sum(together_s) / sum(sum(alone_s[load]) for load in pair)
        worst = max(worst, ratio)
        name = " and ".join(load.value for load in pair)
        print(f"{name:32}  {statistics.fmean(together_s):7.1f}  {ratio:10.2f}", flush=True)
    return int(worst > MOST)


if __name__ == "__main__":
    sys.exit(main())
