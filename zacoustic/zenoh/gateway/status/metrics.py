"""The health report for Prometheus: the same documents as metrics, and a server for them.

A scrape comes on the thread of the server (`run.web.front`), which asks the loop for the documents,
at most once a second. Counters are those of the documents, so they start again with each start of
the gateway, as Prometheus expects. The stream table, the addresses and the words of the code bound
the labels.
"""

import asyncio
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from concurrent import futures
from typing import Any, Final, TypeAlias

import msgspec
from msgspec import UNSET, UnsetType
from prometheus_client import CollectorRegistry, make_asgi_app
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.registry import Collector

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.core.base.linktypes import LinkMetrics
from zacoustic.core.bond.reach import Reach
from zacoustic.core.engine.events import DeliveryOutcome
from zacoustic.core.relay.relay import Hop
from zacoustic.link.serving import cannot_listen, place_name
from zacoustic.run.inbox import tell_loop
from zacoustic.run.web.front import Front
from zacoustic.status.link import LinkDocument
from zacoustic.status.node import DroppedDocument, ModemDocument, NodeDocument
from zacoustic.status.peers import PeerRow, RangeDocument
from zacoustic.status.streams import StreamRow

Documents: TypeAlias = Mapping[str, Any]
Family: TypeAlias = GaugeMetricFamily | CounterMetricFamily

ANSWER_LIMIT_S: Final = 5.0
"""How long a scrape waits for the loop, s."""
FRESH_NS: Final = seconds_to_ns(1.0)
"""Age up to which an answer is given again: no visitor keeps the loop busy."""
_REACHES: Final = {Reach.UP: 1.0, Reach.DOUBT: 0.5, Reach.DOWN: 0.0}
_OUTCOMES: Final = tuple(outcome.value for outcome in DeliveryOutcome)


class MetricsServer:
    """Answers Prometheus; made and closed on the loop.

    Args:
        host: Host to listen at.
        port: Port to listen at; 0: any free one.
        documents: Returns the documents of the health report; called on the loop.
        names: Names under which Prometheus finds it, besides this computer's own.
    """

    def __init__(
        self,
        host: str,
        port: int,
        documents: Callable[[], dict[str, object]],
        names: Collection[str] = (),
    ) -> None:
        registry = CollectorRegistry(auto_describe=False)
        registry.register(_HealthCollector(documents, asyncio.get_running_loop()))
        application = make_asgi_app(registry)
        self._front = Front(application, host, port, names=names, hint="the key metrics_names")

    @property
    def url(self) -> str:
        """URL of the metrics."""
        return f"http://{place_name(self._front.host, self._front.port)}/metrics"

    async def open(self) -> None:
        """Start to listen.

        Raises:
            LinkOpenError: It cannot listen there.
        """
        try:
            await self._front.open()
        except OSError as error:
            rival = "another gateway with the same metrics"
            raise cannot_listen(self._front.host, self._front.port, error, rival=rival) from error

    async def close(self) -> None:
        """Stop to listen. May be called again."""
        await self._front.close()


class _HealthCollector(Collector):
    """Asks the loop for the documents when Prometheus asks."""

    def __init__(
        self,
        documents: Callable[[], dict[str, object]],
        loop: asyncio.AbstractEventLoop,
        clock: Clock = time.monotonic_ns,
    ) -> None:
        self._documents = documents
        self._loop = loop
        self._clock = clock
        self._last: tuple[int, list[Metric]] | None = None

    def collect(self) -> Iterable[Metric]:
        """Return the current metrics; on the server's thread."""
        if self._last is None or self._clock() - self._last[0] >= FRESH_NS:
            metrics = self._ask()
            self._last = (self._clock(), metrics)
        return self._last[1]

    def _ask(self) -> list[Metric]:
        answer: futures.Future[dict[str, Any]] = futures.Future()

        def ask() -> None:
            try:
                answer.set_result(self._documents())
            except Exception as error:  # handed on to the waiting caller, which logs it
                answer.set_exception(error)

        tell_loop(self._loop, ask)
        return list(metrics_of(answer.result(ANSWER_LIMIT_S)))


def metrics_of(documents: Documents) -> Iterator[Metric]:
    """Return the documents of a health report as metrics.

    Args:
        documents: By the end of their keys.
    """
    yield from _node(documents["node"], documents["link"])
    yield from _links(documents)
    yield from _streams(documents["streams"].streams, documents["dropped"])
    yield from _peers(documents)
    yield _reachable(documents)
    yield from _hops(documents["relay"].hops if "relay" in documents else ())
    yield from _rest(documents)


