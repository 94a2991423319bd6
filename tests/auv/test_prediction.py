"""Between two reports the vehicle is where the console says, as often as it says."""

import math
import random
from collections import defaultdict
from collections.abc import Callable

import pytest

from examples.auv.craft import Craft
from examples.auv.messages import (
    ELEVATOR,
    NAV,
    RUDDER,
    THRUST,
    Hold,
    Nav,
    Waypoint,
)
from examples.auv.shore import Shore
from examples.auv.start import NAV_PERIOD_S, START


@pytest.mark.parametrize("loss", [0.0, 0.4, 0.7])
def test_the_vehicle_is_where_the_rings_say_whatever_the_age_of_the_report(
    loss: float, count: Callable[[int], int]
) -> None:
    """Two standard deviations in the plane promise 86 %, at every age; and they are not idle."""
    inside: dict[int, list[bool]] = defaultdict(list)
    share_of_ring: list[float] = []
    for seed in range(count(200)):
        for age_s, off_m, sigma_m in dive_and_predict(seed, loss):
            inside[int(age_s // 6)].append(off_m <= 2 * sigma_m)
            share_of_ring.append(off_m / sigma_m)
    for bin_, found in inside.items():
        if len(found) >= 500:
            assert sum(found) / len(found) >= 0.86, bin_
    assert sorted(share_of_ring)[len(share_of_ring) // 2] > 0.5


def dive_and_predict(seed: int, loss: float) -> list[tuple[float, float, float]]:
    """Steer at random for ten minutes; gives age, how far off, and how sure, twice a second."""
    rng = random.Random(f"{seed}/{loss}")
    craft, shore = Craft(START, seed=seed), Shore()
    craft.arm(True)
    found = []
    order_at_s, report_at_s = 5.0, 1.0
    on_the_way: list[tuple[float, Nav]] = []
    for tick in range(1200):
        now_s = tick / 2
        craft.advance(now_s)
        if now_s >= order_at_s:
            order_at_s = now_s + rng.uniform(5, 60)
            order_at_random(craft, rng)
        if now_s >= report_at_s:
            report_at_s += NAV_PERIOD_S
            if rng.random() >= loss:
                on_the_way.append((now_s + 1.5, craft.nav()))
        while on_the_way and on_the_way[0][0] <= now_s:
            at_s, report = on_the_way.pop(0)
            shore.hear(NAV, report, at_s, way_s=1.5)
        estimate = shore.estimate(now_s)
        if estimate is not None:
            place = craft.motion
            off_m = math.hypot(estimate.north - place.north_m, estimate.east - place.east_m)
            found.append((estimate.age_s, off_m, estimate.sigma))
    return found


def order_at_random(craft: Craft, rng: random.Random) -> None:
    if rng.random() < 0.5:
        craft.hold(Hold(False))
        craft.set_joint(THRUST, -rng.uniform(0, 31))
        craft.set_joint(RUDDER, rng.uniform(-0.25, 0.25))
        craft.set_joint(ELEVATOR, rng.uniform(-0.05, 0.05))
    elif rng.random() < 0.5:
        craft.hold(Hold(True, rng.uniform(2, 30), rng.uniform(0, 359), rng.uniform(0.5, 2)))
    else:
        craft.goto(Waypoint(rng.uniform(-300, 300), rng.uniform(-300, 300), 10.0))
