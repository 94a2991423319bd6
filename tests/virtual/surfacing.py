"""A vehicle that surfaces now and then: radio and sound to the shore, each stream by both.

Node 1 is the shore, node 2 the vehicle, 1000 m apart. For `UP_S` of each `PERIOD_S` datagrams get
through in both directions; the modems hear each other all the time, or only below.
"""

import random
from collections import Counter
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, Final

from tests.virtual.twolinks import RADIO, RADIO_MODEM, SOUND, medium
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.bond.spec import Bond, BondLink, LinkCost
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    CallFailed,
    DeliveryEnded,
    DeliveryOutcome,
    Event,
    GoalReceived,
    GoalStatus,
    PeerReachable,
    RequestReceived,
    ResponseReceived,
    ResultReceived,
    SampleReceived,
)
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

SHORE, AUV = 1, 2
REPORT, LOG, ARM, ASK, GOTO, STOP, PHOTO = 1, 2, 3, 4, 5, 6, 7
"""A best-effort and a reliable topic of the vehicle, a service of each node, an action of the
vehicle, an urgent topic of the shore, and large samples of the vehicle."""
BOND: Final = Bond(number=31, links=(RADIO, SOUND))
PERIOD_S, UP_S = 600.0, 120.0


def table(nodes: Sequence[int] = (SHORE, AUV)) -> StreamTable:
    """Return the table of all nodes."""
    reliable = Qos(reliability=Reliability.RELIABLE, depth=100)
    urgent = Qos(reliability=Reliability.RELIABLE, depth=4, priority=Priority.REAL_TIME)
    by_auv: dict[str, Any] = {"publishers": (AUV,), "subscribers": (SHORE,)}
    return StreamTable(
        [
            TopicSpec(stream_id=REPORT, name="report", **by_auv),
            TopicSpec(stream_id=LOG, name="log", qos=reliable, journal=True, **by_auv),
            ServiceSpec(stream_id=ARM, name="arm", server=AUV, timeout_s=600.0),
            ServiceSpec(stream_id=ASK, name="ask", server=SHORE, timeout_s=600.0),
            ActionSpec(stream_id=GOTO, name="goto", server=AUV, timeout_s=600.0),
            TopicSpec(
                stream_id=STOP, name="stop", qos=urgent, publishers=(SHORE,), subscribers=(AUV,)
            ),
            TopicSpec(stream_id=PHOTO, name="photo", qos=reliable, **by_auv),
        ],
        nodes={each: f"n{each}" for each in nodes},
    )


def rules(*, links: tuple[str, ...] = (SOUND, RADIO), **more: Any) -> TransmitRules:
    """Return the rules of a node that has these links."""
    known = {
        SOUND: LinkRules(name=SOUND),
        RADIO: LinkRules(name=RADIO, bonded=BondLink(cost=LinkCost.FREE)),
    }
    streams = dict.fromkeys((REPORT, LOG, ARM, ASK, GOTO, STOP, PHOTO), BOND.name)
    return TransmitRules(
        links=tuple(known[each] for each in links),
        bonds=(BOND,),
        links_of_streams=streams,
        default_link=BOND.name,
        **more,
    )


def is_up(now: int) -> bool:
    """Return whether the vehicle is at the surface at an instant, ns."""
    return now / NS_PER_S % PERIOD_S < UP_S


