"""`VirtualNetwork`: many real engines on the simulated channel, in virtual time.

The engines are those that run at sea, byte for byte; only the clock differs. One heap holds all
future actions, its instants hold for all nodes, and time jumps from one entry to the next. There is
no thread, no loop and no sleep, so a day takes seconds. One seed gives one trace, and `digest`
identifies a run in 32 bytes.

::

    network = VirtualNetwork(scenario, table)
    network.at(10.0, lambda: network.publish(2, 10, {"depth": 4.2}))
    network.run(until_s=3600)
    network.samples(1)

Faults come from the scenario (`faults`, `loss`, `links`) or from calls: `crash`, `start`,
`set_link`. A node that crashes loses its engine and keeps its journal (`virtualjournal`), its
clocks (`virtualclock`) and its modem (`virtualmodems`). Its next engine gets the content of the
journal, and the boot epoch after the last committed one.

The scenario's profile describes the modem of a node. `Modem` removes features that a test wants to
be without: addresses, the check, frames.

Instants of the network are those of its agenda. An engine and its events use the monotonic clock of
their node, which is the same unless the scenario says otherwise.
"""

import hashlib
import random
from collections.abc import Callable, Iterator, Mapping
from types import MappingProxyType
from typing import Final, TypeVar

import msgspec

from zacoustic.channel.agenda import Agenda
from zacoustic.channel.medium import Medium
from zacoustic.channel.propagation.position import Position
from zacoustic.channel.scenario import Scenario
from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.journal import BOOT_KEY
from zacoustic.core.base.linktypes import ONE_LINK, LinkCapabilities
from zacoustic.core.base.stats import EngineStats
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtualclock import NodeClock
from zacoustic.testing.virtualfaults import schedule_faults
from zacoustic.testing.virtualjournal import FULL, VirtualJournal
from zacoustic.testing.virtualmodems import Disturb, Modem, VirtualModems
from zacoustic.testing.virtualnode import NodeDownError, VirtualNode

# Users of a network may need `Modem`, and the error of a node that is down.
__all__ = ["Deliver", "Disturb", "Modem", "NodeDownError", "VirtualNetwork"]

T = TypeVar("T")

_FREE: Final = TransmitRules()

Deliver = Callable[[int, Event], None]
"""``(address, event)``: receives the events of all engines as they happen."""

Point = Callable[[int, str, Event | None], None]
"""``(address, what, event)``: called before and after each commit and each event of a node; see
`VirtualNetwork`."""

Lives = Callable[[int, bool], None]
"""``(address, is_alive)``: called before a node starts, and after it has crashed."""


