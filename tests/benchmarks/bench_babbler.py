"""Emergencies and reports of a fleet beside a node that talks without pause.

    .venv/bin/python tests/benchmarks/bench_babbler.py [SEEDS]

Each line has all kinds of emergencies and frame sizes of `tests.virtual.babbling` in one setting:
times from publication to arrival, s; the share of the reports that arrive, and that share in parts
of the one beside a node that takes an equal share. Exits 1 when a line is worse than
docs/operations.md says.
"""

import statistics
import sys
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.babbling import NEVER, Setting, Talk, babble

SEEDS: Final = 3
WORST_P95_S: Final = {True: 15.0, False: 30.0}
"""The bound of the 95th percentile, s, with carrier sense and without."""
WORST_P999_S: Final = 60.0
LEAST_REPORTED: Final = 0.7
TALKS: Final = (Talk.ONE, Talk.ALL, Talk.RELIABLE, Talk.QUEUE, Talk.PHOTO)


def _runs(seeds: int, talk: Talk, senses: bool, nodes: int, addressed: bool) -> tuple[
    list[float], float, float
]:  # fmt: skip
    settings = [
        Setting(
            nodes=nodes, frame_bytes=size, addressed=addressed, senses_carrier=senses,
            reliable=reliable, talk=talk,
        )
        for size in (8, 33, 64)
        for reliable in (True, False)
    ]  # fmt: skip
    found = [babble(seed, setting) for setting in settings for seed in range(seeds)]
    return (
        sorted(each for one in found for each in one.took_s),
        statistics.mean(each.reported for each in found),
        statistics.mean(each.busy for each in found),
    )


def main() -> int:
    """Print the table; returns 1 when something is worse than promised."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    print("senses nodes addressed     talk   runs    p50    p95  p99.9  never  reports  of  busy")
    is_kept = True
    for senses in (True, False):
        for nodes in (3, 6, 10):
            for addressed in (True, False):
                fair = _runs(seeds, Talk.SHARE, senses, nodes, addressed)[1]
                for talk in TALKS:
                    took_s, reported, busy = _runs(seeds, talk, senses, nodes, addressed)
                    count = len(took_s)
                    p50, p95, p999 = (took_s[int(count * each)] for each in (0.5, 0.95, 0.999))
                    never = took_s.count(NEVER)
                    kept = p95 <= WORST_P95_S[senses] and reported >= LEAST_REPORTED * fair
                    kept &= not senses or (p999 <= WORST_P999_S and never == 0)
                    is_kept &= kept
                    print(
                        f"{senses!s:>6} {nodes:5} {addressed!s:>9} {talk.value:>8}  {count:5} "
                        f"{p50:6.1f} {p95:6.1f} {p999:6.1f}  {never:5}  {reported:6.2f} "
                        f"{reported / fair:5.2f} {busy:5.2f}{'' if kept else '  worse'}",
                        flush=True,
                    )
    return 0 if is_kept else 1


if __name__ == "__main__":
    sys.exit(main())
