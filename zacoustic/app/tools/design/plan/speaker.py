"""One node of the model: its queue, its frames, and the nodes that know it.

It follows docs/wire.md in sizes: HELLO or TAG by the policy of agreement, LEN before items that are
not delimited, a dense block for dense samples. The node's real medium access decides whether a
frame may start.
"""

import random
from collections.abc import Iterable, Iterator
from typing import Final

import msgspec

from zacoustic.app.tools.design.plan.items import NO_STREAM, NO_VOICE, Item, Lane
from zacoustic.core.base.linktypes import BROADCAST, LinkCapabilities
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.peers.agreementpolicy import POLICIES, Hearers, Opening
from zacoustic.core.peers.handshake import SETTLING_UNITS
from zacoustic.core.peers.owing import PATIENCE_UNITS
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import Wanted
from zacoustic.core.schedule.airtime import AirtimeCaps
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.dense import DenseCodec, DenseSample, Encoded, Listener
from zacoustic.core.values.dense import Speaker as DenseSpeaker
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.wire.agreement import HELLO_BYTES, TAG_BYTES, Confirm
from zacoustic.core.wire.frame import DELIMITER_BYTES

CONFIRM_BYTES: Final = len(Confirm(1, 1).encode())
_DENSE_ACK_BYTES: Final = 3
_WORTH_AN_ACK_BYTES: Final = 6
_MOST_DOUBLINGS: Final = 7
_CAPPED: Final = ("sample", "reliable", "fragment")


class Said(msgspec.Struct, kw_only=True):
    """A frame."""

    destination: int
    """Address, or `BROADCAST`."""
    size_bytes: int
    """Length of the frame."""
    items: list[Item]
    """Its contents."""
    controls: bytes = b""
    """Controls of medium access."""
    hello: bool = False
    """It begins with HELLO."""
    introduced: bool = False
    """It begins with HELLO or TAG."""
    block: bytes = b""
    """A dense block."""
    acknowledged: tuple[tuple[int, int], ...] = ()
    """Marks of dense blocks that it acknowledges, by source."""

    @property
    def opening_bytes(self) -> int:
        """Bytes of HELLO or TAG."""
        return HELLO_BYTES if self.hello else TAG_BYTES * self.introduced


class _Known:
    """What this node knows of a source."""

    def __init__(self) -> None:
        self.settled_at: int | None = None
        self.confirms_at = 0
        self.doublings = 0


