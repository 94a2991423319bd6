"""Nodes with objects on half-duplex water in virtual time: no engine, objects and airtimes only."""

import heapq
import itertools
import random
from collections.abc import Callable
from functools import partial

import msgspec

from zacoustic.core.base.generators import Generators
from zacoustic.core.base.journal import JournalPort, JournalWrite
from zacoustic.core.base.moments import Moments
from zacoustic.core.base.parts import Part
from zacoustic.core.base.timers import Timers
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkCapabilities,
    ReceivedFrame,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.peers.peers import Peers
from zacoustic.core.schedule.access.listening import Listening
from zacoustic.core.schedule.pacers import Pacers
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.transport.objects.admission import Admission, ObjectReceived
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.core.transport.objects.manifest import Manifest
from zacoustic.core.transport.objects.objects import Objects
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.core.transport.objects.sending.bulkpaths import BulkChanged
from zacoustic.core.transport.objects.sending.sending import Sending
from zacoustic.core.transport.reliable.receiving.receiving import Claim
from zacoustic.core.wire.objects import (
    FRAGMENT_CODE,
    Fragment,
    ListenHint,
    decode_feedback,
    decode_fragment,
)

S2C = LinkCapabilities(
    mtu_bytes=64,
    bit_rate_bps=8 / 0.011094,
    preamble_s=0.1503,
    gap_s=0.0904,
    propagation_s=1.0,
)
STREAM = 12


class Node:
    """Objects, a journal, and a half-duplex modem."""

    def __init__(
        self, medium: "Medium", address: int, epoch: int, stored: dict[str, bytes]
    ) -> None:
        self.address = address
        self.epoch = epoch
        self.entries = stored
        self.medium = medium
        self.admission = Admission()
        self.behind: set[int] = set()
        self.awaited: set[int] = set()
        self.turns: list[int] = []
        self.unwanted_of: list[tuple[int, int]] = []
        self.told: list[tuple[int, int]] = []
        self.delivered: list[ObjectReceived] = []
        self.progress: list[ObjectProgress] = []
        self.transmits: tuple[int, int] = (-1, -1)
        self.hears: list[tuple[int, int]] = []
        self.free_at = 0
        self.alive = True
        self.armed: int | None = None
        self.journal = JournalPort()
        pacers = Pacers(Peers())
        self.pacers = pacers
        self.timers = Timers()
        self.listening = Listening(medium.capabilities)
        self.objects = Objects(
            epoch=epoch,
            limits=medium.limits,
            pacers=pacers,
            timers=self.timers,
            generators=Generators.drawn_from(random.Random(f"{medium.seed}/{address}/{epoch}")),
            admission=self,
            owner=self,
            emit=self.tell,
            journal=self.journal,
            moments=Moments(stored),
        )
        self.listening.transfers = _Exclusive(self.objects)
        self.objects.restore(stored, lambda order: "", lambda order, why, now: None)
        self.use_link(medium.capabilities)

    def tell(self, event: ObjectProgress | BulkChanged) -> None:
        assert isinstance(event, ObjectProgress)  # this medium has no bulk service
        self.progress.append(event)

    def use_link(self, capabilities: LinkCapabilities) -> None:
        self.pacers.times = LinkTimes(capabilities)
        self.objects.use_link(
            capabilities, capabilities.mtu_bytes, self.listening.pause_ns, self.medium.now
        )

    # Gate and owner: nothing is in the way, unless a test says so

    def admit(self, source: int, stream_id: int) -> Admission:
        others = sorted(set(self.medium.nodes) - {source})
        admission = self.admission if stream_id else Admission()
        return msgspec.structs.replace(
            admission, rank=others.index(self.address), others=len(others) - 1
        )

    def is_over(self, source: int, manifest: Manifest) -> bool:
        return False

    def claim(self, source: int, manifest: Manifest, *, is_turn: bool) -> Claim:
        if is_turn:
            self.turns.append(manifest.number)
        return Claim.NOW if is_turn or manifest.number not in self.behind else Claim.LATER

    def unwanted(self, source: int, stream_id: int, *, is_alone: bool) -> None:
        self.unwanted_of.append((source, stream_id))

    def expect(self, source: int, manifest: Manifest) -> None:
        """No count of a key awaits it."""

    def deliver(self, arrived: ObjectReceived) -> None:
        self.delivered.append(arrived)

    def is_turn(self, object_id: int, address: int) -> bool:
        return object_id not in self.awaited

    def passed(self, object_id: int, address: int, now: int) -> None:
        self.told.append((object_id, address))

    def refused(self, object_id: int, address: int, reason: int, now: int) -> None:
        pass

    def stored(self, sending: Sending, now: int) -> None:
        pass

    def commit(self, writes: list[JournalWrite]) -> None:
        """Make safe what was written."""
        for write in writes:
            if write.value is None:
                self.entries.pop(write.key, None)
            else:
                self.entries[write.key] = write.value
        for write in writes:
            self.journal.committed(write.write_id, self.medium.now)

    def writes(self) -> list[JournalWrite]:
        """Take what is to be written."""
        return list(iter(self.journal.poll, None))


