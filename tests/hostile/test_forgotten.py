"""Nodes are forgotten at any instant, whatever is under way with them."""

import functools
import random
from collections.abc import Callable

from tests.hostile.drive import Drive
from tests.hostile.scenario import hostile

_TIMES = 12


def test_node_may_be_forgotten_at_any_instant(count: Callable[[int], int]) -> None:
    # 17: forgotten while its SUBSCRIBE is journalled; 152: the answer to one met the next sample.
    for seed in (17, 152, *range(count(400))):
        drive, rng = Drive(hostile(seed)), random.Random(f"forget {seed}")
        addresses = drive.hostile.addresses
        for _ in range(_TIMES):
            node, other = rng.sample(addresses, 2)
            at_s = rng.uniform(1, drive.hostile.busy_s)
            drive.network.at(at_s, functools.partial(_forget, drive, node, other))
        # What is forgotten may run, or be handed on, twice; all the rest holds.
        violations = [each for each in drive.run() if "never ends" in each or "not idle" in each]
        assert not violations, f"seed {seed}: {violations}"


def _forget(drive: Drive, node: int, other: int) -> None:
    if drive.network.is_running(node):
        drive.network.apply(node, lambda engine, now: engine.forget(other, now))
