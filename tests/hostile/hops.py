"""A sealed fleet whose frames go over other nodes, and an enemy beside it without a key.

Nodes 1 to 4 stand in a line and hear their neighbours. Some streams go by a route over the line,
some are flooded, and some go by a bond of sound and radio. The enemy hears every frame, and sends
whatever it likes under any address, at any node.
"""

import random
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from tests.virtual.sealed import SealedFleet
from tests.virtual.twolinks import RADIO, RADIO_MODEM, SOUND, medium
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.bond.spec import Bond, BondLink, LinkCost
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, SampleReceived, SealAlarm
from zacoustic.core.engine.tap import EngineCall, Tap
from zacoustic.core.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.core.relay.route import Route
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.relay import HopAcks, Number, Relayed
from zacoustic.testing.virtual import VirtualNetwork

NODES: Final = (1, 2, 3, 4)
STOP, ABORT, TALK, FLOODED, BONDED = 1, 2, 3, 4, 5
"""An urgent topic from node 1 to node 4, best-effort and reliable; topics that each publishes."""
ROUTE: Final = Route(route_id=1, name="far", path=NODES, link=SOUND)
BOND: Final = Bond(number=31, links=(RADIO, SOUND))
ENEMIES: Final = ("none", "acks", "echoes", "replays", "holds")
"""What an enemy may do."""
_FIRST_S: Final = 700.0
_APART_S: Final = 60.0

Sent = tuple[float, int, str, bytes]
"""``(instant, node, link, frame)``"""


class Hops:
    """The fleet.

    Args:
        seed: Everything follows from it.
        loss: Share of the frames that are lost on a hop.
        build: Makes the engines.
    """

    def __init__(
        self, seed: int = 1, *, loss: float = 0.0, build: Callable[..., Engine] | None = None
    ) -> None:
        self.sent: list[Sent] = []
        """What the modems were given."""
        self.got_s: dict[tuple[int, bytes], list[float]] = {}
        """When node 4 got a value, by stream and value."""
        self.heard: dict[tuple[int, str], set[bytes]] = {}
        """What has come to each node, by node and link."""
        self.told: list[tuple[int, Event]] = []
        self._rng = random.Random(f"hops {seed}")
        self._loss = loss
        self._eavesdrop: Callable[[Sent], None] | None = None
        urgent: dict[str, Any] = {"publishers": (1,), "subscribers": (4,)}
        table = StreamTable(
            [
                TopicSpec(stream_id=STOP, name="stop", qos=_urgent(Reliability.BEST_EFFORT),
                          **urgent),
                TopicSpec(stream_id=ABORT, name="abort", qos=_urgent(Reliability.RELIABLE),
                          **urgent),
                TopicSpec(stream_id=TALK, name="{node}/talk", subscribers=(1, 4)),
                TopicSpec(stream_id=FLOODED, name="{node}/flooded"),
                TopicSpec(stream_id=BONDED, name="{node}/bonded"),
            ],
            nodes={each: f"n{each}" for each in NODES},
        )  # fmt: skip
        of_ends = dict.fromkeys((STOP, ABORT, TALK), ROUTE.name)
        of_all = {FLOODED: FLOOD_NAME, BONDED: BOND.name}
        self.network = VirtualNetwork(
            medium(4, apart_m=1000.0, profile="evologics_s2c_18_34", loss=0.0, seed=seed),
            table,
            rules={
                each: TransmitRules(
                    links=(
                        LinkRules(name=SOUND),
                        LinkRules(name=RADIO, bonded=BondLink(cost=LinkCost.FREE)),
                    ),
                    routes=(ROUTE,),
                    flood=Flood(link=SOUND),
                    bonds=(BOND,),
                    links_of_streams=of_all | (of_ends if each in (1, 4) else {}),
                )
                for each in NODES
            },
            build=build or SealedFleet(),
            disturb=self._disturb,
            deliver=self._happened,
            trace=self._traced,
            digest=False,
        )
        radio = medium(4, apart_m=300.0, profile="ideal", loss=0.0, seed=seed + 1)
        self.network.add_link(RADIO, radio, modem=RADIO_MODEM, disturb=self._disturb)
        for each in NODES:
            Tap(self.network.engine(each), partial(self._hears, each), ["handle_frame"])

    @property
    def now_s(self) -> float:
        """The instant, s."""
        return self.network.now / NS_PER_S

    def eavesdrop(self, take: Callable[[Sent], None]) -> None:
        """Show every further frame to the enemy, at the instant of its transmission."""
        self._eavesdrop = take

    def acquaint(self, until_s: float = 600.0) -> None:
        """Let all nodes hear each other, by each way."""
        for number in range(4):
            for place, node in enumerate(NODES):
                at_s = 5.0 + 120.0 * number + 20.0 * place
                streams = (FLOODED, BONDED) if node in (2, 3) else (TALK, FLOODED, BONDED)
                for stream_id in streams:
                    self.network.at(at_s, partial(self.network.publish, node, stream_id, b"hi"))
        self.network.run(until_s=until_s)

    def inject(
        self, to: int, source: int, frame: bytes, link: str = SOUND, destination: int = BROADCAST
    ) -> None:
        """Let a node hear a frame of the enemy now."""

        def hear(engine: Engine, now: int) -> None:
            if link == RADIO:  # whose frames have addresses of their own
                addressed = bytes((destination, source)) + frame
                received = ReceivedFrame(frame_bytes=addressed, received_at=now)
            else:
                received = ReceivedFrame(
                    frame_bytes=frame, received_at=now, source=source, destination=destination
                )
            engine.handle_frame(received, now, link)

        if self.network.is_running(to):
            self.network.apply(to, hear)

    def inject_at(self, at_s: float, to: int, source: int, frame: bytes) -> None:
        """Let a node hear a frame at an instant."""
        self.network.at(at_s, lambda: self.inject(to, source, frame))

    # Below the methods above

    def _hears(self, node: int, call: EngineCall) -> None:
        link = call.arguments.get("link") or SOUND
        self.heard.setdefault((node, link), set()).add(call.arguments["frame"].frame_bytes)

    def _disturb(self, source: int, node: int, now: int) -> Sequence[float]:
        if abs(source - node) != 1 or self._rng.random() < self._loss:
            return ()
        return (0.0,)

    def _traced(self, record: TraceRecord) -> None:
        if record.what != "transmit" or record.link not in (SOUND, RADIO):
            return
        sent = (record.at / NS_PER_S, record.node, record.link, bytes.fromhex(record.frame))
        self.sent.append(sent)
        if self._eavesdrop is not None:
            self._eavesdrop(sent)

    def _happened(self, node: int, event: Event) -> None:
        if not isinstance(event, SealAlarm):
            self.told.append((node, event))
        if node == 4 and isinstance(event, SampleReceived) and isinstance(event.value, bytes):
            self.got_s.setdefault((event.stream_id, event.value), []).append(self.now_s)


