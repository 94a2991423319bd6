"""`draw_scenario`: one random scenario for each seed, with all faults of sea and hardware."""

import random
from typing import Any, Final

import msgspec

from zacoustic.channel.profiles import profile_named
from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.base.qos import Priority, Qos, Reliability, Stamp
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.testing.scenarios.randomscenario import Lane, RandomScenario, cast_of, opaque, typed
from zacoustic.testing.virtualmodems import Modem

MOST_LOSS: Final = 0.6
"""Share of frames lost in the worst direction."""
MOST_CRASHES: Final = 10
"""Most crashes of each node."""
LONGEST_BLACKOUT_S: Final = 1800.0
"""Longest blackout, s."""
YEAR_S: Final = 31_557_600.0
"""A year, s: unit of the jumps of wall clocks."""
CALM_S: Final = 3600.0
"""Time without faults at the end, s: reliable samples must arrive by then."""

_MODEMS: Final = (
    Modem(),
    Modem(),
    Modem(acknowledges=True),
    Modem(checked=False),
    Modem(addressed=False, checked=False),
    Modem(addressed=False, checked=False, framed=False),
    Modem(senses_carrier=False),
)


def draw_scenario(seed: int, *, reliable: bool = True) -> RandomScenario:
    """Draw a random scenario.

    It has two to five nodes within two kilometres, three streams or more, loss up to 60 % and in
    bursts, damage if the modem does not check, repetitions, jitter, unequal directions, blackouts
    of up to half an hour, unplugged modems, up to ten crashes of each node, slow journals, clocks
    that drift and jump by years. An hour of calm follows.

    Args:
        seed: Every draw follows from it.
        reliable: Whether there are reliable topics.
    """
    rng = random.Random(f"story {seed}")
    count = rng.choice((2, 2, 3, 4, 5))
    busy_s = rng.choice((300.0, 900.0, 2700.0))
    modem = rng.choice(_MODEMS)
    room_bytes = rng.choice((24, 32, 64))
    overhead = 2 * (not modem.addressed) + 4 * (not modem.checked) + 3 * (not modem.framed)
    modem = Modem(
        addressed=modem.addressed,
        checked=modem.checked,
        framed=modem.framed,
        senses_carrier=modem.senses_carrier,
        acknowledges=modem.acknowledges,
        mtu_bytes=min(64, room_bytes + overhead),
    )
    scenario = _scenario(rng, seed, count, busy_s, modem)
    lanes = _lanes(rng, count, room_bytes, reliable=reliable)
    names = {address: f"n{address}" for address in range(1, count + 1)}
    cast = cast_of(lanes, names)
    return RandomScenario(
        seed=seed,
        scenario=scenario,
        casts=dict.fromkeys(names, cast),
        modem=modem,
        busy_s=busy_s,
        calm_s=CALM_S,
        pause_s=rng.choice((10.0, 30.0, 90.0)) * count,
    )


def _scenario(rng: random.Random, seed: int, count: int, busy_s: float, modem: Modem) -> Scenario:
    addresses = range(1, count + 1)
    nodes = [_node(rng, address, busy_s) for address in addresses]
    worst = rng.choice((0.0, 0.1, 0.3, MOST_LOSS))
    links = [
        {
            "from": source,
            "to": target,
            "loss": _loss(rng, worst, busy_s),
            "gain_db": rng.choice((0, 0, -3, -6)),
        }
        for source in addresses
        for target in addresses
        if source != target
    ]
    medium: dict[str, Any] = {
        "seed": seed,
        "channel": rng.choice(("none", "none", "none", "sea")),
        "nodes": nodes,
        "links": links,
    }
    bare = scenario_from_mapping(medium, source=f"story {seed}")
    capabilities = modem.capabilities(profile_named(bare.profile), bare.farthest_s)
    medium["faults"] = {
        **_faults_of_frames(rng, capabilities, modem),
        **_faults_of_nodes(rng, addresses, busy_s),
        "until_s": busy_s,
    }
    return scenario_from_mapping(medium, source=f"story {seed}")


def _node(rng: random.Random, address: int, busy_s: float) -> dict[str, Any]:
    def place() -> list[float]:
        return [rng.uniform(-700, 700), rng.uniform(-700, 700), rng.uniform(5, 60)]

    if rng.random() < 0.8:
        return {"address": address, "position": place()}
    track = [{"t": 0, "position": place()}, {"t": 3 * busy_s, "position": place()}]
    return {"address": address, "track": track}


def _loss(rng: random.Random, worst: float, busy_s: float) -> dict[str, Any]:
    share = rng.uniform(0, worst)
    loss: dict[str, Any] = {"frame": share, "until_s": busy_s}
    if rng.random() < 0.5:
        loss["burst_frames"] = max(1.0, share / (1 - share)) * rng.uniform(1, 10)
    return loss


def _faults_of_frames(
    rng: random.Random, capabilities: LinkCapabilities, modem: Modem
) -> dict[str, Any]:
    airtime_s = capabilities.airtime_ns(capabilities.mtu_bytes) / NS_PER_S
    settling_s = 4 * (airtime_s + capabilities.propagation_s)
    return {
        "corrupt": 0.0 if modem.checked else rng.choice((0.0, 0.05, 0.3)),
        "duplicate": rng.choice((0.0, 0.1, 0.4)),
        "duplicate_after_s": [0.0, 0.9 * settling_s],
        "jitter_s": rng.choice((0.0, 0.0, 0.05, 0.1 * settling_s)),
    }


