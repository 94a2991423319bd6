"""`crossed`: the mechanisms of a fleet crossed with each other, and with outages of hours.

`hostile` puts everything on one link of all nodes. This scenario also draws the links below the
streams (a list of links, links apart, a route, flooding, a mule that carries samples), the seal,
the number windows (`SMALL_SIZES` or those at sea), polling, a babbler, nodes that hear nothing or
are not heard for hours, and crashes of all nodes among it. Drive and oracle are the same.
"""

import random
from collections.abc import Sequence
from functools import partial
from typing import Any, Final

import msgspec

from tests.hostile import fleet
from tests.hostile.scenario import Hostile, Setting
from tests.virtual.twolinks import RADIO, SOUND
from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.base.sizes import SIZES
from zacoustic.core.bond.spec import Bond, BondLink, LinkCost
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.relay.flood import FLOOD_NAME, Flood
from zacoustic.core.relay.route import Route
from zacoustic.core.schedule.access import PollingSpec
from zacoustic.core.streams.carry import Carry
from zacoustic.core.streams.specs import StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing import SMALL_SIZES
from zacoustic.testing.virtual import Modem

WAYS: Final = ("plain", "bond", "links", "route", "flood", "carry")
"""What lies below the streams, by the seed modulo their number:

plain   one link, two or three nodes
bond    a list of sound and radio; the radio hears for two minutes of ten
links   sound and radio, each with streams of its own; remote commands go by radio
route   a line of three or four nodes, and a route between its ends
flood   a line of four nodes, and everything is flooded
carry   a mule between two nodes that never hear each other; the log is carried
"""
_KINDS: Final = ("mixed", "late", "killed", "clock", "photo")
_BOND: Final = Bond(number=31, links=(RADIO, SOUND))
_IDS: Final = (*fleet.BEST_EFFORT, *fleet.RELIABLE, fleet.ARM, fleet.GOTO)
_UP_S, _PERIOD_S = 120.0, 600.0
_MULE_S, _MULE_STAYS_S = 3600.0, 600.0
_CALM_S: Final = 4 * 3600.0

Span = tuple[float, float, int, int]
"""From and to, s, and the source and the receiver of the frames that are lost; 0: any."""


def crossed(seed: int, *, is_brief: bool = False) -> Hostile:
    """Draw the scenario of a seed.

    Args:
        seed: Everything follows from it.
        is_brief: Four minutes of traffic, large samples among it, without crashes and outages.
    """
    rng = random.Random(f"crossed {seed}")
    way, kind = WAYS[seed % len(WAYS)], "photo" if is_brief else rng.choice(_KINDS)
    count = {"plain": rng.choice((2, 3)), "route": rng.choice((3, 4)), "flood": 4, "carry": 3}
    addresses = tuple(range(1, count.get(way, 2) + 1))
    ends = (addresses[0], addresses[-1]) if way in ("route", "carry") else addresses
    is_long = not is_brief and rng.random() < 0.5
    busy_s = rng.choice((7200.0, 14400.0)) if is_long or way == "carry" else 900.0
    busy_s = 240.0 if is_brief else busy_s
    loss = rng.choice((0.0, 0.1, 0.3))
    modem = rng.choice((Modem(), Modem(senses_carrier=False), Modem(acknowledges=True)))
    outages = _outages(rng, ends, busy_s) if is_long else []
    until_s = busy_s if way == "carry" else busy_s - 1.0
    rules = _rules(rng, way, addresses, ends)
    setting = Setting(
        table=_table(way, addresses, ends),
        rules=rules,
        sizes=rng.choice((SIZES, SMALL_SIZES)),
        is_sealed=rng.random() < 0.4,
        ends=ends,
        beside=_sea(rng, seed + 1, addresses, "ideal", 0.0) if way in ("bond", "links") else None,
        disturb=lambda: partial(_disturb, random.Random(seed), way, outages, loss, until_s),
        disturb_beside=lambda: partial(_disturb, random.Random(0), f"radio of {way}", [], 0, 0),
        is_polled=isinstance(rules, TransmitRules) and rules.access is not None,
        mtu_bytes={rng.choice(ends): 40} if way == "plain" and rng.random() < 0.3 else {},
        babbler=rng.choice(ends) if way == "plain" and rng.random() < 0.3 else None,
        calm_s=_CALM_S * {"carry": 4, "flood": 2}.get(way, 1),
    )
    restarts = sorted(
        (rng.uniform(10, busy_s), rng.choice(addresses), False)
        for _ in range(rng.choice((0, 2, 5)) if kind in ("killed", "photo", "mixed") else 0)
        if not is_brief
    )
    faults: dict[str, Any] = {"until_s": busy_s}
    if kind == "late":
        faults |= {"duplicate": 0.1, "duplicate_after_s": [0.0, 2.0]}
    if restarts or is_brief:
        faults["journal"] = {
            "commit_s": rng.choice((0.005, 0.05, 1.0)), "untold": rng.choice((0.0, 0.5, 1.0)),
        }  # fmt: skip
    return Hostile(
        seed=seed,
        kind=kind,
        modem=modem,
        scenario=_sea(rng, seed, addresses, "evologics_s2c_18_34", 0.0, faults),
        addresses=addresses,
        busy_s=busy_s,
        pause_s=25.0 if is_brief else busy_s / rng.choice((10, 30)),
        sizes=(3, 8, 20, 150, 700)
        if is_brief
        else (3, 8, 20, 300, 2000)
        if kind == "photo"
        else (3, 8, 20, 120),
        together=rng.random() < 0.2,
        restarts=tuple(restarts),
        setting=setting,
    )


