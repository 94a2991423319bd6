"""What goes wrong in a scenario: lossy links, crashes, outages, duplicates, drifting clocks."""

import random
from collections.abc import Callable
from typing import Any, Final

from tests.virtual.fleet import line, settling_s
from zacoustic.channel.profiles import profile_named
from zacoustic.channel.scenario import Scenario
from zacoustic.testing.virtual import Modem

_MOST_LOSS: Final = 0.6
_MOST_CRASHES: Final = 10
LONGEST_OUTAGE_S: Final = 1800.0


def weather(
    rng: random.Random,
    seed: int,
    addresses: range,
    busy_s: float,
    modem: Modem,
    outage_s: Callable[[random.Random], float],
) -> Scenario:
    """Draw a scenario, bad for `busy_s` and then calm.

    Args:
        rng: Draws it.
        seed: Of the scenario itself.
        addresses: Nodes, somewhere on a line of 2 km.
        busy_s: How long it lasts, s.
        modem: What they have.
        outage_s: Draws how long an outage lasts, s.
    """
    positions = [rng.uniform(0, 2000) for _ in addresses]
    bare = line(*positions)
    capabilities = modem.capabilities(profile_named(bare.profile), bare.farthest_s)
    worst = rng.choice((0.0, 0.3, _MOST_LOSS))
    links = [
        {"from": source, "to": target, "loss": _loss(rng, worst, busy_s)}
        for source in addresses
        for target in addresses
        if source != target
    ]
    most = rng.choice((0, 2, _MOST_CRASHES))
    crashes = [
        {
            "node": address,
            "at_s": sorted(rng.uniform(0, busy_s) for _ in range(rng.randint(1, most))),
            "restart_after_s": rng.choice((0, 0, 1, 20, 200)),
            "reboots": rng.random() < 0.5,
        }
        for address in addresses
        if most and rng.random() < 0.8
    ]
    faults = {
        "duplicate": rng.choice((0.0, 0.1, 0.5)),
        "duplicate_after_s": [0.0, 0.95 * settling_s(capabilities)],
        "jitter_s": rng.choice((0.0, 0.0, 0.05)),
        "blackouts": [
            _outage(rng, addresses, busy_s, outage_s) for _ in range(rng.choice((0, 0, 1, 3)))
        ],
        "crashes": crashes,
        "clocks": [
            {"node": address, "drift_ppm": rng.choice((20.0, -100.0))}
            for address in addresses
            if rng.random() < 0.3
        ],
        "journal": {
            "commit_s": rng.choice((0.0, 0.005, 0.05, 1.0)),
            "untold": rng.choice((0.0, 0.5)),
        },
        "until_s": busy_s,
    }
    return line(*positions, seed=seed, channel="none", links=links, faults=faults)


def _loss(rng: random.Random, worst: float, busy_s: float) -> dict[str, Any]:
    share = rng.uniform(0, worst)
    loss: dict[str, Any] = {"frame": share, "until_s": busy_s}
    if rng.random() < 0.5:
        loss["burst_frames"] = max(1.0, share / (1 - share)) * rng.uniform(1, 10)
    return loss


def _outage(
    rng: random.Random,
    addresses: range,
    busy_s: float,
    outage_s: Callable[[random.Random], float],
) -> dict[str, Any]:
    begin_s = rng.uniform(0, busy_s - 1)
    outage: dict[str, Any] = {"from_s": begin_s, "to_s": min(busy_s, begin_s + outage_s(rng))}
    if rng.random() < 0.5:
        return outage | {"node": rng.choice(addresses)}
    return outage | {"pair": rng.sample(addresses, 2)}
