"""The health report for Prometheus: the same documents as metrics, and a server for them.

A scrape comes on the thread of the server (`run.web.front`), which asks the loop for the documents,
at most once a second. Counters are those of the documents, so they start again with each start of
the gateway, as Prometheus expects. The stream table, the addresses and the words of the code bound
the labels.
"""

import asyncio
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from concurrent import futures
from typing import TYPE_CHECKING, Any, Final

import msgspec
from prometheus_client import CollectorRegistry, make_asgi_app
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, InfoMetricFamily, Metric
from prometheus_client.registry import Collector

from zacoustic.core.base.clock import Clock, seconds_to_ns
from zacoustic.core.engine.events import DeliveryOutcome
from zacoustic.link.serving import cannot_listen, place_name
from zacoustic.run.inbox import tell_loop
from zacoustic.run.web.front import Front

if TYPE_CHECKING:
    Documents = Mapping[str, Any]

ANSWER_LIMIT_S: Final = 5.0
"""How long a scrape waits for the loop, s."""
FRESH_NS: Final = seconds_to_ns(1.0)
"""Age up to which an answer is given again: no visitor keeps the loop busy."""
_REACHES: Final = {"up": 1.0, "doubt": 0.5, "down": 0.0}
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
                answer.set_result(msgspec.to_builtins(self._documents(), str_keys=True))
            except Exception as error:  # handed on to the waiting caller, which logs it
                answer.set_exception(error)

        tell_loop(self._loop, ask)
        return list(metrics_of(answer.result(ANSWER_LIMIT_S)))


def metrics_of(documents: "Documents") -> Iterator[Metric]:
    """Return the documents of a health report as metrics.

    Args:
        documents: By the end of their keys, of plain objects.
    """
    yield from _node(documents["node"], documents["link"])
    yield from _links(documents)
    yield from _streams(documents["streams"]["streams"], documents["dropped"])
    yield from _peers(documents)
    yield _reachable(documents)
    yield from _hops(documents.get("relay", {}).get("hops", ()))
    yield from _rest(documents)


def _node(node: "Documents", link: "Documents") -> Iterator[Metric]:
    about = {name: str(node[name]) for name in ("address", "name", "version", "wire", "link")}
    yield InfoMetricFamily("zacoustic_gateway", "What the gateway is.", about)
    yield _gauge("start_time_seconds", "When it was started, Unix time.", node["started_at_unix_s"])
    yield _gauge("silent", "1 while nothing is transmitted, by order or quiet.", link["silent"])


def _links(documents: "Documents") -> Iterator[Metric]:
    """Return the metrics of each link, with its name as label."""
    several = [each for key, each in documents.items() if key.startswith("link/")]
    links = several or [documents["link"] | {"ledger": documents["ledger"]}]
    up = _gauges("link_up", "1 while frames can be given to the modem.", "link")
    supply = _gauges("modem_supply_volts", "Supply voltage reported by the modem.", "link")
    counters = {
        "frames_transmitted": _counter("frames_transmitted", "Frames given to the modem.", "link"),
        "frames_received": _counter(
            "frames_received", "Frames that came, damaged ones included.", "link"
        ),
        "bytes_transmitted": _counter("transmitted_bytes", "Bytes given to the modem.", "link"),
        "bytes_received": _counter("received_bytes", "Bytes that came.", "link"),
        "airtime_s": _counter("airtime_seconds", "Airtime of what was transmitted.", "link"),
    }
    reports = _counter("transmit_reports", "Transmissions by how they ended.", "link", "outcome")
    by_cause = _counter(
        "ledger_bytes", "Bytes transmitted, by stream and cause.", "link", "stream", "cause"
    )
    for link in links:
        name = link["name"]
        up.add_metric([name], link["state"] == "up")
        for field, counter in counters.items():
            counter.add_metric([name], link[field])
        for outcome, count in link["reports"].items():
            reports.add_metric([name, outcome], count)
        for entry in link["ledger"]["entries"]:
            by_cause.add_metric([name, entry["stream"], entry["cause"]], entry["bytes"])
        modem = documents.get(f"modem/{name}" if several else "modem", {})
        if modem.get("battery_v") is not None:
            supply.add_metric([name], modem["battery_v"])
    yield from (up, *counters.values(), reports, by_cause, supply)


