"""A photo of 20 kB from node 1 to node 2, and what a node has to say that presses meanwhile.

The modems hand over nothing that is for others, as S2C modems do: whoever is no end of the transfer
hears sound, and only what is broadcast. Nodes stand anywhere within 1500 m of node 1.
"""

import enum
import math
import random
from collections.abc import Sequence
from functools import partial
from typing import Final

import msgspec

from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import DeliveryEnded, Event, RequestReceived, SampleReceived
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import CarrierSenseSpec
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Deliver, Modem, VirtualNetwork

PHOTO_BYTES: Final = 20_000
PHOTO_AT_S: Final = 60.0
NEVER: Final = math.inf
_TALK, _PHOTO = 1, 2
_COPIES_S: Final = 30.0
"""For so long copies of a best-effort sample may still come."""
_FARTHEST_M, _NEAREST_M = 1500.0, 300.0


class Pressing(enum.IntEnum):
    """What is said beside the photo; its stream."""

    STOP = 10
    """A reliable sample of priority `real_time`."""
    BEST_EFFORT = 11
    """A best-effort sample of priority `real_time`."""
    COMMAND = 12
    """A reliable sample of priority `interactive_high`."""
    CALL = 13
    """A call of priority `real_time`, to its server's program."""


def beside_photo(
    seed: int,
    loss: float,
    nodes: int,
    *,
    access: AccessSpec | None = None,
    photo: bool = True,
    deliver: Deliver | None = None,
) -> VirtualNetwork:
    """Make the network of one run.

    Args:
        seed: Of places, losses and back-offs.
        loss: Share of the frames that is lost, at each hearer.
        nodes: How many there are; 2 and more.
        access: How they share the channel; None: they sense each other's carriers.
        photo: It is sent, from `PHOTO_AT_S` on.
        deliver: Takes the events.
    """
    rng = random.Random(f"{seed}/places")
    places = [[0.0, 0.0, 10.0]]
    for _ in range(nodes - 1):
        away_m, angle = rng.uniform(_NEAREST_M, _FARTHEST_M), rng.uniform(0, 2 * math.pi)
        places.append([away_m * math.cos(angle), away_m * math.sin(angle), 10.0])
    scenario = scenario_from_mapping(
        {
            "nodes": [{"address": n, "position": place} for n, place in enumerate(places, 1)],
            "seed": seed,
            "channel": "none",
            "loss": {"frame": loss},
        },
        source="test",
    )
    access = access or CarrierSenseSpec()
    network = VirtualNetwork(
        scenario,
        stop_table(nodes),
        modem=Modem(senses_carrier=isinstance(access, CarrierSenseSpec)),
        rules=TransmitRules(access=access),
        digest=False,
        deliver=deliver,
    )
    for turn in range(3):  # they get to know each other
        for node in range(1, nodes + 1):
            network.at(turn * 16 + 3 * node, partial(network.publish, node, _TALK, b""))
    if photo:
        picture = random.Random(1).randbytes(PHOTO_BYTES)
        network.at(PHOTO_AT_S, partial(network.publish, 1, _PHOTO, picture))
    return network


