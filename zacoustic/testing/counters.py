"""Counts the results of a run on a `VirtualNetwork`: by stream, by cause, by kind of loss."""

from collections import deque
from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.qos import Reliability
from zacoustic.core.base.stats import NO_STREAM
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.testing.scenarios.checker import Arrived, Checker, Publication
from zacoustic.testing.virtual import VirtualNetwork

_SAID_KEPT: Final = 4096
_ON_CHANNEL_NS: Final = seconds_to_ns(5.0)
"""A sample that was published so lately may still be on the channel."""


class StreamResult(msgspec.Struct, frozen=True, kw_only=True):
    """The results of one stream."""

    stream_id: int
    """The stream."""
    name: str
    """Its name."""
    published: int
    """Samples or calls of the traffic."""
    expected: int
    """Samples that would arrive without losses, at all subscribers together; accepted calls."""
    delivered: int
    """Samples that arrived, at all subscribers together, each once; answered calls."""
    late: int
    """Delivered samples that came too late."""
    duplicate: int
    """Samples that arrived again."""
    out_of_order: int
    """Samples that arrived after a newer one of the same key and source."""
    under_way: int = 0
    """Of those expected and not delivered: they wait, are on the channel, or may still be repeated
    at the end; calls without an end. They are not lost."""
    failed: int
    """Calls that ended without an answer."""
    refused: int
    """Samples or calls that the engine refused, or whose node was down."""
    mean_s: float | None
    """Mean time from publication to arrival, or from call to answer, s."""
    p50_s: float | None
    """Median of the same, s."""
    p95_s: float | None
    """95th percentile, s."""
    p99_s: float | None
    """99th percentile, s."""
    transmitted_bytes: int
    """Bytes of the stream given to the links."""
    airtime_share: float
    """The stream's share of the bytes of all streams, 0…1."""
    airtime_s: dict[str, float]
    """Airtime of the stream by cause, s; streams share preambles by their bytes."""


class SimulationResult(msgspec.Struct, frozen=True, kw_only=True):
    """The results of a scenario."""

    seed: int
    """The seed."""
    until_s: float
    """Length of the run, s of virtual time."""
    frames: int
    """Frames transmitted."""
    transmitted_bytes: int
    """Bytes given to the links."""
    airtime_s: float
    """Airtime of all frames, s."""
    airtime_by_cause_s: dict[str, float]
    """The same by cause, s."""
    losses: dict[str, int]
    """Lost arrivals, by outcome."""
    dropped: dict[str, int]
    """Input that engines dropped, by reason."""
    crashes: dict[int, int]
    """Crashes by node, only of nodes that crashed."""
    mean_s: float | None
    """Mean time from publication to arrival, or from call to answer, of all streams together, s."""
    p50_s: float | None
    """Median of the same, s."""
    p95_s: float | None
    """95th percentile, s."""
    p99_s: float | None
    """99th percentile, s."""
    streams: tuple[StreamResult, ...]
    """Results of each stream."""
    digest: str
    """SHA-256 of the trace: equal for equal runs; empty if not computed."""


