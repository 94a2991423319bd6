"""Virtual time: five nodes, a 30-byte message every ten seconds each, 24 hours, twice.

    .venv/bin/python tests/benchmarks/bench_virtual_time.py [HOURS]

Promised: a day in under 60 s on a quiet machine, and the same digest of the trace both times.
Exits 1 when either does not hold.
"""

import random
import sys
import time
from functools import partial

import msgspec

from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

NODES = range(1, 6)
PERIOD_S = 10.0
PAYLOAD_BYTES = 30
DAY_H = 24.0
PROMISED_S = 60.0


class Run(msgspec.Struct, frozen=True):
    """What one run gave."""

    wall_s: float
    digest: str
    frames: int
    delivered: int


def medium() -> Scenario:
    """Return five nodes 400 m apart, in the sea, with the modems of the default profile."""
    nodes = [{"address": node, "position": [400.0 * node, 0, 20]} for node in NODES]
    return scenario_from_mapping({"seed": 7, "nodes": nodes}, source="bench")


def run(hours: float) -> Run:
    """Let the nodes publish for so long in virtual time."""
    table = StreamTable(
        [TopicSpec(stream_id=10, name="{node}/report")],
        nodes={node: f"node{node}" for node in NODES},
    )
    rng = random.Random(7)
    started_s = time.perf_counter()
    network = VirtualNetwork(medium(), table, deliver=lambda address, event: None)

    def publish(node: int) -> None:
        network.publish(node, 10, rng.randbytes(PAYLOAD_BYTES))

    for node in NODES:
        network.every(PERIOD_S, partial(publish, node), first_s=node * PERIOD_S / len(NODES))
    network.run(until_s=hours * 3600)
    wall_s = time.perf_counter() - started_s
    stats = [network.engine(node).stats for node in NODES]
    return Run(
        wall_s,
        network.digest,
        sum(each.frames_transmitted for each in stats),
        sum(sum(each.received.values()) for each in stats),
    )


def main() -> int:
    """Print a table and return the exit code."""
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else DAY_H
    runs = [run(hours), run(hours)]
    print(f"{'virtual h':>9}  {'wall s':>7}  {'frames':>7}  {'delivered':>9}  digest")
    for each in runs:
        print(
            f"{hours:9.1f}  {each.wall_s:7.2f}  {each.frames:7d}  {each.delivered:9d}  "
            f"{each.digest[:16]}"
        )
    promised_s = PROMISED_S * hours / DAY_H
    quick = max(each.wall_s for each in runs) < promised_s
    same = runs[0].digest == runs[1].digest
    print(f"under {promised_s:g} s: {'yes' if quick else 'NO'}")
    print(f"same trace: {'yes' if same else 'NO'}")
    return 0 if quick and same else 1


if __name__ == "__main__":
    sys.exit(main())
