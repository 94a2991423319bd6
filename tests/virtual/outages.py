"""Three outages of an hour, and what is left of them: estimates, and an emergency afterwards.

The links are those of `tests.virtual.silentpeer`. Until the last outage is over a third of the
frames are lost. Both ends log all the time, so that much waits at the end of each outage. Then the
channel is perfect for hours; then an emergency is given at the beginning of one bad minute.
"""

import random
from collections.abc import Sequence
from functools import partial
from typing import Final

import msgspec

from tests.virtual.silentpeer import BETWEEN, GIVER, PEER, RADIO, Way, modem_of, rules, scenario
from zacoustic.core.base.linktypes import ONE_LINK, LinkCapabilities
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

OUTAGE_S: Final = 3600.0
OUTAGES: Final = 3
BAD_S: Final = 60.0
_LOG, _BACK, _STOP, _TALK = 2, 3, 4, 1
_LOSS: Final = 0.3
_CALM_S: Final = 600.0
_REST_S: Final = 4 * 3600.0


class Result(msgspec.Struct, frozen=True):
    """What came of a run."""

    estimates_s: list[float]
    """The round trips of both ends to each other, as they show them, at each end of an outage and
    after the perfect hours, s."""
    bound_s: float
    """The longest round trip that the figures of the link allow, s."""
    stop_s: float
    """From the end of the bad minute to the arrival of the emergency, s."""
    lost: int
    """Samples that have not arrived."""


def run(seed: int, way: Way) -> Result:
    """Let the outages pass.

    Args:
        seed: Everything follows from it.
        way: The kind of link.
    """
    rng = random.Random(f"outages {seed}")
    spans: list[tuple[float, float]] = []
    at_s = 300.0
    for _ in range(OUTAGES):
        spans.append((at_s, at_s + OUTAGE_S))
        at_s += OUTAGE_S + _CALM_S
    perfect_s = at_s
    stop_s = perfect_s + _REST_S
    given: list[bytes] = []
    got: dict[bytes, float] = {}
    estimates_s: list[float] = []

    def disturb(source: int, node: int, now: int) -> Sequence[float]:
        now_s = now / NS_PER_S
        if way in (Way.ROUTE, Way.FLOOD) and {source, node} == {GIVER, PEER}:
            return ()
        if PEER in (source, node):
            if stop_s <= now_s < stop_s + BAD_S:
                return ()
            if any(begin <= now_s < end for begin, end in spans):
                return ()
        if now_s < perfect_s and rng.random() < _LOSS:
            return ()
        return (rng.uniform(0.2, 1.5),) if way is Way.DELEGATED else (0.0,)

    def deliver(address: int, event: Event) -> None:
        if isinstance(event, SampleReceived) and event.stream_id != _TALK:
            got.setdefault(event.value, network.now / NS_PER_S)

    def publish(node: int, stream_id: int, value: bytes) -> None:
        given.append(value)
        network.publish(node, stream_id, value)

    def look() -> None:
        for node, other in ((GIVER, PEER), (PEER, GIVER)):
            links = network.engine(node).stats.links.values()
            estimates_s.extend(each.round_trips_ns.get(other, 0) / NS_PER_S for each in links)

    network = VirtualNetwork(
        scenario(seed), _table(), modem=modem_of(way), rules=rules(way), digest=False,
        disturb=disturb, deliver=deliver, link=ONE_LINK if way is Way.BOND else None,
    )  # fmt: skip
    if way is Way.BOND:
        network.add_link(
            RADIO, scenario(seed, profile="ideal"), modem=modem_of(way, RADIO), disturb=disturb
        )
    for node in (GIVER, BETWEEN, PEER):
        network.at(node, partial(network.publish, node, _TALK, b"hi"))
    at_s, number = 20.0, 0
    while at_s < perfect_s - 100:
        network.at(at_s, partial(publish, GIVER, _LOG, b"log %d" % number))
        back_s = at_s + rng.uniform(0, 60)
        network.at(back_s, partial(publish, PEER, _BACK, b"back %d" % number))
        at_s += rng.expovariate(1 / 150)
        number += 1
    for _, end in spans:
        network.at(end + _CALM_S / 2, look)
    network.at(stop_s, look)
    network.at(stop_s, partial(publish, GIVER, _STOP, b"stop"))
    network.run(until_s=stop_s + 3600)
    look()
    return Result(
        estimates_s=estimates_s,
        bound_s=_bound_s(way, network.capabilities(GIVER)),
        stop_s=got.get(b"stop", 9e9) - stop_s - BAD_S,
        lost=len(set(given) - got.keys()),
    )


def _bound_s(way: Way, hop: LinkCapabilities) -> float:
    """Return the longest round trip that docs/wire.md and the figures of a link allow, s.

    A frame arrives within four units, or never; a unit is a largest frame and the way of its sound.
    Inside other links the latter is longer. Where access takes its time, so may an answer: some
    thirty times what it takes in an idle channel.
    """
    frame_s = hop.airtime_ns(hop.mtu_bytes) / NS_PER_S
    idle_s = 2 * hop.propagation_s + 2 * frame_s + hop.gap_s
    if way is Way.ROUTE:
        return 2 * 4 * (2 * 60.0 / 4 + frame_s) + 5 * frame_s
    if way is Way.FLOOD:
        hop_s = frame_s + hop.gap_s + hop.propagation_s
        return 2 * 4 * (2 * (hop_s + 2 * (hop_s + 2 * frame_s)) + frame_s) + 5 * frame_s
    return 35 * idle_s


def _table() -> StreamTable:
    reliable = Qos(reliability=Reliability.RELIABLE, depth=1000)
    urgent = msgspec.structs.replace(reliable, priority=Priority.REAL_TIME)
    ends = {_LOG: (GIVER, PEER), _BACK: (PEER, GIVER), _STOP: (GIVER, PEER)}
    return StreamTable(
        [
            TopicSpec(stream_id=_TALK, name="{node}/talk"),
            *(
                TopicSpec(
                    stream_id=stream_id, name=f"topic{stream_id}", publishers=(source,),
                    subscribers=(other,), journal=stream_id != _STOP,
                    qos=urgent if stream_id == _STOP else reliable,
                )
                for stream_id, (source, other) in ends.items()
            ),
        ],
        nodes={GIVER: "giver", BETWEEN: "between", PEER: "peer"},
    )  # fmt: skip
