"""What arrives of the reports of a fleet, beside the same reports without any agreement on tables.

    .venv/bin/python tests/benchmarks/bench_fleets.py [--agreement tag,confirm] [--nodes 10,20]
                                                      [--period S] [--seeds 8] [--to-shore]
                                                      [--scheduled]

The figures of docs/config.md: --agreement confirm,tag --period 300 --nodes 4,5,6,16 --seeds 3, and
--period 600 --nodes 64 --seeds 1.

Ten bytes from each node to all others once a period, at an instant of its own each time, in a
square of 3 km of sea, from a cold start, for an hour; mean and 95 % interval over the seeds, each
the mean over all pairs of nodes. A seal is no agreement: a fleet with a key (`--agreement sealed`)
stands beside one whose reports are sealed and nothing else. With `--scheduled` each node has a slot
of a schedule for these places, and what arrives stands beside the same reports, each alone on the
channel. Exits 1 when a fleet delivers too little, or agreement takes too many bytes.
"""

import argparse
import statistics
import sys
from functools import partial
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.crowd import OFF, SEALED, SEALED_OFF, Crowd, run_crowd
from zacoustic.app.tools.design.campaign.interval import interval_of

PERIODS_S: Final = {10: 60.0, 20: 60.0, 40: 120.0, 60: 180.0}
"""Period of a report, by the number of nodes."""
LEAST: Final = {"tag": {20: 0.92, 40: 0.85}, "sealed": dict.fromkeys(PERIODS_S, 0.97)}
"""Share of what arrives without agreement, by method and number of nodes."""
LEAST_OF_ALONE: Final = 0.9
"""Share of what arrives alone on the channel, by a schedule."""
MOST_BYTES: Final = {"tag": 0.26, "sealed": 0.05}
"""Share of the bytes that agreement takes."""


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--agreement", default="tag")
    parser.add_argument("--nodes", default=",".join(map(str, PERIODS_S)))
    parser.add_argument("--period", type=float, help="of a report, s, for any number of nodes")
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--to-shore", action="store_true", help="reports for node 1 alone")
    parser.add_argument("--scheduled", action="store_true", help="by a schedule, beside alone")
    arguments = parser.parse_args()
    if arguments.scheduled:
        return _scheduled(arguments)
    failed = False
    print("nodes  period  agreement   arrives         of bare         agreement's bytes  frames")
    for nodes in map(int, arguments.nodes.split(",")):
        period_s = arguments.period or PERIODS_S[nodes]
        alone: dict[str, list[Crowd]] = {}
        methods = arguments.agreement.split(",")
        bare = [OFF] * (methods != [SEALED]) + [SEALED_OFF] * (SEALED in methods)
        for method in (*bare, *methods):
            crowds = alone[method] = [
                run_crowd(
                    seed,
                    method,
                    nodes=nodes,
                    period_s=period_s,
                    to_shore=arguments.to_shore,
                )
                for seed in range(1, arguments.seeds + 1)
            ]
            beside = alone[SEALED_OFF if method in (SEALED, SEALED_OFF) else OFF]
            ratios = [
                each.arrived / without.arrived for each, without in zip(crowds, beside, strict=True)
            ]
            share = statistics.fmean(each.agreement for each in crowds)
            print(
                f"{nodes:5}  {period_s:4.0f} s  {method:10}  "
                f"{_interval([each.arrived for each in crowds]):14}  {_interval(ratios):14}  "
                f"{share:17.1%}  {statistics.fmean(each.frames for each in crowds):6.0f}",
                flush=True,
            )
            if not arguments.to_shore:
                failed |= statistics.fmean(ratios) < LEAST.get(method, {}).get(nodes, 0.0)
                failed |= share > MOST_BYTES.get(method, 1.0)
    return int(failed)


def _scheduled(arguments: argparse.Namespace) -> int:
    failed = False
    print("nodes  period  agreement   alone           arrives         of alone")
    for nodes in map(int, arguments.nodes.split(",")):
        period_s = arguments.period or PERIODS_S[nodes]
        seeds = range(1, arguments.seeds + 1)
        run = partial(run_crowd, nodes=nodes, period_s=period_s, to_shore=arguments.to_shore)
        alone = [run(seed, OFF, alone=True).arrived for seed in seeds]
        for method in arguments.agreement.split(","):
            arrived = [run(seed, method, scheduled=True).arrived for seed in seeds]
            ratios = [one / other for one, other in zip(arrived, alone, strict=True)]
            print(
                f"{nodes:5}  {period_s:4.0f} s  {method:10}  {_interval(alone):14}  "
                f"{_interval(arrived):14}  {_interval(ratios)}",
                flush=True,
            )
            failed |= statistics.fmean(ratios) < LEAST_OF_ALONE
    return int(failed)


def _interval(values: list[float]) -> str:
    found = interval_of(values, 0.95)
    assert found is not None
    half = "" if found.high is None else f" ± {found.high - found.mean:.3f}"
    return f"{found.mean:.3f}{half}"


if __name__ == "__main__":
    sys.exit(main())