class Counters(Checker):
    """A checker that counts.

    Args:
        tables: The table of each node.
        late_after_s: Age above which a sample of a stream is late, s; default: its lifespan.
    """

    def __init__(
        self, tables: Mapping[int, StreamTable], late_after_s: Mapping[int, float] | None = None
    ) -> None:
        super().__init__()
        self.crashes: dict[int, int] = {}
        """Crashes by node."""
        self._tables = tables
        self._late_after_s = {} if late_after_s is None else late_after_s
        self._counts: dict[int, _Counts] = {}

    def published(self, publication: Publication) -> None:
        """Count it, and its receivers."""
        counts = self._of(publication.stream)
        counts.published += 1
        receivers = []
        for node, table in self._tables.items():
            stream = table.get(publication.stream.stream_id)
            if node != publication.node and stream is not None and stream.may_subscribe(node):
                receivers.append(node)
        counts.expected += len(receivers)
        counts.newest_said.append((publication, tuple(receivers)))

    def called(self, publication: Publication) -> None:
        """Count it."""
        counts = self._of(publication.stream)
        counts.published += 1
        counts.expected += 1

    def refused(self, node: int, stream: Stream) -> None:
        """Count it."""
        counts = self._of(stream)
        counts.published += 1
        counts.refused += 1

    def received(self, arrived: Arrived) -> None:
        """Count it by its kind."""
        publication = arrived.publication
        counts = self._of(publication.stream)
        got = (arrived.node, publication.number)
        if got in counts.got:
            counts.duplicate += 1
            return
        counts.got.add(got)
        lane = (arrived.node, publication.node, publication.instance)
        if publication.number < counts.newest.get(lane, 0):
            counts.out_of_order += 1
        counts.newest[lane] = max(publication.number, counts.newest.get(lane, 0))
        took_ns = arrived.at - publication.at
        counts.took_ns.append(took_ns)
        late_after_ns = self._late_after_ns(publication.stream)
        counts.late += late_after_ns is not None and took_ns > late_after_ns

    def answered(self, arrived: Arrived) -> None:
        """Count it."""
        counts = self._of(arrived.publication.stream)
        counts.took_ns.append(arrived.at - arrived.publication.at)

    def failed(self, arrived: Arrived) -> None:
        """Count it."""
        self._of(arrived.publication.stream).failed += 1

    def crashed(self, node: int, at: int) -> None:
        """Count it."""
        self.crashes[node] = self.crashes.get(node, 0) + 1

    def result(self, network: VirtualNetwork, until_s: float) -> SimulationResult:
        """Return the results.

        Args:
            network: The network of the run.
            until_s: Length of the run, s of virtual time.
        """
        ledger = _Ledger(network)
        took = sorted(took_ns for counts in self._counts.values() for took_ns in counts.took_ns)
        return SimulationResult(
            seed=network.scenario.seed,
            until_s=until_s,
            frames=ledger.frames,
            transmitted_bytes=ledger.transmitted_bytes,
            airtime_s=ledger.airtime_ns / NS_PER_S,
            airtime_by_cause_s=ledger.airtime_s(),
            losses=dict(sorted(network.losses.items())),
            dropped=dict(sorted(ledger.dropped.items())),
            crashes=dict(sorted(self.crashes.items())),
            mean_s=_mean_s(took),
            p50_s=_percentile_s(took, 50),
            p95_s=_percentile_s(took, 95),
            p99_s=_percentile_s(took, 99),
            streams=tuple(
                counts.result(ledger, network) for _, counts in sorted(self._counts.items())
            ),
            digest=network.digest,
        )

    def _of(self, stream: Stream) -> "_Counts":
        counts = self._counts.get(stream.stream_id)
        if counts is None:
            counts = self._counts[stream.stream_id] = _Counts(stream)
        return counts

    def _late_after_ns(self, stream: Stream) -> int | None:
        late_after_s = self._late_after_s.get(stream.stream_id)
        if late_after_s is None and isinstance(stream.spec, TopicSpec):
            late_after_s = stream.spec.qos.lifespan_s
        return None if late_after_s is None else seconds_to_ns(late_after_s)


