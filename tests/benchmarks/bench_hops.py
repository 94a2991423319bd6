"""Urgent samples over three hops, in a fleet with a key, beside an enemy who has none.

Virtual time, S2C profile, 1000 m between neighbours, losses on each hop. Each line has the share of
the samples that arrive, their median and 95 % delay, and what all nodes transmit for each sample.
Run: ``python tests/benchmarks/bench_hops.py [SEEDS]``; ends with 1 when an enemy costs more than
one sample of a hundred.
"""

import argparse
import sys
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.hostile.hops import ABORT, ENEMIES, STOP, Trial
from zacoustic.core.engine.engine import Engine

SEEDS: Final = 10
STOPS: Final = 40
LOSSES: Final = (0.0, 0.2, 0.4)
MOST_LOST: Final = 0.01


def main() -> int:
    """Print the table; return 1 when a promise is broken."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", nargs="?", type=int, default=SEEDS)
    seeds = parser.parse_args().seeds
    print("loss  topic        enemy      arrive  median s   95 % s  frames  bytes each")
    worst = 0.0
    for loss in LOSSES:
        for name, stream_id in (("best effort", STOP), ("reliable", ABORT)):
            alone = 0.0
            for kind in ("no key", *ENEMIES):
                build = Engine if kind == "no key" else None
                enemy = "none" if kind == "no key" else kind
                trials = [
                    Trial(seed, enemy, stream_id, loss=loss, stops=STOPS, build=build)
                    for seed in range(seeds)
                ]
                delays = sorted(each for trial in trials for each in trial.delays_s)
                samples = seeds * STOPS
                frames = [frame for trial in trials for frame in trial.frames]
                share = len(delays) / samples
                if kind == "none":
                    alone = share
                elif kind != "no key":
                    worst = max(worst, alone - share)
                print(
                    f"{loss:4.0%}  {name:11}  {kind:8} {share:8.1%}"
                    f" {delays[len(delays) // 2]:9.1f} {delays[len(delays) * 95 // 100]:8.1f}"
                    f" {len(frames) / samples:7.2f} {sum(map(len, frames)) / samples:11.1f}",
                    flush=True,
                )
    return int(worst > MOST_LOST)


if __name__ == "__main__":
    sys.exit(main())
