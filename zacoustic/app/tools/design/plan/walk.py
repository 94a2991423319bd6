"""The engines of a fleet with its traffic, in virtual time, and what they took of the channel.

A stream's share of the channel is not just its bytes: a frame has a preamble, several records share
one, acknowledgements, repetitions and relays come on top, and medium access decides how many frames
there are. No formula covers all of that, so the engines themselves run, on the scenario's channel.
The airtime of each frame is divided among its streams and causes by the bytes in it.

A node that represents others (`sampling`) publishes their samples in frames of its own. What each
node transmits for itself (acknowledgements, introductions, heartbeats) counts for each of them, and
a confirmation for each node of the fleet.
"""

import itertools
import math
import random
import statistics
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import msgspec

from zacoustic.app.tools.design.plan.offers import Offer
from zacoustic.app.tools.design.sim.fleetrun import FleetRun
from zacoustic.channel.scenario import Scenario
from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.stats import NO_STREAM, Cause, EngineStats, TunnelStats
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import HELLO_BYTES, TAG_BYTES
from zacoustic.errors import LocalError
from zacoustic.seal.spec import SecuritySpec
from zacoustic.testing.scenarios.checker import Arrived, Checker, Publication

FIRST_S: Final = 3600.0
"""The longest beginning of a walk, in which nodes agree on their tables, s."""
FIRST_ARRIVALS: Final = 2_000
"""The most arrivals in it."""
_STRIDE_S: Final = 5.0
_PARTS: Final = 10
"""Equal parts of a walk, whose scatter tells how sure its result is."""
_STUDENT: Final = 2.262
"""The 97.5th percentile of Student's distribution with one degree of freedom less than parts."""
_AGREEMENT: Final = frozenset({Cause.HELLO, Cause.CONFIRM, Cause.ASK, Cause.TABLE})
_OF_SAMPLES: Final = frozenset(
    {Cause.PAYLOAD, Cause.HEADER, Cause.ENVELOPE, Cause.SEAL, Cause.REPEAT, Cause.REPAIR}
)
"""What the samples of a represented node cost, once for each sample; all else is of a node."""

Key = tuple[int, Cause]


class Found:
    """The result of a walk."""

    def __init__(self) -> None:
        self.airtime_s: dict[int, float] = {}
        """Airtime by node, s."""
        self.link_airtime_s: dict[str, float] = {}
        """Airtime by link, s."""
        self.link_paid_bytes: Counter[str] = Counter()
        """Bytes by link that are paid for, where frames cost money."""
        self.relayed_s: dict[int, float] = {}
        """Airtime by node for frames of routes, bonds and floods that it passes on, and for what
        these add to its own, s."""
        self.stream_airtime_s: dict[int, float] = {}
        """Airtime by stream, s; 0: no stream."""
        self.agreement_s = 0.0
        """Airtime of HELLO, TAG, CONFIRM and what follows from differences, s."""
        self.first_s = 0.0
        """Length of its beginning, s: at most `FIRST_S`, less with many frames."""
        self.first_agreement = 0.0
        """Share of the agreement's bytes in all bytes of the beginning, 0…1."""
        self.walked_s = 0.0
        """Modelled time, s."""
        self.confidence_s = 0.0
        """How far all airtime may be off for the shortness of the time: with 95 % by at most this,
        s."""
        self.arrivals = 0
        """Frames, each counted at each node, its own included: the work of the walk."""
        self.frames = 0.0
        self.transmitted_bytes = 0.0
        self.agreement_bytes = 0.0
        """Bytes of HELLO, TAG, CONFIRM and what follows from differences."""
        self.latencies_s: dict[int, list[float]] = {}
        """Time to each arrival by stream, s."""
        self.said: dict[int, int] = {}
        """Number of samples and calls by stream."""
        self.went: dict[int, int] = {}
        """Number of those transmitted, by stream."""
        self.arrived: dict[int, dict[int, int]] = {}
        """Number of samples or answers by stream and receiving node."""
        self.said_s: dict[int, list[float]] = {}
        """Instants of the samples of topics with one speaker, by stream, s."""
        self.refused: dict[int, int] = {}
        """Number of those that publishing refuses, by stream."""
        self.refusals: dict[int, LocalError] = {}
        """The last refusal, by stream."""


