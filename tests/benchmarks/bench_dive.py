"""The dive of examples/auv in virtual time: way-points, latency of orders, and of the stop.

Vehicle and shore on real engines, S2C modems 1500 m apart, a report every 5 s. Run:
``python tests/benchmarks/bench_dive.py [SEEDS]``; ends with 1 when a figure is worse than promised.
"""

import random
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from examples.auv.dive import DEPTH_WITHIN_M, REACHED_WITHIN_M, Dive
from examples.auv.messages import ARM, HOLD, STOP, TAKE_PHOTO, Arm, Hold, Stop, TakePhoto
from examples.auv.virtual import VirtualDive

SEEDS: Final = 20
WORST_ORDER_S: Final = 10.0
"""At 20 % loss, 95th percentile."""
WORST_STOP_S: Final = 6.0
"""At 40 % loss, 95th percentile."""
WORST_STOP_WITH_PHOTO_S: Final = 10.0
_WITHIN_S: Final = 120.0

RemoteCommand = Callable[[VirtualDive], None]


def percentile(values: list[float], share: float) -> float:
    """Return the value below which that share of them lies."""
    return sorted(values)[min(len(values) - 1, int(len(values) * share))]


def stop(water: VirtualDive) -> None:
    """Order the vehicle to stop."""
    water.put(STOP, Stop())


def hold(water: VirtualDive) -> None:
    """Order the autopilot to steer."""
    water.call(HOLD, Hold(True, 10.0, 90.0, 1.5))


def latency_s(seed: int, loss: float, order: RemoteCommand, *, with_photo: bool) -> float:
    """Measure how long one order takes to the vehicle's program; infinity: it did not arrive."""
    water = VirtualDive(seed=seed, loss=loss)
    water.network.run(until_s=30.0)
    water.call(ARM, Arm(True))
    water.network.run(until_s=60.0)
    if with_photo:
        water.call(TAKE_PHOTO, TakePhoto(1))
    water.network.run(until_s=90.0 + random.Random(seed).uniform(0.0, 20.0))
    known = len(water.arrivals)
    order(water)
    water.network.run(until_s=water.now_s + _WITHIN_S)
    return water.arrivals[known].took_s if len(water.arrivals) > known else float("inf")


def dives(seeds: int) -> bool:
    """Run whole dives; tells whether all was as promised."""
    kept = True
    print("loss  dives  complete  worst way-point m  worst depth m  orders p50, p95 s  unaccounted")
    for loss in (0.0, 0.2, 0.4):
        complete, away_m, off_m, unaccounted = 0, 0.0, 0.0, 0
        took_s: list[float] = []
        for seed in range(seeds):
            water = VirtualDive(seed=seed, loss=loss)
            dive = Dive(water.shore, water)
            water.run(dive)
            complete += dive.is_over and not dive.problems
            for line in dive.problems:
                print(f"      seed {seed}: {line}")
            away_m = max([away_m, *(away for away, _ in water.missed)])
            off_m = max([off_m, *(off for _, off in water.missed)])
            unaccounted += water.unaccounted()
            took_s += [each.took_s for each in water.arrivals]
        p50, p95 = percentile(took_s, 0.5), percentile(took_s, 0.95)
        print(
            f"{loss:4.0%}  {seeds:5}  {complete:8}  {away_m:17.2f}  {off_m:13.2f}  "
            f"{p50:9.1f} {p95:7.1f}  {unaccounted:11}"
        )
        kept = kept and complete == seeds and unaccounted == 0
        kept = kept and away_m <= REACHED_WITHIN_M and off_m <= DEPTH_WITHIN_M
        kept = kept and (loss > 0.2 or p95 <= WORST_ORDER_S)
    return kept


def main() -> int:
    """Print the tables; returns 1 when something is worse than promised."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else SEEDS
    kept = dives(seeds)
    print()
    print("an order, from the shore to the vehicle's program       p50 s   p95 s   p99 s")
    cases: tuple[tuple[str, float, RemoteCommand, bool, float], ...] = (
        ("hold, 20 % loss", 0.2, hold, False, WORST_ORDER_S),
        ("hold, 20 % loss, a photo is coming up", 0.2, hold, True, WORST_ORDER_S),
        ("stop, 40 % loss", 0.4, stop, False, WORST_STOP_S),
        ("stop, a photo is coming up", 0.0, stop, True, WORST_STOP_WITH_PHOTO_S),
        ("stop, 40 % loss, a photo is coming up", 0.4, stop, True, WORST_STOP_WITH_PHOTO_S),
    )
    for name, loss, order, with_photo, worst_s in cases:
        runs = [latency_s(seed, loss, order, with_photo=with_photo) for seed in range(5 * seeds)]
        p50, p95, p99 = (percentile(runs, share) for share in (0.5, 0.95, 0.99))
        print(f"{name:52}  {p50:6.1f}  {p95:6.1f}  {p99:6.1f}")
        kept = kept and p95 <= worst_s
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