class _Exclusive:
    """Objects of a node; only exclusive ones change its pauses."""

    def __init__(self, objects: Objects) -> None:
        self._objects = objects

    @property
    def is_exclusive(self) -> bool:
        return self._objects.is_exclusive

    def has_fragment(self, now: int) -> bool:
        return False


class Medium:
    """A heap, and nodes that all hear each other after the same delay."""

    def __init__(
        self,
        seed: int,
        *,
        nodes: int = 2,
        loss: float = 0.0,
        delay_s: float = 1.0,
        capabilities: LinkCapabilities = S2C,
        limits: ObjectLimits | None = None,
        commit_s: float = 0.0,
        alter: Callable[[bytes, random.Random], bytes] | None = None,
        repeat: float = 0.0,
    ) -> None:
        self.seed = seed
        self.now = 0
        self.loss = loss
        self.delay_ns = seconds_to_ns(delay_s)
        self.capabilities = capabilities
        self.limits = limits or ObjectLimits()
        self.rng = random.Random(seed)
        self.frames: dict[int, int] = {}
        self.record: list[tuple[int, int, int, bytes]] = []
        self.commit_ns = seconds_to_ns(commit_s)
        self.alter = alter
        self.repeat = repeat
        self._ids = 0
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._order = itertools.count()
        self.nodes: dict[int, Node] = {}
        for address in range(1, nodes + 1):
            self.nodes[address] = Node(self, address, 1, {})

    def at(self, at: int, action: Callable[[], None]) -> None:
        heapq.heappush(self._heap, (at, next(self._order), action))

    def publish(self, payload: bytes, *, exclusive: bool = False, source: int = 1) -> int:
        node = self.nodes[source]
        receivers = tuple(sorted(set(self.nodes) - {source}))
        node.objects.check_size("photo", len(payload))
        self._ids += 1
        node.objects.publish(
            self._ids,
            STREAM,
            payload,
            self.now,
            instance=(),
            encoding=None,
            lineage=node.epoch,
            number=self._ids,
            receivers=receivers,
            exclusive=exclusive,
        )
        self.service(node)
        return self._ids

    def kill(self, address: int) -> None:
        self.nodes[address].alive = False

    def start(self, address: int) -> None:
        """Start a killed node with what its journal has."""
        old = self.nodes[address]
        node = self.nodes[address] = Node(self, address, old.epoch + 1, old.entries)
        node.delivered = old.delivered
        node.progress = old.progress
        node.objects._incoming._emit = node.objects._outgoing._emit = node.tell
        node.free_at = max(old.free_at, self.now)
        node.transmits = old.transmits
        self.service(node)

    def run(self, *, until: Callable[[], bool], limit_s: float = 1e6) -> bool:
        while self._heap and not until():
            if self._heap[0][0] > seconds_to_ns(limit_s):
                self.now = max(self.now, seconds_to_ns(limit_s))
                break
            self.now, _, action = heapq.heappop(self._heap)
            action()
        return until()

    def run_to(self, instant: int) -> None:
        self.run(until=lambda: False, limit_s=instant / NS_PER_S)
        self.now = max(self.now, instant)

    def is_idle(self) -> bool:
        return all(node.objects.is_idle for node in self.nodes.values())

    def service(self, node: Node) -> None:
        if not node.alive:
            return
        now = self.now
        while writes := node.writes():
            if self.commit_ns:
                self.at(now + self.commit_ns, partial(self._commit, node, writes))
            else:
                node.commit(writes)
        node.timers.fire(now)
        due_at = node.objects.due_at(now)
        deadline_at = node.timers.next_at()
        if due_at is not None:
            due_at = max(due_at, now, node.free_at)
            due_at = node.listening.pauses_until(due_at, now, is_urgent=False)
            due_at = node.listening.invited_at(due_at) or due_at
            if due_at <= now:
                self._transmit(node)
                return
        wake = min((at for at in (due_at, deadline_at) if at is not None), default=None)
        if wake is not None and wake != node.armed:
            node.armed = wake
            self.at(wake, lambda: self._wake(node, wake))

    def _commit(self, node: Node, writes: list[JournalWrite]) -> None:
        if node.alive:
            node.commit(writes)
            self.service(node)

    def _wake(self, node: Node, at: int) -> None:
        if node.armed == at:
            node.armed = None
            self.service(node)

    def _transmit(self, node: Node) -> None:
        offer = node.objects.offer(self.now)
        if offer is None:
            return
        room_bytes = self.capabilities.mtu_bytes
        if offer.is_fragment:
            taken = node.objects.take_fragment(
                room_bytes, self.now, node.listening.frames_before_pause(self.now)
            )
        else:
            taken = node.objects.take_feedback(offer.destination, room_bytes, self.now)
        if taken is None:
            self.service(node)
            return
        record = taken.record
        code = record[0]
        self.frames[code] = self.frames.get(code, 0) + 1
        # The table of the issue reckons with acknowledgements of eight bytes.
        airtime_ns = self.capabilities.airtime_ns(max(8, len(record)))
        started_at, ends_at = self.now, self.now + airtime_ns
        node.transmits = (started_at, ends_at)
        node.listening.handle_started(started_at)
        self.record.append((node.address, started_at, ends_at, record))
        node.free_at = ends_at + seconds_to_ns(self.capabilities.gap_s)
        self.at(ends_at, lambda: self._report(node, started_at, taken.part))
        for address in self.nodes:
            if address != node.address and offer.destination in (address, BROADCAST):
                arrives = (started_at + self.delay_ns, ends_at + self.delay_ns)
                self.at(arrives[0], partial(self._begin, address, arrives))
                arrive = partial(
                    self._arrive, node.address, address, offer.destination, arrives, record
                )
                self.at(arrives[1], arrive)

    def _begin(self, address: int, span: tuple[int, int]) -> None:
        self.nodes[address].hears.append(span)

    def _report(self, node: Node, started_at: int, part: Part) -> None:
        if node.alive:
            node.listening.handle_transmitted(started_at, self.now)
            report = TransmitReport(
                transmission_id=1,
                outcome=TransmitOutcome.SENT,
                started_at=started_at,
                finished_at=self.now,
            )
            part.reported(report, self.now)
            self.service(node)

    def _arrive(
        self, source: int, address: int, destination: int, span: tuple[int, int], record: bytes
    ) -> None:
        node = self.nodes[address]
        others = [each for each in node.hears if each != span]
        node.hears = [each for each in node.hears if each[1] > span[0] - 10 * NS_PER_S]
        collided = any(begin < span[1] and end > span[0] for begin, end in others)
        deaf = node.transmits[0] < span[1] and node.transmits[1] > span[0]
        lost = self.rng.random() < self.loss
        if collided or deaf or lost or not node.alive:
            return
        for _ in range(2 if self.rng.random() < self.repeat else 1):
            bytes_ = self.alter(record, self.rng) if self.alter else record
            self._hand_over(node, source, destination, bytes_)

    def _hand_over(self, node: Node, source: int, destination: int, record: bytes) -> None:
        received = ReceivedFrame(
            frame_bytes=record, received_at=self.now, source=source, destination=destination
        )
        airtime_ns = self.capabilities.airtime_ns(len(record))
        node.listening.heard_frame(source, airtime_ns, self.now)
        if record[:1] == bytes((FRAGMENT_CODE,)):
            fragment = decode_fragment(record)
            if fragment is not None:
                node.objects.fragment(source, fragment, received, self.now)
                self._announce(node, source, fragment)
        else:
            feedback = decode_feedback(record, 0)
            if feedback is not None:
                node.objects.feedback(source, feedback[0], self.now)
        node.pacers.heard(source, self.now)
        self.service(node)

    def _announce(self, node: Node, source: int, fragment: Fragment) -> None:
        """Tell medium access when the source listens, as the engine does."""
        airtime_ns = self.capabilities.airtime_ns(self.capabilities.mtu_bytes)
        started_at = self.now - self.delay_ns - airtime_ns
        if fragment.call is ListenHint.WINDOW:
            node.listening.heard_pause(source, airtime_ns, started_at, self.delay_ns, self.now)
        else:
            listens = fragment.call is not ListenHint.NONE
            node.listening.heard_listening(source, listens=listens, now=self.now)


def confirmation_s(
    seed: int, loss: float, *, exclusive: bool, size_bytes: int = 10240
) -> tuple[float, Medium]:
    """Return when the sender of a 10 KiB object knows that it has arrived, s."""
    medium = Medium(seed, loss=loss)
    payload = random.Random(seed + 1).randbytes(size_bytes)
    medium.publish(payload, exclusive=exclusive)
    assert medium.run(until=lambda: medium.nodes[1].objects.is_idle, limit_s=100_000)
    assert [each.payload for each in medium.nodes[2].delivered] == [payload]
    return medium.now / NS_PER_S, medium
