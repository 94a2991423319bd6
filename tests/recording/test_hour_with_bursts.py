"""An hour with burst data: report, ladder and graph book what the ledgers of the senders book."""

from functools import partial
from typing import Any

import pytest

from tests.core.bulklink import BulkSea
from tests.recording.memory import recorded
from zacoustic.app.tools.inspect.recordings.facts.facts import Facts
from zacoustic.app.tools.inspect.recordings.facts.gathering import add_messages
from zacoustic.app.tools.inspect.recordings.report.figures import figures_of
from zacoustic.app.tools.inspect.recordings.report.linkfigures import losses_over_time
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import Service
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.status.channel import FrameRow
from zacoustic.zenoh.gateway.status.channel import FrameLog
from zacoustic.zenoh.gateway.status.documents.peers import PeerTable
from zacoustic.zenoh.gateway.status.traffic import Traffic

HOUR_S = 3600
PHOTO, NAV = 10, 11


def table() -> StreamTable:
    photos = Qos(reliability=Reliability.RELIABLE, priority=Priority.BACKGROUND, depth=2)
    return StreamTable(
        [
            TopicSpec(stream_id=PHOTO, name="photo", qos=photos, publishers=(2,), subscribers=(1,)),
            TopicSpec(stream_id=NAV, name="nav", publishers=(1, 2)),
        ]
    )


class Hour:
    """Two recorded nodes; a photo of 20 kB every ten minutes, and small samples both ways."""

    def __init__(self) -> None:
        recorder, self.sink = recorded()
        self.logs: dict[int, FrameLog] = {}
        self.shown: dict[int, dict[tuple[str, float, int], FrameRow]] = {1: {}, 2: {}}
        self.traffic = {node: Traffic(lambda: self.sea.now / NS_PER_S) for node in (1, 2)}
        self.begun_s: dict[int, float] = {}

        def build(**parts: Any) -> Any:
            return recorder.make(**{**parts, "trace": partial(self._trace, parts["address"])})

        self.sea = BulkSea.__new__(BulkSea)
        self.sea.now = 0
        self.sea.__init__(table(), build=build)  # type: ignore[misc]
        self._count = 0
        for minute in range(0, 60, 10):
            self.sea.at(60.0 * minute + 5, partial(self._publish, 2, PHOTO, 20_000))
        for at_s in range(10, HOUR_S - 60, 40):
            self.sea.at(at_s, partial(self._publish, 1 + at_s // 40 % 2, NAV, 12))
        self.sea.at(HOUR_S, lambda: None)
        self.sea.run(lambda: self.sea.now >= HOUR_S * NS_PER_S)
        recorder.finish()

    def _publish(self, node: int, stream_id: int, size_bytes: int) -> None:
        self._count += 1
        value = self._count.to_bytes(2, "big") * (size_bytes // 2)
        self.sea.nodes[node].engine.publish(stream_id, value, self.sea.now)

    def _trace(self, node: int, record: TraceRecord) -> None:
        if node not in getattr(self.sea, "nodes", {}):
            return
        if node not in self.logs:
            engine = lambda: self.sea.nodes[node].engine  # noqa: E731
            unix_s = lambda: self.sea.now / NS_PER_S  # noqa: E731
            self.logs[node] = FrameLog(self.sea.table, engine, unix_s=unix_s)
        self.logs[node].note(record)
        self.traffic[node].note(record)
        document: Any = self.logs[node].documents()["channel"]
        for each in document.last:
            self.shown[node][each.way, each.begun_unix_s, id(each)] = each


@pytest.fixture(scope="module")
def hour() -> Hour:
    return Hour()


def test_the_report_books_what_the_ledgers_book(hour: Hour) -> None:
    facts = Facts()
    add_messages(facts, hour.sink.messages)
    figures = figures_of(facts)
    bursts = [each for _, _, each in hour.sea.given if each.service is Service.BULK]
    assert len(bursts) > 100
    booked: dict[int, float] = {}
    for node in figures.nodes:
        stats = hour.sea.nodes[node.node].engine.stats
        assert node.ledger_is_exact
        assert node.airtime_s == pytest.approx(stats.airtime_ns / NS_PER_S)
        for entry in stats.ledger():
            booked[entry.stream_id] = booked.get(entry.stream_id, 0.0) + entry.airtime_ns / NS_PER_S
    for stream in figures.streams:
        assert stream.airtime_s == pytest.approx(booked[stream.stream_id])
    assert all(link.loss == 0.0 for link in figures.links)
    lost = losses_over_time(facts, 30)
    assert set(lost) == {(1, 2), (2, 1)}
    assert {share for row in lost.values() for _, share in row} == {0.0}


def test_the_ladder_and_the_graph_book_what_the_ledgers_book(hour: Hour) -> None:
    for node, other in ((1, 2), (2, 1)):
        own_s = hour.sea.nodes[node].engine.stats.airtime_ns / NS_PER_S
        sent = [each for each in hour.shown[node].values() if each.way == "out"]
        heard = [each for each in hour.shown[other].values() if each.way == "in"]
        assert sum(each.airtime_s for each in sent) == pytest.approx(own_s)
        assert sum(each.airtime_s for each in heard) == pytest.approx(own_s)
        runner: Any = type("Runner", (), {"engine": hour.sea.nodes[other].engine})
        peers: Any = PeerTable(runner, hour.traffic[other]).documents()["peers"]
        (link,) = peers[node].received.values()
        assert link.airtime_s == pytest.approx(own_s, abs=0.002)


def test_a_lean_reading_has_the_same_figures_and_losses(hour: Hour) -> None:
    whole, lean = Facts(), Facts(lean=True)
    for facts in (whole, lean):
        add_messages(facts, hour.sink.messages)
    assert figures_of(lean) == figures_of(whole)
    assert losses_over_time(lean, 30) == losses_over_time(whole, 30)
    assert len(lean.frames) == len(whole.frames)
    assert whole.published
    assert [*lean.published, *lean.arrived, *lean.births] == []
