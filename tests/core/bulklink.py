"""Nodes whose modems have a bulk service, in virtual time, with losses that a test decides.

A model of a device with a connection, of no vendor: frames of the bulk service wait in a buffer
and go in trains, which the other modem acknowledges. A train that is lost is sent again; after
four times the connection has failed, with all that waits. A modem that transmits hears nothing.
Where the service `rides_back`, a frame that is given as soon as a train has come goes with its
acknowledgement.
"""

import heapq
import itertools
import random
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from types import MappingProxyType

from zacoustic.core.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event
from zacoustic.core.engine.makeengine import MakeEngine
from zacoustic.core.linktypes import (
    BROADCAST,
    BulkService,
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Service,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable

WAY_S = 0.5
TRAIN_FRAMES = 3
ATTEMPTS = 4
CAPABILITIES = LinkCapabilities(
    mtu_bytes=64,
    bit_rate_bps=800.0,
    preamble_s=0.15,
    gap_s=0.09,
    propagation_s=WAY_S,
    bulk=BulkService(mtu_bytes=1024, bit_rate_bps=8000.0, preamble_s=0.1, most_outstanding=16),
)


class BulkNode:
    """One engine and its modem."""

    def __init__(self, sea: "BulkSea", address: int, epoch: int, entries: dict[str, bytes]) -> None:
        self.sea = sea
        self.address = address
        self.epoch = epoch
        self.entries = entries
        self.events: list[Event] = []
        self.sounds_until = 0
        self.buffer: list[Transmission] = []
        self.has_train = False
        self.is_alive = True
        self.most_outstanding = 0
        self.outstanding: set[int] = set()
        self.acknowledges = (0, 0)
        """To whom its modem sends the acknowledgement of a train, and when, ns."""
        self.engine = sea.build(
            address=address,
            table=sea.table,
            epoch=epoch,
            rng=random.Random(f"{sea.seed}/{address}/{epoch}"),
            stored=dict(entries),
            rules=sea.rules.get(address, TransmitRules()),
            trace=None,
        )
        self.engine.handle_link_state(LinkState.UP, sea.now, sea.capabilities)

    def serve(self) -> None:
        """Poll the engine until it is dry."""
        now, engine = self.sea.now, self.engine
        while True:
            write = engine.poll_journal()
            if write is not None:
                if write.value is None:
                    self.entries.pop(write.key, None)
                else:
                    self.entries[write.key] = write.value
                engine.handle_journal_committed(write.write_id, now)
                continue
            made = engine.poll_transmit(now)
            if made is not None:
                self.sea.given.append((now, self.address, made))
                if made.service is Service.BULK:
                    assert len(made.frame_bytes) <= 1024
                    assert made.destination != BROADCAST
                    self.outstanding.add(made.transmission_id)
                    self.most_outstanding = max(self.most_outstanding, len(self.outstanding))
                    self.buffer.append(made)
                    self.sea.start_train(self)
                else:
                    assert len(made.frame_bytes) <= 64
                    self.sea.send_plain(self, made)
                continue
            event = engine.poll_event()
            if event is None:
                return
            self.events.append(event)


class BulkSea:
    """The nodes, the water and the time.

    Args:
        table: Of all nodes.
        addresses: The nodes.
        loss: Share of the frames and trains that are lost.
        seed: Of all randomness.
        broken: Whether no train ever gets through.
        capabilities: Of all links.
        build: Makes the engines.
        rules: Of nodes that do not transmit freely.
    """

    def __init__(
        self,
        table: StreamTable,
        addresses: tuple[int, ...] = (1, 2),
        *,
        loss: float = 0.0,
        seed: int = 1,
        broken: bool = False,
        capabilities: LinkCapabilities = CAPABILITIES,
        build: MakeEngine = Engine,
        rules: Mapping[int, TransmitRules] = MappingProxyType({}),
    ) -> None:
        self.build = build
        self.rules = rules
        self.now = 0
        self.table = table
        self.seed = seed
        self.loss = loss
        self.broken = broken
        self.capabilities = capabilities
        self.given: list[tuple[int, int, Transmission]] = []
        self.trains: Counter[int] = Counter()
        self._rng = random.Random(f"sea/{seed}")
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._count = itertools.count()
        self.nodes: dict[int, BulkNode] = {}
        for address in addresses:
            self.nodes[address] = BulkNode(self, address, 1, {})
            self.nodes[address].serve()

    def at(self, delay_s: float, act: Callable[[], None]) -> None:
        at = self.now + seconds_to_ns(delay_s)
        heapq.heappush(self._heap, (at, next(self._count), act))

    def restart(self, address: int) -> None:
        """Kill a node and start it again with its journal; its modem forgets what waits."""
        old = self.nodes[address]
        old.is_alive = False
        self.nodes[address] = BulkNode(self, address, old.epoch + 1, old.entries)
        self.nodes[address].serve()

    def run(self, until: Callable[[], bool], limit_s: float = 3600.0) -> float:
        """Let time pass until a condition holds; return how long that was, s."""
        begun_at, limit_at = self.now, self.now + seconds_to_ns(limit_s)
        while not until():
            due = {each: each.engine.poll_timeout() for each in self.nodes.values()}
            instants = [at for at in due.values() if at is not None]
            instants += [self._heap[0][0]] if self._heap else []
            assert instants, "nothing is to happen any more"
            self.now = max(self.now, min(instants))
            assert self.now <= limit_at, f"not within {limit_s} s"
            if self._heap and self._heap[0][0] <= self.now:
                heapq.heappop(self._heap)[2]()
            for node, at in due.items():
                if at is not None and at <= self.now and node.is_alive:
                    node.engine.handle_timeout(self.now)
            for node in list(self.nodes.values()):
                node.serve()
        return ns_to_seconds(self.now - begun_at)

    # The water

    def send_plain(self, node: BulkNode, made: Transmission) -> None:
        """Send a frame of the plain service, after a train under way."""
        bulk, (source, at) = self.capabilities.bulk, node.acknowledges
        if bulk and bulk.rides_back and made.destination == source and self.now < at:
            wait_s = ns_to_seconds(at - self.now)
            self.at(wait_s, lambda: self._report(node, made, TransmitOutcome.SENT, at))
            self.at(wait_s + WAY_S, partial(self._arrive, node.address, source, made))
            return
        begin_at = max(self.now, node.sounds_until)
        sound_ns = self.capabilities.airtime_ns(len(made.frame_bytes))
        node.sounds_until = begin_at + sound_ns
        wait_s = ns_to_seconds(node.sounds_until - self.now)
        self.at(wait_s, lambda: self._report(node, made, TransmitOutcome.SENT, begin_at))
        for other in list(self.nodes):
            if other != node.address and made.destination in (other, BROADCAST):
                self.at(wait_s + WAY_S, partial(self._arrive, node.address, other, made))

    def _arrive(self, source: int, address: int, made: Transmission) -> None:
        node = self.nodes[address]
        if self._rng.random() < self.loss or node.sounds_until > self.now:
            return  # lost, or the modem transmits itself
        self._hand_over(source, node, made)

    def _hand_over(self, source: int, node: BulkNode, made: Transmission) -> None:
        node.engine.handle_frame(
            ReceivedFrame(
                frame_bytes=made.frame_bytes,
                received_at=self.now,
                source=source,
                destination=made.destination,
                service=made.service,
            ),
            self.now,
        )

    def start_train(self, node: BulkNode) -> None:
        """Send the next train, unless one is under way."""
        if node.has_train or not node.buffer:
            return
        node.has_train = True
        self.at(0.0, lambda: self._send_train(node, node.buffer[:TRAIN_FRAMES], ATTEMPTS))

    def _send_train(self, node: BulkNode, train: list[Transmission], attempts: int) -> None:
        bulk = self.capabilities.bulk
        assert bulk is not None
        begin_at = max(self.now, node.sounds_until)
        sound_ns = sum(bulk.airtime_ns(len(made.frame_bytes)) for made in train)
        node.sounds_until = begin_at + sound_ns
        self.trains[node.address] += 1
        wait_s = ns_to_seconds(node.sounds_until - self.now)
        is_lost = self.broken or self._rng.random() < self.loss
        if not is_lost:
            self.at(wait_s + WAY_S, lambda: self._take_train(node, train))
        ended = self._train_lost if is_lost else self._train_acknowledged
        self.at(wait_s + 2 * WAY_S + 0.2, lambda: ended(node, train, attempts, begin_at))

    def _take_train(self, node: BulkNode, train: list[Transmission]) -> None:
        for made in train:
            receiver = self.nodes[made.destination]
            receiver.acknowledges = node.address, self.now + seconds_to_ns(0.1)
            self._hand_over(node.address, receiver, made)

    def _train_acknowledged(
        self, node: BulkNode, train: list[Transmission], attempts: int, begin_at: int
    ) -> None:
        node.has_train = False
        del node.buffer[: len(train)]
        for made in train:
            self._report(node, made, TransmitOutcome.DELIVERED, begin_at)
        self.start_train(node)

    def _train_lost(
        self, node: BulkNode, train: list[Transmission], attempts: int, begin_at: int
    ) -> None:
        if attempts > 1:
            self._send_train(node, train, attempts - 1)
            return
        node.has_train = False
        failed, node.buffer = node.buffer, []
        for made in failed:
            self._report(node, made, TransmitOutcome.NOT_DELIVERED, begin_at)
        self.start_train(node)

    def _report(
        self, node: BulkNode, made: Transmission, outcome: TransmitOutcome, begin_at: int
    ) -> None:
        if not node.is_alive:
            return
        node.outstanding.discard(made.transmission_id)
        node.engine.handle_transmit_report(
            TransmitReport(
                transmission_id=made.transmission_id,
                outcome=outcome,
                started_at=min(begin_at, self.now),
                finished_at=self.now,
            ),
            self.now,
        )