def _node(node: NodeDocument, link: LinkDocument) -> Iterator[Metric]:
    about = ("address", "name", "version", "wire", "link")
    facts = {each: str(getattr(node, each)) for each in about}
    yield InfoMetricFamily("zacoustic_gateway", "What the gateway is.", facts)
    started_at = _gauges("start_time_seconds", "When it was started, Unix time.")
    _add(started_at, [], node.started_at_unix_s)
    yield started_at
    yield _gauge("silent", "1 while nothing is transmitted, by order or quiet.", link.is_silent)


def _links(documents: Documents) -> Iterator[Metric]:
    """Return the metrics of each link, with its name as label."""
    several: list[LinkDocument] = [
        each for key, each in documents.items() if key.startswith("link/")
    ]
    links = several or [msgspec.structs.replace(documents["link"], ledger=documents["ledger"])]
    up = _gauges("link_up", "1 while frames can be given to the modem.", "link")
    supply = _gauges("modem_supply_volts", "Supply voltage reported by the modem.", "link")
    counters = [
        (_counter(name, words, "link"), figure)
        for figure, name, words in (
            ("frames_sent", "frames_transmitted", "Frames given to the modem."),
            ("frames_heard", "frames_received", "Frames that came, damaged ones included."),
            ("bytes_sent", "transmitted_bytes", "Bytes given to the modem."),
            ("bytes_heard", "received_bytes", "Bytes that came."),
            ("airtime_s", "airtime_seconds", "Airtime of what was transmitted."),
        )
    ]
    reports = _counter("transmit_reports", "Transmissions by how they ended.", "link", "outcome")
    by_cause = _counter(
        "ledger_bytes", "Bytes transmitted, by stream and cause.", "link", "stream", "cause"
    )
    for link in links:
        name = link.name
        up.add_metric([name], link.state == "up")
        for counter, figure in counters:
            counter.add_metric([name], getattr(link, figure))
        for outcome, count in link.reports.items():
            reports.add_metric([name, outcome], count)
        for entry in link.ledger.entries if link.ledger else ():
            by_cause.add_metric([name, entry.stream, entry.cause], entry.bytes)
        modem = documents.get(f"modem/{name}" if several else "modem", ModemDocument())
        _add(supply, [name], modem.battery_v)
    yield from (up, *(counter for counter, _ in counters), reports, by_cause, supply)


def _streams(rows: Iterable[StreamRow], dropped: DroppedDocument) -> Iterator[Metric]:
    families = [
        (make(name, words, "stream"), figure)
        for make, figure, name, words in (
            (_counter, "published", "stream_published",
             "What the local network gave, and was taken."),
            (_counter, "sent", "stream_transmitted_records", "Records transmitted."),
            (_counter, "heard", "stream_received_records", "Records that came."),
            (_gauges, "waiting", "stream_waiting", "What waits for the channel."),
            (_gauges, "delivering", "stream_delivering", "Reliable samples that have not ended."),
            (_counter, "deadline_missed", "stream_deadlines_missed", "Periods without a sample."),
            (_gauges, "sent_at_unix_s", "stream_last_transmitted_timestamp_seconds",
             "When last, Unix time."),
            (_gauges, "heard_at_unix_s", "stream_last_received_timestamp_seconds",
             "When last, Unix time."),
        )
    ]  # fmt: skip
    ended = _counter(
        "stream_deliveries", "Reliable samples by how they ended.", "stream", "outcome"
    )
    for row in rows:
        for family, figure in families:
            _add(family, [row.name], getattr(row, figure))
        for outcome in _OUTCOMES:
            _add(ended, [row.name, outcome], getattr(row, outcome))
    yield from (family for family, _ in families)
    yield ended
    discarded = _counter("stream_discarded", "Samples of no use any more.", "stream", "reason")
    for reason in ("expired", "superseded", "unsubscribed"):
        for name, count in getattr(dropped, reason).items():
            discarded.add_metric([name, reason], count)
    yield discarded
    refused = _counter(
        "local_discarded", "What the local network gave in vain.", "stream", "reason"
    )
    for name, counts in dropped.local.items():
        for reason, count in counts.items():
            refused.add_metric([name, reason], count)
    yield refused