class Surfacing:
    """The two nodes, and what they told.

    Args:
        seed: Everything follows from it.
        loss: Share of the frames that are lost by sound.
        radio_loss: Share of the datagrams that are lost at the surface.
        hears_above: Whether the modems hear each other while the vehicle is up.
        copies: Extra arrivals of each datagram, s after the first.
        more: Arguments of `VirtualNetwork`.
    """

    def __init__(
        self,
        seed: int = 1,
        *,
        loss: float = 0.0,
        radio_loss: float = 0.0,
        hears_above: bool = True,
        copies: Sequence[float] = (),
        **more: Any,
    ) -> None:
        self.rng = random.Random(seed)
        self.given_s: dict[tuple[int, bytes], float] = {}
        self.got_s: dict[tuple[int, bytes], list[float]] = {}
        self.ended: Counter[DeliveryOutcome] = Counter()
        self.served: Counter[tuple[int, bytes]] = Counter()
        self.answers: Counter[str] = Counter()
        self.reach: list[tuple[float, PeerReachable]] = []
        self.frames: list[tuple[float, int, str, bytes]] = []
        """``(instant, node, link, frame)``"""
        self._is_ready = False
        self._observers: list[Callable[[TraceRecord], None]] = []

        def by_sound(source: int, node: int, now: int) -> Sequence[float]:
            return (0.0,) if hears_above or not is_up(now) else ()

        def by_radio(source: int, node: int, now: int) -> Sequence[float]:
            if not is_up(now) or self.rng.random() < radio_loss:
                return ()
            return (0.0, *copies)

        more.setdefault("rules", rules())
        more.setdefault("table", table())
        self.network = VirtualNetwork(
            medium(2, apart_m=1000.0, profile="evologics_s2c_18_34", loss=loss, seed=seed),
            deliver=self._happened,
            trace=self._traced,
            disturb=by_sound,
            **more,
        )
        radio = medium(2, apart_m=300.0, profile="ideal", loss=0.0, seed=seed + 1)
        self.network.add_link(RADIO, radio, modem=RADIO_MODEM, disturb=by_radio)
        self._is_ready = True

    def observe(self, observer: Callable[[TraceRecord], None]) -> None:
        """Show an observer all further trace records."""
        self._observers.append(observer)

    @property
    def now_s(self) -> float:
        """The instant, s."""
        return self.network.now / NS_PER_S

    def publish_at(self, at_s: float, stream_id: int, value: bytes) -> None:
        """Let the publisher of a topic publish at an instant, if it runs then."""
        node = SHORE if stream_id == STOP else AUV

        def publish() -> None:
            if self.network.is_running(node):
                self.given_s[stream_id, value] = self.now_s
                self.network.publish(node, stream_id, value)

        self.network.at(at_s, publish)

    def call_at(self, at_s: float, stream_id: int, request: bytes) -> None:
        """Let the client of a service call it at an instant, if it runs then."""
        self._command_at(
            at_s,
            SHORE if stream_id == ARM else AUV,
            lambda engine, now: engine.call(stream_id, request, now),
        )

    def send_goal_at(self, at_s: float, goal: bytes) -> None:
        """Let the shore send a goal at an instant."""
        self._command_at(at_s, SHORE, lambda engine, now: engine.actions.send_goal(GOTO, goal, now))

    def restart_at(self, at_s: float, node: int) -> None:
        """Kill a node at an instant, and start it again ten seconds later."""
        self.network.at(at_s, partial(self.network.crash, node))
        self.network.at(at_s + 10.0, partial(self.network.start, node))

    def delays_s(self, stream_id: int, *, is_at_surface: bool | None = None) -> list[float]:
        """Return the delays of the samples of a topic, in order; one not received is missing."""
        return sorted(
            at[0] - self.given_s[key]
            for key, at in self.got_s.items()
            if key[0] == stream_id and is_at_surface in (None, self.given_s[key] % PERIOD_S < UP_S)
        )

    # Below the methods above

    def _command_at(self, at_s: float, node: int, command: Any) -> None:
        def act() -> None:
            if self.network.is_running(node):
                self.network.apply(node, command)

        self.network.at(at_s, act)

    def _traced(self, record: TraceRecord) -> None:
        for observer in self._observers:
            observer(record)
        if record.what == "transmit" and record.link in (RADIO, SOUND):
            at_s = record.at / NS_PER_S
            self.frames.append((at_s, record.node, record.link, bytes.fromhex(record.frame)))

    def _happened(self, node: int, event: Event) -> None:
        if not self._is_ready:
            return
        match event:
            case SampleReceived(stream_id=stream_id, value=bytes(value)):
                self.got_s.setdefault((stream_id, value), []).append(self.now_s)
            case DeliveryEnded(outcome=outcome):
                self.ended[outcome] += 1
            case RequestReceived(call=call, value=bytes(value)):
                self.served[call.stream_id, value] += 1
                self._command_at(
                    self.now_s, node, lambda engine, now: engine.reply(call, value[::-1], now)
                )
            case GoalReceived(goal=goal, value=bytes(value)):
                self.served[GOTO, value] += 1
                self._command_at(
                    self.now_s, node, lambda engine, now: engine.actions.accept(goal, now)
                )
                self._command_at(self.now_s + 20.0, node, partial(_finish, goal))
            case ResponseReceived() | ResultReceived():
                self.answers["answered"] += 1
            case CallFailed():
                self.answers["failed"] += 1
            case PeerReachable():
                self.reach.append((self.now_s, event))


def _finish(goal: Any, engine: Engine, now: int) -> None:
    engine.actions.finish(goal, GoalStatus.SUCCEEDED, b"there", now)
