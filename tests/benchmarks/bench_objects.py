"""A 10 KiB object at the airtimes of an S2C modem, 1 s away, by loss: how much of the bit rate.

    .venv/bin/python tests/benchmarks/bench_objects.py [SEEDS]

In % of 539 bit/s, from the first bit to the sender's confirmation; half-duplex, the same loss both
ways, unknown to the sender. Exits 1 when one is below what is promised.
"""

import statistics
import sys
from pathlib import Path

# Run as a file, the project's root is not on the path.
sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.core.objects.medium import confirmation_s
from tests.virtual.test_objects import percentage

SIZE_BYTES = 10240
FULL_BPS = 539.0
PROMISED = {False: {0.0: 82, 0.2: 62, 0.3: 53, 0.5: 36}, True: {0.0: 90, 0.2: 70, 0.3: 60, 0.5: 42}}


def protocol(seed: int, loss: float, exclusive: bool) -> float:
    """Return the share of the bit rate without engines, %: airtimes and delay only."""
    took_s, _ = confirmation_s(seed, loss, exclusive=exclusive, size_bytes=SIZE_BYTES)
    return 100 * SIZE_BYTES * 8 / took_s / FULL_BPS


def engines(seed: int, loss: float, exclusive: bool) -> float:
    """Return the same between whole engines on the simulated channel, %."""
    return percentage(seed, loss, exclusive=exclusive)


def main() -> int:
    """Print a table and return the exit code."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    kept = True
    print(f"{'':>14}  {'loss':>5}  {'promised':>8}  {'protocol':>8}  {'engines':>8}")
    for exclusive, targets in PROMISED.items():
        for loss, promised in targets.items():
            shares = [
                statistics.fmean(measure(seed, loss, exclusive) for seed in range(seeds))
                for measure in (protocol, engines)
            ]
            kept = kept and min(shares) >= promised
            name = "exclusive" if exclusive else "listen windows"
            print(
                f"{name:>14}  {loss:5.0%}  {promised:8d}  {shares[0]:8.2f}  {shares[1]:8.2f}",
                flush=True,
            )
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