def _urgent(reliability: Reliability) -> Qos:
    return Qos(reliability=reliability, depth=50, priority=Priority.REAL_TIME)


class Enemy:
    """Stands beside node 1, hears what it sends over the route, and answers at once.

    Args:
        hops: The fleet.
        kind: What it does.
    """

    def __init__(self, hops: Hops, kind: str) -> None:
        self._hops = hops
        self._rng = random.Random(f"enemy {kind}")
        self._heard: list[Sent] = []
        self.forged = 0
        if kind != "none":
            hops.eavesdrop(getattr(self, f"_{kind}"))

    def _answers(self, sent: Sent) -> bool:
        return sent[1] == 1 and sent[2] == SOUND

    def _send(self, source: int, frame: bytes, after_s: float = 1.2) -> None:
        self.forged += 1
        self._hops.inject_at(self._hops.now_s + after_s, 1, source, frame)

    def _acks(self, sent: Sent) -> None:
        """Acknowledge each frame, and every number if it cannot be read."""
        if self._answers(sent):
            numbers = [sent[3][2]] if sent[3][0] == 0xBF else range(256)
            for first in range(0, len(numbers), 24):
                some = [Number(1, False, each) for each in list(numbers)[first : first + 24]]
                self._send(2, HopAcks(tuple(some)).encode())

    def _echoes(self, sent: Sent) -> None:
        """Send the frame again as the next node would."""
        if self._answers(sent):
            self._send(2, sent[3])

    def _replays(self, sent: Sent) -> None:
        """Send what the next node has sent before, frames and acknowledgements."""
        if sent[1] == 2 and sent[2] == SOUND:
            self._heard.append(sent)
        elif self._answers(sent):
            for _, _, _, frame in self._heard[-20:]:
                self._send(2, frame)

    def _holds(self, sent: Sent) -> None:
        """Announce trains that never come."""
        if self._answers(sent):
            for number in range(20):
                seq = self._rng.randrange(256)
                frame = Relayed(Number(1, True, seq), bytes(10), more=True).encode()
                self._send(2, frame, after_s=3.0 * number)


class Trial:
    """Urgent samples from node 1 to node 4 over the route, a minute apart, beside an enemy.

    Args:
        seed: Everything follows from it.
        kind: What the enemy does, one of `ENEMIES`.
        stream_id: `STOP` or `ABORT`.
        loss: Share of the frames that are lost on a hop.
        stops: How many samples there are.
        build: Makes the engines; None: those of a fleet with one key.
    """

    def __init__(
        self,
        seed: int,
        kind: str,
        stream_id: int,
        *,
        loss: float,
        stops: int,
        build: Callable[..., Engine] | None = None,
    ) -> None:
        self.hops = hops = Hops(seed, loss=loss, build=build)
        hops.acquaint()
        self.enemy = Enemy(hops, kind)
        before = len(hops.sent)
        for number in range(stops):
            publish = partial(hops.network.publish, 1, stream_id, b"stop%d" % number)
            hops.network.at(_FIRST_S + _APART_S * number, publish)
        hops.network.run(until_s=_FIRST_S + _APART_S * stops + 1200.0)
        got_s = {
            int(value[4:]): at_s for (each, value), at_s in hops.got_s.items() if each == stream_id
        }
        assert all(len(at_s) == 1 for at_s in got_s.values()), "a sample arrived twice"
        self.delays_s = sorted(
            at_s[0] - _FIRST_S - _APART_S * number for number, at_s in got_s.items()
        )
        """Of the samples that have arrived."""
        self.frames = [each[3] for each in hops.sent[before:] if each[2] == SOUND]
        """What the modems were given meanwhile."""
