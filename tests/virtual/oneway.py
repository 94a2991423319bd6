"""A node that fills its link with the positions of eight vehicles, and others that only listen."""

import random
from functools import partial
from typing import Any, Final

from tests.virtual.fleet import line
from tests.virtual.test_dense import NAV
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import TypeTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

TOPICS: Final = 8
"""Topics, each with a sample that waits: no block has two of one topic."""


class OneWay:
    """Node 1 publishes more than its link can take; node 2 has nothing to say.

    Args:
        codec: Of the topic.
        period_s: Interval of the samples, s.
        answer_s: Interval at which node 2 says something, s; 0: never.
        modem: Of both nodes.
        receivers: How many nodes listen.
        loss: Share of the frames that is lost.
        seed: Of the samples.
        settings: Of the scenario.
    """

    def __init__(
        self, codec: str, *, period_s: float = 0.1, answer_s: float = 0.0,
        modem: Modem | None = None, receivers: int = 1, loss: float = 0.0, seed: int = 1,
        **settings: Any,
    ) -> None:  # fmt: skip
        self._rng = random.Random(f"one way/{seed}")
        lost = random.Random(f"lost/{seed}")
        self.came = 0
        self.wrong = 0
        self._published: dict[int, dict[str, Any]] = {}
        self._ways = [[43.1, 6.0, 20.0, 90.0] for _ in range(TOPICS)]
        others = tuple(range(2, 2 + receivers))
        navs = [
            TopicSpec(
                stream_id=10 + each, name=f"nav{each}", type_name="Nav", codec=codec,
                qos=Qos(depth=1), publishers=(1,), subscribers=others,
            )
            for each in range(TOPICS)
        ]  # fmt: skip
        word = TopicSpec(stream_id=9, name="word", publishers=others, subscribers=(1,))
        nodes = {each: f"n{each}" for each in (1, *others)}
        self.network = VirtualNetwork(
            line(*(500.0 * each for each in range(len(nodes))), **settings),
            StreamTable([*navs, word], types=TypeTable([NAV]), nodes=nodes),
            modem=modem or Modem(), deliver=self._take, digest=False,
            disturb=lambda *_: () if lost.random() < loss else (0.0,),
        )  # fmt: skip
        self._period_s, self._answer_s = period_s, answer_s

    def run(self, seconds: float) -> int:
        """Run; return how many samples came."""
        for number in range(int(seconds / self._period_s)):
            self.network.at(1 + number * self._period_s, self._publish)
        if self._answer_s:
            for number in range(int(seconds / self._answer_s)):
                at_s = 1 + number * self._answer_s
                self.network.at(at_s, partial(self.network.publish, 2, 9, b"word"))
        self.network.run(until_s=1 + seconds)
        return self.came

    def _publish(self) -> None:
        rng, ticket = self._rng, len(self._published) % 60_000
        way = self._ways[ticket % TOPICS]
        way[3] = (way[3] + rng.gauss(0, 3)) % 360
        way[0] += rng.gauss(5e-6, 1e-6)
        way[2] = min(max(way[2] + rng.gauss(0, 0.3), 0), 1000)
        value = {
            "ticket": ticket, "lat": min(way[0], 43.2), "lon": way[1], "depth": way[2],
            "heading": way[3], "speed": 1.2 + rng.gauss(0, 0.02),
        }  # fmt: skip
        self._published[ticket] = value
        self.network.publish(1, 10 + ticket % TOPICS, value)

    def _take(self, address: int, event: Event) -> None:
        if isinstance(event, SampleReceived) and event.stream_id >= 10:
            sent = self._published.get(event.value["ticket"], {"depth": -1.0})
            self.wrong += abs(sent["depth"] - event.value["depth"]) > 0.06
            self.came += address == 2
