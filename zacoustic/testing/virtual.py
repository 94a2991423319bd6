"""`VirtualNetwork`: many real engines on the simulated channel, in virtual time.

The engines are the ones that run at sea, byte for byte; only the clock is another. One heap holds
everything that is to come, the instants of all nodes are those of the heap, and time jumps from one
entry to the next. There is no thread, no loop and no sleep, so a day takes seconds, and one seed
gives one trace: `digest` tells two runs apart in 32 bytes.

::

    network = VirtualNetwork(scenario, table)
    network.at(10.0, lambda: network.publish(2, 10, {"depth": 4.2}))
    network.run(until_s=3600)
    network.samples(1)

The modem of a node is what the scenario's profile says. `Modem` takes from it what the tests want
to be without: addresses, the check, frames.
"""

import hashlib
import heapq
import itertools
import random
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

import msgspec

from zacoustic.channel.faults import corrupt
from zacoustic.channel.medium import Arrival, Medium
from zacoustic.channel.profiles import ModemProfile
from zacoustic.channel.scenario import Scenario
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine import Engine
from zacoustic.core.events import Event, SampleReceived
from zacoustic.core.keys import Instance
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkCapabilities,
    LinkMetrics,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.streams import StreamTable
from zacoustic.core.trace import TraceRecord

T = TypeVar("T")

Deliver = Callable[[int, Event], None]
"""``(address, event)``: takes the events of all engines as they happen."""

Disturb = Callable[[int, int, int], Sequence[float]]
"""``(source, node, now)``: what becomes of a frame that arrives: it is handed over after each of
these times, s; ``(0.0,)`` is as it should be, ``()`` a loss, more than one a repetition."""


class Modem(msgspec.Struct, frozen=True, kw_only=True):
    """What the modems of a network do by themselves."""

    addressed: bool = True
    """Frames carry their addresses."""
    checked: bool = True
    """Damaged frames do not arrive."""
    framed: bool = True
    """Frames arrive as frames; otherwise as a byte stream."""
    senses_carrier: bool = True
    """The beginning and the end of a reception are told."""
    mtu_bytes: int | None = None
    """Largest frame, bytes; None: that of the profile."""


