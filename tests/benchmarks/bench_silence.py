"""The cost of a silent peer in a day, by what waits for it and by the kind of link.

    .venv/bin/python tests/benchmarks/bench_silence.py [SEEDS]

The first table has the most frames of one node in a day of silence (`tests.virtual.silentpeer`);
of one of everything on routes and floods it also has those after the first ten minutes. The second
one has what three outages of an hour leave behind (`tests.virtual.outages`): the longest estimate
of a round trip beside its bound, the emergency after a bad minute, the samples that never came.

Must hold: at most 100 frames for each peer; estimates within their bounds, emergencies within 60 s
on each kind of link, no sample lost.
"""

import sys
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual import outages
from tests.virtual.silentpeer import ONE_OF_EACH, Silence, Trial, Waits, Way, rest_of

SEEDS: Final = 5
_OUTAGES_EACH: Final = 10
"""The second table takes so many times as many seeds."""


def main() -> int:
    """Print the tables."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    print(f"most frames of a node in a day of silence, {seeds} runs, absent / heard but deaf")
    print(f"{'':36}" + "".join(f"{way.value:>15}" for way in Way))
    cases: dict[str, tuple[Waits, ...]] = {each.value: (each,) for each in Waits}
    cases["one of everything"] = ONE_OF_EACH
    cases["and an emergency"] = (*ONE_OF_EACH, Waits.EMERGENCY)
    for name, kinds in cases.items():
        cells = [_silence(way, rest_of(kinds, way), seeds) for way in Way]
        print(f"{name:36}" + "".join(f"{each:>15}" for each in cells), flush=True)
    runs = _OUTAGES_EACH * seeds
    print(f"\nafter three outages of an hour, {runs} runs")
    print(f"{'':12}{'estimate s':>12}{'bound s':>12}{'emergency s: p50':>20}{'max':>8}{'lost':>6}")
    for way in Way:
        results = [outages.run(seed, way) for seed in range(runs)]
        stops_s = sorted(each.stop_s for each in results)
        print(
            f"{way.value:12}{max(max(each.estimates_s) for each in results):12.1f}"
            f"{results[0].bound_s:12.1f}{stops_s[runs // 2]:20.1f}{stops_s[-1]:8.1f}"
            f"{sum(each.lost for each in results):6}",
            flush=True,
        )
    return 0


def _silence(way: Way, kinds: list[Waits], seeds: int) -> str:
    """Return the most frames of a day, of an absent peer and of a deaf one."""
    if not kinds:
        return "-"
    cells = []
    for silence in Silence:
        most = late = 0
        for seed in range(seeds):
            outcome = Trial(seed, way, kinds, silence=silence).run(returns=False)
            frames = {node: days[0] for node, days in outcome.frames.items()}
            if silence is Silence.DEAF:
                talk = Trial(seed, way, (), silence=silence).run(returns=False)
                frames = {node: each - talk.frames[node][0] for node, each in frames.items()}
            most = max(most, *frames.values())
            late = max(late, *outcome.late_frames.values())
        is_inside = silence is Silence.ABSENT and way in (Way.ROUTE, Way.FLOOD) and len(kinds) > 1
        cells.append(f"{most} ({late})" if is_inside else str(most))
    return " / ".join(cells)


if __name__ == "__main__":
    sys.exit(main())