class VirtualNetwork:
    """Engines, a medium and an agenda.

    Args:
        scenario: The channel, the nodes and the faults.
        table: The stream table of all nodes, or one for each address.
        modem: Features of the modems.
        mtu_bytes: Largest frame of single nodes, bytes, by address; others have that of `modem`.
        link: Name of the link of this medium; None: the first link of each node.
        seed: Replaces the seed of the scenario.
        deliver: Receives each event; None: `events` keeps them.
        trace: Receives each trace record.
        digest: Compute the digest of the trace, which takes a tenth of a run's time.
        disturb: Loses, delays and repeats frames in addition to the scenario.
        lives: Called when a node has crashed, and before it starts again; may call `set_table`.
        rules: Rules of transmission, one for all nodes or by address; a node without them transmits
            freely.
        build: Creates the engines.
        point: Called with ``commit`` and ``committed`` around each commit of a node's journal, with
            ``event`` and ``told`` around each event; may crash that node there.

    Raises:
        ValueError: There is a table for a node that the scenario does not have.
    """

    def __init__(
        self,
        scenario: Scenario,
        table: StreamTable | Mapping[int, StreamTable],
        *,
        modem: Modem | None = None,
        mtu_bytes: Mapping[int, int] = MappingProxyType({}),
        link: str | None = None,
        seed: int | None = None,
        deliver: Deliver | None = None,
        trace: Callable[[TraceRecord], None] | None = None,
        digest: bool = True,
        disturb: Disturb | None = None,
        lives: Lives | None = None,
        rules: TransmitRules | Mapping[int, TransmitRules] = _FREE,
        build: MakeEngine = Engine,
        point: Point | None = None,
    ) -> None:
        if seed is not None:
            scenario = msgspec.structs.replace(scenario, seed=seed)
        self.scenario = scenario
        self.events: list[tuple[int, Event]] = []
        """``(address, event)`` in order, without `deliver`."""
        self._agenda = Agenda()
        medium = Medium(scenario)
        self._nodes: dict[int, VirtualNode] = {}
        self._medium = VirtualModems(
            self._agenda, medium, modem or Modem(), link, disturb, self._service, mtu_bytes
        )
        self._media = [self._medium]
        self._beside: dict[str, VirtualModems] = {}
        self._deliver = deliver or (lambda address, event: self.events.append((address, event)))
        self._trace = trace
        self._hash = hashlib.sha256() if digest else None
        self._lives = lives
        self._rules = rules
        self._build = build
        self._point = point or (lambda address, what, event: None)
        tables = table if isinstance(table, Mapping) else dict.fromkeys(medium.addresses, table)
        if set(tables) - set(medium.addresses):
            raise ValueError(f"tables for {sorted(tables)}; nodes: {list(medium.addresses)}")
        clocks = {spec.node: spec for spec in scenario.faults.clocks}
        for address in sorted(tables):
            self._nodes[address] = VirtualNode(
                address,
                table=tables[address],
                journal=VirtualJournal(address, scenario.faults.journal),
                clock=NodeClock(clocks.get(address)),
                rng=random.Random(f"{scenario.seed}/crash/{address}"),
            )
            if link is None or self._has(address, link):
                self._medium.add(self._nodes[address])
        for address in self._nodes:
            self.start(address)
        schedule_faults(self, scenario)

    # Time

    @property
    def now(self) -> int:
        """The present instant, ns since the start."""
        return self._agenda.now

    def at(self, instant_s: float, action: Callable[[], object]) -> None:
        """Run an action at an instant, s since the start; at once if that is past."""
        self._agenda.at(instant_s, action)

    def every(self, period_s: float, action: Callable[[], object], *, first_s: float = 0.0) -> None:
        """Repeat an action; the agenda then never runs dry, so `run` needs an end."""
        self._agenda.every(period_s, action, first_s=first_s)

    def run(self, *, until_s: float | None = None) -> None:
        """Run the actions up to an instant, or until none is left."""
        self._agenda.run(None if until_s is None else seconds_to_ns(until_s))

    @property
    def is_quiet(self) -> bool:
        """Whether nothing more will happen: no sound on the channel, no timer armed."""
        return not len(self._agenda)

    # Nodes

    @property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of all nodes of the network, in order, also of those that are down."""
        return tuple(self._nodes)

    def engine(self, address: int) -> Engine:
        """Return the engine of a node, for its getters; use `apply` for commands.

        Raises:
            NodeDownError: The node is down.
        """
        return self._nodes[address].running

    def is_running(self, address: int) -> bool:
        """Tell whether a node has an engine now."""
        return self._nodes[address].engine is not None

    def life(self, address: int) -> int:
        """Return how often a node has started."""
        return self._nodes[address].lives

    def apply(self, address: int, command: Callable[[Engine, int], T]) -> T:
        """Give a command to an engine and let it act.

        Raises:
            NodeDownError: The node is down.
        """
        node = self._nodes[address]
        result = command(node.running, node.clock.local(self.now))
        self._service(node)
        return result

    def publish(
        self, address: int, stream_id: int, value: object, *, instance: Instance = ()
    ) -> int:
        """Publish a sample from a node; result and errors as for `Engine.publish`.

        Raises:
            NodeDownError: The node is down.
        """
        node = self._nodes[address]
        now = node.clock.local(self.now)
        result = node.running.publish(stream_id, value, now, instance=instance)
        self._service(node)
        return result

    def samples(self, address: int, stream_id: int | None = None) -> list[SampleReceived]:
        """Return the samples in `events` that a node received, of one stream or of all."""
        return [
            event
            for at, event in self.events
            if at == address
            and isinstance(event, SampleReceived)
            and stream_id in (None, event.stream_id)
        ]

    def capabilities(self, address: int, link: str | None = None) -> LinkCapabilities:
        """Return the capabilities of a node's modem, by default of its first link."""
        medium = self._media_of(address)[0] if link is None else self._on(link)
        return medium.capabilities(address)

    def stats(self) -> Iterator[EngineStats]:
        """Yield the statistics of all engines, former boot epochs included."""
        for address in self._nodes:
            yield from self.stats_of(address)

    def stats_of(self, address: int) -> Iterator[EngineStats]:
        """Yield the statistics of a node's engines, former boot epochs included."""
        node = self._nodes[address]
        yield from node.past
        if node.engine is not None:
            yield node.engine.stats

    def journal(self, address: int) -> VirtualJournal:
        """Return the journal of a node, for its getters."""
        return self._nodes[address].journal

    def wall_ns(self, address: int) -> int:
        """Return the wall clock of a node, ns since 1970."""
        return self._nodes[address].clock.wall(self.now)

    def local_ns(self, address: int) -> int:
        """Return the monotonic clock of a node, ns: the `now` of its engine."""
        return self._nodes[address].clock.local(self.now)

    # Further links

    def add_link(
        self,
        link: str,
        scenario: Scenario,
        *,
        modem: Modem | None = None,
        disturb: Disturb | None = None,
    ) -> None:
        """Add another modem to the nodes that have such a link, on a separate medium.

        Args:
            link: Name of the link, such as `radio`, in the `TransmitRules` of the engines.
            scenario: The medium, and all nodes.
            modem: Features of its modems.
            disturb: Loses, delays and repeats frames in addition to the scenario.
        """
        medium = VirtualModems(
            self._agenda, Medium(scenario), modem or Modem(), link, disturb, self._service
        )
        self._beside[link] = medium
        self._media.append(medium)
        for node in self._nodes.values():
            if not self._has(node.address, link):
                continue
            medium.add(node)
            if node.engine is not None:
                self._connect(medium, node, node.engine)

    # Faults caused by calls

    def crash(self, address: int, *, reboots: bool = False) -> None:
        """Crash a node: its engine goes, committed journal writes stay. No effect if it is down.

        Args:
            address: Address of the node.
            reboots: The whole computer has lost power, so its monotonic clock starts again.
        """
        node = self._nodes[address]
        if node.engine is None:
            return
        node.past.append(node.engine.stats)
        node.engine = None
        self._arm(node, None)
        for medium in self._media_of(address):
            medium.stations[address].pending.clear()
        node.journal.crash(node.rng.random())
        if reboots:
            node.clock.reboot(self.now)
        if self._lives is not None:
            self._lives(address, False)

    def start(self, address: int) -> None:
        """Start a node that is down. No effect if it is not."""
        node = self._nodes[address]
        if node.engine is not None:
            return
        if self._lives is not None and node.lives:
            self._lives(address, True)
        epoch = node.journal.begin_life()
        node.lives += 1
        node.engine = self._build(
            address=address,
            table=node.table,
            epoch=epoch,
            rng=random.Random(f"{self.scenario.seed}/{address}/{epoch}"),
            rules=self._rules_of(address),
            stored={**node.journal.entries, BOOT_KEY: b"%d" % node.clock.boots},
            trace=self._note if self._trace or self._hash else None,
        )
        for medium in self._media_of(address):
            self._connect(medium, node, node.engine)

    def _rules_of(self, address: int) -> TransmitRules:
        rules = self._rules
        return rules if isinstance(rules, TransmitRules) else rules.get(address, _FREE)

    def _has(self, address: int, link: str) -> bool:
        return any(each.name == link for each in self._rules_of(address).of_links)

    def set_table(self, address: int, table: StreamTable) -> None:
        """Give a node another table for its next start."""
        self._nodes[address].table = table

    def restart(self, address: int, table: StreamTable | None = None) -> None:
        """Crash a node and start it again at once, with the same table or another."""
        self.crash(address)
        if table is not None:
            self.set_table(address, table)
        self.start(address)

    def set_link(self, address: int, *, up: bool, link: str | None = None) -> None:
        """Unplug or plug in the modem of a node, by default that of its first link."""
        node = self._nodes[address]
        medium = self._media_of(address)[0] if link is None else self._on(link)
        medium.stations[address].is_up = up
        if node.engine is None:
            return
        if up:
            self._connect(medium, node, node.engine)
        else:
            medium.disconnect(node, node.engine)
            self._service(node)

    def move(self, address: int, position: Position) -> None:
        """Move a node: x east, y north, z down, m."""
        self._medium.medium.move(address, position, self.now)

    def tell_clock(self, address: int) -> None:
        """Tell an engine the time and error of its node's wall clock. No effect if it is down."""
        node = self._nodes[address]
        if node.engine is not None:
            self._tell_clock(node, node.engine)
            self._service(node)

    # Results

    @property
    def digest(self) -> str:
        """Hexadecimal SHA-256 of the trace so far; empty if not computed."""
        return self._hash.hexdigest() if self._hash else ""

    @property
    def losses(self) -> dict[str, int]:
        """Frames that did not arrive, by outcome."""
        return self._medium.losses

    # Below the methods above

    def _media_of(self, address: int) -> list[VirtualModems]:
        return [each for each in self._media if address in each.stations]

    def _on(self, link: str | None) -> VirtualModems:
        return self._medium if link is None else self._beside.get(link, self._medium)

    def _connect(self, medium: VirtualModems, node: VirtualNode, engine: Engine) -> None:
        """Tell an engine that its modem is there, once the modem is free."""
        device = medium.stations[node.address]
        if node.engine is not engine or not device.is_up:
            return
        if device.silent_at > self.now:
            self._agenda.push(device.silent_at, self._connect, medium, node, engine)
            return
        if node.clock.is_told:
            self._tell_clock(node, engine)
        medium.connect(node, engine)
        self._service(node)

    def _tell_clock(self, node: VirtualNode, engine: Engine) -> None:
        now = node.clock.local(self.now)
        node.clock.told(self.now)
        engine.handle_clock(node.clock.wall(self.now) - now, node.clock.error(self.now), now)

    def _service(self, node: VirtualNode) -> None:
        """Poll an engine until it is dry, and arm its timer: the contract of `engine`."""
        engine = node.engine
        if engine is None:
            return
        now = node.clock.local(self._agenda.now)
        if node.clock.is_due(self._agenda.now):
            self._tell_clock(node, engine)
        self._take_writes(node, engine)
        if node.engine is not engine:
            return
        while (transmission := engine.poll_transmit(now)) is not None:
            self._on(transmission.link).send(node.address, transmission)
        while (event := engine.poll_event()) is not None:
            self._point(node.address, "event", event)
            if node.engine is engine:
                self._deliver(node.address, event)
                self._point(node.address, "told", event)
            if node.engine is not engine:  # a handler of an event may crash the node
                return
        self._take_writes(node, engine)
        if node.engine is not engine:
            return
        if node.journal.is_idle and node.journal.commit_ns:
            self._commit(node, engine)  # as a runner does, once the events are handed over
        self._arm(node, engine.poll_timeout())

    def _take_writes(self, node: VirtualNode, engine: Engine) -> None:
        """Take the writes of an engine; commit them if that takes no time."""
        while node.engine is engine and (write := engine.poll_journal()) is not None:
            node.journal.add(write)
            while (write := engine.poll_journal()) is not None:
                node.journal.add(write)
            if node.journal.is_idle and not node.journal.commit_ns:
                self._commit(node, engine)

    def _arm(self, node: VirtualNode, due_at: int | None) -> None:
        """Set the timer of a node's engine."""
        if due_at == node.armed_at:
            return
        if node.armed is not None:
            self._agenda.cancel(node.armed)
        node.armed_at, node.armed = due_at, None
        if due_at is not None:
            at = max(node.clock.instant(due_at), self._agenda.now)
            node.armed = self._agenda.push(at, self._expire, node)

    def _expire(self, node: VirtualNode) -> None:
        node.armed = node.armed_at = None
        node.running.handle_timeout(node.clock.local(self._agenda.now))
        self._service(node)

    def _commit(self, node: VirtualNode, engine: Engine) -> None:
        """Begin to commit the waiting writes; later ones wait for the next commit."""
        journal = node.journal
        if not journal.begin():
            return
        if journal.commit_ns or journal.fails_until(self.now) is not None:
            self._agenda.push(self.now + journal.commit_ns, self._committed, node, engine)
            return
        self._finish(node, engine)

    def _finish(self, node: VirtualNode, engine: Engine) -> None:
        """Complete the commit under way."""
        self._point(node.address, "commit", None)
        if node.engine is not engine:
            return
        group = node.journal.finish()
        self._point(node.address, "committed", None)
        for write in group if node.engine is engine else ():
            engine.handle_journal_committed(write.write_id, node.clock.local(self.now))

    def _committed(self, node: VirtualNode, engine: Engine) -> None:
        if node.engine is not engine:
            return
        journal, now = node.journal, node.clock.local(self.now)
        if (again_at := journal.fails_until(self.now)) is not None:
            engine.handle_journal_state(FULL, now)
            self._agenda.push(again_at, self._committed, node, engine)
        else:
            if engine.journal_failure:
                engine.handle_journal_state("", now)
            self._finish(node, engine)
            if node.engine is engine:
                self._commit(node, engine)
        self._service(node)

    def _note(self, record: TraceRecord) -> None:
        if not self._nodes[record.node].clock.is_true:
            record = msgspec.structs.replace(record, at=self.now)
        if self._hash is not None:
            if record.link != ONE_LINK:
                self._hash.update(record.link.encode())
            self._hash.update(
                f"{record.at} {record.node} {record.what} {record.peer} {record.streams} "
                f"{record.detail} {record.frame}\n".encode()
            )
        if self._trace is not None:
            self._trace(record)
