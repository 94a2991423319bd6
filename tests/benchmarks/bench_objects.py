"""A 10 KiB object at the airtimes of an S2C modem, 1 s away, by loss: how much of the bit rate.

    .venv/bin/python tests/benchmarks/bench_objects.py [SEEDS]

In % of 539 bit/s, from the first bit to the sender's confirmation; half-duplex, the same loss both
ways, unknown to the sender. Exits 1 when one is below what is promised.
"""

import statistics
import sys

from tests.core.objects.water import confirmation_s

SIZE_BYTES = 10240
FULL_BPS = 539.0
PROMISED = {False: {0.0: 82, 0.2: 62, 0.3: 53, 0.5: 36}, True: {0.0: 90, 0.2: 70, 0.3: 60, 0.5: 42}}


def main() -> int:
    """Print a table and return the exit code."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    kept = True
    print(f"{'':>14}  {'loss':>5}  {'%':>6}  {'promised':>8}  {'frames':>7}  {'answers':>7}")
    for exclusive, targets in PROMISED.items():
        for loss, promised in targets.items():
            shares, fragments, answers = [], [], []
            for seed in range(seeds):
                took_s, run = confirmation_s(seed, loss, exclusive=exclusive, size_bytes=SIZE_BYTES)
                shares.append(100 * SIZE_BYTES * 8 / took_s / FULL_BPS)
                fragments.append(run.frames.get(0xBA, 0))
                answers.append(run.frames.get(0xBB, 0))
            share = statistics.fmean(shares)
            kept = kept and share >= promised
            name = "exclusive" if exclusive else "listen windows"
            print(
                f"{name:>14}  {loss:5.0%}  {share:6.2f}  {promised:8d}  "
                f"{statistics.fmean(fragments):7.1f}  {statistics.fmean(answers):7.2f}"
            )
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