def _streams(rows: list["Documents"], dropped: "Documents") -> Iterator[Metric]:
    published = _counter(
        "stream_published", "What the local network gave, and was taken.", "stream"
    )
    transmitted = _counter("stream_transmitted_records", "Records transmitted.", "stream")
    received = _counter("stream_received_records", "Records that came.", "stream")
    waiting = _gauges("stream_waiting", "What waits for the channel.", "stream")
    delivering = _gauges("stream_delivering", "Reliable samples that have not ended.", "stream")
    ended = _counter(
        "stream_deliveries", "Reliable samples by how they ended.", "stream", "outcome"
    )
    missed = _counter("stream_deadlines_missed", "Periods without a sample.", "stream")
    sent_at = _gauges(
        "stream_last_transmitted_timestamp_seconds", "When last, Unix time.", "stream"
    )
    heard_at = _gauges("stream_last_received_timestamp_seconds", "When last, Unix time.", "stream")
    for row in rows:
        labels = [row["name"]]
        published.add_metric(labels, row["published"])
        transmitted.add_metric(labels, row["transmitted"])
        received.add_metric(labels, row["received"])
        waiting.add_metric(labels, row["waiting"])
        for family, value in (
            (delivering, row.get("delivering")),
            (missed, row.get("deadline_missed")),
            (sent_at, row["sent_at_unix_s"]),
            (heard_at, row["heard_at_unix_s"]),
        ):
            if value is not None:
                family.add_metric(labels, value)
        for outcome in _OUTCOMES:
            if outcome in row:
                ended.add_metric([row["name"], outcome], row[outcome])
    yield from (published, transmitted, received, waiting, delivering, ended, missed)
    yield from (sent_at, heard_at)
    discarded = _counter("stream_discarded", "Samples of no use any more.", "stream", "reason")
    for reason in ("expired", "superseded", "unsubscribed"):
        for name, count in dropped[reason].items():
            discarded.add_metric([name, reason], count)
    yield discarded
    refused = _counter(
        "local_discarded", "What the local network gave in vain.", "stream", "reason"
    )
    for name, counts in dropped["local"].items():
        for reason, count in counts.items():
            refused.add_metric([name, reason], count)
    yield refused


def _peers(documents: "Documents") -> Iterator[Metric]:
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
    for address, row in documents["peers"].items():
        metrics = row["metrics"] or {}
        measured = documents.get(f"peer/{address}/range", {})
        for outcome in ("delivered", "not_delivered"):
            exchanges.add_metric([address, outcome], row[outcome])
        for family, value in (
            (heard_at, row["heard_at_unix_s"]),
            (errors, row["per"]),
            (same, row["same_table"]),
            (lost, documents.get(f"peer/{address}/lost", {}).get("lost")),
            (ranges, measured.get("range_m")),
            (delays, measured.get("propagation_s")),
            (snr, metrics.get("snr_db")),
            (level, metrics.get("received_level_db")),
            (integrity, metrics.get("integrity")),
        ):
            if value is not None:
                family.add_metric([address], value)
    yield from (heard_at, exchanges, errors, same, lost, ranges, delays, snr, level, integrity)


def _reachable(documents: "Documents") -> Metric:
    """Return which link reaches which node; of several lists of links the one that is surest."""
    found: dict[tuple[str, str], float] = {}
    for key, bond in documents.items():
        if not key.startswith("bond/"):
            continue
        for address, by_link in bond["reach"].items():
            for link, reach in by_link.items():
                known = found.get((address, link), 0.0)
                found[address, link] = max(known, _REACHES.get(reach, 0.0))
    reachable = _gauges(
        "peer_link_reachable", "1 if a link of a list reaches it, 0.5 in doubt.", "peer", "link"
    )
    for (address, link), value in found.items():
        reachable.add_metric([address, link], value)
    return reachable


def _hops(hops: Iterable["Documents"]) -> Iterator[Metric]:
    counters = {
        "transmissions": _counter(
            "relay_hop_transmissions", "Transmissions over a hop.", "route", "next_node"
        ),
        "passed_on": _counter(
            "relay_hop_passed_on", "Frames that have arrived behind a hop.", "route", "next_node"
        ),
        "given_up": _counter(
            "relay_hop_given_up", "Frames that a hop has given up.", "route", "next_node"
        ),
    }
    for hop in hops:
        for field, counter in counters.items():
            counter.add_metric([hop["route"], str(hop["next_node"])], hop[field])
    yield from counters.values()


def _rest(documents: "Documents") -> Iterator[Metric]:
    dropped = _counter("dropped", "What came off the channel and was of no use.", "reason")
    for reason, count in documents["dropped"]["channel"].items():
        dropped.add_metric([reason], count)
    yield dropped
    objects = _gauges("objects", "Samples larger than a frame, on their way.", "direction")
    for direction in ("sending", "receiving"):
        objects.add_metric([direction], len(documents["objects"][direction]))
    yield objects
    journal = documents["journal"]
    yield _gauge("journal_kept", "1 if anything survives a restart.", journal["kept"])
    yield _gauge("journal_doubted", "1 if it may miss what was written.", bool(journal["doubt"]))
    yield _gauge("journal_failing", "1 while it cannot be written.", bool(journal["failure"]))


def _gauge(name: str, words: str, value: float) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"zacoustic_{name}", words, value)


def _gauges(name: str, words: str, *labels: str) -> GaugeMetricFamily:
    return GaugeMetricFamily(f"zacoustic_{name}", words, labels=labels)


def _counter(name: str, words: str, *labels: str) -> CounterMetricFamily:
    return CounterMetricFamily(f"zacoustic_{name}", words, labels=labels)
