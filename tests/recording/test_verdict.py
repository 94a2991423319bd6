"""What a report begins with: what was lost, and what was only left out; and hostile names in it."""

from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from tests.hostilenames import HOSTILE, HOSTILE_NAME, assert_harmless, strictly
from tests.recording.memory import recorded
from tests.virtual.fleet import line
from zacoustic.app.cli import main
from zacoustic.app.tools.design.sim.recorder import recorded_to
from zacoustic.app.tools.inspect.recordings.facts.facts import Facts
from zacoustic.app.tools.inspect.recordings.facts.gathering import add_messages
from zacoustic.app.tools.inspect.recordings.report.figures import Figures, figures_of
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

RUN_S = 1200.0
TEXT = HOSTILE.encode()[:40]


def reported(depth: int = 1, **settings: Any) -> Figures:
    """Publish a number every ten seconds, of which one a minute may go, and another topic."""
    table = StreamTable(
        [
            TopicSpec(stream_id=1, name="seldom", qos=Qos(min_interval_s=60.0, depth=depth)),
            TopicSpec(stream_id=2, name="often"),
        ]
    )
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800, **settings), table, build=recorder.make)

    def publish() -> None:
        text = b"%d" % network.now
        network.publish(1, 1, text)
        network.publish(1, 2, text)

    network.every(10.0, publish, first_s=5.0)
    network.run(until_s=RUN_S)
    recorder.finish()
    facts = Facts()
    add_messages(facts, sink.messages)
    return figures_of(facts)


@pytest.mark.parametrize("depth", [1, 3])
def test_what_an_interval_leaves_out_is_no_loss(depth: int) -> None:
    figures = reported(depth)
    seldom, often = figures.streams
    assert seldom.published == often.published == 120
    assert seldom.thinned == pytest.approx(120 - RUN_S / 60 - depth, abs=2)
    # The last ones still wait when the recording ends, and two nodes may speak at once.
    assert seldom.delivered >= seldom.expected - depth - 2
    assert (often.thinned, often.expected) == (0, 120)
    whole = f"seldom: {seldom.thinned} of 120 left out on purpose by min_interval_s"
    assert whole in figures.verdict


@pytest.mark.parametrize("depth", [1, 4])
@pytest.mark.parametrize("period_s", [5.0, 7.0, 60.0, 61.0])
def test_what_still_waits_at_the_end_is_no_loss(depth: int, period_s: float) -> None:
    qos = Qos(min_interval_s=60.0, depth=depth)
    table = StreamTable([TopicSpec(stream_id=1, name="seldom", qos=qos)])
    recorder, sink = recorded()
    network = VirtualNetwork(line(0, 800, channel="none"), table, build=recorder.make)
    network.every(period_s, lambda: network.publish(1, 1, b"%d" % network.now))
    network.run(until_s=RUN_S + 2)
    recorder.finish()
    facts = Facts()
    add_messages(facts, sink.messages)
    (line_of_verdict, *_) = figures_of(facts).verdict
    assert line_of_verdict.startswith("everything arrived"), line_of_verdict


def test_loss_is_told_from_thinning() -> None:
    figures = reported(loss={"frame": 0.4})
    seldom, often = figures.streams
    assert seldom.thinned == pytest.approx(99, abs=3)
    lost = often.expected - often.delivered
    assert 25 < lost < 75
    assert f"often {lost} of 120" in figures.verdict[0]
    assert "did not arrive" in figures.verdict[0]
    assert 0.25 < 1 - seldom.delivered / seldom.expected < 0.75


def trial_of_an_enemy(path: Path) -> None:
    """Record a network whose names and texts want to steer what shows them."""
    table = StreamTable(
        [
            TopicSpec(stream_id=1, name=HOSTILE_NAME),
            TopicSpec(stream_id=2, name="../../../escaped", qos=Qos(depth=4)),
            TopicSpec(stream_id=3, name="_a_", qos=Qos(reliability=Reliability.RELIABLE)),
        ],
        nodes={1: HOSTILE_NAME, 2: ".."},
    )
    with recorded_to(path) as recorder:
        assert recorder is not None
        network = VirtualNetwork(line(0, 800), table, build=recorder.make)
        for stream_id in (1, 2, 3):
            network.at(float(stream_id), partial(network.publish, 1, stream_id, TEXT))
        network.run(until_s=60.0)


def test_hostile_recording_steers_nothing_and_leaves_no_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("matplotlib")
    folder = tmp_path / "a" / "b" / "c"
    folder.mkdir(parents=True)
    monkeypatch.chdir(folder)
    trial = folder / "trial.mcap"
    trial_of_an_enemy(trial)
    for verb in (["decode"], ["report"], ["report", "--html", "page.html"], ["replay", "--check"]):
        assert main([*verb, str(trial)]) == 0
        assert_harmless("".join(capsys.readouterr()))
        if "--html" not in verb:
            assert main([*verb, str(trial), "--json"]) == 0
            for shown in capsys.readouterr().out.splitlines():
                assert_harmless(shown)
                strictly(shown)
    found = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()}
    assert found == {"a/b/c/trial.mcap", "a/b/c/page.html"}
    page = (folder / "page.html").read_text(encoding="utf-8")
    tags: set[str] = set()
    attributes: set[str] = set()

    class Reader(HTMLParser):
        def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
            tags.add(tag)
            attributes.update(name for name, _ in attrs)

    Reader().feed(page)
    assert "script" not in tags
    assert not [name for name in attributes if name.startswith("on")]
    assert "\x1b" not in page
    assert "\u202e" not in page


def test_plots_take_the_colours_of_the_page() -> None:
    pytest.importorskip("matplotlib")
    from zacoustic.app.tools.inspect.recordings.report.plots import plots_of

    recorder, sink = recorded()
    network = VirtualNetwork(
        line(0, 800), StreamTable([TopicSpec(stream_id=1, name="a")]), build=recorder.make
    )
    network.every(5.0, lambda: network.publish(1, 1, b"%d" % network.now))
    network.run(until_s=60.0)
    recorder.finish()
    facts = Facts()
    add_messages(facts, sink.messages)
    drawn = "".join(plot.svg for plot in plots_of(facts, figures_of(facts)))
    assert "currentColor" in drawn
    for ink in ("#000000", "#010203", "#ffffff", "fill: white", "fill: black"):
        assert ink not in drawn
