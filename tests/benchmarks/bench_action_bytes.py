"""What an action of ROS 2 takes on the channel (`action_bytes`): a Fibonacci of order 10.

A goal, ten pieces of feedback and a result, all bytes of both nodes counted, in virtual time over
many seeds. *Warm*: the nodes have exchanged a few messages before, over the same water; *cold*:
they have never heard of each other. Target: at most 150 bytes, the mean of each case, and warm 95
of a hundred.

    python -m tests.benchmarks.bench_action_bytes [--runs 200] [--strict] [--sealed]

The target is one without a key. With one (`--sealed`), the last two columns are the mean bytes of a
seal, all frames of the run counted, and what they are where nothing is repeated.
"""

import argparse
import statistics
import sys
from pathlib import Path
from typing import Final

# Run as a file, as `make bench` does, the project's root is not on the path.
sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.fibonacci import Run
from tests.virtual.sealed import SealedFleet, seal_bytes
from zacoustic.core.engine.engine import Engine

TARGET_BYTES: Final = 150
CASES: Final = ((False, 0.0), (False, 0.3), (True, 0.0), (True, 0.3))


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=200, help="seeds of each case (200)")
    parser.add_argument("--strict", action="store_true", help="fail where the target is missed")
    parser.add_argument("--sealed", action="store_true", help="the nodes have a key")
    args = parser.parse_args()
    print(
        f"{'start':5} {'loss':>5} {'mean':>6} {'median':>6} {'p95':>5} {'worst':>5} {'above':>6}"
        + ("  seal expected" if args.sealed else "")
    )
    is_missed = False
    for cold, loss in CASES:
        sizes = []
        frames, seals, expected = 0, 0, 0.0
        for seed in range(args.runs if loss else 1):
            fleet = SealedFleet() if args.sealed else None
            run = Run(seed, loss=loss, cold=cold, build=fleet or Engine)
            run.check()
            sizes.append(run.bytes_on_link)
            if fleet is not None:
                more, taken = seal_bytes(run.medium)
                frames, seals = frames + more, seals + taken
                expected += fleet.expected_bytes * more
        sizes.sort()
        mean = statistics.mean(sizes)
        above = sum(size > TARGET_BYTES for size in sizes) / len(sizes)
        start, median = "cold" if cold else "warm", statistics.median(sizes)
        print(
            f"{start:5} {loss:5.0%} {mean:6.1f} {median:6.0f} "
            f"{sizes[int(0.95 * len(sizes))]:5} {sizes[-1]:5} {above:6.1%}"
            + (f" {seals / frames:5.2f} {expected / frames:8.2f}" if frames else "")
        )
        p95 = sizes[int(0.95 * len(sizes))]
        is_missed |= mean > TARGET_BYTES or (not cold and p95 > TARGET_BYTES)
    print(f"target {TARGET_BYTES} bytes" + " without a key" * args.sealed)
    return int(args.strict and is_missed and not args.sealed)


if __name__ == "__main__":
    sys.exit(main())