class Walk(Checker):
    """One simulation, a *walk* through the time of a fleet.

    Args:
        scenario: The channel.
        tables: The table of each node.
        rules: The config's rules of transmission, by node.
        offers: The offered traffic.
        seed: Seed of all draws, from 1.
        security: The seal of each node that has one.
        members: Nodes represented by each node, itself included; none: each represents itself.
    """

    def __init__(
        self,
        scenario: Scenario,
        tables: Mapping[int, StreamTable],
        rules: Mapping[int, TransmitRules],
        offers: Sequence[Offer],
        seed: int,
        security: Mapping[int, SecuritySpec],
        members: Mapping[int, tuple[int, ...]],
    ) -> None:
        super().__init__()
        self.found = Found()
        self._offers = offers
        self._members = {each: members.get(each, (each,)) for each in tables}
        nodes = sum(map(len, self._members.values()))
        self._confirms = (nodes - 1) / max(1, len(tables) - 1)
        """Confirmations of a node for each that the walk has."""
        self._ledgers: dict[int, _Ledger] = {}
        self._introductions: dict[int, int] = {}
        """How many represented nodes have yet to say HELLO as the one that represents them has."""
        self._run: FleetRun | None = None
        # A plan is of the hours between the quiet ones.
        rules = {
            address: msgspec.structs.replace(each, quiet=()) for address, each in rules.items()
        }
        # The first seed is the scenario's own.
        scenario = msgspec.structs.replace(scenario, seed=scenario.seed + seed - 1)
        self._run = FleetRun(
            scenario, tables, rules, self, security=security, trace=self._traced, digest=False
        )
        self._begin(offers, seed)

    def run(
        self,
        until_s: float,
        most_arrivals: int | None = None,
        progress: Callable[[float], None] | None = None,
    ) -> Found:
        """Walk for a time, s; or until that many frames have arrived.

        Args:
            until_s: The time, s.
            most_arrivals: Number of frames, each counted at each node.
            progress: Called with the done share, 0…1.
        """
        assert self._run is not None
        found, network = self.found, self._run.network
        course = [0.0]
        while found.walked_s < until_s:
            if most_arrivals is not None and found.arrivals >= most_arrivals:
                break
            found.walked_s = min(found.walked_s + _STRIDE_S, until_s)
            network.run(until_s=found.walked_s)
            course.append(sum(found.airtime_s.values()))
            frames = sum(stats.frames_transmitted for stats in network.stats())
            found.arrivals = frames * len(network.addresses)
            if not found.first_s:
                self._end_beginning(is_over=found.walked_s >= until_s)
            if progress is not None:
                share = found.arrivals / most_arrivals if most_arrivals else 0.0
                progress(min(1.0, max(share, found.walked_s / until_s)))
        for address in network.addresses:
            if network.is_running(address):
                self._book(address, network.engine(address).stats)
            self._add_links(address)
        self._count_first_transmissions()
        found.confidence_s = _confidence_of(course)
        return found

    def _end_beginning(self, *, is_over: bool) -> None:
        found = self.found
        if is_over or found.walked_s >= FIRST_S or found.arrivals >= FIRST_ARRIVALS:
            found.first_s = found.walked_s
            found.first_agreement = found.agreement_bytes / max(1.0, found.transmitted_bytes)

    def _add_links(self, address: int) -> None:
        assert self._run is not None
        for stats in self._run.network.stats_of(address):
            for name, each in stats.links.items():
                if not isinstance(each, TunnelStats):  # its frames are those of a link
                    airtime_s = each.airtime_ns / NS_PER_S
                    before_s = self.found.link_airtime_s.get(name, 0.0)
                    self.found.link_airtime_s[name] = before_s + airtime_s
                    self.found.link_paid_bytes[name] += each.paid_bytes

    # Offered traffic

    def _begin(self, offers: Sequence[Offer], seed: int) -> None:
        rng = random.Random(f"plan/{seed}")
        speakers = Counter(offer.stream.stream_id for offer in offers)
        for offer in offers:
            self.found.said.setdefault(offer.stream.stream_id, 0)
            if speakers[offer.stream.stream_id] == 1 and not offer.is_call:
                self.found.said_s[offer.stream.stream_id] = []
            self._repeat(offer, offer.values(rng), offer.instants(rng))

    def _repeat(self, offer: Offer, values: Iterator[object], instants: Iterator[int]) -> None:
        assert self._run is not None
        run, stream = self._run, offer.stream
        run.answers.setdefault(stream.stream_id, offer.answer)

        def act() -> None:
            self.found.said[stream.stream_id] += 1
            if (said_s := self.found.said_s.get(stream.stream_id)) is not None:
                said_s.append(run.network.now / NS_PER_S)
            run.say(offer.node, stream, offer.instance, next(values))
            go_on()

        def go_on() -> None:
            at = next(instants, None)
            if at is not None:
                run.network.at(max(at, run.network.now) / NS_PER_S, act)

        go_on()

    # What becomes of it

    def received(self, arrived: Arrived) -> None:
        """Note its latency."""
        self._note(arrived.publication, arrived)

    def answered(self, arrived: Arrived) -> None:
        """Note its latency."""
        self._note(arrived.publication, arrived)

    def _note(self, publication: Publication, arrived: Arrived) -> None:
        stream_id, found = publication.stream.stream_id, self.found
        latency_s = (arrived.at - publication.at) / NS_PER_S
        found.latencies_s.setdefault(stream_id, []).append(latency_s)
        nodes = found.arrived.setdefault(stream_id, {})
        nodes[arrived.node] = nodes.get(arrived.node, 0) + 1

    def _count_first_transmissions(self) -> None:
        """Take from the engines what they have composed once, and what they have refused."""
        assert self._run is not None
        run, found = self._run, self.found
        speakers = {(offer.node, offer.stream.stream_id) for offer in self._offers}
        for address in run.network.addresses:
            for stats in run.network.stats_of(address):
                for stream_id, number in stats.transmitted.items():
                    if (address, stream_id) in speakers:
                        found.went[stream_id] = found.went.get(stream_id, 0) + number
        found.refused.update(run.refused)
        found.refusals.update(run.refusals)

    # Frames

    def _traced(self, record: TraceRecord) -> None:
        """Book each frame as it is composed, so that a preamble is shared by its bytes alone."""
        run = self._run
        if record.what == "transmit" and run is not None and run.network.is_running(record.node):
            self._book(record.node, run.network.engine(record.node).stats)

    def _book(self, address: int, stats: EngineStats) -> None:
        ledger = self._ledgers.get(address)
        if ledger is None or ledger.stats is not stats:  # the node has begun another life
            ledger = self._ledgers[address] = _Ledger(stats)
        airtime_s, frames, parts = ledger.news()
        if not parts:
            return
        members = self._members[address]
        has_samples = any(each != NO_STREAM and cause in _OF_SAMPLES for each, cause in parts)
        if has_samples and len(members) > 1:
            airtime_s += self._introduce(address, parts)
        size_bytes = sum(parts.values())
        counted = 0.0
        for (stream_id, cause), part in parts.items():
            is_of_node = not has_samples or cause not in (*_OF_SAMPLES, Cause.HELLO)
            times = float(len(members) if is_of_node else 1)
            if cause is Cause.CONFIRM:
                times *= self._confirms
            share = part / size_bytes * times
            counted += share
            self._count(address, stream_id, cause, part * times, airtime_s * share)
        self.found.frames += frames * counted

    def _introduce(self, address: int, parts: dict[Key, int]) -> float:
        """Let each represented node say HELLO in a frame of its samples, as this node has.

        Returns:
            The airtime of what the frame has more, s.
        """
        hello = (NO_STREAM, Cause.HELLO)
        owed = self._introductions.get(address, 0)
        if parts.get(hello, 0) >= HELLO_BYTES:
            self._introductions[address] = owed + len(self._members[address]) - 1
        elif parts.get(hello) == TAG_BYTES and owed:
            assert self._run is not None
            self._introductions[address] = owed - 1
            before_bytes = sum(parts.values())
            parts[hello] = HELLO_BYTES
            airtime_ns = self._run.network.capabilities(address).airtime_ns
            return (airtime_ns(sum(parts.values())) - airtime_ns(before_bytes)) / NS_PER_S
        return 0.0

    def _count(
        self, address: int, stream_id: int, cause: Cause, size_bytes: float, airtime_s: float
    ) -> None:
        """Count bytes of a node, and of those that it represents."""
        found, members = self.found, self._members[address]
        for each in members:
            found.airtime_s[each] = found.airtime_s.get(each, 0.0) + airtime_s / len(members)
            if cause is Cause.RELAY:
                before_s = found.relayed_s.get(each, 0.0)
                found.relayed_s[each] = before_s + airtime_s / len(members)
        before_s = found.stream_airtime_s.get(stream_id, 0.0)
        found.stream_airtime_s[stream_id] = before_s + airtime_s
        found.transmitted_bytes += size_bytes
        if cause in _AGREEMENT:
            found.agreement_bytes += size_bytes
            found.agreement_s += airtime_s


