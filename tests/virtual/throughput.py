"""Throughput of medium access on the simulated channel, and what theory says of it.

A hundred sources with real engines send frames of one length to a receiver that only listens;
messages come at random (Poisson), any overlap at the receiver destroys both frames. Loads and
throughputs are in frames per frame's airtime: `G` is what is tried, `S` what arrives.
"""

import math
import random
from typing import Any, Final

import msgspec

from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Qos
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import AlohaSpec, CarrierSenseSpec
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

SOURCES: Final = 100
RECEIVER: Final = 1
_PAYLOAD_BYTES: Final = 40
FRAME_BYTES: Final = 8 + 1 + _PAYLOAD_BYTES  # nobody confirms: a HELLO in each frame
AIRTIME_S: Final = profile_named(DEFAULT_PROFILE).airtime_s(FRAME_BYTES)


class Point(msgspec.Struct, frozen=True):
    """What one run gave."""

    load: float
    """G: messages."""
    offered: float
    """Frames that were sent."""
    throughput: float
    """S: frames that arrived."""
    arrived: int
    """Their number."""


def pure_aloha(load: float, frames: int, *, seed: int = 7) -> Point:
    """Measure pure ALOHA, without back-off."""
    return _measure(load, frames, AlohaSpec(back_off=False), seed=seed)


def slotted_aloha(delay: float, guard: float, load: float, frames: int, *, seed: int = 7) -> Point:
    """Measure slotted ALOHA.

    Args:
        delay: Longest propagation delay to the receiver; those of the sources are spread from 0.
        guard: How much longer than a frame a slot is.
        load: G.
        frames: How many messages.
        seed: Of the run.

    All in airtimes.
    """
    spec = AlohaSpec(back_off=False, slot_s=AIRTIME_S * (1 + guard))
    return _measure(load, frames, spec, reach=delay, seed=seed)


def carrier_sense(delay: float, load: float, frames: int, *, seed: int = 7) -> Point:
    """Measure carrier sense: who hears somebody gives up; `delay` between all nodes, airtimes."""
    return _measure(load, frames, CarrierSenseSpec(), delay=delay, lifespan_s=1e-3, seed=seed)


def pure_aloha_theory(load: float) -> float:
    """S of pure ALOHA, whatever the delay."""
    return load * math.exp(-2.0 * load)


def slotted_aloha_theory(delay: float, guard: float, load: float, *, steps: int = 400) -> float:
    """S of slotted ALOHA with delays that are uniform in 0…`delay`.

    A frame is destroyed by those of its own slot and of the neighbouring ones that arrive less than
    a frame apart.
    """
    slot = 1.0 + guard
    delays = [delay * (step + 0.5) / steps for step in range(steps)]
    reach = math.ceil((delay + 1.0) / slot)
    survivors = 0.0
    for own in delays[:: steps // 100]:
        overlaps = sum(
            abs(slots * slot + other - own) < 1.0
            for slots in range(-reach, reach + 1)
            for other in delays
        )
        survivors += math.exp(-load * slot * overlaps / steps)
    return load * survivors / 100


def carrier_sense_theory(delay: float, load: float) -> float:
    """S of non-persistent carrier sense (Kleinrock and Tobagi), delay at most one frame."""
    clear = math.exp(-delay * load)
    return load * clear / (load * (1.0 + 2.0 * delay) + clear)


def _measure(
    load: float,
    frames: int,
    access: AccessSpec,
    *,
    reach: float = 0.0,
    delay: float | None = None,
    lifespan_s: float | None = None,
    seed: int,
) -> Point:
    rng = random.Random(seed)
    step_m = 1500.0 * reach * AIRTIME_S / SOURCES
    sources = range(RECEIVER + 1, RECEIVER + 1 + SOURCES)
    nodes = [{"address": RECEIVER, "position": [0, 0, 10]}]
    nodes += [
        {"address": address, "position": [1 + step_m * (index + 0.5), 0, 10]}
        for index, address in enumerate(sources)
    ]
    medium: dict[str, Any] = {
        "nodes": nodes, "seed": seed, "channel": "none", "collisions": "protocol",
    }  # fmt: skip
    if delay is not None:
        medium["delay_s"] = delay * AIRTIME_S
    topic = TopicSpec(
        stream_id=1, name="a", subscribers=(RECEIVER,), qos=Qos(depth=50, lifespan_s=lifespan_s)
    )
    # Two largest frames in a row are a run, after which nodes listen for a pause: not these.
    mtu_bytes = FRAME_BYTES if delay is None else 2 * FRAME_BYTES
    messages = arrived = 0

    def disturb(source: int, node: int, now: int) -> tuple[float, ...]:
        nonlocal arrived
        arrived += node == RECEIVER
        return ()

    network = VirtualNetwork(
        scenario_from_mapping(medium, source="throughput"),
        dict.fromkeys(sources, StreamTable([topic])),
        modem=Modem(senses_carrier=delay is not None, mtu_bytes=mtu_bytes),
        deliver=lambda address, event: None,
        disturb=disturb,
        digest=False,
        rules=TransmitRules(access=access),
    )

    def message() -> None:
        nonlocal messages
        messages += 1
        network.publish(rng.choice(sources), 1, bytes(_PAYLOAD_BYTES))
        wait()

    def wait() -> None:
        after_s = rng.expovariate(load / AIRTIME_S)
        network.at(network.now / NS_PER_S + after_s, message)

    wait()
    end_s = frames / load * AIRTIME_S
    network.run(until_s=end_s)
    sent = sum(each.frames_transmitted for each in network.stats())
    share = AIRTIME_S / end_s
    return Point(messages * share, sent * share, arrived * share, arrived)
