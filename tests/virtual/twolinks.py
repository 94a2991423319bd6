"""Nodes with two links: sound, 1000 m apart, and a radio without addresses and check.

Streams 1 to 6 go by sound, 11 to 16 by radio; otherwise the two are alike. Handlers answer calls
and pursue goals at once, and count how often they did.
"""

from collections import Counter
from functools import partial
from typing import Any, Final

from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.base.qos import Forward, Qos, Reliability
from zacoustic.core.engine.events import (
    Event,
    GoalKey,
    GoalReceived,
    GoalStatus,
    RequestReceived,
    SampleReceived,
)
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

SOUND: Final = "sound"
RADIO: Final = "radio"
LINKS: Final = (SOUND, RADIO)
FIX, PLAN, KEPT, ARM, MOVE, VIEW = 1, 2, 3, 4, 5, 6
"""Best effort; reliable; reliable and journalled; a service and an action of node 1; on demand."""
BESIDE: Final = 10
"""Stream ids of the radio are those of sound and this."""
ROUTES: Final = {each + BESIDE: RADIO for each in (FIX, PLAN, KEPT, ARM, MOVE, VIEW)}
MOST_FRAMES: Final = 20_000
"""Whoever sends more does not wait for answers."""
RADIO_MODEM: Final = Modem(addressed=False, checked=False, senses_carrier=False)


def fleet(nodes: int = 2) -> StreamTable:
    """Return the table of all nodes."""
    reliable = Qos(reliability=Reliability.RELIABLE, depth=50)
    streams: list[Any] = []
    for link, first in zip(LINKS, (0, BESIDE), strict=True):
        streams += [
            TopicSpec(stream_id=first + FIX, name=f"{link}/fix"),
            TopicSpec(stream_id=first + PLAN, name=f"{link}/plan", qos=reliable),
            TopicSpec(stream_id=first + KEPT, name=f"{link}/kept", qos=reliable, journal=True),
            ServiceSpec(stream_id=first + ARM, name=f"{link}/arm", server=1, timeout_s=600.0),
            ActionSpec(stream_id=first + MOVE, name=f"{link}/move", server=1, timeout_s=600.0),
            TopicSpec(
                stream_id=first + VIEW, name=f"{link}/view", qos=Qos(forward=Forward.ON_DEMAND)
            ),
        ]
    return StreamTable(streams, nodes={each: f"n{each}" for each in range(1, nodes + 1)})


def rules(
    sound: LinkRules | None = None, radio: LinkRules | None = None, **more: Any
) -> TransmitRules:
    """Return rules with both links."""
    links = (sound or LinkRules(name=SOUND), radio or LinkRules(name=RADIO))
    return TransmitRules(links=links, links_of_streams=ROUTES, **more)


def medium(nodes: int, *, apart_m: float, profile: str, loss: float, seed: int) -> Scenario:
    """Return a medium with nodes in a row."""
    return scenario_from_mapping(
        {
            "profile": profile,
            "channel": "none",
            "seed": seed,
            "loss": {"frame": loss},
            "nodes": [
                {"address": each, "position": [apart_m * each, 0, 10]}
                for each in range(1, nodes + 1)
            ],
        },
        source="a test",
    )


class TwoLinks:
    """A network of such nodes.

    Args:
        nodes: How many.
        loss: Share of lost frames on sound and radio.
        seed: Of both media.
        more: Arguments of `VirtualNetwork`.
    """

    def __init__(
        self, nodes: int = 2, *, loss: tuple[float, float] = (0.0, 0.0), seed: int = 1, **more: Any
    ) -> None:
        self.served: Counter[tuple[int, bytes]] = Counter()
        """How often each request and goal was begun, by stream and content."""
        self.frames: list[tuple[str, int, int, bytes]] = []
        """``(link, node, instant, frame)`` of what was sent."""
        self.events: list[tuple[int, Event]] = []
        more.setdefault("rules", rules())
        more.setdefault("table", fleet(nodes))
        self.network = VirtualNetwork(
            medium(nodes, apart_m=1000.0, profile="evologics_s2c_18_34", loss=loss[0], seed=seed),
            deliver=self._happened,
            trace=self._traced,
            **more,
        )
        # As late as datagrams of a network may be: a fifth of a second.
        radio = medium(nodes, apart_m=300.0, profile="ideal", loss=loss[1], seed=seed + 1)
        self.network.add_link(RADIO, radio, modem=RADIO_MODEM)

    def use_all(self, tag: bytes, photo: bytes, *, node: int = 2) -> None:
        """Use every kind of stream on both links; a photo is larger than a frame."""
        network = self.network
        for first in (0, BESIDE):
            network.publish(node, first + FIX, b"fix" + tag)
            network.publish(node, first + PLAN, b"plan" + tag)
            network.publish(node, first + KEPT, b"kept" + tag)
            self.call(node, first + ARM, b"arm" + tag)
            self.send_goal(node, first + MOVE, b"move" + tag)
            network.publish(node, first + PLAN, photo + tag)

    def got(self, node: int, stream_id: int) -> list[bytes]:
        """Return the values that a node received of a stream."""
        return [
            event.value
            for at, event in self.events
            if at == node and isinstance(event, SampleReceived) and event.stream_id == stream_id
        ]

    def told(self, node: int, kind: type) -> list[Any]:
        """Return the events of a class that a node has told."""
        return [event for at, event in self.events if at == node and isinstance(event, kind)]

    def sent(self, link: str) -> list[tuple[int, int, bytes]]:
        """Return what was sent on a link: node, instant, frame."""
        return [frame[1:] for frame in self.frames if frame[0] == link]

    def call(self, node: int, stream_id: int, request: bytes) -> int:
        """Call a service of node 1."""
        return self.network.apply(node, lambda engine, now: engine.call(stream_id, request, now))

    def send_goal(self, node: int, stream_id: int, goal: bytes) -> GoalKey:
        """Send a goal to node 1."""
        return self.network.apply(
            node, lambda engine, now: engine.actions.send_goal(stream_id, goal, now)
        )

    def acquaint(self, until_s: float = 120.0) -> None:
        """Let all nodes know each other, by both links."""
        for stream_id in (FIX, FIX + BESIDE):
            for node in self.network.addresses:
                for at_s in (0.0, until_s / 2):
                    self.network.at(
                        at_s + node, partial(self.network.publish, node, stream_id, b"hi")
                    )
        self.network.run(until_s=until_s)

    # Below the methods above

    def _traced(self, record: Any) -> None:
        if record.what == "transmit":
            frame = bytes.fromhex(record.frame)
            self.frames.append((record.link, record.node, record.at, frame))
            assert len(self.frames) < MOST_FRAMES, f"{record.link} repeats without end"

    def _happened(self, node: int, event: Event) -> None:
        self.events.append((node, event))
        if isinstance(event, RequestReceived):
            self.served[event.call.stream_id, event.value] += 1
            self._later(node, lambda engine, now: engine.reply(event.call, event.value[::-1], now))
        elif isinstance(event, GoalReceived):
            self.served[event.goal.stream_id, event.value] += 1
            self._later(node, lambda engine, now: self._pursue(engine, event.goal, now))

    def _later(self, node: int, command: Any) -> None:
        def act() -> None:
            if self.network.is_running(node):
                self.network.apply(node, command)

        self.network.at(self.network.now / 1e9, act)

    @staticmethod
    def _pursue(engine: Any, goal: GoalKey, now: int) -> None:
        if engine.actions.accept(goal, now):
            engine.actions.finish(goal, GoalStatus.SUCCEEDED, b"done", now)
