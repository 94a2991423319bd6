"""All lanes of one publisher: each begins with its first sample or with the journal's count."""

import random
from collections.abc import Iterator

from zacoustic.core.base.moments import Moments
from zacoustic.core.base.qos import Priority
from zacoustic.core.base.sizes import SampleNumbering
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.schedule.queue import RELIABLE_LANE, LaneKey
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.transport.reliable.rhythm import SendRhythm
from zacoustic.core.transport.reliable.sending.keeping import JournalledLane
from zacoustic.core.transport.reliable.sending.sendlane import OutgoingSample, SendLane, Stage
from zacoustic.core.transport.reliable.spans import LINEAGES, Span, Spans
from zacoustic.core.transport.subscriptions.subscriptions import Subscriptions
from zacoustic.errors import LocalError


class SendLanes:
    """The lanes of one node.

    Args:
        address: Address of the node.
        table: Its streams.
        handshake: Knows the boot epoch.
        subscriptions: Knows the subscribers of on-demand topics.
        numbering: How samples are numbered.
        moments: Find instants again after a restart.
        rng: Draws lineages in place of those that others have used.
    """

    def __init__(
        self,
        address: int,
        table: StreamTable,
        handshake: Handshake,
        subscriptions: Subscriptions,
        rng: random.Random,
        numbering: SampleNumbering,
        moments: Moments,
    ) -> None:
        self._moments = moments
        self._numbering = numbering
        self._address = address
        self._table = table
        self._handshake = handshake
        self._subscriptions = subscriptions
        self._rng = rng
        self._claimed: set[int] = set()
        """Topics of which others have sent samples in the lineage that this boot epoch would
        begin."""
        self._lanes: dict[LaneKey, SendLane] = {}
        self.under_way: dict[int, OutgoingSample] = {}
        """The samples of all lanes, by delivery id."""

    def __iter__(self) -> Iterator[SendLane]:
        return iter(self._lanes.values())

    def find(self, stream: Stream, instance: Instance) -> SendLane | None:
        """Return a key's lane, or None."""
        return self._lanes.get((stream.stream_id, RELIABLE_LANE, *instance))

    def of(self, stream: Stream, instance: Instance) -> SendLane:
        """Return a key's lane; create one that counts from 0 in the present boot epoch."""
        lane = self.find(stream, instance)
        if lane is None:
            return self.begin(stream, instance, Spans([Span(0, self._lineage(stream))]), 0)
        if lane.is_former:
            lane.begin_life(self._lineage(stream))
        return lane

    def claimed(self, stream: Stream, lineage: int) -> None:
        """Note that a receiver has a sample of a key of which this boot epoch published none."""
        if lineage == self._handshake.epoch:
            self._claimed.add(stream.stream_id)

    def begin(
        self,
        stream: Stream,
        instance: Instance,
        spans: Spans,
        number: int,
        *,
        is_journalled: bool | None = None,
    ) -> SendLane:
        """Create a lane that begins at this number; journalled as its topic says, or as it was."""
        qos = stream.qos
        is_pressing = qos.priority is Priority.REAL_TIME or qos.deadline_ns is not None
        lane = SendLane(
            (stream.stream_id, RELIABLE_LANE, *instance),
            self._receivers(stream, instance),
            spans,
            number,
            is_journalled=stream.journals_sent if is_journalled is None else is_journalled,
            subscribers=self._subscriptions.subscribers(stream),
            rhythm=self._rhythm(stream, instance),
            may_aim=not is_pressing,
            numbering=self._numbering,
            under_way=self.under_way,
        )
        self._lanes[lane.key] = lane
        return lane

    def restore(self, stream: Stream, kept: JournalledLane) -> SendLane:
        """Restore a lane from before the restart, with its samples, all to be sent again.

        It keeps all its spans: large samples, which come next, may be the last ones of a span.
        """
        first = min((number for number, _ in kept.samples), default=kept.next_number)
        spans = Spans(kept.spans, kept.own)
        lane = self.begin(stream, kept.instance, spans, first, is_journalled=True)
        lane.is_former = True
        for number, each in kept.samples:
            lane.next_number = number
            made_at = self._moments.restored(each.made)
            sample = lane.add(stream, each, queued_at=0, expires_at=None, made_at=made_at)
            sample.stage = Stage.BEHIND
        lane.next_number = lane.born = kept.next_number
        return lane

    def check(self, stream: Stream) -> None:
        """Refuse a topic that no node could acknowledge.

        Raises:
            LocalError: Neither nodes nor subscribers are listed.
        """
        assert isinstance(stream.spec, TopicSpec)
        if stream.spec.subscribers is None and not self._table.nodes:
            raise LocalError(
                f"{stream.name}: nobody is listed who could acknowledge",
                hint="list the nodes, or the subscribers of the stream",
            )

    def repeating_bytes(self) -> int:
        """Return how many bytes of repetitions wait or are in transmission."""
        return sum(
            sample.waiting.size_bytes
            for lane in self
            for sample in lane.active()
            if sample.tries and sample.stage in (Stage.QUEUED, Stage.ON_AIR)
        )

    def _rhythm(self, stream: Stream, instance: Instance) -> SendRhythm | None:
        # Several receivers would all ask at once, and urgent samples are sent in copies anyway.
        is_urgent = stream.qos.priority is Priority.REAL_TIME
        # Who is given a carried sample says so at once: its silence would mean that it is away.
        alone = len(self._receivers(stream, instance)) == 1 and not stream.is_addressed
        return SendRhythm(stream.qos) if alone and not is_urgent else None

    def _lineage(self, stream: Stream) -> int:
        """Return the lineage of a key whose first sample in this boot epoch is published."""
        if stream.stream_id not in self._claimed:
            return self._handshake.epoch
        return self._rng.randrange(LINEAGES)

    def _receivers(self, stream: Stream, instance: Instance) -> tuple[int, ...]:
        listed = stream.receivers(instance, self._table.nodes)
        return tuple(each for each in listed if each != self._address)
