"""Other nodes' subscriptions at this node: their messages, and the subscribers of each topic."""

from collections.abc import Callable, Mapping, Set
from functools import partial
from typing import Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.signals import Signal
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.context import Context
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.exchanges.repeating import UNPROVED_S
from zacoustic.core.wire.subscriptions import Subscribe, page_of, streams_of

_KEY: Final = "demand"
"""Keys in the journal are ``demand/PEER/PAGE``; the value is epoch (2), version (1), streams (1)
and the digest of the table with which the message was read (4)."""
_KEPT_BYTES: Final = 8
_UNPROVED_NS: Final = seconds_to_ns(UNPROVED_S)
"""How long a subscription holds that anybody may have forged, ns."""


class _Held:
    """The message of one node about one page."""

    __slots__ = ("epoch", "is_journalled", "read_at", "streams", "version")

    def __init__(self, epoch: int, version: int, streams: int, read_at: int | None) -> None:
        self.epoch = epoch
        self.is_journalled = read_at is None
        """Whether the journal has it."""
        self.version = version
        self.streams = streams
        self.read_at = read_at
        """Instant of its first arrival, ns; None: in an earlier boot epoch."""

    def is_same(self, epoch: int, message: Subscribe) -> bool:
        """Return whether this is that message."""
        known = (self.epoch, self.version, self.streams)
        return known == (epoch, message.version, message.streams)


