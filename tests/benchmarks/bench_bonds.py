"""A vehicle with radio and sound that surfaces every ten minutes for two, for 24 hours.

    .venv/bin/python tests/benchmarks/bench_bonds.py [HOURS]

1000 m, S2C and datagrams; 1000 reliable samples at random instants, 200 calls across the switches,
a report every 30 s; then a day in which nothing is published.
"""

import random
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.surfacing import ARM, ASK, LOG, PERIOD_S, REPORT, SHORE, UP_S, Surfacing
from tests.virtual.twolinks import RADIO
from zacoustic.core.bond.reach import Reach


def main() -> int:
    """Print the figures."""
    hours = float(sys.argv[1]) if len(sys.argv) > 1 else 24.0
    for loss, radio_loss, hears_above in ((0.0, 0.0, True), (0.1, 0.0, True), (0.3, 0.1, False)):
        water = run(hours, loss, radio_loss, hears_above=hears_above)
        place = "heard" if hears_above else "deaf"
        print(f"loss by sound {loss:.0%}, by radio {radio_loss:.0%}; modems {place} at the surface")
        logged = [key for key in water.given_s if key[0] == LOG]
        lost = sum(key not in water.got_s for key in logged)
        doubled = sum(len(water.got_s.get(key, ())) > 1 for key in logged)
        print(f"  reliable: {len(logged)} given, {lost} lost, {doubled} doubled")
        for name, at_surface in (("below", False), ("at the surface", True)):
            delays = water.delays_s(LOG, is_at_surface=at_surface)
            print(f"  delay {name}: p50 {_at(delays, 0.5):.1f} s, p95 {_at(delays, 0.95):.1f} s")
        twice = sum(times > 1 for times in water.served.values())
        print(f"  calls: {dict(water.answers)}, {twice} run twice")
        reports = [key for key in water.given_s if key[0] == REPORT]
        print(f"  reports: {sum(key in water.got_s for key in reports)} of {len(reports)} arrived")
        print(f"  switched to radio after: p95 {_at(_switches(water), 0.95):.1f} s")
        frames = sum(link == RADIO for _, _, link, _ in water.frames)
        print(f"  frames: {frames} by radio, {len(water.frames) - frames} by sound")
        before = len(water.frames)
        water.network.run(until_s=(hours + 24.5) * 3600.0)
        print(f"  frames in a day without anything to say: {len(water.frames) - before}")
    return 0


def run(hours: float, loss: float, radio_loss: float, *, hears_above: bool) -> Surfacing:
    """Run the day, and half an hour in which all settles."""
    rng = random.Random(1)
    water = Surfacing(1, loss=loss, radio_loss=radio_loss, hears_above=hears_above, digest=False)
    end_s = hours * 3600.0
    for number in range(round(1000 * hours / 24)):
        water.publish_at(rng.uniform(10.0, end_s), LOG, b"l%d" % number)
    for number in range(round(100 * hours / 24)):
        switch_s = PERIOD_S * rng.randrange(1, round(end_s / PERIOD_S)) + rng.choice((0.0, UP_S))
        water.call_at(switch_s + rng.uniform(-3.0, 3.0), ARM, b"a%d" % number)
        water.call_at(switch_s + rng.uniform(-3.0, 3.0), ASK, b"b%d" % number)
    for number in range(round(end_s / 30.0)):
        water.publish_at(15.0 + 30.0 * number, REPORT, b"r%d" % number)
    water.network.run(until_s=end_s + 1800.0)
    return water


def _switches(water: Surfacing) -> list[float]:
    """Return how long after it had something to say at the surface the vehicle used the radio."""
    given = sorted(water.given_s.values())
    found: dict[float, float] = {}
    for at_s, event in water.reach:
        is_up = (event.address, event.link, event.reach) == (SHORE, RADIO, Reach.UP)
        if not is_up or at_s % PERIOD_S > UP_S:
            continue
        surfaced_s = at_s - at_s % PERIOD_S
        first_s = next((each for each in given if surfaced_s <= each <= at_s), at_s)
        found.setdefault(surfaced_s, at_s - first_s)
    return sorted(found.values())


def _at(values: list[float], share: float) -> float:
    return values[min(len(values) - 1, int(share * len(values)))] if values else float("nan")


if __name__ == "__main__":
    sys.exit(main())