def stop_table(nodes: int) -> StreamTable:
    """Return the streams: a stop from each node to each other one."""
    urgent = Qos(priority=Priority.REAL_TIME, depth=4)
    reliable = msgspec.structs.replace(urgent, reliability=Reliability.RELIABLE)
    command = msgspec.structs.replace(reliable, priority=Priority.INTERACTIVE_HIGH)
    photo = msgspec.structs.replace(reliable, priority=Priority.BACKGROUND)
    kinds = {Pressing.STOP: reliable, Pressing.BEST_EFFORT: urgent, Pressing.COMMAND: command}
    topics = [
        TopicSpec(
            stream_id=kind + 10 * receiver,
            name=f"{kind.name.lower()}/{receiver}/{{node}}",
            qos=qos,
            publishers=tuple(each for each in range(1, nodes + 1) if each != receiver),
            subscribers=(receiver,),
        )
        for kind, qos in kinds.items()
        for receiver in (1, 2)
    ]
    calls = [
        ServiceSpec(
            stream_id=Pressing.CALL + 10 * server,
            name=f"call/{server}",
            server=server,
            timeout_s=300.0,
            qos=urgent,
        )
        for server in (1, 2)
    ]
    return StreamTable(
        [
            TopicSpec(stream_id=_TALK, name="talk"),
            TopicSpec(stream_id=_PHOTO, name="photo", qos=photo, publishers=(1,), subscribers=(2,)),
            *topics,
            *calls,
        ],
        nodes={n: f"n{n}" for n in range(1, nodes + 1)},
    )


def stop_took_s(
    seed: int,
    loss: float,
    nodes: int,
    what: Pressing,
    *,
    to: int = 1,
    sources: Sequence[int] = (),
    access: AccessSpec | None = None,
    just_booted: bool = False,
    within_s: float = 240.0,
    patience_s: float = 300.0,
) -> float:
    """Return how long something that presses is on its way beside the photo, s, or `NEVER`.

    Args:
        seed: Of the run.
        loss: Share of the frames that is lost.
        nodes: How many there are.
        what: What is said.
        to: Whom it is for, an end of the photo.
        sources: Who says it, within half a second; the last to arrive counts. None: the last node.
        access: How they share the channel.
        just_booted: Whoever says it has started just before, and has no journal.
        within_s: So long after the beginning of the photo, at most.
        patience_s: It is waited for that long.
    """
    arrived: dict[int, float] = {}

    def deliver(address: int, event: Event) -> None:
        if address != to:
            return
        if isinstance(event, RequestReceived) and event.call.stream_id == stream_id:
            arrived.setdefault(event.call.client, network.now / NS_PER_S)
        elif isinstance(event, SampleReceived) and event.stream_id == stream_id:
            assert event.source not in arrived, f"handed on twice, seed {seed}"
            arrived[event.source] = network.now / NS_PER_S

    stream_id = what + 10 * to
    network = beside_photo(seed, loss, nodes, access=access, deliver=deliver)
    rng = random.Random(f"{seed}/instant")
    at_s = PHOTO_AT_S + rng.uniform(0, within_s)
    sources = sources or (nodes,)
    for source in sources:
        if just_booted:
            network.at(at_s - 1, partial(network.crash, source))
            network.at(at_s - 0.5, partial(network.start, source))
        press = partial(network.publish, source, stream_id, b"now")
        if what is Pressing.CALL:
            press = partial(
                network.apply,
                source,
                lambda engine, now: engine.call(stream_id, b"now", now),
            )
        network.at(at_s + (rng.uniform(0, 0.5) if len(sources) > 1 else 0), press)
    until_s = at_s
    while len(arrived) < len(sources) and until_s < at_s + patience_s:
        until_s += 5
        network.run(until_s=until_s)
    if what is Pressing.BEST_EFFORT and arrived:
        network.run(until_s=until_s + _COPIES_S)
    return max(arrived.values()) - at_s if len(arrived) == len(sources) else NEVER


def photo_took_s(seed: int, loss: float, nodes: int) -> float:
    """Return how long the photo takes to its publisher's knowledge, s, or `NEVER`."""
    ended_s: list[float] = []

    def deliver(address: int, event: Event) -> None:
        if isinstance(event, DeliveryEnded) and event.stream_id == _PHOTO:
            ended_s.append(event.ended_at / NS_PER_S)

    network = beside_photo(seed, loss, nodes, deliver=deliver)
    until_s = PHOTO_AT_S
    while not ended_s and until_s < 6000:
        until_s += 60
        network.run(until_s=until_s)
    return ended_s[0] - PHOTO_AT_S if ended_s else NEVER
