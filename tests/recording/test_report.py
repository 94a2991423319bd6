"""Figures of recordings: those of the simulation that made them; and their page."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import msgspec
import pytest

from tests.recording.memory import recorded
from tests.recording.smalltrial import CHANNEL, FLEET
from tests.recording.test_exact import measure, run_survey, survey
from tests.virtual.fleet import line
from zacoustic.app.cli import main
from zacoustic.app.tools.design.sim.recorder import recorded_to
from zacoustic.app.tools.design.sim.simulation import simulate
from zacoustic.app.tools.inspect.recordings.facts.facts import Facts
from zacoustic.app.tools.inspect.recordings.facts.gathering import add_messages, gather
from zacoustic.app.tools.inspect.recordings.report.figures import Figures, figures_of
from zacoustic.app.tools.inspect.recordings.report.linkfigures import losses_over_time
from zacoustic.app.tools.inspect.recordings.report.plots import plots_of
from zacoustic.app.tools.inspect.recordings.report.reporttext import as_text
from zacoustic.app.tools.inspect.recordings.report.spread import spread_of
from zacoustic.app.tools.inspect.recordings.whatif.measuredchannel import measure_channel
from zacoustic.core.linktypes import LinkMetrics
from zacoustic.testing.virtual import Modem, VirtualNetwork


@pytest.fixture
def channel(tmp_path: Path) -> Path:
    (tmp_path / "water.json5").write_text(CHANNEL, encoding="utf-8")
    (tmp_path / "fleet.json5").write_text(FLEET, encoding="utf-8")
    return tmp_path / "water.json5"


@pytest.fixture
def trial(channel: Path) -> Path:
    path = channel.with_name("trial.mcap")
    assert main(["sim", str(channel), "--until", "300", "--record", str(path)]) == 0
    return path


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_figures_are_those_of_the_simulation(channel: Path, seed: int) -> None:
    path = channel.with_name("trial.mcap")
    with recorded_to(path) as recorder:
        told = simulate(channel, seed=seed, until_s=1800, record=recorder)
    found = figures_of(gather([path]))
    assert [each.name for each in found.streams] == ["auv1/nav", "auv1/raw", "auv1/arm"]
    for stream, expected in zip(found.streams, told.streams, strict=True):
        assert stream.published == expected.published
        assert stream.refused == expected.refused
        assert stream.failed == expected.failed
        assert stream.transmitted_bytes == expected.transmitted_bytes
        if stream.name != "auv1/nav":  # the same value again and again
            assert stream.delivered == expected.delivered
            assert stream.latency_s is not None
            assert stream.latency_s.p50 == pytest.approx(expected.p50_s, abs=1e-6)
            assert stream.latency_s.p95 == pytest.approx(expected.p95_s, abs=1e-6)
    assert sum(node.frames for node in found.nodes) == told.frames
    assert sum(node.frame_bytes for node in found.nodes) == told.transmitted_bytes
    assert sum(node.airtime_s for node in found.nodes) == pytest.approx(told.airtime_s)
    lost = sum((each.sent or 0) - each.heard for each in found.links)
    on_their_way = 2  # both nodes speak in the last instant
    assert lost - on_their_way <= sum(told.losses.values()) <= lost
    assert all(node.ledger_is_exact for node in found.nodes)
    assert found.notes == []


def test_a_simulation_writes_no_other_file_than_it_was_told(
    channel: Path, trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = sorted(channel.parent.iterdir())
    assert main(["sim", str(channel), "--until", "60", "--record", str(trial)]) == 2
    assert "exists; allowed: a new file" in capsys.readouterr().err
    assert sorted(channel.parent.iterdir()) == before


def test_recordings_of_both_ends_are_put_together(tmp_path: Path) -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800, 1500, loss={"frame": 0.2}), survey(), build=recorder.make)
    run_survey(network, until_s=600)
    recorder.finish()
    whole, parts, one = Facts(), Facts(), Facts()
    add_messages(whole, sink.messages)
    for node in (1, 2, 3):
        add_messages(parts, [each for each in sink.messages if each.topic[1] == str(node)])
    add_messages(one, [each for each in sink.messages if each.topic[1] == "1"])
    expected, found = figures_of(whole), figures_of(parts)
    assert found.streams == expected.streams
    assert found.links == expected.links
    (nav,) = [each for each in found.streams if each.name == "{node}/nav"]
    assert 0.5 < nav.delivered / nav.expected < 1
    assert nav.age_s is not None
    alone = figures_of(one)
    (nav,) = [each for each in alone.streams if each.name == "{node}/nav"]
    assert (nav.expected, nav.delivered) == (0, 0)
    assert nav.arrived > 10
    assert "node 2, 3 is not recorded" in alone.notes[0]
    assert alone.links[0].sent is None


def test_a_ledger_that_is_not_that_of_the_frames_is_said() -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800), survey(), build=recorder.make)
    network.publish(2, 4, b"a log")
    network.run(until_s=60)
    recorder.finish()
    facts = Facts()
    lost = next(each for each in sink.of("/2/frames"))
    add_messages(facts, [each for each in sink.messages if each is not lost])
    figures = figures_of(facts)
    assert [node.ledger_is_exact for node in figures.nodes] == [True, False]
    assert "something of it is not in the recording" in figures.notes[0]


def test_a_recording_that_ends_early_is_held_against_its_last_ledger() -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800), survey(), build=recorder.make)
    run_survey(network, until_s=300)
    facts = Facts()
    last = max(at for at, each in enumerate(sink.messages) if b'"direction":"sent"' in each.data)
    add_messages(facts, sink.messages[: last + 1])
    nodes = figures_of(facts).nodes
    assert [node.ledger_is_exact for node in nodes] == [True, True]
    assert sum(node.frame_bytes - (node.covered_bytes or 0) for node in nodes) > 0


def test_what_modems_measure_besides_frames_is_in_the_figures_and_on_the_channel() -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800), survey(), build=recorder.make)
    for number, range_m in enumerate((600.0, 610.0, 620.0)):
        metrics = LinkMetrics(range_m=range_m, propagation_s=range_m / 1500)
        measure(network, 20.0 * number, 1, 2, metrics)
    run_survey(network, until_s=100)
    facts = Facts()
    recorder.finish()
    add_messages(facts, sink.messages)
    link = next(each for each in figures_of(facts).links if (each.source, each.node) == (2, 1))
    assert link.range_m is not None
    assert (link.range_m.count, link.range_m.p50) == (3, 610.0)
    assert "range 50 %, m" in as_text(figures_of(facts))
    facts = Facts()  # without frames, on which these modems measure delays, and many do not
    add_messages(facts, [each for each in sink.messages if not each.topic.endswith("/frames")])
    places = [node.position for node in measure_channel(facts, seed=1).scenario.nodes]
    assert places == [(0.0, 0.0, 10.0), (pytest.approx(610.0), 0.0, 10.0)]


def test_nobody_is_blamed_for_what_is_sent_when_the_other_end_is_not_recorded() -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800), survey(), build=recorder.make)
    network.at(150.0, lambda: network.crash(2))
    run_survey(network, until_s=500)
    recorder.finish()
    facts = Facts()
    add_messages(facts, sink.messages)
    link = next(each for each in figures_of(facts).links if (each.source, each.node) == (1, 2))
    assert link.loss is not None
    assert link.loss < 0.3  # half of all frames are sent when nobody hears
    assert figures_of(facts).nodes[0].frames > 2 * (link.sent or 0)
    assert measure_channel(facts, seed=1).losses["1 to 2"] < 0.2


def test_links_without_addresses_have_figures_as_well() -> None:
    recorder, sink = recorded()
    modem = Modem(addressed=False, checked=False)
    network = VirtualNetwork(line(0, 800), survey(), modem=modem, build=recorder.make)
    run_survey(network, until_s=300)
    facts = Facts()
    add_messages(facts, sink.messages)
    assert {(each.source, each.node) for each in figures_of(facts).links} == {(1, 2), (2, 1)}


def test_link_on_which_nothing_ever_arrives_loses_all() -> None:
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800, 90_000), survey(), build=recorder.make)
    run_survey(network, until_s=300)
    recorder.finish()
    facts = Facts()
    add_messages(facts, sink.messages)
    lost = losses_over_time(facts, 10)
    assert {share for _, share in lost[1, 3]} == {1.0}
    assert min(share for _, share in lost[1, 2]) < 1.0


def test_spreads_are_of_all_numbers() -> None:
    assert spread_of([]) is None
    one = spread_of([2.0])
    assert one is not None
    assert (one.p50, one.p95, one.mean) == (2.0, 2.0, 2.0)
    many = spread_of([float(number) for number in range(100, 0, -1)])
    assert many is not None
    assert (many.least, many.p50, many.p95, many.greatest) == (1, 51, 96, 100)


class _Page(HTMLParser):
    """Finds what a page would load from elsewhere, and whether its elements are closed."""

    def __init__(self) -> None:
        super().__init__()
        self.loads: list[str] = []
        self.open: list[str] = []
        self.count: dict[str, int] = {}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.count[tag] = self.count.get(tag, 0) + 1
        if tag not in ("meta",):
            self.open.append(tag)
        for name, value in attrs:
            local = value is None or value.startswith("#") or name.startswith("xmlns")
            if name in ("src", "href", "xlink:href", "data") and not local:
                self.loads.append(str(value))

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        if self.open and self.open[-1] == tag:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_needs_nothing_from_elsewhere(
    trial: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = trial.with_suffix(".html")
    capsys.readouterr()
    assert main(["report", str(trial), "--html", str(page)]) == 0
    said = capsys.readouterr().out
    assert "channel in use" in said
    assert "exact" in said
    text = page.read_text(encoding="utf-8")
    parsed = _Page()
    parsed.feed(text)
    assert parsed.loads == []
    assert parsed.open == []
    assert "@import" not in text
    assert "url(http" not in text
    assert parsed.count["table"] == 3
    assert parsed.count["svg"] == 8
    assert text.count("auv1/nav") > 3
    ids = re.findall(r'<svg[^>]*viewBox="([^"]*)"', text)
    assert len(ids) == 8
    facts = gather([trial])
    assert all(plot.svg in text for plot in plots_of(facts, figures_of(facts))), "the same again"


def test_names_from_a_recording_are_text_on_the_page(tmp_path: Path) -> None:
    from zacoustic.app.tools.inspect.recordings.report.page import as_page

    figures = Figures(
        files=[], began_utc_ns=0, duration_s=1, utilisation=0, streams=[], nodes=[], links=[],
        notes=["<script>alert(1)</script>"],
    )  # fmt: skip
    page = as_page(figures, [], title="<b>&")
    assert "<script>" not in page
    assert "&lt;b&gt;&amp;" in page


def test_json_has_everything(trial: Path, capsys: pytest.CaptureFixture[str]) -> None:
    capsys.readouterr()
    assert main(["report", str(trial), "--json"]) == 0
    found = msgspec.convert(json.loads(capsys.readouterr().out), Figures)
    assert found == figures_of(gather([trial]))
    assert found.files == [str(trial)]