def _sea(
    rng: random.Random,
    seed: int,
    addresses: Sequence[int],
    profile: str,
    loss: float,
    faults: dict[str, Any] | None = None,
) -> Scenario:
    apart_m = rng.choice((50.0, 300.0, 1000.0))
    places = [[apart_m * each, rng.uniform(0, apart_m / 5), 20] for each in addresses]
    nodes = [
        {"address": each, "position": place} for each, place in zip(addresses, places, strict=True)
    ]
    drawn = {
        "seed": seed, "profile": profile, "channel": "none", "loss": {"frame": loss},
        "nodes": nodes, "faults": faults or {},
    }  # fmt: skip
    return scenario_from_mapping(drawn, source=f"crossed {seed}")


def _disturb(
    rng: random.Random,
    way: str,
    outages: list[Span],
    loss: float,
    until_s: float,
    source: int,
    node: int,
    now: int,
) -> tuple[float, ...]:
    """Lose a frame where nobody hears it, in an outage, and by chance."""
    at_s = now / NS_PER_S
    if way in ("route", "flood") and abs(source - node) > 1:
        return ()
    if way == "radio of bond" and at_s % _PERIOD_S >= _UP_S:
        return ()
    if way == "carry":
        pair, place = {source, node}, at_s % _MULE_S
        is_there = place < _MULE_STAYS_S if 1 in pair else place >= _MULE_S - _MULE_STAYS_S
        if pair == {1, 3} or not is_there:
            return ()
    if at_s < until_s and rng.random() < loss:
        return ()
    for from_s, to_s, by, at in outages:
        if from_s <= at_s < to_s and by in (0, source) and at in (0, node):
            return ()
    return (0.0,)


def _outages(rng: random.Random, ends: Sequence[int], busy_s: float) -> list[Span]:
    """Draw outages: of all, of one node, of one direction."""
    drawn: list[Span] = []
    for _ in range(rng.choice((1, 3))):
        from_s = rng.uniform(0, 0.7 * busy_s)
        to_s = from_s + rng.uniform(300.0, 0.3 * busy_s)
        node = rng.choice(ends)
        drawn.append((from_s, to_s, *rng.choice(((0, 0), (node, 0), (0, node)))))
    return drawn


def _table(way: str, addresses: Sequence[int], ends: Sequence[int]) -> StreamTable | None:
    plain = fleet.table(range(1, len(addresses) + 1))
    if tuple(ends) == tuple(addresses):
        return plain
    mule = addresses[1]

    def between(spec: StreamSpec) -> StreamSpec:
        if not isinstance(spec, TopicSpec):
            return spec
        to = spec.subscribers or tuple(ends)
        changed = msgspec.structs.replace(spec, publishers=tuple(ends), subscribers=to)
        is_carried = way == "carry" and spec.stream_id == fleet.LOG
        carry = Carry(by=(mule,), after_s=120.0, expires_s=9000.0) if is_carried else None
        return msgspec.structs.replace(changed, carry=carry)

    specs = [between(each.spec) for each in plain]
    if way == "carry":  # what is not carried would never arrive
        specs = [each for each in specs if each.stream_id in (fleet.LOG, fleet.RAW)]
    return StreamTable(specs, types=plain.types, nodes=dict(plain.nodes))


def _rules(
    rng: random.Random, way: str, addresses: Sequence[int], ends: Sequence[int]
) -> TransmitRules | dict[int, TransmitRules]:
    both = (
        LinkRules(name=SOUND),
        LinkRules(name=RADIO, bonded=BondLink(cost=LinkCost.FREE)),
    )
    if way == "bond":
        name = _BOND.name
        return TransmitRules(
            links=both, bonds=(_BOND,), links_of_streams=dict.fromkeys(_IDS, name),
            default_link=name,
        )  # fmt: skip
    if way == "links":
        by_radio = dict.fromkeys(rng.sample(_IDS, 5), RADIO)
        return TransmitRules(links=both, links_of_streams=by_radio, default_link=RADIO)
    if way == "route":
        routes = (Route(route_id=1, name="far", path=tuple(addresses), link="link"),)
        rules = TransmitRules(routes=routes)
        at_end = TransmitRules(
            routes=routes, links_of_streams=dict.fromkeys(_IDS, "far"), default_link="far"
        )
        return {each: at_end if each in ends else rules for each in addresses}
    if way == "flood":
        return TransmitRules(
            flood=Flood(link="link", hops=3, max_airtime=0.3),
            links_of_streams=dict.fromkeys(_IDS, FLOOD_NAME),
            default_link=FLOOD_NAME,
        )
    if way == "plain" and rng.random() < 0.25:
        others = tuple(addresses[1:])
        return TransmitRules(access=PollingSpec(poller=1, nodes=others, idle_s=20.0))
    return TransmitRules()