class VirtualNetwork:
    """Engines, a medium and a heap.

    Args:
        scenario: The water and who is in it.
        table: The stream table of all nodes, or one for each address.
        modem: What the modems do by themselves.
        seed: Replaces the seed of the scenario.
        deliver: Takes each event; without it they are kept in `events`.
        trace: Takes each trace record; the digest is made in any case.
        disturb: Loses, delays and repeats frames beyond what the scenario says.

    Raises:
        ValueError: A table for a node that the scenario does not have.
    """

    def __init__(
        self,
        scenario: Scenario,
        table: StreamTable | Mapping[int, StreamTable],
        *,
        modem: Modem | None = None,
        seed: int | None = None,
        deliver: Deliver | None = None,
        trace: Callable[[TraceRecord], None] | None = None,
        disturb: Disturb | None = None,
    ) -> None:
        if seed is not None:
            scenario = msgspec.structs.replace(scenario, seed=seed)
        self.scenario = scenario
        self.now = 0
        self.events: list[tuple[int, Event]] = []
        """``(address, event)`` in the order in which they happened, without `deliver`."""
        self.losses: dict[str, int] = {}
        """What became of the frames that did not arrive, by outcome."""
        self._medium = Medium(scenario)
        self._modem = modem or Modem()
        self._deliver = deliver or (lambda address, event: self.events.append((address, event)))
        self._trace = trace
        self._disturb = disturb
        self._hash = hashlib.sha256()
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._order = itertools.count()
        addresses = self._medium.addresses
        tables = table if isinstance(table, Mapping) else dict.fromkeys(addresses, table)
        if set(tables) - set(addresses):
            raise ValueError(f"tables for {sorted(tables)}; nodes: {list(addresses)}")
        self._nodes: dict[int, _Node] = {}
        for address in sorted(tables):
            self._start(address, tables[address], epoch=1)

    # Time

    def at(self, instant_s: float, action: Callable[[], object]) -> None:
        """Do something at an instant, s since the beginning; at once if that is over."""
        self._push(max(self.now, seconds_to_ns(instant_s)), lambda: _discard(action()))

    def every(self, period_s: float, action: Callable[[], object], *, first_s: float = 0.0) -> None:
        """Do something again and again; keeps the heap from running dry, so `run` needs an end."""
        period_ns = seconds_to_ns(period_s)
        if period_ns <= 0:
            raise ValueError(f"period_s is {period_s}; allowed: above 0")

        def act() -> None:
            action()
            self._push(self.now + period_ns, act)

        self._push(max(self.now, seconds_to_ns(first_s)), act)

    def run(self, *, until_s: float | None = None) -> None:
        """Let happen what is to happen, up to an instant, or until nothing is left."""
        until = None if until_s is None else seconds_to_ns(until_s)
        while self._heap and (until is None or self._heap[0][0] <= until):
            self.now, _, action = heapq.heappop(self._heap)
            action()
        if until is not None:
            self.now = max(self.now, until)

    @property
    def is_quiet(self) -> bool:
        """Nothing is to happen any more: no sound in the water, no timer armed."""
        return not self._heap

    # Nodes

    @property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of all engines, in order."""
        return tuple(self._nodes)

    def engine(self, address: int) -> Engine:
        """Return the engine of a node, for its getters; commands go by `apply`."""
        return self._nodes[address].engine

    def apply(self, address: int, command: Callable[[Engine, int], T]) -> T:
        """Give a command to an engine and let it act."""
        node = self._nodes[address]
        result = command(node.engine, self.now)
        self._service(node)
        return result

    def publish(
        self, address: int, stream_id: int, value: object, *, instance: Instance = ()
    ) -> None:
        """Publish a sample from a node; raises what `Engine.publish` raises."""
        self.apply(
            address, lambda engine, now: engine.publish(stream_id, value, now, instance=instance)
        )

    def samples(self, address: int, stream_id: int | None = None) -> list[SampleReceived]:
        """Return the samples in `events` that a node received, of one stream or of all."""
        return [
            event
            for at, event in self.events
            if at == address
            and isinstance(event, SampleReceived)
            and stream_id in (None, event.stream_id)
        ]

    def restart(self, address: int, table: StreamTable | None = None) -> None:
        """Kill a node and start it again with nothing but its next boot epoch, or a new table."""
        old = self._nodes[address]
        epoch = (old.engine.epoch + 1) & 0xFFFF
        self._start(address, table or old.engine.table, epoch=epoch, before=old)

    def set_link(self, address: int, *, up: bool) -> None:
        """Unplug or plug in the modem of a node."""
        node = self._nodes[address]
        node.is_up = up
        if up:
            self._connect(node)
        else:
            node.engine.handle_link_state(LinkState.DOWN, self.now)
            self._service(node)

    # Results

    @property
    def digest(self) -> str:
        """Hexadecimal SHA-256 of the trace so far."""
        return self._hash.hexdigest()

    # Below the methods above

    def _start(
        self, address: int, table: StreamTable, epoch: int, *, before: "_Node | None" = None
    ) -> None:
        engine = Engine(
            address=address,
            table=table,
            epoch=epoch,
            rng=random.Random(f"{self.scenario.seed}/{address}/{epoch}"),
            trace=self._note,
        )
        node = self._nodes[address] = _Node(address, engine, self._medium.profile(address))
        if before is not None:
            # The modem knows nothing of the restart: what it has begun, it sends.
            node.is_up = before.is_up
            node.transmits_until = before.transmits_until
        self._connect(node)

    def _connect(self, node: "_Node") -> None:
        """Tell an engine that its modem is there, once that is free."""
        if not self._is_current(node) or not node.is_up:
            return
        if node.transmits_until > self.now:
            self._push(node.transmits_until, lambda: self._connect(node))
            return
        capabilities = self._capabilities(node.profile)
        node.engine.handle_link_state(LinkState.UP, self.now, capabilities)
        self._service(node)

    def _capabilities(self, profile: ModemProfile) -> LinkCapabilities:
        modem = self._modem
        return LinkCapabilities(
            mtu_bytes=modem.mtu_bytes or profile.mtu_bytes,
            bit_rate_bps=profile.bit_rate_bps,
            preamble_s=profile.preamble_s,
            gap_s=profile.gap_s,
            propagation_s=self._farthest_s(),
            half_duplex=profile.half_duplex,
            addressed=modem.addressed,
            checked=modem.checked,
            framed=modem.framed,
            senses_carrier=modem.senses_carrier and not profile.separates_senders,
        )

    def _farthest_s(self) -> float:
        """Longest propagation delay between any two nodes now, s."""
        return max(
            (
                self._medium.path(source, node, self.now).propagation_s
                for source, node in itertools.permutations(self._medium.addresses, 2)
            ),
            default=0.0,
        )

    def _push(self, at: int, action: Callable[[], None]) -> None:
        heapq.heappush(self._heap, (at, next(self._order), action))

    def _service(self, node: "_Node") -> None:
        """Poll an engine until it is dry, and arm its timer: the contract of `engine`."""
        engine, now = node.engine, self.now
        while (write := engine.poll_journal()) is not None:
            engine.handle_journal_committed(write.write_id, now)
        while (transmission := engine.poll_transmit(now)) is not None:
            self._transmit(node, engine, transmission)
        while (event := engine.poll_event()) is not None:
            self._deliver(node.address, event)
        due_at = engine.poll_timeout()
        if due_at is not None and due_at != node.armed_at:
            node.armed_at = due_at
            self._push(max(due_at, now), lambda: self._expire(node, engine, due_at))
        elif due_at is None:
            node.armed_at = None

    def _expire(self, node: "_Node", engine: Engine, due_at: int) -> None:
        if node.engine is engine and node.armed_at == due_at and self._is_current(node):
            node.armed_at = None
            engine.handle_timeout(self.now)
            self._service(node)

    def _is_current(self, node: "_Node") -> bool:
        return self._nodes[node.address] is node

    def _transmit(self, node: "_Node", engine: Engine, transmission: Transmission) -> None:
        started_at = self.now
        if not node.is_up:
            outcome, ends_at = TransmitOutcome.ABORTED, started_at
        else:
            size_bytes = len(transmission.frame_bytes)
            emission = self._medium.transmit(node.address, size_bytes, started_at)
            outcome, ends_at = TransmitOutcome.SENT, emission.ends_at
            node.transmits_until = ends_at
            for arrival in emission.arrivals:
                self._schedule(arrival, transmission)
        report = TransmitReport(
            transmission_id=transmission.transmission_id,
            outcome=outcome,
            started_at=started_at,
            finished_at=ends_at,
        )
        self._push(ends_at, lambda: self._report(node, engine, report))

    def _report(self, node: "_Node", engine: Engine, report: TransmitReport) -> None:
        if self._is_current(node):
            engine.handle_transmit_report(report, self.now)
            self._service(node)

    def _schedule(self, arrival: Arrival, transmission: Transmission) -> None:
        profile = self._medium.profile(arrival.node)
        noticed = arrival.snr_db >= profile.detection_snr_db and not profile.separates_senders
        heard = noticed and self._modem.senses_carrier
        if heard:
            self._push(arrival.starts_at, lambda: self._carrier(arrival.node, 1))
        self._push(arrival.ends_at, lambda: self._arrive(arrival, transmission, heard))

    def _carrier(self, address: int, change: int) -> None:
        """A carrier began (+1) or ended (-1) at a node."""
        node = self._nodes.get(address)
        if node is None:
            return
        was_busy = node.carriers > 0
        node.carriers = max(0, node.carriers + change)
        if was_busy != (node.carriers > 0):
            node.engine.handle_carrier(node.carriers > 0, self.now)
            self._service(node)

    def _arrive(self, arrival: Arrival, transmission: Transmission, heard: bool) -> None:
        reception = self._medium.finish(arrival)
        if reception.is_received:
            frame_bytes = transmission.frame_bytes
            if reception.corrupt_seed is not None:
                if not self._modem.checked:
                    frame_bytes = corrupt(frame_bytes, random.Random(reception.corrupt_seed))
                    self._receive(arrival, transmission, frame_bytes)
            else:
                delays_s: Sequence[float] = (0.0,)
                if self._disturb is not None:
                    delays_s = self._disturb(arrival.source, arrival.node, self.now)
                for after_s in (*delays_s, *reception.duplicates_after_s):
                    self._hand_over(after_s, arrival, transmission, frame_bytes)
        else:
            outcome = reception.outcome.value
            self.losses[outcome] = self.losses.get(outcome, 0) + 1
        if heard:
            self._carrier(arrival.node, -1)

    def _hand_over(
        self, after_s: float, arrival: Arrival, transmission: Transmission, frame_bytes: bytes
    ) -> None:
        if after_s > 0:
            at = self.now + seconds_to_ns(after_s)
            self._push(at, lambda: self._receive(arrival, transmission, frame_bytes))
        else:
            self._receive(arrival, transmission, frame_bytes)

    def _receive(self, arrival: Arrival, transmission: Transmission, frame_bytes: bytes) -> None:
        node = self._nodes.get(arrival.node)
        if node is None or not node.is_up:
            return
        addressed = self._modem.addressed
        if addressed and transmission.destination not in (arrival.node, BROADCAST):
            return
        node.engine.handle_frame(
            ReceivedFrame(
                frame_bytes=frame_bytes,
                received_at=self.now,
                source=arrival.source if addressed else 0,
                destination=transmission.destination if addressed else BROADCAST,
                metrics=LinkMetrics(snr_db=arrival.snr_db, propagation_s=arrival.propagation_s),
            ),
            self.now,
        )
        self._service(node)

    def _note(self, record: TraceRecord) -> None:
        self._hash.update(
            f"{record.at} {record.node} {record.what} {record.peer} {record.streams} "
            f"{record.detail} {record.frame}\n".encode()
        )
        if self._trace is not None:
            self._trace(record)


class _Node:
    """One engine and the state of its modem."""

    def __init__(self, address: int, engine: Engine, profile: ModemProfile) -> None:
        self.address = address
        self.engine = engine
        self.profile = profile
        self.is_up = True
        self.transmits_until = 0
        self.carriers = 0
        self.armed_at: int | None = None


def _discard(_: object) -> None:
    """Throw a result away."""
