"""Who hears whom, and the routes that follow: runs of probes, counts, and expected transmissions.

Each node transmits a run of probes in turn, and all others count them. Then each is asked what it
has heard. A node that does not answer directly is asked over nodes that do.

A frame is over a hop once its sender hears it one hop further, so a hop costs 1 / (p · q)
transmissions on average: p is the share of probes that came over it, q the one of those that came
back (D. De Couto and others, A high-throughput path metric for multi-hop wireless routing, 2003).
The route proposed is the one with the least sum.
"""

import asyncio
import heapq
import itertools
import json
import random
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Final

import msgspec

from zacoustic.core.relay.route import MOST_NODES, Route
from zacoustic.core.wire.relay import LAST_ROUTE, PROBE_BYTES
from zacoustic.core.wire.routing import MOST_SOURCES, MOST_VIA, RoutingKind, RoutingRequest
from zacoustic.errors import CallTimeoutError, DeliveryError, ServiceError
from zacoustic.zenoh.requests.routing import RoutingReport

_REST_S: Final = 2.0
"""Pause after a run, s: the last probe is on its way."""
_MS_PER_S: Final = 1000.0


class Asker(ABC):
    """Gives commands about routes to nodes, and lets time pass."""

    @abstractmethod
    async def own(self) -> int:
        """Return the address of the node that asks.

        Raises:
            DeliveryError: There is none.
        """

    @abstractmethod
    async def ask(self, node: int, request: RoutingRequest, timeout_s: float) -> RoutingReport:
        """Give a command; `request.via` has the nodes between.

        Raises:
            CallTimeoutError: No answer in time.
            ServiceError: A node refuses it.
            DeliveryError, LocalError: It cannot be given.
        """

    async def wait(self, seconds: float) -> None:
        """Let time pass."""
        await asyncio.sleep(seconds)


class Way(msgspec.Struct, frozen=True, kw_only=True):
    """What was measured from one node to another one."""

    source: int
    """Address of the node that has transmitted."""
    hearer: int
    """Address of the node that has counted."""
    heard: int
    """How many probes came."""
    sent: int
    """How many were transmitted."""

    @property
    def loss(self) -> float:
        """Share that was lost, 0…1."""
        return 1 - self.heard / self.sent


class Survey(msgspec.Struct, frozen=True, kw_only=True):
    """What was measured."""

    own: int
    """Address of the node that has asked."""
    count: int
    """Probes of each node."""
    ways: tuple[Way, ...]
    """Each pair of which the first has transmitted and the second was asked."""
    over: dict[int, tuple[int, ...]]
    """The nodes that have transmitted, with those over which each was asked."""
    missing: dict[int, str]
    """The nodes of which nothing is known, or only who was heard there, and why."""
    probe_bytes: int = PROBE_BYTES
    """Bytes of a probe without the envelope of the link."""
    own_airtime_s: float = 0.0
    """Airtime of the node that has asked: its probes, and its questions."""
    probes_airtime_s: float = 0.0
    """Airtime of the probes of the others."""

    def cost(self, node: int, other: int) -> float | None:
        """Return the expected transmissions of a hop; None: one does not hear the other."""
        found = {(each.source, each.hearer): each for each in self.ways}
        there, back = found.get((node, other)), found.get((other, node))
        if there is None or back is None or not there.heard or not back.heard:
            return None
        return (there.sent * back.sent) / (there.heard * back.heard)

    def cost_of(self, path: Sequence[int]) -> float | None:
        """Return the expected transmissions of a path; None: one of its hops is none."""
        costs = [self.cost(*hop) for hop in itertools.pairwise(path)]
        return None if None in costs else sum(each for each in costs if each is not None)


class Proposal(msgspec.Struct, frozen=True, kw_only=True):
    """A route with the least expected transmissions between two nodes."""

    id: int
    """Its number: that of the route of the file between these two, else a free one."""
    name: str
    """Its name."""
    path: tuple[int, ...]
    """Its nodes."""
    transmissions: float
    """Expected transmissions of a frame over it."""
    present: tuple[int, ...] = ()
    """The path in the file; empty: there is none."""
    present_transmissions: float | None = None
    """Those of that path; None: there is none, or one of its hops is none."""


async def survey(
    asker: Asker,
    nodes: Iterable[int],
    *,
    count: int,
    timeout_s: float,
    rng: random.Random,
    tell: Callable[[str], None] = lambda text: None,
) -> Survey:
    """Let each node transmit a run of probes, then ask each what it has heard.

    Args:
        asker: Gives the commands.
        nodes: Addresses of all nodes.
        count: Probes of each node, 1…32.
        timeout_s: How long to try each hop of a question, s.
        rng: Draws the number of the run.
        tell: Takes a line on progress.

    Raises:
        DeliveryError, LocalError: No node asks here.
    """
    own = await asker.own()
    run = rng.randrange(256)
    field = _Survey(asker, own, run, count, timeout_s, tell)
    await field.probe(own, ())
    pending = [each for each in sorted(nodes) if each != own]
    fresh = [own]
    while fresh and pending:
        # A node is tried over those only that were not known the last time.
        reached = []
        for over in fresh:
            via = () if over == own else (*field.over[over], over)
            for node in list(pending):
                if len(via) <= MOST_VIA and await field.probe(node, via):
                    reached.append(node)
                    pending.remove(node)
        fresh = reached
    for node in list(field.over):
        await field.hear(node)
    return field.result()


