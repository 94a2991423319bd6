"""Samples that wait for a large one of their key, so that it arrives before they displace it.

A new sample displaces the oldest one of its key that the depth has no room for. If that one is
just crossing as an object, its airtime is lost; and where samples come faster than the link takes
them, each displaces the one before it, and none would ever arrive. So the new sample is a
*successor*: it waits until the object has ended, or is asked for in vain. Of the successors of a
key the newest `depth` stay. Successors also wait for the minimum interval of a key between large
samples; between small ones the transmit queue keeps it.

A successor has no number yet, and receivers know nothing of it. On a journalled topic it is in the
journal from the start.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.moments import Moment
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import RELIABLE_LANE
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.deliveries import DeliveryEnded, DeliveryOutcome, DeliveryStored
from zacoustic.core.transport.outcomes import Outcomes
from zacoustic.core.transport.publication import EncodedSample
from zacoustic.core.transport.reliable.sending.keeping import OTHER_STREAM
from zacoustic.errors import LocalError, QueueFullError

_JOURNAL: Final = "next"

Key = tuple[int, Instance]
"""A key: stream id and wildcards."""


class Successor(msgspec.Struct, frozen=True, kw_only=True):
    """A sample that waits."""

    delivery_id: int
    sample: EncodedSample
    is_delete: bool
    is_large: bool
    """Whether it fits no frame."""


class _Kept(msgspec.Struct, frozen=True, array_like=True):
    """A successor in the journal."""

    digest: bytes
    """Of its stream."""
    instance: Instance
    prefix: bytes
    payload: bytes
    encoding: str | None
    stamped: bool
    is_delete: bool
    made: Moment | None = None


class Successors:
    """The successors of one node's samples.

    Args:
        context: What the components of its engine share.
        most_large: The most that may wait and are larger than a frame.
        is_crossing: Returns whether the next sample of a key would displace an object that crosses.
        is_numbered: Returns whether a sample with this delivery id has a number.
        publish: Publishes a sample under a delivery id.
        emit: Takes the events of those that end before.
        outcomes: Tells the ends of those that are journalled.
    """

    def __init__(
        self,
        context: Context,
        most_large: int,
        is_crossing: Callable[[Stream, Instance], bool],
        is_numbered: Callable[[int], bool],
        publish: Callable[[Stream, Successor, int], None],
        emit: Callable[[DeliveryEnded | DeliveryStored], None],
        outcomes: Outcomes,
    ) -> None:
        self._table = context.table
        self._queue = context.queue
        self._journal = context.journal
        self._moments = context.moments
        self._timers = context.timers
        self._most_large = most_large
        self._is_crossing = is_crossing
        self._is_numbered = is_numbered
        self._publish = publish
        self._emit: Callable[[Any], None] = emit
        self._outcomes = outcomes
        self._waiting: dict[Key, list[Successor]] = {}
        self._large_at: dict[Key, int] = {}
        """When the last large sample of a key began, of those with a minimum interval."""
        self._told_stored: set[int] = set()
        """Delivery ids of which the application knows that they are journalled."""

    def recover(self, stored: Mapping[str, bytes]) -> None:
        """Restore the successors from before a restart, in their order."""
        for name in sorted(key for key in stored if key.startswith(f"{_JOURNAL}/")):
            _, stream_id, delivery_id = name.split("/")
            kept = msgspec.msgpack.decode(stored[name], type=_Kept)
            sample = EncodedSample(
                instance=kept.instance,
                prefix=kept.prefix,
                payload=kept.payload,
                dense_value=None,
                stamped=kept.stamped,
                encoding=kept.encoding,
                made_at=0,
                dated_at=self._moments.restored(kept.made),
                expires_at=None,
            )
            successor = Successor(
                delivery_id=int(delivery_id), sample=sample, is_delete=kept.is_delete, is_large=True
            )
            stream = self._table.get(int(stream_id))
            has_ended = self._outcomes.has(successor.delivery_id)
            if has_ended or self._is_numbered(successor.delivery_id):
                self._journal.write(name, None)  # the power was cut between the two writes
                continue
            if stream is None or stream.digest != kept.digest:
                outcome = DeliveryOutcome.CANCELLED
                ended = _ended(int(stream_id), successor, outcome, 0, OTHER_STREAM)
                self._outcomes.tell(ended, is_dated=False)
                self._journal.write(name, None)
                continue
            self._waiting.setdefault((stream.stream_id, kept.instance), []).append(successor)

    def link_up(self, now: int) -> None:
        """Go on: the link is up. Lifespans of restored successors start again."""
        for (stream_id, _), waiting in self._waiting.items():
            lifespan_s = self._table.by_id(stream_id).qos.lifespan_s
            for place, each in enumerate(waiting):
                if lifespan_s is not None and each.sample.expires_at is None:
                    expires_at = now + seconds_to_ns(lifespan_s)
                    sample = msgspec.structs.replace(each.sample, expires_at=expires_at)
                    waiting[place] = msgspec.structs.replace(each, sample=sample)
        self.changed()

    def must_wait(self, stream: Stream, instance: Instance, now: int) -> bool:
        """Return whether the next sample of a key becomes a successor."""
        key = (stream.stream_id, instance)
        if key in self._waiting or self._is_crossing(stream, instance):
            return True
        return self._free_at(stream, key) > now

    def add(self, stream: Stream, successor: Successor, now: int) -> None:
        """Let a sample wait.

        Raises:
            QueueFullError: Too many large ones wait.
        """
        sample = successor.sample
        waiting = self._waiting.setdefault((stream.stream_id, sample.instance), [])
        if len(waiting) < stream.qos.depth:
            self._check_room(successor)
        waiting.append(successor)
        if stream.journals_sent:
            kept = _Kept(
                stream.digest,
                sample.instance,
                sample.prefix,
                sample.payload,
                sample.encoding,
                sample.stamped,
                successor.is_delete,
                self._moments.keep(sample.dated_at) if sample.stamped else None,
            )
            self._journal.write(
                _name(stream, successor),
                msgspec.msgpack.encode(kept),
                lambda at: self._stored(stream, successor),
            )
        if len(waiting) > stream.qos.depth:
            self._end(stream, waiting, waiting[0], DeliveryOutcome.SUPERSEDED, now)
        self.changed()

    def began(self, stream: Stream, instance: Instance, now: int) -> None:
        """Note that a large sample of a key begins."""
        if self._interval_ns(stream):
            self._large_at[stream.stream_id, instance] = now

    def knows_stored(self, delivery_id: int) -> bool:
        """Return whether the application knows that a sample with a number is journalled."""
        is_known = delivery_id in self._told_stored
        self._told_stored.discard(delivery_id)
        return is_known

    def sample_ended(self, delivery_id: int) -> None:
        """Note the end of a sample of this node."""
        self._told_stored.discard(delivery_id)
        self.changed()

    def changed(self) -> None:
        """Look again what may go: a sample has ended, or nobody answers."""
        if self._waiting:
            self._timers.changed((Due.SUCCESSOR,), self._due_at, self._go_on)

    def cancel(self, delivery_id: int, now: int) -> bool:
        """Cancel a successor; return False when it is none."""
        for (stream_id, _), waiting in self._waiting.items():
            for each in waiting:
                if each.delivery_id == delivery_id:
                    stream = self._table.by_id(stream_id)
                    self._end(stream, waiting, each, DeliveryOutcome.CANCELLED, now)
                    self._drop_empty()
                    return True
        return False

    def of(self, stream_id: int) -> int:
        """Return how many successors a topic has."""
        return sum(len(each) for key, each in self._waiting.items() if key[0] == stream_id)

    def has(self, delivery_id: int) -> bool:
        """Return whether a sample is a successor."""
        return any(each.delivery_id == delivery_id for each in self._each())

    # Below the methods above

    def _each(self) -> Iterator[Successor]:
        return (each for waiting in self._waiting.values() for each in waiting)

    def _check_room(self, successor: Successor) -> None:
        large = sum(each.is_large for each in self._each())
        if successor.is_large and large >= self._most_large:
            raise QueueFullError(f"{large} samples larger than a frame wait already")

    def _stored(self, stream: Stream, successor: Successor) -> None:
        delivery_id = successor.delivery_id
        if self.has(delivery_id):  # otherwise the sample with a number tells it
            self._emit(DeliveryStored(delivery_id=delivery_id, stream_id=stream.stream_id))
            self._told_stored.add(delivery_id)

    def _interval_ns(self, stream: Stream) -> int:
        qos = self._queue.overridden((stream.stream_id, RELIABLE_LANE), stream.qos)
        return seconds_to_ns(qos.min_interval_s)

    def _free_at(self, stream: Stream, key: Key) -> int:
        """Return the instant from which the minimum interval lets a key go on, ns."""
        large_at = self._large_at.get(key)
        return 0 if large_at is None else large_at + self._interval_ns(stream)

    def _due_at(self) -> int | None:
        """Return the earliest instant at which a successor may go or expires, ns, or None."""
        instants = [at for each in self._each() if (at := each.sample.expires_at) is not None]
        for key in self._waiting:
            stream = self._table.by_id(key[0])
            if not self._is_crossing(stream, key[1]):
                instants.append(self._free_at(stream, key))
        return min(instants, default=None)

    def _go_on(self, now: int) -> None:
        """Publish the successors that may go, and end those that are too old."""
        for key in list(self._waiting):
            stream, waiting = self._table.by_id(key[0]), self._waiting[key]
            for each in list(waiting):
                expires_at = each.sample.expires_at
                if expires_at is not None and expires_at <= now:
                    self._end(stream, waiting, each, DeliveryOutcome.EXPIRED, now)
            while waiting and not self._is_crossing(stream, key[1]):
                if self._free_at(stream, key) > now:
                    break
                successor = waiting.pop(0)
                try:
                    # The journal gets the sample that has a number before it loses this one.
                    self._publish(stream, successor, now)
                except LocalError as error:
                    outcome, why = DeliveryOutcome.CANCELLED, str(error.args[0])
                    self._tell(stream, successor, outcome, now, why)
                self._forget(stream, successor)
        self._drop_empty()
        self.changed()

    def _drop_empty(self) -> None:
        self._waiting = {key: waiting for key, waiting in self._waiting.items() if waiting}

    def _end(
        self,
        stream: Stream,
        waiting: list[Successor],
        successor: Successor,
        outcome: DeliveryOutcome,
        now: int,
    ) -> None:
        waiting.remove(successor)
        self._told_stored.discard(successor.delivery_id)
        self._tell(stream, successor, outcome, now)
        self._forget(stream, successor)

    def _tell(
        self,
        stream: Stream,
        successor: Successor,
        outcome: DeliveryOutcome,
        now: int,
        why: str = "",
    ) -> None:
        ended = _ended(stream.stream_id, successor, outcome, now, why)
        if stream.journals_sent:
            self._outcomes.tell(ended)
        else:
            self._emit(ended)

    def _forget(self, stream: Stream, successor: Successor) -> None:
        if stream.journals_sent:
            self._journal.write(_name(stream, successor), None)


def _name(stream: Stream, successor: Successor) -> str:
    return f"{_JOURNAL}/{stream.stream_id}/{successor.delivery_id:020}"


def _ended(
    stream_id: int, successor: Successor, outcome: DeliveryOutcome, now: int, detail: str = ""
) -> DeliveryEnded:
    return DeliveryEnded(
        delivery_id=successor.delivery_id,
        stream_id=stream_id,
        outcome=outcome,
        missing=(),
        ended_at=now,
        detail=detail,
    )