def _peers(documents: Documents) -> Iterator[Metric]:
    heard_at = _gauges("peer_last_heard_timestamp_seconds", "When last, Unix time.", "peer")
    exchanges = _counter(
        "peer_exchanges", "Frames that its modem was to confirm.", "peer", "outcome"
    )
    errors = _gauges(
        "peer_packet_error_ratio", "Of the last 64 of those, how many were lost.", "peer"
    )
    same = _gauges("peer_same_table", "1 if its stream table is ours.", "peer")
    lost = _gauges("peer_lost", "1 if it was not heard for the configured time.", "peer")
    ranges = _gauges("peer_range_meters", "Slant distance.", "peer")
    delays = _gauges("peer_propagation_seconds", "Propagation delay, one way.", "peer")
    snr = _gauges("peer_snr_decibels", "Signal-to-noise ratio.", "peer")
    level = _gauges("peer_received_level_decibels", "By the modem's own reference.", "peer")
    integrity = _gauges("peer_signal_integrity", "In the modem's own scale.", "peer")
    rows: Mapping[int, PeerRow] = documents["peers"]
    for address, row in rows.items():
        peer, metrics = str(address), row.metrics or LinkMetrics()
        measured = documents.get(f"peer/{address}/range", RangeDocument())
        exchanges.add_metric([peer, "delivered"], row.delivered)
        exchanges.add_metric([peer, "not_delivered"], row.not_delivered)
        sighting = documents.get(f"peer/{address}/lost")
        for family, value in (
            (heard_at, row.heard_at_unix_s),
            (errors, row.per),
            (same, row.same_table),
            (lost, None if sighting is None else sighting.lost),
            (ranges, measured.range_m),
            (delays, measured.propagation_s),
            (snr, metrics.snr_db),
            (level, metrics.received_level_db),
            (integrity, metrics.integrity),
        ):
            _add(family, [peer], value)
    yield from (heard_at, exchanges, errors, same, lost, ranges, delays, snr, level, integrity)


def _reachable(documents: Documents) -> Metric:
    """Return which link reaches which node; of several lists of links the one that is surest."""
    found: dict[tuple[str, str], float] = {}
    for key, bond in documents.items():
        if not key.startswith("bond/"):
            continue
        for address, by_link in bond.reach.items():
            for link, reach in by_link.items():
                known = found.get((str(address), link), 0.0)
                found[str(address), link] = max(known, _REACHES[reach])
    reachable = _gauges(
        "peer_link_reachable", "1 if a link of a list reaches it, 0.5 in doubt.", "peer", "link"
    )
    for labels, value in found.items():
        reachable.add_metric(labels, value)
    return reachable


def _hops(hops: Iterable[Hop]) -> Iterator[Metric]:
    counters = [
        (_counter(f"relay_hop_{figure}", words, "route", "next_node"), figure)
        for figure, words in (
            ("transmissions", "Transmissions over a hop."),
            ("passed_on", "Frames that have arrived behind a hop."),
            ("given_up", "Frames that a hop has given up."),
        )
    ]
    for hop in hops:
        for counter, figure in counters:
            counter.add_metric([hop.route, str(hop.next_node)], getattr(hop, figure))
    yield from (counter for counter, _ in counters)


def _rest(documents: Documents) -> Iterator[Metric]:
    dropped = _counter("dropped", "What came off the channel and was of no use.", "reason")
    for reason, count in documents["dropped"].channel.items():
        dropped.add_metric([reason], count)
    yield dropped
    objects = _gauges("objects", "Samples larger than a frame, on their way.", "direction")
    for direction in ("sending", "receiving"):
        objects.add_metric([direction], len(getattr(documents["objects"], direction)))
    yield objects
    journal = documents["journal"]
    yield _gauge("journal_kept", "1 if anything survives a restart.", journal.kept)
    yield _gauge("journal_doubted", "1 if it may miss what was written.", bool(journal.doubt))
    yield _gauge("journal_failing", "1 while it cannot be written.", bool(journal.failure))


def _add(family: Family, labels: Sequence[str], value: float | UnsetType | None) -> None:
    """Add a figure, unless it is unknown or the subject has none."""
    if value is not None and value is not UNSET:
        family.add_metric(labels, value)


def _gauge(name: str, words: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"zacoustic_{name}", words, value)


def _gauges(name: str, words: str, *labels: str) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"zacoustic_{name}", words, labels=labels)


def _counter(name: str, words: str, *labels: str) -> CounterMetricFamily:
    return CounterMetricFamily(f"zacoustic_{name}", words, labels=labels)