class Speaker:
    """A node.

    Args:
        address: Address.
        table: Its streams.
        hearers: Addresses of all others.
        capabilities: Capabilities of its modem.
        rules: The config's rules of transmission.
        rng: Draws pauses.
        stands_for: Number of nodes it represents; it has their airtime caps together.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        hearers: Iterable[int],
        capabilities: LinkCapabilities,
        rules: TransmitRules,
        rng: random.Random,
        stands_for: int = 1,
    ) -> None:
        self.address = address
        self.table = table
        self.port = LinkPort(capabilities, address, rng, rules.access)
        self.capabilities = capabilities
        self.on_air: Said | None = None
        self.armed_at: int | None = None
        self.carriers = 0
        self.dropped = 0
        """Number of items replaced or expired before transmission."""
        self._caps = AirtimeCaps(_cap_of(rules.max_airtime, stands_for))
        for stream in table:
            self._caps.limit(stream.stream_id, _cap_of(stream.qos.max_airtime, stands_for))
        self._hearers = tuple(hearers)
        self._listed = bool(table.nodes)
        self._rng = rng
        self._lanes: dict[tuple[object, ...], Lane] = {}
        self._confirmed: set[int] = set()
        self._policy = POLICIES[rules.agreement]
        self._since_hello = self._hellos = 0
        self._known: dict[int, _Known] = {}
        self._unit_ns = capabilities.airtime_ns(capabilities.mtu_bytes) + int(
            capabilities.propagation_s * 1e9
        )
        self._dense: DenseSpeaker | None = None
        codec = _dense_codec(table, address)
        if codec is not None:
            self._dense = DenseSpeaker(codec)
        self._listeners: dict[int, Listener] = {}
        self._unsaid: dict[int, int] = {}

    # Waiting items

    def push(self, key: tuple[object, ...], item: Item, qos: Qos, depth: int | None = None) -> None:
        """Put an item into a lane."""
        lane = self._lanes.get(key)
        if lane is None:
            lane = self._lanes[key] = Lane(qos, depth)
        self.dropped += lane.push(item)

    def take_back(self, key: tuple[object, ...]) -> None:
        """Empty a lane."""
        lane = self._lanes.get(key)
        if lane is not None:
            lane.items.clear()

    def waits(self, key: tuple[object, ...]) -> bool:
        """Tell whether an item waits in a lane."""
        lane = self._lanes.get(key)
        return lane is not None and bool(lane.items)

    def ready_at(self, now: int) -> int | None:
        """Return when the next frame may go, ns; None: nothing waits, or it depends on events."""
        if self.on_air is not None:
            return None
        due = [lane.due_at for lane in self._busy(now)]
        instants = [at for at in due if at is not None]
        urgent = any(lane.is_urgent and lane.items for lane in self._lanes.values())
        found = []
        if instants:
            due_at = min(instants)
            if not urgent:
                due_at = max(due_at, self._caps.free_at(now))
            at = self.port.free_at(Wanted(due_at, urgent), now)
            if at is not None:
                found.append(at)
        speak_at = self.port.speak_at(now)
        if speak_at is not None:
            found.append(speak_at)
        return min(found, default=None)

    # Frames

    def say(self, now: int) -> Said | None:
        """Compose the frame that goes now."""
        lanes = sorted(self._busy(now), key=lambda lane: lane.rank)
        due = [lane for lane in lanes if (at := lane.due_at) is not None and at <= now]
        if due:
            urgent = any(lane.is_urgent for lane in lanes)
            at = self.port.free_at(Wanted(now, urgent), now)
            is_free = urgent or self._caps.free_at(now) <= now
            if at is not None and at <= now and is_free:
                return self._fill(due[0], lanes, now)
        speak_at = self.port.speak_at(now)
        if speak_at is None or speak_at > now:
            return None
        controls = self.port.access.controls(self.capabilities.mtu_bytes, now, alone=True)
        if not controls:
            return None
        return Said(
            destination=self.port.access.answers_to, size_bytes=len(controls), items=[],
            controls=controls,
        )  # fmt: skip

    def _fill(self, first: Lane, lanes: list[Lane], now: int) -> Said:
        destination, voice = first.items[0].destination, first.items[0].voice
        if first.items[0].alone:
            item = first.items.popleft()
            return Said(destination=destination, size_bytes=item.size_bytes, items=[item])
        opening = self._opening(destination)
        introduced = opening is not Opening.BARE
        hello = introduced and opening is not Opening.TAG
        room_bytes = self.port.envelope.room_bytes
        if introduced:
            room_bytes -= HELLO_BYTES if hello else TAG_BYTES
        waiting_bytes = sum(each.size_bytes for lane in lanes for each in lane.items)
        first_bytes = first.items[0].bytes_in(destination)
        controls = self.port.controls(
            room_bytes - first_bytes, waiting_bytes, now, has_object=False
        )
        room_bytes -= len(controls)
        taken: list[Item] = []
        samples: list[DenseSample] = []
        encoded: Encoded | None = None
        for lane in [first, *(each for each in lanes if each is not first)]:
            while lane.items and lane.next_at <= now:
                item = lane.items[0]
                if not _concerns(item, destination) or NO_VOICE != item.voice != voice != NO_VOICE:
                    break
                block, fits = self._fits(item, taken, samples, destination, room_bytes, introduced)
                if not fits:
                    break
                taken.append(lane.items.popleft())
                voice = voice or item.voice
                if item.dense is not None:
                    samples.append(item.dense)
                    encoded = block or encoded
                lane.taken_at = now
                if lane.min_interval_ns:
                    break
        size_bytes, encoded = self._size(taken, samples, destination, room_bytes, introduced)
        if encoded is not None and self._dense is not None:
            self._dense.sent(encoded)
        marks = self._marks(destination, room_bytes - size_bytes)
        used_bytes = self.port.envelope.room_bytes - room_bytes
        return Said(
            destination=destination,
            size_bytes=used_bytes + size_bytes + _DENSE_ACK_BYTES * len(marks)
            + self.capabilities.mtu_bytes - self.port.envelope.room_bytes,
            items=taken, controls=controls, hello=hello, introduced=introduced,
            block=b"" if encoded is None else encoded.frame, acknowledged=marks,
        )  # fmt: skip

    def _fits(
        self, item: Item, taken: list[Item], samples: list[DenseSample], destination: int,
        room_bytes: int, introduced: bool,
    ) -> tuple[Encoded | None, bool]:  # fmt: skip
        dense = samples if item.dense is None else [*samples, item.dense]
        records_bytes = _records_bytes([*taken, item], destination, introduced)
        if records_bytes <= room_bytes:
            return None, True
        if not dense:
            return None, False
        size_bytes, encoded = self._size([*taken, item], dense, destination, room_bytes, introduced)
        return encoded, size_bytes <= room_bytes

    def _size(
        self, items: list[Item], samples: list[DenseSample], destination: int, room_bytes: int,
        introduced: bool,
    ) -> tuple[int, Encoded | None]:  # fmt: skip
        """Return the size of records, or that of a block with the remaining records if less."""
        records_bytes = _records_bytes(items, destination, introduced)
        if not samples or self._dense is None:
            return records_bytes, None
        others = [each for each in items if each.dense is None]
        others_bytes = _records_bytes(others, destination, introduced)
        others_bytes += DELIMITER_BYTES * bool(others and _open_ended(others, introduced))
        receivers = self._receivers(destination, samples)
        encoded = self._dense.encode(samples, max(1, room_bytes - others_bytes), receivers)
        if encoded is None or encoded.taken < len(samples):
            return records_bytes, None
        block_bytes = others_bytes + len(encoded.frame)
        if block_bytes > records_bytes <= room_bytes:
            return records_bytes, None
        return block_bytes, encoded

    def spend(self, said: Said, airtime_ns: int, now: int) -> None:
        """Charge the airtime of a frame to the caps."""
        sizes: dict[int, int] = {}
        for item in said.items:
            sizes[item.stream_id] = sizes.get(item.stream_id, 0) + item.size_bytes
        held = self._caps.spend(sizes, airtime_ns, now)
        for key, lane in self._lanes.items():
            until = held.get(key[1]) if len(key) > 1 and isinstance(key[1], int) else None
            if until is not None and key[0] in _CAPPED:
                lane.held_until = until

    # Introductions

    def heard(self, source: int, said: Said, now: int) -> None:
        """Take the controls of a frame."""
        known = self._known.setdefault(source, _Known())
        settling_ns = SETTLING_UNITS * self._unit_ns
        if said.hello and known.settled_at is None:
            known.settled_at = now + settling_ns
        answers = self._policy.answers(unicast=said.destination != BROADCAST)
        is_due = known.settled_at is not None and now >= known.confirms_at
        if said.introduced and is_due and answers:
            self._confirm(source, known, now)
        if said.block and known.settled_at is not None:
            self._hear_block(source, said.block)
        for of, mark in said.acknowledged:
            if of == self.address and self._dense is not None:
                self._dense.acknowledged(source, mark)

    def _confirm(self, source: int, known: _Known, now: int) -> None:
        """Queue a CONFIRM after a frame of the source, when it is allowed."""
        assert known.settled_at is not None
        pause_ns = self._rng.randrange(self._unit_ns // 2, 2 * self._unit_ns + 1)
        if now < known.settled_at:
            pause_ns += known.settled_at + PATIENCE_UNITS * self._unit_ns - now
        key = ("confirm", source)
        if self.waits(key):
            lane = self._lanes[key]
            lane.items[0].wait_ns = min(
                lane.items[0].wait_ns, now + pause_ns - lane.items[0].queued_at
            )
            return
        item = Item(NO_STREAM, source, CONFIRM_BYTES, now)
        item.is_control = True
        item.wait_ns = pause_ns
        item.heard = self._confirmed_at
        known.doublings = min(known.doublings + 1, _MOST_DOUBLINGS)
        known.confirms_at = now + (1 << known.doublings) * self._unit_ns
        self.push(key, item, Qos(priority=Priority.BACKGROUND))

    def _confirmed_at(self, node: int, now: int) -> None:
        """Do nothing: the walk informs the confirmed node."""

    def confirmed(self, hearer: int) -> None:
        """Note that a hearer knows this node's table."""
        self._confirmed.add(hearer)

    def _opening(self, destination: int) -> Opening:
        to_all = destination == BROADCAST
        opening = self._policy.opening(
            to_all=to_all,
            hearers=Hearers.UNKNOWN if self._is_unknown(destination) else Hearers.AGREED,
            since_hello=self._since_hello,
            hellos=self._hellos,
        )
        if to_all and opening is Opening.HELLO:
            self._since_hello, self._hellos = 1, self._hellos + 1
        else:
            self._since_hello += to_all
        return opening

    def _is_unknown(self, destination: int) -> bool:
        if destination != BROADCAST:
            return destination not in self._confirmed
        return not self._listed or any(each not in self._confirmed for each in self._hearers)

    # Dense blocks

    def _receivers(self, destination: int, samples: list[DenseSample]) -> tuple[int, ...]:
        if destination != BROADCAST:
            return (destination,)
        streams = [self.table.by_id(each.stream_id) for each in samples]
        listed = [
            each.spec.subscribers is not None
            for each in streams
            if isinstance(each.spec, TopicSpec)
        ]
        if not self._listed and not all(listed):
            return ()
        return tuple(
            node for node in self._hearers if any(each.may_subscribe(node) for each in streams)
        )

    def _hear_block(self, source: int, block: bytes) -> None:
        listener = self._listeners.get(source)
        if listener is None:
            codec = _dense_codec(self.table, source)
            if codec is None:
                return
            listener = self._listeners[source] = Listener(codec)
        try:
            listener.decode(block)
        except PayloadError:
            return  # it refers to a lost block
        self._unsaid[source] = self._unsaid.get(source, 0) + len(block)

    def _marks(self, destination: int, room_bytes: int) -> tuple[tuple[int, int], ...]:
        marks: list[tuple[int, int]] = []
        for source, unsaid_bytes in self._unsaid.items():
            mark = self._listeners[source].mark
            concerned = destination in (BROADCAST, source)
            if unsaid_bytes < _WORTH_AN_ACK_BYTES or mark is None or not concerned:
                continue
            if len(marks) * _DENSE_ACK_BYTES + _DENSE_ACK_BYTES <= room_bytes:
                marks.append((source, mark))
        for source, _ in marks:
            self._unsaid[source] = 0
        return tuple(marks)

    # Below the methods above

    def _busy(self, now: int) -> Iterator[Lane]:
        for lane in self._lanes.values():
            if lane.items:
                self.dropped += lane.expire(now)
            if lane.items:
                yield lane


def _cap_of(share: float | None, nodes: int) -> float | None:
    return None if share is None else min(1.0, share * nodes)


def _concerns(item: Item, destination: int) -> bool:
    if item.alone:
        return False
    return item.destination == destination or (destination == BROADCAST and not item.for_one_node)


def _open_ended(items: list[Item], introduced: bool) -> bool:
    return any(each.open_ended or (introduced and not each.is_control) for each in items)


def _records_bytes(items: list[Item], destination: int, introduced: bool) -> int:
    """Return the size of records: LEN before all but one of those that are not delimited."""
    ends = sum(each.open_ended or (introduced and not each.is_control) for each in items)
    sizes_bytes = sum(each.bytes_in(destination) for each in items)
    return sizes_bytes + DELIMITER_BYTES * max(0, ends - 1)


def _dense_codec(table: StreamTable, source: int) -> DenseCodec | None:
    types = {
        stream.stream_id: stream.dense_type
        for stream in table
        if stream.dense_type is not None and stream.may_publish(source)
    }
    return DenseCodec(types, model=table.model, digest=table.digest) if types else None
