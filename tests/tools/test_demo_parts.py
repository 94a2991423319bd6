"""The parts of the demo that need no water: lanes, logbook, verdict, views, files, processes."""

import asyncio
import io
import json
import re
import socket
import sys
from pathlib import Path
from typing import Any

import pytest

from zacoustic.app.tools.demo.children import Child, ChildDiedError
from zacoustic.app.tools.demo.logbook import Logbook
from zacoustic.app.tools.demo.networks import (
    NAMES,
    SHORE,
    VEHICLE,
    demo_text,
    free_ports,
    write_networks,
)
from zacoustic.app.tools.demo.verdict import as_text, summary_of
from zacoustic.app.tools.demo.views import JsonView, LinesView, View
from zacoustic.config import read_config
from zacoustic.core.streams.table import StreamTable

NAV = {"count": 0, "lat": 43.1, "lon": 5.9, "depth": 12.34, "heading": 0.0}


class Hand:
    """A clock that is set by hand, s."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def table(tmp_path: Path) -> StreamTable:
    return read_config(write_networks(tmp_path, "sim/127.0.0.1:9")[SHORE].file).table


@pytest.fixture
def clock() -> Hand:
    return Hand()


@pytest.fixture
def logbook(table: StreamTable, clock: Hand) -> Logbook:
    book = Logbook(table, clock, propagation_s=0.667)
    book.began_at = clock.now_s
    return book


def put(count: int, at: float, value: dict[str, Any] = NAV) -> dict[str, Any]:
    return {"event": "put", "key": "auv1/nav", "count": count, "at": at, "value": value}


def received(count: int, at: float, value: dict[str, Any]) -> dict[str, Any]:
    return {**put(count, at, value), "event": "received"}


def everything(logbook: Logbook) -> None:
    """Let everything of the demo cross once."""
    rounded = {**NAV, "depth": 12.3}
    status = {"count": 0, "battery": 87.5, "mode": "idle", "leak": False}
    waypoint = {"count": 0, "lat": 43.0, "lon": 6.0, "depth": 20.0}
    arm: dict[str, Any] = {"key": "auv1/arm", "count": 0}
    frame = {"source": 2, "sequence": 0, "frame_bytes": 31}
    told: list[tuple[str, dict[str, Any]]] = [
        ("vehicle", put(0, 100.0)),
        ("vehicle", {**put(0, 100.0, status), "key": "fleet/auv1/status"}),
        ("medium", {"event": "emission", **frame, "airtime_s": 0.494}),
        ("medium", {"event": "reception", **frame, "node": 1, "outcome": "received",
                    "propagation_s": 0.667}),
        ("console", received(0, 101.2, rounded)),
        ("console", {**received(0, 101.2, status), "key": "fleet/auv1/status"}),
        ("console", {**put(0, 102.0, waypoint), "key": "auv1/waypoint"}),
        ("vehicle", {**received(0, 103.0, waypoint), "key": "auv1/waypoint"}),
        ("console", {"event": "call", "at": 104.0, "value": {"armed": True}, **arm}),
        ("vehicle", {"event": "served", "at": 105.0, "value": {"armed": True},
                     "answer": {"armed": True, "volts": 29.4}, **arm}),
        ("console", {"event": "answer", "at": 106.0, "value": {"armed": True, "volts": 29.4},
                     **arm}),
        ("vehicle", {"event": "done", "at": 107.0}),
        ("console", {"event": "done", "at": 107.0}),
    ]  # fmt: skip
    for child, line in told:
        logbook.take(child, line)


def test_a_run_in_which_everything_crossed_is_ok(logbook: Logbook) -> None:
    everything(logbook)
    logbook.take_ledger(VEHICLE, {10: 20, 11: 6, 20: 5, 0: 8})
    summary = summary_of(logbook)
    assert summary.missing == ()
    assert summary.ok
    assert logbook.has_all_crossed
    nav = summary.streams[0]
    assert (nav.stream, nav.sent, nav.crossed, nav.transmitted_bytes) == ("auv1/nav", 1, 1, 20)
    assert nav.mean_delay_s == pytest.approx(1.2)
    assert nav.airtime_share == pytest.approx(20 / 31, abs=1e-3)
    assert summary.overhead_bytes == 8
    assert [lane.mean_delay_s for lane in summary.streams[3:]] == [1.0, 1.0]
    assert "everything crossed" in as_text(summary)


def test_what_crossed_is_told_with_the_frame_that_carried_it(logbook: Logbook) -> None:
    everything(logbook)
    assert [note.stream for note in logbook.frames[0].carried] == [
        "auv1/nav",
        "fleet/{node}/status",
    ]


def test_a_sample_that_did_not_cross_is_missing_by_name_and_number(logbook: Logbook) -> None:
    everything(logbook)
    logbook.take("vehicle", put(1, 108.0))
    summary = summary_of(logbook)
    assert not summary.ok
    assert summary.missing == ("auv1/nav from auv1: 1 of 2 did not cross (number 1)",)


@pytest.mark.parametrize(
    ("count", "value", "fault"),
    [
        (0, {**NAV, "depth": 12.3}, "number 0 arrived twice"),
        (5, {**NAV, "depth": 12.3}, "number 5 arrived and was never sent"),
        (1, {**NAV, "depth": 99.9}, "number 1 arrived as"),
    ],
)
def test_what_arrives_twice_changed_or_unsent_is_a_fault(
    count: int, value: dict[str, Any], fault: str, logbook: Logbook
) -> None:
    everything(logbook)
    logbook.take("vehicle", put(1, 108.0))
    logbook.take("console", received(count, 109.0, value))
    assert any(fault in line for line in summary_of(logbook).missing)


def test_a_process_that_died_is_the_only_thing_missing_before_the_start(
    table: StreamTable, clock: Hand
) -> None:
    summary = summary_of(Logbook(table, clock, propagation_s=0.667), ("medium ended with code 1",))
    assert summary.missing == ("medium ended with code 1",)
    assert not summary.ok


def test_a_best_effort_sample_whose_frame_was_lost_is_told_and_no_failure(
    logbook: Logbook,
) -> None:
    everything(logbook)
    logbook.take("vehicle", put(1, 108.0))
    for source in (1, 2):  # what the other network lost explains nothing
        assert not summary_of(logbook).ok
        frame = {"source": source, "sequence": 1, "frame_bytes": 12}
        logbook.take("medium", {"event": "emission", **frame, "airtime_s": 0.2})
        logbook.take("medium", {"event": "reception", **frame, "node": 3 - source,
                                "outcome": "collision", "propagation_s": 0.667})  # fmt: skip
    summary = summary_of(logbook)
    assert summary.ok
    assert summary.lost == ("auv1/nav from auv1: 1 of 2 did not cross (number 1)",)
    assert "everything else crossed" in as_text(summary)


def test_a_lost_frame_alone_is_no_failure(logbook: Logbook, clock: Hand) -> None:
    everything(logbook)
    frame = {"source": 2, "sequence": 1, "frame_bytes": 4}
    logbook.take("medium", {"event": "emission", **frame, "airtime_s": 0.2})
    assert len(logbook.on_the_channel()) == 1
    clock.now_s += 1.0
    logbook.take("medium", {"event": "reception", **frame, "node": 1, "outcome": "half_duplex",
                            "propagation_s": 0.667})  # fmt: skip
    summary = summary_of(logbook)
    assert summary.ok
    assert (summary.frames, summary.lost_frames) == (2, 1)


@pytest.mark.parametrize("view", [LinesView(), JsonView()])
def test_views_write_a_line_for_each_note_and_the_summary_last(
    view: View, logbook: Logbook, capsys: pytest.CaptureFixture[str]
) -> None:
    view.begin(logbook)
    for note in logbook.take("vehicle", put(0, 100.5)):
        view.note(note)
    view.tick()
    view.stop()
    view.conclude(summary_of(logbook))
    lines = capsys.readouterr().out.splitlines()
    if isinstance(view, JsonView):
        first, last = (json.loads(line) for line in lines)
        assert first == {"event": "sent", "at_s": 0.5, "stream": "auv1/nav", "source": 2,
                         "count": 0, "value": NAV}  # fmt: skip
        assert last["event"] == "summary"
        assert last["ok"] is False
    else:
        assert lines[0].startswith("   0.50 s  auv1: auv1/nav 0 is to cross: lat 43.1")
        assert lines[-1] == "not everything crossed"


def test_the_live_view_draws_and_saves_its_picture(logbook: Logbook) -> None:
    rich_console = pytest.importorskip("rich.console")
    from zacoustic.app.tools.demo.live import LiveView

    console = rich_console.Console(width=120, height=40, force_terminal=True, record=True)
    drawn = io.BytesIO()
    view = LiveView(console=console, screenshot=drawn, title="the title")
    view.begin(logbook)
    everything(logbook)
    view.tick()
    view.stop()
    view.conclude(summary_of(logbook))
    shown = console.export_text()
    for part in ("the title", "in the water now", "auv1/nav", "everything crossed"):
        assert part in shown
    picture = drawn.getvalue().decode()
    assert picture.startswith("<svg")
    assert "url(http" not in picture.replace('"', "")


def test_the_live_view_shows_its_table_on_a_terminal_of_80_by_24(logbook: Logbook) -> None:
    rich_console = pytest.importorskip("rich.console")
    from zacoustic.app.tools.demo.live import LiveView

    screen = io.StringIO()
    console = rich_console.Console(
        width=80, height=24, force_terminal=True, file=screen, color_system=None
    )
    view = LiveView(console=console, title="the title, which is longer than it ought to be " * 2)
    view.begin(logbook)
    for _ in range(3):
        everything(logbook)
    view.tick()
    view.stop()
    drawn = re.split(r"[\r\n]+", re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", screen.getvalue()))
    last = max(index for index, line in enumerate(drawn) if line.startswith("the title"))
    shown = drawn[last:]
    assert max(map(len, shown)) <= 80
    assert len(shown) <= 24
    for part in ("in the water now", "what it carried", "crossed", "mean delay"):
        assert any(part in line for line in shown)
    assert any(line.strip().startswith("auv1/nav  ") for line in shown)


def test_each_local_network_has_the_same_streams_and_a_port_of_its_own(tmp_path: Path) -> None:
    networks = write_networks(tmp_path, "sim/127.0.0.1:4711")
    configs = {
        address: read_config(local_network.file) for address, local_network in networks.items()
    }
    assert {address: config.address for address, config in configs.items()} == {1: 1, 2: 2}
    assert len({config.table.digest for config in configs.values()}) == 1
    assert len({local_network.endpoint for local_network in networks.values()}) == 2
    assert {config.links[0].locator for config in configs.values()} == {"sim/127.0.0.1:4711"}
    assert {config.name for config in configs.values()} == set(NAMES.values())
    for local_network in networks.values():
        assert local_network.endpoint in local_network.file.read_text(encoding="utf-8")


def test_the_clients_of_the_demo_are_plain_zenoh_programs() -> None:
    for name in ("vehicle.py", "console.py"):
        assert "zacoustic" not in "".join(
            line for line in demo_text(name).splitlines() if "import" in line.split()
        )


def test_free_ports_are_others_each_time_and_none_that_a_connection_could_take() -> None:
    found = [*free_ports(8), *free_ports(8)]
    assert len(set(found)) == 16
    assert max(found) < 32_768  # where Linux begins with those of connections
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", found[-1] + 1))
        assert found[-1] + 1 not in free_ports(8)


def test_a_child_that_dies_is_told_with_the_end_of_its_stderr() -> None:
    async def run() -> None:
        program = "import sys; print('no JSON'); sys.exit('the reason')"
        child = Child("medium", [sys.executable, "-c", program], lambda name, told: None)
        await child.start()
        try:
            await child.watch()
        finally:
            await child.stop()

    with pytest.raises(ChildDiedError, match=r"^medium ended with code 1: the reason$"):
        asyncio.run(run())


def test_a_child_tells_by_lines_and_ends_with_its_input() -> None:
    told: list[tuple[str, object]] = []

    async def run() -> int | None:
        heard = asyncio.Event()

        def hear(name: str, line: dict[str, Any]) -> None:
            told.append((name, line["event"]))
            heard.set()

        program = (
            "import json, sys\n"
            "for line in sys.stdin: print(json.dumps({'event': line.strip()}), flush=True)"
        )
        child = Child("vehicle", [sys.executable, "-c", program], hear, reads_input=True)
        await child.start()
        child.tell("go")
        await heard.wait()
        await child.stop()
        await child.stop()
        return child.exit_code

    assert asyncio.run(run()) == 0
    assert told == [("vehicle", "go")]


def test_a_child_that_cannot_be_started_says_so() -> None:
    child = Child("medium", ["/nowhere/at/all"], lambda name, told: None)
    with pytest.raises(ChildDiedError, match="cannot be started"):
        asyncio.run(child.start())
