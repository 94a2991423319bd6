"""Invariants of every random scenario; each is a checker.

`ScenarioRun` itself checks that nothing is altered or arrives on a wrong stream.
"""

from typing import Final

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.qos import Priority, Reliability
from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome, Event
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.topics.copied import COPIED_NS
from zacoustic.testing.scenarios.checker import Arrived, Checker, Publication, Run


def is_reliable(stream: Stream) -> bool:
    """Tell whether samples of a stream are repeated until they are acknowledged."""
    spec = stream.spec
    return isinstance(spec, TopicSpec) and spec.qos.reliability is Reliability.RELIABLE


class NothingTwice(Checker):
    """No node receives a sample twice.

    A reliable sample never comes twice, over all boot epochs of a node with a journal, unless it is
    marked: a crash interrupted its delivery. A best-effort sample may come again only within the
    settling time, in which a modem may repeat a frame. A node that has crashed meanwhile has
    forgotten the numbers of urgent best-effort samples, which are repeated for half a minute.
    """

    def begins(self, scenario_run: Run) -> None:
        """Learn the settling time."""
        self._within_ns = scenario_run.settling_ns + seconds_to_ns(
            scenario_run.drawn.scenario.faults.jitter_s
        )
        self._pressed_ns = self._within_ns + COPIED_NS
        self._first: dict[tuple[int, int], Arrived] = {}

    def received(self, arrived: Arrived) -> None:
        """Compare with the first arrival."""
        publication = arrived.publication
        first = self._first.setdefault((arrived.node, publication.number), arrived)
        if first is arrived or (arrived.again and first.life < arrived.life):
            return
        if is_reliable(publication.stream):
            if first.life == arrived.life or _keeps(publication.stream):
                self.violations.append(f"{_told(arrived)} a second time, after {_at(first.at)}")
        elif arrived.at - first.at > self._within_ns and not (
            first.life < arrived.life
            and publication.stream.qos.priority is Priority.REAL_TIME
            and arrived.at - publication.at <= self._pressed_ns
        ):
            self.violations.append(f"{_told(arrived)} again, long after {_at(first.at)}")


class InOrder(Checker):
    """The reliable samples of a key of one source arrive in the order of their publication."""

    def __init__(self) -> None:
        super().__init__()
        self._last: dict[tuple[int, int, int, Instance], Arrived] = {}

    def received(self, arrived: Arrived) -> None:
        """Compare with the previous arrival."""
        publication = arrived.publication
        if not is_reliable(publication.stream) or arrived.again:
            return
        stream_id = publication.stream.stream_id
        lane = (arrived.node, publication.node, stream_id, publication.instance)
        last = self._last.get(lane)
        self._last[lane] = arrived
        if last is None or last.publication.number <= publication.number:
            return
        if last.life == arrived.life or _keeps(publication.stream):
            self.violations.append(
                f"{_told(arrived)} after #{last.publication.number}, which is younger"
            )


class NothingLost(Checker):
    """A reliable sample reaches every subscriber, or its publisher gets another outcome.

    A crash of the publisher may lose samples that were accepted and not yet journalled, and without
    a journal all its samples.
    """

    def __init__(self) -> None:
        super().__init__()
        self._open: dict[int, Publication] = {}
        self._owed: dict[int, set[int]] = {}
        self._by_id: dict[tuple[int, int], Publication] = {}

    def begins(self, scenario_run: Run) -> None:
        """Remember the nodes."""
        self._scenario_run = scenario_run

    def published(self, publication: Publication) -> None:
        """Note its receivers."""
        if not is_reliable(publication.stream):
            return
        owed = self._receivers(publication)
        if not owed:
            return
        self._open[publication.number] = publication
        self._by_id[publication.node, publication.result] = publication
        self._owed[publication.number] = owed

    def _receivers(self, publication: Publication) -> set[int]:
        return {
            address
            for address, cast in self._scenario_run.casts.items()
            if address != publication.node
            and (stream := cast.table.get(publication.stream.stream_id)) is not None
            and stream.digest == publication.stream.digest
            and stream.may_subscribe(address)
        }

    def received(self, arrived: Arrived) -> None:
        """Note one arrival."""
        self._owed.get(arrived.publication.number, set()).discard(arrived.node)

    def crashed(self, node: int, at: int) -> None:
        """Forget samples that may be lost."""
        journal = self._scenario_run.network.journal(node)
        for publication in list(self._open.values()):
            if publication.node != node:
                continue
            if not (_keeps(publication.stream) and journal.is_journalled(publication.written)):
                self._close(publication)

    def happened(self, node: int, event: Event, at: int) -> None:
        """Note a publisher's outcome."""
        if not isinstance(event, DeliveryEnded):
            return
        publication = self._by_id.get((node, event.delivery_id))
        if publication is None or publication.number not in self._open:
            return
        owed = self._owed[publication.number]
        if event.outcome is DeliveryOutcome.DELIVERED and owed:
            self.violations.append(
                f"{_at(at)}: node {node} is told that {_named(publication)} is delivered; "
                f"{sorted(owed)} never got it"
            )
        self._close(publication)

    def ends(self, scenario_run: Run) -> None:
        """Report samples that never had an outcome."""
        for publication in self._open.values():
            owed = sorted(self._owed[publication.number])
            self.violations.append(
                f"{_named(publication)} has no outcome at the end; missing at {owed or 'nobody'}"
            )

    def _close(self, publication: Publication) -> None:
        del self._open[publication.number]
        del self._owed[publication.number]


class OncePerCall(Checker):
    """No server executes a call twice, over all boot epochs if it keeps journal and table."""

    def __init__(self) -> None:
        super().__init__()
        self._served: set[tuple[int, int]] = set()

    def begins(self, scenario_run: Run) -> None:
        """Learn whether boot epochs are distinguished."""
        drawn = scenario_run.drawn
        self._forgets = bool(drawn.pool) or drawn.scenario.faults.journal.keeps is False

    def served(self, arrived: Arrived) -> None:
        """Compare with the calls executed before."""
        forgets = self._forgets or not _keeps(arrived.publication.stream)
        call = (arrived.publication.number, arrived.life if forgets else 0)
        if call in self._served:
            self.violations.append(f"{_told(arrived)} runs a second time")
        self._served.add(call)


INVARIANTS: Final[tuple[type[Checker], ...]] = (NothingTwice, InOrder, NothingLost, OncePerCall)
"""All invariants; they hold in the scenarios of `draw_scenario`."""


def _keeps(stream: Stream) -> bool:
    """Tell whether the stream is journalled; all tables of a scenario agree on that."""
    return stream.spec.journal


def _at(instant: int) -> str:
    return f"{instant / NS_PER_S:.3f} s"


def _named(publication: Publication) -> str:
    return (
        f"#{publication.number} of node {publication.node} on {publication.key}, published at "
        f"{_at(publication.at)} in life {publication.life}"
    )


def _told(arrived: Arrived) -> str:
    return f"{_at(arrived.at)}: node {arrived.node} gets {_named(arrived.publication)}"
