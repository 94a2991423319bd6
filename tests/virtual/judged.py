"""What random scenarios have in common: what came of them, and what must not have happened."""

import random
from functools import partial
from typing import Final

from zacoustic.core.base.qos import Qos
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.testing.virtual import VirtualNetwork

NEWS: Final = TopicSpec(stream_id=1, name="news", qos=Qos(depth=1))
"""Chatter of all nodes beside what a scenario is about."""


class JudgedScenario:
    """A random scenario that judges itself.

    Args:
        seed: Everything follows from it.
    """

    network: VirtualNetwork

    def __init__(self, seed: int) -> None:
        self.seed = seed
        self.violations: list[str] = []
        self.outcomes: dict[str, int] = {}

    def _count(self, outcome: str) -> None:
        self.outcomes[outcome] = self.outcomes.get(outcome, 0) + 1

    def _complain(self, what: str) -> None:
        self.violations.append(f"seed {self.seed}, {self.network.now / NS_PER_S:.1f} s: {what}")

    def _plan_news(self, rng: random.Random, addresses: range, busy_s: float) -> None:
        """Let each node publish news now and then."""
        for address in addresses:
            at_s = rng.uniform(0, 60)
            while at_s < busy_s:
                self.network.at(at_s, partial(self._publish_news, address))
                at_s += rng.uniform(10, 120)

    def _publish_news(self, address: int) -> None:
        if self.network.is_running(address):
            self.network.publish(address, NEWS.stream_id, b"news")

    def _expect_rest(self, addresses: range) -> None:
        """All is over: no engine has anything to do."""
        for address in addresses:
            if not self.network.engine(address).is_idle:
                self._complain(f"node {address} does not come to rest")