class _Survey:
    """A survey under way."""

    def __init__(
        self,
        asker: Asker,
        own: int,
        run: int,
        count: int,
        timeout_s: float,
        tell: Callable[[str], None],
    ) -> None:
        self._asker = asker
        self._own = own
        self._run = run
        self._count = count
        self._timeout_s = timeout_s
        self._tell = tell
        self.over: dict[int, tuple[int, ...]] = {}
        self._heard: dict[int, Mapping[int, int]] = {}
        self._missing: dict[int, str] = {}
        self._sent_s: list[float] = []
        self._probes_s = 0.0

    async def probe(self, node: int, via: tuple[int, ...]) -> bool:
        """Let a node transmit its probes; return whether it does."""
        request = RoutingRequest(kind=RoutingKind.PROBE, via=via, run=self._run, count=self._count)
        report = await self._ask(node, request)
        if report is None:
            return False
        self.over[node] = via
        self._missing.pop(node, None)
        if node != self._own:
            self._probes_s += self._count * report.airtime_ms / _MS_PER_S
        over = f" over {', '.join(map(str, via))}" if via else ""
        self._tell(f"node {node}{over}: {self._count} probes in {report.over_s} s")
        await self._asker.wait(report.over_s + _REST_S)
        return True

    async def hear(self, node: int) -> None:
        """Ask a node what it has heard."""
        heard: dict[int, int] = {}
        after = 0
        while True:
            request = RoutingRequest(
                kind=RoutingKind.HEARD, via=self.over[node], run=self._run, after=after
            )
            report = await self._ask(node, request)
            if report is None:
                return
            heard.update(report.heard)
            if len(report.heard) < MOST_SOURCES:
                break
            after = max(report.heard)
        self._heard[node] = heard
        self._tell(f"node {node} has heard {len(heard)} nodes")

    def result(self) -> Survey:
        """Return what was measured."""
        ways = tuple(
            Way(
                source=source,
                hearer=hearer,
                heard=min(heard.get(source, 0), self._count),
                sent=self._count,
            )
            for hearer, heard in sorted(self._heard.items())
            for source in sorted(self.over)
            if source != hearer
        )
        return Survey(
            own=self._own,
            count=self._count,
            ways=ways,
            over=dict(sorted(self.over.items())),
            missing=dict(sorted(self._missing.items())),
            own_airtime_s=round(max(self._sent_s) - min(self._sent_s), 3) if self._sent_s else 0.0,
            probes_airtime_s=round(self._probes_s, 3),
        )

    async def _ask(self, node: int, request: RoutingRequest) -> RoutingReport | None:
        """Ask a node; None: there is no answer, and `_missing` says why."""
        limit_s = self._timeout_s * (1 + len(request.via))
        try:
            report = await self._asker.ask(node, request, limit_s)
        except CallTimeoutError:
            self._missing.setdefault(node, "no answer")
        except (ServiceError, DeliveryError) as error:
            if node == self._own:
                raise
            self._missing[node] = str(error)
        else:
            self._sent_s.append(report.sent_s)
            return report
        return None


def best_path(found: Survey, start: int, end: int) -> tuple[int, ...]:
    """Return the path with the least expected transmissions; empty: there is none.

    Of two equal ones the one with fewer hops, then the one with lower addresses.
    """
    nodes = sorted({each.source for each in found.ways} | {each.hearer for each in found.ways})
    waiting: list[tuple[float, int, tuple[int, ...]]] = [(0.0, 0, (start,))]
    done: set[int] = set()
    while waiting:
        cost, hops, path = heapq.heappop(waiting)
        if path[-1] == end:
            return path
        if path[-1] in done or len(path) >= MOST_NODES:
            continue
        done.add(path[-1])
        for node in nodes:
            more = None if node in done else found.cost(path[-1], node)
            if more is not None:
                # Rounded, so that equal sums are equal in whatever order they were made.
                heapq.heappush(waiting, (round(cost + more, 9), hops + 1, (*path, node)))
    return ()


def proposals(
    found: Survey,
    pairs: Iterable[tuple[int, int]],
    *,
    routes: Sequence[Route] = (),
    names: Mapping[int, str] | None = None,
    taken: Iterable[int] = (),
) -> list[Proposal]:
    """Return a route for each pair that is better joined over others.

    Args:
        found: What was measured.
        pairs: The ends.
        routes: The routes of the file: a proposal between the same ends has its number and name.
        names: Names of the nodes.
        taken: Numbers of bonds.
    """
    known = {frozenset((each.path[0], each.path[-1])): each for each in routes}
    used = {*(each.route_id for each in routes), *taken}
    free = (number for number in range(1, LAST_ROUTE + 1) if number not in used)
    named = {each.name for each in routes}
    proposed = []
    for start, end in pairs:
        before = known.get(frozenset((start, end)))
        if before is not None:
            start, end = before.path[0], before.path[-1]
        path = best_path(found, start, end)
        if not path or (len(path) == 2 and before is None):
            continue
        if before is not None:
            number, name = before.route_id, before.name
        else:
            number = next(free, 0)
            if not number:
                break
            name = f"to_{(names or {}).get(end, str(end))}"
            name = name if name not in named else f"{name}_{number}"
            named.add(name)
        proposed.append(
            Proposal(
                id=number,
                name=name,
                path=path,
                transmissions=round(found.cost_of(path) or 0.0, 2),
                present=() if before is None else before.path,
                present_transmissions=None if before is None else found.cost_of(before.path),
            )
        )
    return proposed


def routes_text(proposed: Sequence[Proposal]) -> str:
    """Return the key `routes` of the file with these routes."""
    rows = [
        f"  {{ id: {each.id}, name: {json.dumps(each.name)}, path: {json.dumps(each.path)} }},"
        for each in proposed
    ]
    return "\n".join(["routes: [", *rows, "],"]) if rows else "routes: [],"
