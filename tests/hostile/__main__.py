"""``python -m tests.hostile [crossed | small] SEED …``: runs scenarios, says what did not hold.

``crossed`` takes those of `crossing`, ``small`` those of `scenario` with small number windows.
"""

import sys
import time

from tests.hostile.crossing import crossed
from tests.hostile.drive import Drive
from tests.hostile.scenario import hostile, small


def main(words: list[str]) -> int:
    """Run the seeds, or ranges of them as ``FROM..TO``; returns the exit code."""
    draws = {"crossed": crossed, "small": small}
    draw = draws.get(words[0], hostile) if words else hostile
    seeds: list[int] = []
    for word in words[draw is not hostile :]:
        first, _, last = word.partition("..")
        seeds += range(int(first), int(last or first) + 1)
    failed = 0
    for seed in seeds:
        drawn = draw(seed)
        began = time.process_time()
        drive = Drive(drawn)
        violations = drive.run()
        failed += bool(violations)
        took_s = time.process_time() - began
        print(
            f"{seed} {drawn.kind}: {drive.frames} frames, quiet {drive.longest_s:.0f} s into the "
            f"calm, {took_s:.1f} s; {len(violations)} complaints"
        )
        for violation in violations:
            print(f"    {violation}")
        if len(seeds) == 1:
            print(
                *(f"    {what}: {times}" for what, times in sorted(drive.oracle.counts.items())),
                sep="\n",
            )
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
