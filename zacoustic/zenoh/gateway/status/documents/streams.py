"""The document about the streams."""

from collections.abc import Callable
from typing import Final

from zacoustic.core.base.qos import Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome, PeerSeen, StreamsDiffer
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.run.runner import LinkRunner
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

    def _streams(self) -> dict[str, object]:
        engine, stats = self._engine, self._engine.stats
        jobs, superseded = self._jobs(), self._intake.superseded()
        return {
            "digest": engine.table.digest.hex(),
            "streams": [
                {
                    "id": stream.stream_id,
                    "name": stream.name,
                    "kind": _KINDS[type(stream.spec)],
                    "jobs": sorted(job for job, of in jobs if of == stream.stream_id),
                    "published": stats.published.get(stream.stream_id, 0)
                    + superseded.get(stream.stream_id, 0),
                    "transmitted": stats.transmitted.get(stream.stream_id, 0),
                    "received": stats.received.get(stream.stream_id, 0),
                    "waiting": engine.pending(stream.stream_id)
                    + self._intake.waiting(stream.stream_id),
                    **self._traffic.of_stream(stream.stream_id),
                    **self._missed(stream),
                    **self._deliveries(stream),
                    **self._override(stream),
                    **self._subscriptions(stream),
                }
                for stream in engine.table
            ],
            "differ": [
                {"id": stream_id, "name": self._name(stream_id), "peers": sorted(peers)}
                for stream_id, peers in sorted(self._differing.items())
                if peers
            ],
        }

    def _missed(self, stream: Stream) -> dict[str, int]:
        """Return the number of missed deadlines, for a topic that has one."""
        if stream.qos.deadline_s is None:
            return {}
        missed = self._engine.stats.deadlines_missed
        return {"deadline_missed": missed.get(stream.stream_id, 0)}

    def _deliveries(self, stream: Stream) -> dict[str, int]:
        """Return the outcomes of the samples of a reliable topic."""
        if stream.qos.reliability is not Reliability.RELIABLE:
            return {}
        counts = self._outcomes.get(stream.stream_id, {})
        return {outcome.value: counts.get(outcome.value, 0) for outcome in DeliveryOutcome} | {
            "delivering": self._engine.delivering(stream.stream_id)
        }

    def _override(self, stream: Stream) -> dict[str, object]:
        """Return how the samples of a topic of this node are sent, with its overrides."""
        if not (isinstance(stream.spec, TopicSpec) and stream.may_publish(self._engine.address)):
            return {}
        on, qos = self._engine.commands.overrides.effective(stream)
        priority = qos.priority.name.lower()
        return {"override": {"on": on, "min_interval_s": qos.min_interval_s, "priority": priority}}

    def _subscriptions(self, stream: Stream) -> dict[str, list[int]]:
        """Return subscribers and publishers of an on-demand topic."""
        subscriptions = self._engine.subscriptions
        subscribers = subscriptions.subscribers(stream)
        if subscribers is None:
            return {}
        asked = subscriptions.wanted(stream.stream_id)
        return {"subscribers": sorted(subscribers), "subscribed_to": sorted(asked)}

    def _name(self, stream_id: int) -> str:
        stream = self._engine.table.get(stream_id)
        return stream.name if stream is not None else ""