def _faults_of_nodes(rng: random.Random, addresses: range, busy_s: float) -> dict[str, Any]:
    most = rng.choice((0, 2, MOST_CRASHES))
    crashes = [
        {
            "node": address,
            "at_s": sorted(rng.uniform(0, busy_s) for _ in range(rng.randint(1, most))),
            "restart_after_s": rng.choice((0, 1, 20, 200)),
            "reboots": rng.random() < 0.5,
        }
        for address in addresses
        if most
    ]
    return {
        "blackouts": [_blackout(rng, addresses, busy_s) for _ in range(rng.choice((0, 0, 1, 3)))],
        "unplugged": [
            {"node": address, **_span(rng, busy_s, 200.0)}
            for address in addresses
            if rng.random() < 0.2
        ],
        "crashes": crashes,
        "clocks": [_clock(rng, address, busy_s) for address in addresses if rng.random() < 0.5],
        "journal": {"commit_s": rng.choice((0.0, 0.005, 0.05, 1.0))},
    }


def _blackout(rng: random.Random, addresses: range, busy_s: float) -> dict[str, Any]:
    longest_s = rng.choice((30.0, 300.0, LONGEST_BLACKOUT_S))
    blackout: dict[str, Any] = _span(rng, busy_s, longest_s)
    if rng.random() < 0.3:
        blackout["every_s"] = 1.5 * (blackout["to_s"] - blackout["from_s"])
    if rng.random() < 0.5:
        blackout["node"] = rng.choice(addresses)
    else:
        blackout["pair"] = rng.sample(addresses, 2)
    return blackout


def _span(rng: random.Random, busy_s: float, longest_s: float) -> dict[str, Any]:
    begin_s = rng.uniform(0, busy_s - 1)
    return {"from_s": begin_s, "to_s": min(busy_s, begin_s + rng.uniform(1, longest_s))}


def _clock(rng: random.Random, address: int, busy_s: float) -> dict[str, Any]:
    return {
        "node": address,
        "drift_ppm": rng.choice((0.0, 20.0, -100.0)),
        "offset_s": rng.uniform(-10, 10) * YEAR_S,
        "jumps": [
            {"at_s": rng.uniform(0, busy_s), "by_s": rng.uniform(-30, 30) * YEAR_S}
            for _ in range(rng.randint(0, 3))
        ],
    }


def _lanes(rng: random.Random, count: int, room_bytes: int, *, reliable: bool) -> dict[int, Lane]:
    """Draw three streams or more; an introduction of 11 bytes and a head precede a payload."""
    largest = room_bytes - 18
    parts = (Wildcard(name="part", values=("a", "b")),)
    pool = {
        10: _with(
            Lane(_topic(rng, 10, "{node}/nav"), typed("Nav")),
            codec=rng.choice(("cbor", "packed", "dense", "dense")),
        ),
        11: _with(
            Lane(_topic(rng, 11, "raw"), opaque(rng.randint(3, largest - 1))),
            codec=rng.choice(("cbor", "cbor", "packed", "dense")),
        ),
        12: _with(Lane(_topic(rng, 12, "to1"), opaque(rng.randint(3, largest))), subscribers=(1,)),
        13: _with(Lane(_topic(rng, 13, "{node}/{part}"), opaque(4)), wildcards=parts),
        20: Lane(
            ServiceSpec(
                stream_id=20,
                name="arm",
                server=rng.randint(1, count),
                timeout_s=rng.choice((20.0, 120.0)),
                qos=Qos(priority=Priority.INTERACTIVE_HIGH),
            ),
            opaque(4),
            opaque(5),
        ),
    }
    if reliable:
        pool |= {
            30: Lane(_reliable(rng, 30, "{node}/log"), opaque(rng.randint(3, largest))),
            31: _with(Lane(_reliable(rng, 31, "orders/{part}"), opaque(5)), wildcards=parts),
            32: _with(Lane(_reliable(rng, 32, "report"), typed("Report")), subscribers=(1,)),
        }
    chosen = rng.sample(sorted(pool), min(len(pool), rng.randint(3, 5)))
    return {stream_id: pool[stream_id] for stream_id in sorted(chosen)}


def _topic(rng: random.Random, stream_id: int, name: str) -> TopicSpec:
    priorities = (Priority.DATA, Priority.DATA, Priority.REAL_TIME, Priority.BACKGROUND)
    qos = Qos(
        priority=rng.choice(priorities),
        depth=rng.choice((1, 3, 10)),
        lifespan_s=rng.choice((None, None, 30.0)),
        linger_s=rng.choice((0.0, 0.0, 2.0)),
        stamp=rng.choice((Stamp.NONE, Stamp.AGE)),
    )
    return TopicSpec(stream_id=stream_id, name=name, qos=qos)


def _reliable(rng: random.Random, stream_id: int, name: str) -> TopicSpec:
    qos = Qos(
        reliability=Reliability.RELIABLE,
        priority=rng.choice((Priority.DATA, Priority.DATA, Priority.INTERACTIVE_HIGH)),
        depth=rng.choice((1, 10, 1000)),
        lifespan_s=rng.choice((None, None, None, 120.0)),
        stamp=rng.choice((Stamp.NONE, Stamp.AGE)),
    )
    return TopicSpec(stream_id=stream_id, name=name, qos=qos, journal=rng.random() < 0.7)


def _with(lane: Lane, **settings: object) -> Lane:
    """Return a lane whose stream differs in some fields, and has the type of its shape."""
    type_spec = lane.shape.type_spec
    type_name = type_spec.name if type_spec else None
    spec = msgspec.structs.replace(lane.spec, type_name=type_name, **settings)
    return msgspec.structs.replace(lane, spec=spec)