class Subscribers:
    """The subscribers of one node's topics.

    Args:
        context: What the components of its engine share.
        answer: Sends the answer to a message: ``(address, message, now)``.
    """

    def __init__(self, context: Context, answer: Callable[[int, Subscribe, int], None]) -> None:
        self._address = context.address
        self._table = context.table
        self._handshake = context.handshake
        self._versions = context.sizes.versions
        self._journal = context.journal
        self.changed = Signal[Stream, Set[int], int]()
        """``(topic, newcomers, now)``: the subscribers of a topic have changed."""
        self._answer = answer
        self._held: dict[tuple[int, int], _Held] = {}
        self._unproved: dict[tuple[int, int], _Held] = {}
        """Messages from nodes that have not shown that they have heard this one; none is in
        `_held`."""
        self._timers = context.timers
        self._subscribers: dict[int, set[int]] = {}

    def of(self, stream: Stream) -> Set[int]:
        """Return the nodes that have subscribed to an on-demand topic, as a live set."""
        return self._subscribers.setdefault(stream.stream_id, set())

    def receive(self, source: int, message: Subscribe, readable: Set[int], now: int) -> str | None:
        """Take a subscribe message.

        Args:
            source: The node that subscribes.
            message: Its subscriptions.
            readable: The streams that both ends are known to define in the same way.
            now: The instant.

        Returns:
            The reason why it is dropped, or None.
        """
        life = self._handshake.peer(source).epoch
        if life is None:
            return "unconfirmed"
        if not self._table.lists(source):
            return "not_subscriber"
        if not self._is_of_use(source, message.page):
            self._answer(source, message, now)  # keep nothing of it, but let its sender stop
            return None
        held = self._held.get((source, message.page))
        is_known = held is not None and held.is_same(life, message)
        if not is_known and not self._handshake.is_present(message.heard):
            return self._receive_unproved(source, life, message, readable, now)
        self._forget_unproved(source, message.page)
        if held is None or not is_known:
            if held is not None and self._is_older(held, life, message.version, now):
                return "stale_subscribe"
            held = self._held[source, message.page] = _Held(
                life, message.version, message.streams, now
            )
            self._keep(source, held, message)
        elif held.is_journalled:
            self._answer(source, message, now)
        # Also for a known message: its streams may have become readable only now.
        self._settle(source, message, readable, now)
        return None

    def peer_forgotten(self, source: int, now: int) -> None:
        """Forget a node and its subscriptions."""
        for place in [place for place in self._unproved if place[0] == source]:
            self._forget_unproved(*place)
        for place in [place for place in self._held if place[0] == source]:
            del self._held[place]
            self._journal.write(_name(*place), None)
        for stream_id, subscribers in self._subscribers.items():
            if source in subscribers:
                subscribers.discard(source)
                self.changed(self._table.by_id(stream_id), set(), now)

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the messages from earlier boot epochs."""
        for key, kept in stored.items():
            name, _, rest = key.partition("/")
            if name != _KEY or len(kept) != _KEPT_BYTES or kept[4:] != self._table.digest:
                continue
            source, page = map(int, rest.split("/"))
            if not (self._table.lists(source) and self._is_of_use(source, page)):
                self._journal.write(key, None)
                continue
            version, streams = kept[2], kept[3]
            epoch = int.from_bytes(kept[:2], "big")
            self._held[source, page] = _Held(epoch, version, streams, None)
            for stream_id in streams_of(page, streams):
                if self._is_possible(source, stream_id):
                    self.of(self._table.by_id(stream_id))
                    self._subscribers[stream_id].add(source)

    # Below the methods above

    def _keep(self, source: int, held: _Held, message: Subscribe) -> None:
        """Journal a message, then answer it."""

        def kept(at: int) -> None:
            held.is_journalled = True
            if self._held.get((source, message.page)) is held:
                self._answer(source, message, at)

        value = held.epoch.to_bytes(2, "big") + bytes((held.version, held.streams))
        self._journal.write(_name(source, message.page), value + self._table.digest, kept)

    def _receive_unproved(
        self, source: int, life: int, message: Subscribe, readable: Set[int], now: int
    ) -> str | None:
        """Take a message that may be forged: it adds subscriptions for a while and removes none."""
        place = (source, message.page)
        before = self._unproved.get(place)
        if before is not None and self._is_older(before, life, message.version, now):
            return "stale_subscribe"
        self._unproved[place] = _Held(life, message.version, message.streams, now)
        key = (Due.SUBSCRIBER, source, message.page)
        self._timers.at(key, now + _UNPROVED_NS, partial(self._end_unproved, *place))
        self._answer(source, message, now)
        for stream_id in set(streams_of(message.page, message.streams)) & readable:
            self._add(source, stream_id, now)
        return None

    def _forget_unproved(self, source: int, page: int) -> None:
        self._unproved.pop((source, page), None)
        self._timers.cancel((Due.SUBSCRIBER, source, page))

    def _end_unproved(self, source: int, page: int, now: int) -> None:
        """End the subscriptions that an unproved message has added."""
        letter = self._unproved.pop((source, page))
        held = self._held.get((source, page))
        kept = set() if held is None else set(streams_of(page, held.streams))
        for stream_id in set(streams_of(page, letter.streams)) - kept:
            self._remove(source, stream_id, now)

    def _add(self, source: int, stream_id: int, now: int) -> None:
        if self._is_possible(source, stream_id):
            stream = self._table.by_id(stream_id)
            subscribers = self._subscribers.setdefault(stream_id, set())
            if source not in subscribers:
                subscribers.add(source)
                self.changed(stream, {source}, now)

    def _remove(self, source: int, stream_id: int, now: int) -> None:
        subscribers = self._subscribers.get(stream_id, set())
        if source in subscribers:
            subscribers.discard(source)
            self.changed(self._table.by_id(stream_id), set(), now)

    def _is_older(self, held: _Held, life: int, version: int, now: int) -> bool:
        """Return whether a message was sent before the held one."""
        if held.epoch != life or held.read_at is None:
            return False
        if now >= held.read_at + self._handshake.settling_ns:
            return False  # an earlier message would have arrived by now
        return (version - held.version) % self._versions > self._versions // 2

    def _is_of_use(self, source: int, page: int) -> bool:
        """Return whether a node may subscribe here to any stream of a page."""
        return any(
            page_of(stream.stream_id) == page and self._is_possible(source, stream.stream_id)
            for stream in self._table
        )

    def _is_possible(self, source: int, stream_id: int) -> bool:
        stream = self._table.get(stream_id)
        return (
            stream is not None
            and isinstance(stream.spec, TopicSpec)
            and stream.is_on_demand
            and stream.may_publish(self._address)
            and stream.may_subscribe(source)
        )

    def _settle(self, source: int, message: Subscribe, readable: Set[int], now: int) -> None:
        """Set the subscribers to those of a message."""
        wanted = set(streams_of(message.page, message.streams)) & readable
        for stream in self._table:
            stream_id = stream.stream_id
            if page_of(stream_id) != message.page or not self._is_possible(source, stream_id):
                continue
            change = self._add if stream_id in wanted else self._remove
            change(source, stream_id, now)


def _name(source: int, page: int) -> str:
    return f"{_KEY}/{source}/{page}"
