"""`plan` against `sim`: the utilisation that a model foretells, and what the engines then do.

    .venv/bin/python tests/benchmarks/bench_plan.py [HOURS]

`HOURS` of virtual time, 8 unless told otherwise, about a minute. Exits 1 when one of the plans is
more than 5 % off.
"""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.tools.planned import ALLOWED, HOURS, compare_all


def main() -> int:
    """Print the table and return the exit code."""
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else HOURS
    print(f"{hours:g} h of virtual time\n{'case':28s} {'planned':>8s} {'measured':>8s} {'off':>7s}")
    kept = True
    with tempfile.TemporaryDirectory() as folder:
        for each in compare_all(Path(folder), hours):
            fits = abs(each.off) <= ALLOWED
            kept = kept and fits
            print(
                f"{each.name:28s} {each.planned:8.2%} {each.measured:8.2%} {each.off:+7.2%}"
                f"{'' if fits else '   NO'}",
                flush=True,
            )
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
