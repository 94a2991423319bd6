"""The document about the streams."""

from collections.abc import Callable, Collection, Mapping
from typing import Any, Final

from zacoustic.core.base.qos import Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome, PeerSeen, StreamsDiffer
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.run.runner import LinkRunner
from zacoustic.status.streams import DifferRow, Override, StreamRow, StreamsDocument
from zacoustic.zenoh.gateway.status.traffic import Traffic
from zacoustic.zenoh.gateway.streams.intake import Intake

_KINDS: Final[dict[type[StreamSpec], str]] = {
    TopicSpec: "topic",
    ServiceSpec: "service",
    ActionSpec: "action",
}


class StreamStatus:
    """The document ``streams`` of one gateway.

    Args:
        runner: Runs the engine that carries them.
        traffic: Knows when they crossed.
        jobs: Jobs of this gateway: job and stream id.
        intake: Has the samples that have not reached the engine.
    """

    def __init__(
        self,
        runner: LinkRunner,
        traffic: Traffic,
        jobs: Callable[[], frozenset[tuple[str, int]]],
        intake: Intake,
    ) -> None:
        self._intake = intake
        self._runner = runner
        self._traffic = traffic
        self._jobs = jobs
        self._differing: dict[int, set[int]] = {}
        self._outcomes: dict[int, dict[str, int]] = {}

    def note_peer(self, event: PeerSeen) -> None:
        """Clear a peer's differences: its new boot epoch may agree."""
        for peers in self._differing.values():
            peers.discard(event.address)

    def note_difference(self, event: StreamsDiffer) -> None:
        """Note that a stream is stopped."""
        self._differing.setdefault(event.stream_id, set()).add(event.address)

    def note_delivery(self, event: DeliveryEnded) -> None:
        """Count how a reliable sample ended."""
        counts = self._outcomes.setdefault(event.stream_id, {})
        counts[event.outcome.value] = counts.get(event.outcome.value, 0) + 1

    def documents(self) -> dict[str, object]:
        """Return the document, by the end of its key."""
        return {"streams": self._streams()}

    @property
    def _engine(self) -> Engine:
        return self._runner.engine

    def _streams(self) -> StreamsDocument:
        engine = self._engine
        jobs, superseded = self._jobs(), self._intake.superseded()
        return StreamsDocument(
            digest=engine.table.digest.hex(),
            streams=[self._row(stream, jobs, superseded) for stream in engine.table],
            differ=[
                DifferRow(id=stream_id, name=self._name(stream_id), peers=sorted(peers))
                for stream_id, peers in sorted(self._differing.items())
                if peers
            ],
        )

    def _row(
        self, stream: Stream, jobs: Collection[tuple[str, int]], superseded: Mapping[int, int]
    ) -> StreamRow:
        stream_id, engine, stats = stream.stream_id, self._engine, self._engine.stats
        more: dict[str, Any] = {}
        if stream.qos.deadline_s is not None:
            more["deadline_missed"] = stats.deadlines_missed.get(stream_id, 0)
        if stream.qos.reliability is Reliability.RELIABLE:
            counts = self._outcomes.get(stream_id, {})
            more |= {each.value: counts.get(each.value, 0) for each in DeliveryOutcome}
            more["delivering"] = engine.delivering(stream_id)
        if isinstance(stream.spec, TopicSpec) and stream.may_publish(engine.address):
            on, qos = engine.commands.overrides.effective(stream)
            more["override"] = Override(
                on=on, min_interval_s=qos.min_interval_s, priority=qos.priority.name.lower()
            )
        subscribers = engine.subscriptions.subscribers(stream)
        if subscribers is not None:
            more["subscribers"] = sorted(subscribers)
            more["subscribed_to"] = sorted(engine.subscriptions.wanted(stream_id))
        return StreamRow(
            id=stream_id,
            name=stream.name,
            kind=_KINDS[type(stream.spec)],
            jobs=sorted(job for job, of in jobs if of == stream_id),
            published=stats.published.get(stream_id, 0) + superseded.get(stream_id, 0),
            sent=stats.transmitted.get(stream_id, 0),
            heard=stats.received.get(stream_id, 0),
            waiting=engine.pending(stream_id) + self._intake.waiting(stream_id),
            **self._traffic.of_stream(stream_id),
            **more,
        )

    def _name(self, stream_id: int) -> str:
        stream = self._engine.table.get(stream_id)
        return stream.name if stream is not None else ""
