"""A subscription that holds for ten minutes is proved in that time, however long a node was away.

Behind a flood, repetitions to an absent node become rare: at first every minute, after an hour
every half an hour. When it is back, its answer says that it has taken the subscription for ten
minutes; then the proof must not wait for half an hour.
"""

import random
from collections.abc import Callable
from functools import partial
from typing import Final

from zacoustic.channel.scenario import LinkSpec, NodeSpec, Scenario
from zacoustic.core.base.qos import Forward, Qos
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, SubscribersChanged
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

VIDEO: Final = 1
NODES: Final = (1, 2, 3)
AWAY_S: Final = 3600.0
UNTIL_S: Final = AWAY_S + 2.5 * 3600.0
LOSS: Final = 0.4


class Away:
    """Three nodes in a line; node 1 publishes, and nobody hears it in the first hour."""

    def __init__(self, seed: int) -> None:
        self.events: list[tuple[float, int, Event]] = []
        self._rng = random.Random(seed)
        self._is_ready = False
        scenario = Scenario(
            seed=seed,
            channel="sea",
            nodes=tuple(NodeSpec(address=each, position=(1000.0 * each, 0, 10)) for each in NODES),
            links=(
                LinkSpec(source=1, target=3, gain_db=-100.0),
                LinkSpec(source=3, target=1, gain_db=-100.0),
            ),
        )
        video = TopicSpec(
            stream_id=VIDEO, name="video", publishers=(1,), subscribers=(3,),
            qos=Qos(forward=Forward.ON_DEMAND),
        )  # fmt: skip
        self.network = VirtualNetwork(
            scenario,
            StreamTable([video], nodes={each: f"n{each}" for each in NODES}),
            rules=TransmitRules(flood=Flood(link="link", hops=4), default_link=FLOOD_NAME),
            disturb=self._disturb,
            deliver=self._happened,
            digest=False,
        )
        self._is_ready = True

    @property
    def now_s(self) -> float:
        return self.network.now / NS_PER_S

    def times(self, kind: type[Event]) -> list[float]:
        """Return when events of a kind were told, s."""
        return [at_s for at_s, _, event in self.events if isinstance(event, kind)]

    def _disturb(self, source: int, node: int, now: int) -> tuple[float, ...]:
        is_away = now < AWAY_S * NS_PER_S and 1 in (source, node)
        return () if is_away or self._rng.random() < LOSS else (0.0,)

    def _happened(self, node: int, event: Event) -> None:
        if self._is_ready:
            self.events.append((self.now_s, node, event))


def subscribe(engine: Engine, now: int) -> None:
    engine.subscriptions.want(VIDEO, now)


def test_a_subscription_ends_no_more_once_its_publisher_has_taken_it(
    count: Callable[[int], int],
) -> None:
    ended = 0
    for seed in range(count(600)):
        away = Away(seed)
        away.network.at(10.0, partial(away.network.apply, 3, subscribe))
        for number in range(140):
            away.network.at(AWAY_S + 60.0 * number, partial(away.network.publish, 1, VIDEO, b"i"))
        away.network.run(until_s=UNTIL_S)
        changes = away.times(SubscribersChanged)
        assert changes, f"seed {seed}: node 1 has never heard that node 3 subscribes"
        ended += len(changes) > 1
    # Of five proofs in ten minutes, each with its answer over two hops, all may be lost.
    assert ended <= count(600) // 30
