"""A fleet that reports: each node tells all others something short, once a period.

What arrives is compared with the same reports without any agreement: the same bytes, at the same
instants, in an extension, which every receiver reads without knowing whose table it is.
"""

import math
import random
from collections import Counter
from functools import partial
from typing import Final

import msgspec

from tests.virtual.sealed import SealedFleet
from zacoustic.app.tools.design.schedule import ScheduleWish, distance_of, make_schedule
from zacoustic.channel.profiles import profile_named
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.stats import Cause
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.peers.agreementpolicy import AgreementMethod
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import ScheduleSpec
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport import contract as ct
from zacoustic.testing import VirtualNetwork
from zacoustic.testing.virtual import Modem

OFF: Final = "off"
"""In place of a method: nothing but the reports."""
SEALED: Final = "sealed"
"""In place of a method: the fleet has a key."""
SEALED_OFF: Final = "sealed off"
"""The same, and nothing but the reports."""
AGREEMENT: Final = (Cause.HELLO, Cause.CONFIRM, Cause.ASK, Cause.TABLE)
"""What agreement costs."""
REPORT_BYTES: Final = 10
_ALONE_S: Final = 10.0
"""Longer than a report and its echo take."""
_SIDE_M: Final = 3000.0
_DEEPEST_M: Final = 50.0
_REPORT: Final = 1
_CODE: Final = 0xE1
_HEADER_BYTES: Final = 2
"""Of an extension, beyond that of a record."""


class Told(ct.TransportEvent, frozen=True, kw_only=True):
    """A report has arrived without agreement."""

    source: int


class Plain(ct.Transport):
    """Sends reports in extensions."""

    name = "plain"

    def __init__(self, context: ct.Context) -> None:
        super().__init__(context)
        self.waiting: bytes | None = None
        context.reception.on_extension(_CODE, self.take)

    def report(self, report: bytes) -> None:
        """Send a report to all; a newer one supersedes it."""
        self.waiting = report

    def due_at(self, now: int) -> int | None:
        """Return when a frame is to go, ns."""
        return None if self.waiting is None else now

    def offer(self, now: int) -> ct.Offer | None:
        """Ask for a frame to all."""
        return None if self.waiting is None else ct.Offer(destination=BROADCAST)

    def say(self, destination: int, room_bytes: int, now: int) -> ct.Said | None:
        """Say the report."""
        if self.waiting is None:
            return None
        body, self.waiting = self.waiting[_HEADER_BYTES:], None
        return ct.Said(extension=ct.Extension(_CODE, body))

    def take(self, heard: ct.Heard, body: bytes) -> str | None:
        """Take one."""
        self.context.emit(Told(source=heard.source))
        return None


class Crowd(msgspec.Struct, frozen=True, kw_only=True):
    """What becomes of the reports of a fleet."""

    arrived: float
    """Share of the reports that arrived, mean over all pairs of nodes."""
    agreement: float
    """Share of all bytes that agreement took."""
    bytes_by_cause: dict[str, int]
    """All bytes of all nodes."""
    frames: int
    """Of all nodes."""


def _schedule(scenario: Scenario) -> ScheduleSpec:
    """Return a schedule with one frame a cycle for each node."""
    positions = {each.address: each.position for each in scenario.nodes if each.position}
    wish = ScheduleWish(frames=dict.fromkeys(positions, 1), clock_error_s=0.01)
    capabilities = Modem().capabilities(profile_named(scenario.profile), scenario.farthest_s)
    return make_schedule(wish, distance_of(positions), capabilities)


def run_crowd(
    seed: int,
    method: str,
    *,
    nodes: int,
    period_s: float,
    length_s: float = 3600.0,
    to_shore: bool = False,
    scheduled: bool = False,
    alone: bool = False,
) -> Crowd:
    """Run a fleet that starts cold, in a square of sea.

    Args:
        seed: Everything follows from it: places, instants, the channel.
        method: Word of an `AgreementMethod`, `OFF`, `SEALED` or `SEALED_OFF`.
        nodes: How many.
        period_s: Each node reports once in it, at an instant of its own each time, s.
        length_s: How long, s.
        to_shore: The reports are for node 1 alone.
        scheduled: Each node has a slot of its own, of a schedule for these places.
        alone: Each report has the channel to itself, which takes longer than `length_s`.
    """
    rng = random.Random(seed)
    addresses = range(1, nodes + 1)
    scenario = Scenario(
        nodes=tuple(
            NodeSpec(
                address=address,
                position=(
                    rng.uniform(0, _SIDE_M), rng.uniform(0, _SIDE_M), rng.uniform(5, _DEEPEST_M)
                ),
            )
            for address in addresses
        ),
        seed=seed,
    )  # fmt: skip
    subscribers = (1,) if to_shore else None
    table = StreamTable(
        [TopicSpec(stream_id=_REPORT, name="{node}/report", subscribers=subscribers)],
        nodes={address: f"n{address}" for address in addresses},
    )
    arrived: Counter[tuple[int, int]] = Counter()
    published: Counter[int] = Counter()

    def deliver(address: int, event: Event) -> None:
        if isinstance(event, SampleReceived | Told):
            arrived[event.source, address] += 1

    is_off, is_sealed = method in (OFF, SEALED_OFF), method in (SEALED, SEALED_OFF)
    is_open = not is_off and not is_sealed
    agreement = AgreementMethod(method) if is_open else AgreementMethod.CONFIRM
    make = partial(Engine, transports=[Plain])
    network = VirtualNetwork(
        scenario,
        table,
        deliver=deliver,
        digest=False,
        rules=TransmitRules(agreement=agreement, access=_schedule(scenario) if scheduled else None),
        build=SealedFleet(make=make) if is_sealed else make,
    )

    def report(address: int) -> None:
        content = rng.randbytes(REPORT_BYTES)
        if is_off:
            network.apply(address, lambda engine, now: engine.transport(Plain).report(content))
        else:
            network.publish(address, _REPORT, content)
        published[address] += 1

    number = 0
    for address in addresses:
        if to_shore and address == 1:
            continue
        for turn in range(math.floor(length_s / period_s)):
            number += 1
            at_s = _ALONE_S * number if alone else period_s * (turn + rng.random())
            network.at(at_s, partial(report, address))
    network.run(until_s=max(length_s, _ALONE_S * (number + 1) if alone else 0.0))
    shares = [
        arrived[source, address] / published[source]
        for source in published
        for address in ((1,) if to_shore else addresses)
        if address != source
    ]
    by_cause: Counter[str] = Counter()
    for stats in network.stats():
        for entry in stats.ledger():
            by_cause[entry.cause.value] += entry.transmitted_bytes
    spent = sum(by_cause[cause.value] for cause in AGREEMENT)
    return Crowd(
        arrived=sum(shares) / len(shares),
        agreement=spent / max(1, by_cause.total()),
        bytes_by_cause=dict(by_cause),
        frames=sum(stats.frames_transmitted for stats in network.stats()),
    )
