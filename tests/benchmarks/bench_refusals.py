"""What a frame that does not open costs a sealed node, in time of the processor.

Frames of strangers come as fast as sound carries them; a node must not be busy with them. Must
hold: 50 µs for each, random or changed, with either tag.

    .venv/bin/python tests/benchmarks/bench_refusals.py [--frames N] [--strict]
"""

import argparse
import random
import sys
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.hostile.unopened import Victim, changed_frames, random_frames

LIMIT_US: Final = 50.0


def main() -> int:
    """Measure, print a table, and say whether the limit holds."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=20_000, help="of each kind")
    parser.add_argument(
        "--strict", action="store_true", help="exit with 1 when the limit is missed"
    )
    arguments = parser.parse_args()
    worst_us = 0.0
    print(f"{arguments.frames} frames of each kind{'':6}tag of 4      8 bytes, µs each")
    for name, make in (("random", random_frames), ("changed", changed_frames)):
        each_us = []
        for strong in (False, True):
            victim = Victim()
            frames = make(victim.sent, random.Random(1), strong=strong)
            each_us.append(victim.hear(frames, arguments.frames) * 1e6 / arguments.frames)
        worst_us = max(worst_us, *each_us)
        print(f"{name:<30}{each_us[0]:>10.1f}{each_us[1]:>10.1f}")
    holds = worst_us <= LIMIT_US
    print(f"limit {LIMIT_US:g} µs: {'holds' if holds else 'MISSED'}")
    return 1 if arguments.strict and not holds else 0


if __name__ == "__main__":
    raise SystemExit(main())
