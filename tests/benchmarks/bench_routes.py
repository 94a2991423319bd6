"""Five nodes in a line, 1.5 km apart: what a route over four hops delivers, and at what cost.

    .venv/bin/python tests/benchmarks/bench_routes.py [SEEDS]

S2C instant messages in the simulated sea, four hours each, one message in a frame of 60 bytes at
random instants. With a stated loss only neighbours hear each other. Then a sample of 10 KiB over a
line that loses 10 % at each hop, a relay restarted, beside the same over one hop. Exits 1 when a
figure is worse than promised.
"""

import random
import statistics
import sys
from pathlib import Path
from typing import NamedTuple

# Run as a file, the project's root is not on the path.
sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.lineoffive import APART_M, FIX, NODES, PLAN, LineOfFive, table
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.testing.virtual import VirtualNetwork

HOURS = 4
MESSAGE_BYTES = {FIX: 56, PLAN: 50}
"""With the heads of sample and route a frame of 60 bytes on each hop."""
PHOTO_BYTES = 10240


class Row(NamedTuple):
    """One traffic, and what is promised of it."""

    name: str
    stream_id: int
    every_s: float
    loss: float | None
    delivered: float
    most_frames: float
    p95_s: float


ROWS = (
    Row("best effort, one per 120 s", FIX, 120.0, None, 0.99, 8.0, 40.0),
    Row("best effort, one per 30 s", FIX, 30.0, None, 0.95, 1e9, 1e9),
    Row("best effort, one per 120 s, 30 % lost at each hop", FIX, 120.0, 0.3, 0.99, 13.0, 60.0),
    Row("reliable, one per 120 s, with acknowledgement", PLAN, 120.0, None, 1.0, 16.0, 1e9),
)


def traffic(row: Row, seed: int) -> tuple[int, int, list[float]]:
    """Return how many messages and frames were sent, and the delays, s."""
    line, published_at = LineOfFive(row.loss, seed=seed), {}

    def publish(number: int) -> None:
        value = number.to_bytes(4, "big") + bytes(MESSAGE_BYTES[row.stream_id] - 4)
        published_at[value] = line.network.now
        line.publish(row.stream_id, value)

    published = line.every(row.every_s, HOURS * 3600.0, random.Random(seed), publish)
    line.network.run(until_s=HOURS * 3600.0 + 900.0)
    delays = [(at - published_at[value]) / 1e9 for at, _, value in line.received]
    assert len({value for _, _, value in line.received}) == len(delays)
    return published, line.frames, delays


def photo_over_route_s(seed: int) -> float:
    """Return how long a large sample takes over four hops, s."""
    line = LineOfFive(0.1, seed=seed)
    photo = random.Random(seed).randbytes(PHOTO_BYTES)
    line.publish(PLAN, photo)
    line.network.at(200.0, lambda: line.network.restart(3))
    line.network.run(until_s=4 * 3600.0)
    assert line.values(PLAN) == [photo]
    return line.received[0][0] / 1e9


def photo_over_one_hop_s(seed: int) -> float:
    """Return how long it takes between two nodes that lose as many frames, s."""
    places = {1: 0.0, NODES: APART_M}
    nodes = tuple(
        NodeSpec(address=each, position=(at_m, 0.0, 10.0)) for each, at_m in places.items()
    )
    network = VirtualNetwork(Scenario(nodes=nodes, seed=seed), table(), digest=False)
    done_at: list[int] = []

    def look() -> None:
        if network.samples(NODES) and not done_at:
            done_at.append(network.now)

    network.every(1.0, look)
    network.publish(1, PLAN, random.Random(seed).randbytes(PHOTO_BYTES))
    network.run(until_s=4 * 3600.0)
    return done_at[0] / 1e9


def main() -> int:
    """Print two tables and return the exit code."""
    seeds = range(int(sys.argv[1]) if len(sys.argv) > 1 else 6)
    kept = True
    print(f"{'':<50} {'delivered':>9} {'frames':>7} {'p50 s':>6} {'p95 s':>6}")
    for row in ROWS:
        runs = [traffic(row, seed) for seed in seeds]
        delays = sorted(delay for _, _, some in runs for delay in some)
        share = len(delays) / sum(published for published, _, _ in runs)
        frames = sum(sent for _, sent, _ in runs) / len(delays)
        p95_s = delays[int(0.95 * len(delays))]
        kept &= share >= row.delivered and frames <= row.most_frames and p95_s <= row.p95_s
        p50_s = statistics.median(delays)
        print(f"{row.name:<50} {share:9.1%} {frames:7.1f} {p50_s:6.1f} {p95_s:6.1f}", flush=True)
    far_s = statistics.fmean(map(photo_over_route_s, seeds))
    near_s = statistics.fmean(map(photo_over_one_hop_s, seeds))
    share = near_s * 4 / far_s
    kept &= share >= 0.7
    print(
        f"\n10 KiB over four hops: {far_s:.0f} s; over one: {near_s:.0f} s; "
        f"{share:.0%} of a quarter of its rate"
    )
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
