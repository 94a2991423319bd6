"""Fleets in virtual time: how long an hour of them takes, and how much memory.

Nodes on a grid 100 m apart, S2C modems, each with a report at random instants, an hour of virtual
time. Agreement as in fleets of that size: by tags, or sealed with the key of the fleet.

    .venv/bin/python tests/benchmarks/bench_fleet_scale.py [--strict]

Must hold on a quiet machine: 40 nodes with a report in two minutes in 10 s; 254 nodes with one of
ten bytes in 15 minutes in 180 s and 1 GB.
"""

import argparse
import json
import math
import random
import resource
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.sealed import SealedFleet
from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.engine.engine import Engine
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

REPORT: Final = 10
HOUR_S: Final = 3600.0
SPACING_M: Final = 100.0


class Fleet(msgspec.Struct, frozen=True, kw_only=True):
    """A fleet, and what an hour of it may take."""

    nodes: int
    period_s: float
    report_bytes: int
    most_s: float
    most_mb: float


FLEETS: Final = (
    Fleet(nodes=40, period_s=120.0, report_bytes=20, most_s=10.0, most_mb=1000.0),
    Fleet(nodes=254, period_s=900.0, report_bytes=10, most_s=180.0, most_mb=1000.0),
)


def main() -> int:
    """Measure each fleet in a process of its own, and say whether the limits hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strict", action="store_true", help="exit with 1 when a limit is missed")
    parser.add_argument("--play", nargs=2, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.play:
        index, is_sealed = (int(each) for each in arguments.play)
        print(json.dumps(play(FLEETS[index], is_sealed=bool(is_sealed))))
        return 0
    print(f"{'fleet':28}{'wall s':>8}{'MB':>7}{'frames':>8}{'received':>10}")
    holds = True
    for index, fleet in enumerate(FLEETS):
        for is_sealed in (False, True):
            command = [sys.executable, __file__, "--play", str(index), str(int(is_sealed))]
            told = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
            is_good = told["wall_s"] <= fleet.most_s and told["mb"] <= fleet.most_mb
            holds = holds and is_good
            verdict = "holds" if is_good else "MISSED"
            name = f"{fleet.nodes} nodes, {'sealed' if is_sealed else 'agreement by tags'}"
            print(
                f"{name:28}{told['wall_s']:8.1f}{told['mb']:7.0f}{told['frames']:8d}"
                f"{told['received']:10d}  limit {fleet.most_s:g} s: {verdict}",
                flush=True,
            )
    return 1 if arguments.strict and not holds else 0


def play(fleet: Fleet, *, is_sealed: bool) -> dict[str, float | int]:
    """Let a fleet live for an hour of virtual time; return what it took."""
    nodes = {address: f"n{address}" for address in range(1, fleet.nodes + 1)}
    table = StreamTable([TopicSpec(stream_id=REPORT, name="{node}/report")], nodes=nodes)
    rng = random.Random(7)
    begun_s = time.perf_counter()
    network = VirtualNetwork(
        medium(fleet.nodes),
        table,
        rules=TransmitRules(agreement=AgreementMethod.TAG),
        deliver=lambda address, event: None,
        build=SealedFleet() if is_sealed else Engine,
        digest=False,
    )

    def publish(node: int) -> None:
        network.publish(node, REPORT, rng.randbytes(fleet.report_bytes))

    for node in nodes:
        first_s = rng.uniform(0.0, fleet.period_s)
        network.every(fleet.period_s, partial(publish, node), first_s=first_s)
    network.run(until_s=HOUR_S)
    stats = list(network.stats())
    return {
        "wall_s": time.perf_counter() - begun_s,
        "mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        "frames": sum(each.frames_transmitted for each in stats),
        "received": sum(sum(each.received.values()) for each in stats),
    }


def medium(nodes: int) -> Scenario:
    """Return a grid of nodes."""
    side = math.ceil(math.sqrt(nodes))
    places = [
        {
            "address": 1 + each,
            "position": [SPACING_M * (each % side), SPACING_M * (each // side), 20],
        }
        for each in range(nodes)
    ]
    return scenario_from_mapping({"seed": 7, "nodes": places}, source="bench")


if __name__ == "__main__":
    sys.exit(main())