class _Counts:
    """Counts of one stream."""

    def __init__(self, stream: Stream) -> None:
        self.stream = stream
        self.published = 0
        self.expected = 0
        self.late = 0
        self.duplicate = 0
        self.out_of_order = 0
        self.failed = 0
        self.refused = 0
        self.took_ns: list[int] = []
        self.got: set[tuple[int, int]] = set()
        self.newest: dict[tuple[int, int, Instance], int] = {}
        self.newest_said: deque[tuple[Publication, tuple[int, ...]]] = deque(maxlen=_SAID_KEPT)
        """The last samples, each with its receivers."""

    def _under_way(self, network: VirtualNetwork) -> int:
        """Return how many of those that have not arrived may still do."""
        if not isinstance(self.stream.spec, TopicSpec):
            return max(0, self.expected - len(self.took_ns) - self.failed)
        waiting: dict[int, int] = {}
        found = 0
        for publication, receivers in reversed(self.newest_said):
            node = publication.node
            missing = sum((each, publication.number) not in self.got for each in receivers)
            if node not in waiting:
                is_up = network.is_running(node)
                waiting[node] = network.engine(node).pending(self.stream.stream_id) if is_up else 0
            if not missing:
                continue
            is_open = network.now - publication.at < _ON_CHANNEL_NS
            if self.stream.qos.reliability is Reliability.RELIABLE:
                is_open |= network.is_running(node) and network.engine(node).is_delivering(
                    publication.result
                )
            elif waiting[node]:
                waiting[node] -= 1
                is_open = True
            found += missing if is_open else 0
        return found

    def result(self, ledger: "_Ledger", network: VirtualNetwork) -> StreamResult:
        """Return the results."""
        stream_id, took = self.stream.stream_id, sorted(self.took_ns)
        return StreamResult(
            stream_id=stream_id,
            name=self.stream.name,
            published=self.published,
            expected=self.expected,
            delivered=len(took),
            late=self.late,
            duplicate=self.duplicate,
            out_of_order=self.out_of_order,
            under_way=self._under_way(network),
            failed=self.failed,
            refused=self.refused,
            mean_s=_mean_s(took),
            p50_s=_percentile_s(took, 50),
            p95_s=_percentile_s(took, 95),
            p99_s=_percentile_s(took, 99),
            transmitted_bytes=ledger.bytes_of(stream_id),
            airtime_share=ledger.share_of(stream_id),
            airtime_s=ledger.airtime_s(stream_id),
        )


class _Ledger:
    """The summed statistics of all engines, former boot epochs included."""

    def __init__(self, network: VirtualNetwork) -> None:
        self.frames = 0
        self.transmitted_bytes = 0
        self.airtime_ns = 0
        self.dropped: dict[str, int] = {}
        self._bytes: dict[int, int] = {}
        self._airtime_ns: dict[tuple[int, str], float] = {}
        for stats in network.stats():
            self.frames += stats.frames_transmitted
            self.transmitted_bytes += stats.bytes_transmitted
            self.airtime_ns += stats.airtime_ns
            for reason, number in stats.dropped.items():
                self.dropped[reason] = self.dropped.get(reason, 0) + number
            for entry in stats.ledger():
                size, key = entry.transmitted_bytes, (entry.stream_id, entry.cause.value)
                self._bytes[entry.stream_id] = self._bytes.get(entry.stream_id, 0) + size
                self._airtime_ns[key] = self._airtime_ns.get(key, 0.0) + entry.airtime_ns

    def bytes_of(self, stream_id: int) -> int:
        """Return the bytes of a stream."""
        return self._bytes.get(stream_id, 0)

    def share_of(self, stream_id: int) -> float:
        """Return a stream's share of the bytes of all streams, 0…1."""
        of_streams = sum(size for each, size in self._bytes.items() if each != NO_STREAM)
        return self.bytes_of(stream_id) / of_streams if of_streams else 0.0

    def airtime_s(self, stream_id: int | None = None) -> dict[str, float]:
        """Return the airtime by cause, s, of one stream or of everything."""
        by_cause: dict[str, float] = {}
        for (each, cause), airtime_ns in sorted(self._airtime_ns.items()):
            if stream_id in (None, each):
                by_cause[cause] = by_cause.get(cause, 0.0) + airtime_ns / NS_PER_S
        return by_cause


def _mean_s(took_ns: list[int]) -> float | None:
    """Return the mean of times, s."""
    return sum(took_ns) / len(took_ns) / NS_PER_S if took_ns else None


def _percentile_s(took_ns: list[int], percent: int) -> float | None:
    """Return a percentile of sorted times, s."""
    if not took_ns:
        return None
    return took_ns[min(len(took_ns) - 1, len(took_ns) * percent // 100)] / NS_PER_S
