"""Recordings of any length: memory of a report does not grow with them, and its figures are exact.

A long recording is a short one again and again: each time the nodes boot, at a later instant.
"""

import gc
import tracemalloc
from collections import Counter
from collections.abc import Callable, Iterator

import msgspec
import pytest

from tests.recording.memory import recorded
from tests.recording.test_exact import run_survey, survey
from tests.virtual.fleet import line
from zacoustic.app.tools.inspect.recordings.facts import rows
from zacoustic.app.tools.inspect.recordings.facts.facts import Delivery, Facts, Sample
from zacoustic.app.tools.inspect.recordings.facts.gathering import add_messages
from zacoustic.app.tools.inspect.recordings.report.figures import Figures, figures_of
from zacoustic.app.tools.inspect.recordings.report.linkfigures import losses_over_time
from zacoustic.app.tools.inspect.recordings.report.thinning import left_out
from zacoustic.core.base.qos import Qos
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.run.recording.reading import ReadMessage
from zacoustic.testing.virtual import VirtualNetwork

SHORT_S = 600
BYTES_OF_A_SAMPLE = 10
OF_THE_GROWTH = 0.02
"""Memory that a byte of messages may cost; on the disk they are compressed to a fifth."""


@pytest.fixture(scope="module")
def short() -> list[ReadMessage]:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800, 1500, loss={"frame": 0.1}), survey(), build=recorder.make)
    run_survey(network, until_s=SHORT_S)
    recorder.finish()
    return sink.messages


def again(messages: list[ReadMessage], times: int) -> Iterator[ReadMessage]:
    """Yield messages several times, one after the other, and none of them is kept."""
    for number in range(times):
        later_ns = number * SHORT_S * NS_PER_S
        for message in messages:
            data = message.data
            if message.topic.endswith("/engine") and b"life" in data[:8]:
                written = msgspec.msgpack.decode(data)
                written["life"]["utc_offset_ns"] += later_ns
                data = msgspec.msgpack.encode(written)
            yield msgspec.structs.replace(message, utc_ns=message.utc_ns + later_ns, data=data)


def reported(messages: Iterator[ReadMessage]) -> tuple[Figures, object]:
    """Return everything that a page shows."""
    facts = Facts(lean=True)
    add_messages(facts, messages)
    return figures_of(facts), losses_over_time(facts, 30)


def peak_of(work: Callable[..., object], *arguments: object) -> int:
    """Return the most memory that a work has used at once, bytes."""
    gc.collect()
    tracemalloc.start()
    try:
        work(*arguments)
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_report_of_four_times_as_much_takes_no_more_memory(
    short: list[ReadMessage], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rows, "BLOCK_BYTES", rows.BLOCK_BYTES // 8)
    monkeypatch.setattr(rows, "RUN_ROWS", rows.RUN_ROWS // 8)
    reported(again(short, 1))  # what is cached for good
    few, many = (peak_of(reported, again(short, times)) for times in (3, 12))
    more_bytes = 9 * sum(len(message.data) for message in short)
    assert many - few < OF_THE_GROWTH * more_bytes


@pytest.mark.parametrize(("period_s", "each"), [(10, 1), (1, 10), (1, 20), (1, 10_000)])
def test_thinned_topic_takes_no_more_memory_whether_its_samples_arrive_or_not(
    monkeypatch: pytest.MonkeyPatch, period_s: int, each: int
) -> None:
    monkeypatch.setattr(rows, "BLOCK_BYTES", rows.BLOCK_BYTES // 8)
    monkeypatch.setattr(rows, "RUN_ROWS", rows.RUN_ROWS // 8)
    few, many = (peak_of(thinned, count, period_s, each) for count in (2000, 8000))
    assert many - few < 6000 * BYTES_OF_A_SAMPLE


def thinned(count: int, period_s: int, each: int) -> None:
    """Find what was left out of a regular topic; one sample of so many arrives."""
    facts = Facts()
    spec = TopicSpec(stream_id=1, name="seldom", qos=Qos(min_interval_s=10.0))
    facts.streams[1] = StreamTable([spec]).by_id(1)
    facts.ended_ns = count * period_s * NS_PER_S
    for number in range(count):
        at_ns = number * period_s * NS_PER_S
        facts.samples.append(Sample(b"place", b"", at_ns, False, number, 1, 1, 1))
        if number % each == 0:
            facts.deliveries.append(Delivery(number, at_ns + NS_PER_S, 0, 1, at_ns, 1, b"place"))
    share = Counter(left_out(facts))[1, 1] / count
    assert share == pytest.approx(1 - period_s / 10, abs=0.1)


def test_figures_do_not_depend_on_what_is_in_memory(
    short: list[ReadMessage], monkeypatch: pytest.MonkeyPatch
) -> None:
    expected = reported(again(short, 3))
    assert sum(stream.delivered for stream in expected[0].streams) > 500
    monkeypatch.setattr(rows, "BLOCK_BYTES", 1)
    monkeypatch.setattr(rows, "MERGED_BYTES", 1)
    monkeypatch.setattr(rows, "RUN_ROWS", 50)
    assert reported(again(short, 3)) == expected