def _confidence_of(course: Sequence[float]) -> float:
    """Return how far the end of a course may be off, from the scatter of its equal parts."""
    steps = (len(course) - 1) // _PARTS
    if not steps:
        return 0.0
    ends = course[len(course) - 1 - steps * _PARTS :: steps]
    parts = [after - before for before, after in itertools.pairwise(ends)]
    return _STUDENT * statistics.stdev(parts) * math.sqrt(_PARTS)


class _Ledger:
    """What of an engine's counters is booked.

    Args:
        stats: The counters.
    """

    def __init__(self, stats: EngineStats) -> None:
        self.stats = stats
        self._airtime_ns = 0
        self._frames = 0
        self._parts: dict[Key, int] = {}

    def news(self) -> tuple[float, int, dict[Key, int]]:
        """Return airtime, s, frames, and bytes by stream and cause, since the last call."""
        stats, before = self.stats, self._parts
        parts: dict[Key, int] = {}
        if stats.frames_transmitted == self._frames:  # a route has composed what a link sends later
            return 0.0, 0, parts
        for entry in stats.ledger():
            key = (entry.stream_id, entry.cause)
            more = entry.transmitted_bytes - before.get(key, 0)
            if more:
                parts[key] = more
                before[key] = entry.transmitted_bytes
        if not parts:
            return 0.0, 0, parts
        airtime_s = (stats.airtime_ns - self._airtime_ns) / NS_PER_S
        frames = stats.frames_transmitted - self._frames
        self._airtime_ns, self._frames = stats.airtime_ns, stats.frames_transmitted
        return airtime_s, frames, parts
