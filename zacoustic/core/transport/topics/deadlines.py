"""Deadlines: a topic promises samples of each key at least so often; a miss is reported.

The terms are those of ROS 2 and DDS. The publisher of a topic with `deadline_s` promises a sample
of each key at least every `deadline_s`. An application that depends on it must know when the
promise is broken: at sea, a value that has stopped looks like one that does not change.

Each end watches for itself. The publishing node watches its application's publications and a
receiving node watches its deliveries, so that every delay (loss, silence, a queue) counts. The
first sample of a key in a boot epoch starts the watch, each further one starts a new period, and a
deleted key is no longer awaited. A missed period is reported once, and then the next one begins.
Topics without a deadline need no timer, nor does a key before its first sample.

The deadline also bounds repetitions and requests:
`zacoustic.core.transport.reliable.sending.pacing`.
"""

import enum
from collections.abc import Callable
from functools import partial

import msgspec

from zacoustic.core.base.stats import count
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.context import Context
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.deliveries import SampleReceived
from zacoustic.core.transport.subscriptions.subscriptions import Subscriptions

_Key = tuple[int, int, Instance]
"""Source, stream, instance."""


class DeadlineSide(enum.Enum):
    """The side that missed a deadline, in DDS terms."""

    OFFERED = "offered"
    """This node promised samples and published none in time."""
    REQUESTED = "requested"
    """This node received no sample in time."""


class DeadlineMissed(msgspec.Struct, frozen=True, kw_only=True):
    """A topic with `deadline_s` had no sample in time; once for each period without one."""

    stream_id: int
    """The topic's stream."""
    source: int
    """Address of the publisher; this node's, where `side` is OFFERED."""
    instance: Instance
    """The key within the topic."""
    key: str
    """The key."""
    side: DeadlineSide
    """The side that missed it."""
    missed: int
    """How many periods this key of this node has missed in this boot epoch."""
    is_first: bool
    """Whether the period before had a sample."""
    last_at: int
    """Instant of the last sample, ns."""
    missed_at: int
    """End of the period, ns."""


class Awaited(msgspec.Struct, kw_only=True):
    """The state of a key of a publisher with an awaited sample."""

    stream_id: int
    """The topic's stream."""
    key: str
    """The key."""
    source: int
    """Address of the node that publishes it."""
    last_at: int
    """Instant of the last sample, ns."""
    due_at: int | None
    """Instant at which the next period is missed, ns; None: no longer awaited."""
    is_late: bool = False
    """Whether a period was missed since the last sample."""
    missed: int = 0
    """How many periods were missed in all."""


class Deadlines:
    """The deadlines of one node's topics.

    Args:
        context: What the components of its engine share.
        subscriptions: Knows which on-demand topics this node wants.
    """

    def __init__(self, context: Context, subscriptions: Subscriptions) -> None:
        self._address = context.address
        self._table = context.table
        self._subscriptions = subscriptions
        self._timers = context.timers
        self._stats = context.stats
        self._emit: Callable[[DeadlineMissed | SampleReceived], None] = context.emit
        context.peers.forgotten.connect(self.peer_forgotten)
        self._awaited: dict[_Key, Awaited] = {}

    def published(self, stream_id: int, instance: Instance, now: int, *, deleted: bool) -> None:
        """Restart the period of a key after its publication by the application."""
        self._note((self._address, stream_id, instance), now, deleted=deleted)

    def hand_on(self, sample: SampleReceived, now: int) -> None:
        """Give a sample of another node to the application."""
        count(self._stats.received, sample.stream_id)
        key = (sample.source, sample.stream_id, sample.instance)
        self._note(key, now, deleted=sample.deleted)
        self._emit(sample)

    def peer_forgotten(self, source: int, now: int) -> None:
        """Stop awaiting samples of a node until it is heard again."""
        for key in [key for key in self._awaited if key[0] == source]:
            self._timers.cancel((Due.DEADLINE, key))
            del self._awaited[key]

    def awaited(self) -> list[Awaited]:
        """Return the awaited samples of this node and of others; treat them as read-only."""
        return list(self._awaited.values())

    # Below the methods above

    def _note(self, key: _Key, now: int, *, deleted: bool) -> None:
        source, stream_id, instance = key
        stream = self._table.by_id(stream_id)
        deadline_ns = stream.qos.deadline_ns
        if deadline_ns is None:
            return
        awaited = self._awaited.get(key)
        if deleted:
            if awaited is not None:
                self._forget(key, awaited)
            return
        if awaited is None:
            name = stream.keys.key(source, instance)
            awaited = Awaited(stream_id=stream_id, key=name, source=source, last_at=now, due_at=now)
            self._awaited[key] = awaited
        awaited.last_at, awaited.is_late = now, False
        self._await(key, awaited, now + deadline_ns)

    def _await(self, key: _Key, awaited: Awaited, due_at: int) -> None:
        awaited.due_at = due_at
        self._timers.at((Due.DEADLINE, key), due_at, partial(self._miss, key, awaited, due_at))

    def _forget(self, key: _Key, awaited: Awaited) -> None:
        awaited.due_at, awaited.is_late = None, False
        self._timers.cancel((Due.DEADLINE, key))

    def _miss(self, key: _Key, awaited: Awaited, due_at: int, now: int) -> None:
        """Report a missed deadline."""
        stream = self._table.by_id(awaited.stream_id)
        deadline_ns = stream.qos.deadline_ns
        if deadline_ns is None or not self._is_wanted(stream, awaited.source):
            self._forget(key, awaited)
            return
        # More than one only if nobody called the engine for so long: the computer slept.
        periods = 1 + (now - due_at) // deadline_ns
        missed_at = due_at + (periods - 1) * deadline_ns
        is_first, awaited.is_late = not awaited.is_late, True
        awaited.missed += periods
        self._await(key, awaited, missed_at + deadline_ns)
        count(self._stats.deadlines_missed, awaited.stream_id, periods)
        is_ours = awaited.source == self._address
        self._emit(
            DeadlineMissed(
                stream_id=awaited.stream_id,
                source=awaited.source,
                instance=key[2],
                key=awaited.key,
                side=DeadlineSide.OFFERED if is_ours else DeadlineSide.REQUESTED,
                missed=awaited.missed,
                is_first=is_first,
                last_at=awaited.last_at,
                missed_at=missed_at,
            )
        )

    def _is_wanted(self, stream: Stream, source: int) -> bool:
        """Return whether samples are expected: a topic may stop if this node unsubscribed."""
        if source == self._address or not stream.is_on_demand:
            return True
        return source in self._subscriptions.wanted(stream.stream_id)
