"""The page of `zacoustic dashboard` in this process, without a browser, and what it draws."""

import asyncio
import re
from typing import Any

import msgspec
import pytest

pytest.importorskip("nicegui")

from tests.tools.boards import NOW_S, WAYS, fleet_board, full_board, full_view, line_board, put
from zacoustic.app.tools.pages.truth import Alarm
from zacoustic.app.tools.watch.crowd import MOST_GATEWAYS, MOST_STREAMS, MOST_TROUBLED
from zacoustic.app.tools.watch.drawing import (
    cause_bars,
    event_lines,
    figure,
    load_chart,
    transfer_bars,
)
from zacoustic.app.tools.watch.history import SPAN_S, STEP_S, History, Point
from zacoustic.app.tools.watch.lookout import Lookout
from zacoustic.app.tools.watch.page import Page, frame_rows, peer_row, stream_row
from zacoustic.app.tools.watch.views import GatewayView
from zacoustic.app.tools.watch.words import alarm_of, troubled_first
from zacoustic.errors import SessionError


def lookout(node: int | None = None) -> Lookout:
    def make() -> Any:
        raise AssertionError("it is not run here")

    return Lookout(make, "tcp/h:7447", node)


def test_page_shows_what_there_is_and_what_comes_later() -> None:
    from nicegui import ui
    from nicegui.testing.user_simulation import user_simulation

    shown = lookout()
    pages: list[Page] = []

    async def visit() -> None:
        async with user_simulation(lambda: pages.append(Page(shown))) as user:
            await user.open("/")
            await user.should_see("connecting")
            shown.trouble = "no Zenoh router at tcp/h:7447"
            pages[0].refresh()
            await user.should_see("no Zenoh router at tcp/h:7447")
            shown.board, shown.trouble = full_board(), ""
            shown.note()
            pages[0].refresh()
            await user.should_see("1 gateway on tcp/h:7447")
            await user.should_see("2 auv1")
            await user.should_see("link up")
            table: Any = next(iter(user.find(marker="streams", kind=ui.table).elements))
            assert [row["name"] for row in table.rows] == ["auv1/cmd", "odd", "auv1/nav"]
            quiet: Any = next(iter(user.find(marker="quiet", kind=ui.checkbox).elements))
            quiet.value = True
            pages[0].refresh()
            assert [row["name"] for row in table.rows][3] == "quiet"
            events: Any = next(iter(user.find(marker="events", kind=ui.html).elements))
            assert "lost 3 buoy" in events.content
            put(shown.board, "link", {"state": "down", "detail": "no answer"})
            put(shown.board, "link", {"state": "up"}, address=7)
            put(shown.board, "streams", {}, address=7)
            pages[0].refresh()
            await user.should_see("2 gateways on tcp/h:7447")
            await user.should_see("link down, no answer")

    asyncio.run(visit())


def test_a_fleet_of_forty_is_one_page_with_what_fails_on_top() -> None:
    from nicegui import ui
    from nicegui.testing.user_simulation import user_simulation

    shown = lookout()
    shown.board, shown.trouble = fleet_board(), ""
    shown.note()
    pages: list[Page] = []

    async def visit() -> None:
        async with user_simulation(lambda: pages.append(Page(shown))) as user:
            await user.open("/")
            await user.should_see("40 gateways on tcp/h:7447")

            def marked(name: str, kind: Any) -> list[Any]:
                found = user.find(marker=name, kind=kind).elements
                return sorted(found, key=lambda each: each.id)

            states = [each.text for each in marked("state", ui.badge)]
            assert len(states) == MOST_GATEWAYS
            assert states[0] == "link down"
            peers = [[row["node"] for row in each.rows] for each in marked("peers", ui.table)]
            assert peers[0] == []
            assert peers[1] == ["30 auv30", "40 auv40"]
            said = [each.text for each in marked("more peers", ui.label)]
            assert said[1] == "well: 37 nodes, each heard in the last 39 s"
            streams = marked("streams", ui.table)
            assert streams[0].rows[0]["name"] == "auv175/report"
            assert {len(each.rows) for each in streams} == {MOST_STREAMS}
            assert marked("more streams", ui.label)[0].text == "and 135 streams"
            assert marked("rest", ui.label)[0].text.startswith("and 34 gateways, all well")
            rows = sum(len(each.rows) for each in user.find(kind=ui.table).elements)
            assert rows <= MOST_GATEWAYS * (MOST_STREAMS + MOST_TROUBLED + 10)
            for box in marked("all nodes", ui.checkbox):
                box.value = True
            pages[0].refresh()
            assert len(marked("peers", ui.table)[1].rows) == 39
            for address in range(1, 41):
                put(shown.board, "link", {"state": "down"}, address)
            pages[0].refresh()
            assert len(marked("state", ui.badge)) == MOST_GATEWAYS
            assert len(marked("gateways", ui.table)[0].rows) == MOST_TROUBLED
            said = [each.text for each in marked("rest", ui.label)]
            assert said[0].startswith("and 10 gateways, 10 of them with troubles")

    asyncio.run(visit())
    alarm = alarm_of(shown.board.views(), "")
    assert alarm is not None
    assert alarm.text.endswith("and 36 more")
    assert len(alarm.text) < 200


def test_network_is_on_top_and_closed_while_a_gateway_is_alone() -> None:
    from nicegui import ui
    from nicegui.testing.user_simulation import user_simulation

    shown = lookout()
    pages: list[Page] = []

    async def visit() -> None:
        async with user_simulation(lambda: pages.append(Page(shown))) as user:
            await user.open("/")
            shown.board, shown.trouble = full_board(peers={}), ""
            pages[0].refresh()
            network: Any = next(iter(user.find(marker="network", kind=ui.expansion).elements))
            assert network.value is False
            for name, document in WAYS.items():
                put(shown.board, name, document)
            pages[0].refresh()
            pages[0].refresh_graph()
            assert network.value is True
            graph: Any = next(iter(user.find(marker="graph", kind=ui.html).elements))
            assert graph.content.startswith('<svg role="img" aria-label="Network: 5 nodes;')
            network.value = False  # the reader closes it, and it stays closed
            pages[0].refresh_graph()
            assert network.value is False
            bonds: Any = next(iter(user.find(marker="bonds", kind=ui.table).elements))
            assert [row["by"] for row in bonds.rows] == ["radio", "radio, in doubt", "no link"]
            carried: Any = next(iter(user.find(marker="carried", kind=ui.table).elements))
            assert [row["topic"] for row in carried.rows] == ["auv1/log", "buoy/log"]
            links: Any = next(iter(user.find(marker="links", kind=ui.table).elements))
            assert [row["link"] for row in links.rows] == ["acoustic", "radio"]
            figures: Any = next(iter(user.find(marker="figures", kind=ui.html).elements))
            assert "3 of its own wait, 2 of them in custody, 12 of others" in figures.content
            shown.board = line_board()
            pages[0].refresh()
            await user.should_see("5 gateways on tcp/h:7447")
            assert "worst hop 3→2: 4.2 transmissions for each frame" in graph.content

    asyncio.run(visit())


def test_page_of_one_gateway_leaves_the_others_out() -> None:
    shown = lookout(7)
    shown.board = full_board()
    assert shown.addresses() == []
    put(shown.board, "link", {"state": "up"}, address=7)
    put(shown.board, "streams", {}, address=7)
    assert shown.addresses() == [7]


def test_lookout_says_that_there_is_no_router_and_tries_again(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    attempts = 0

    async def scene() -> None:
        twice = asyncio.Event()

        def make() -> Any:
            nonlocal attempts
            attempts += 1
            if attempts > 1:
                twice.set()
            raise SessionError("no Zenoh router at tcp/h:1")

        monkeypatch.setattr("zacoustic.app.tools.watch.lookout.RETRY_S", 0.0)
        shown = Lookout(make, "tcp/h:1")
        task = asyncio.create_task(shown.run())
        await twice.wait()
        assert shown.trouble == "no Zenoh router at tcp/h:1"
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(scene())


def test_rows_say_what_is_wrong() -> None:
    view = full_view()
    nav, cmd, _, odd = (stream_row(each) for each in view.streams)
    assert (nav["sent"], nav["sent_rate"], nav["heard"], nav["waiting"]) == ("20", "2/min", "", "2")
    assert (cmd["age"], cmd["trouble"]) == ("62 s", "late 4 times")
    assert odd["trouble"] == "differs at 1: stopped"
    shore, buoy = (peer_row(each) for each in view.peers)
    assert (shore["lost"], shore["range"]) == ("25.0 % of 8 !", "1512 m, 3 min ago")
    assert (buoy["heard"], buoy["trouble"]) == ("never", "LOST, another table")


def test_frames_are_told_the_newest_first_below_what_is_being_sent() -> None:
    rows = frame_rows(full_view())
    assert [(row["what"], row["outcome"], row["ago"]) for row in rows] == [
        ("→ 1: auv1/nav", "being sent", "0.1 s"),
        ("→ all: auv1/nav, auv1/photo", "not delivered", "10 s"),
        ("← 1: acknowledgements and the like", "", "60 s"),
    ]
    assert frame_rows(full_view(channel={})) == []


def test_texts_of_the_network_are_no_html() -> None:
    bad = "<script>alert(1)</script>"
    view = full_view(
        events={"events": [{"at_unix_s": 1, "event": "x", "text": bad}]},
        ledger={"entries": [{"id": 1, "cause": bad, "bytes": 5, "airtime_s": 1}]},
        objects={"sending": [{"to": 1, "stream": bad, "total_bytes": 9}]},
    )
    drawn = (
        event_lines(view.events)
        + cause_bars(view.causes)
        + transfer_bars(view.transfers)
        + figure(bad, bad, note=bad)
    )
    assert "<script" not in drawn
    assert drawn.count("&lt;script&gt;") == 6


def test_streams_that_fail_stand_on_top_with_what_was_refused_and_what_expired() -> None:
    row = {"kind": "topic", "transmitted": 1}
    streams = [
        {"id": 1, "name": "fine", **row},
        {"id": 2, "name": "best effort", **row},
        {"id": 3, "name": "reliable", **row, "delivering": 0, "expired": 3, "refused": 2},
        {"id": 4, "name": "late", **row, "deadline_missed": 7},
    ]
    dropped = {"expired": {"best effort": 5, "reliable": 3}, "local": {"best effort": {"size": 4}}}
    view = full_view(streams={"streams": streams}, dropped=dropped)
    assert [each.name for each in troubled_first(view.streams)] == [
        "late", "best effort", "reliable", "fine",
    ]  # fmt: skip
    rows = {each["name"]: each for each in map(stream_row, view.streams)}
    assert [rows["best effort"][name] for name in ("refused", "expired")] == ["4", "5"]
    assert [rows["reliable"][name] for name in ("refused", "expired")] == ["2", "3"]
    assert [rows["fine"][name] for name in ("refused", "expired")] == ["", ""]


def test_a_warning_that_is_repeated_is_one_line() -> None:
    said = [("a", 100), ("b", 200), ("a", 300), ("a", 990), ("c", 995)]
    events = [{"at_unix_s": at, "event": "x", "trouble": True, "text": text} for text, at in said]
    drawn = event_lines(full_view(events={"events": events}).events)
    assert re.findall(r">([abc][^<]*)<", drawn) == ["c", "a (3 times)", "b"]
    assert 'data-age="10.0"' in drawn


def test_alarm_tells_what_is_dead() -> None:
    board = full_board()
    assert alarm_of(board.views(), "") is None
    trouble = alarm_of([], "no Zenoh router at tcp/h:7447")
    assert trouble is not None
    assert trouble.text == "NOT CURRENT: no Zenoh router at tcp/h:7447"
    board.note_answer(2, has_answered=False)
    gone = alarm_of(board.views(), "")
    assert gone == Alarm("NOT CURRENT: gateway 2 auv1 gone", 0.0)
    assert not board.view(2).is_alive
    board.note_answer(2, has_answered=True)
    put(board, "link", {"state": "down"})
    down = alarm_of(board.views(), "")
    assert down == Alarm("NOT CURRENT: link of gateway 2 auv1 down")


@pytest.mark.parametrize("digit", ["²", "١", "9" * 5000, "-1", ""])
def test_a_key_with_other_digits_is_nobodys(digit: str) -> None:
    board = full_board()
    for key in (f"@acoustic/{digit}/link", f"@acoustic/2/peer/{digit}/lost"):
        board.take(key, b'{"state": "up", "lost": true}')
    assert board.addresses() == [2]


def test_bars_are_as_long_as_the_shares() -> None:
    view = full_view()
    assert re.findall(r"width:([\d.]+)%", cause_bars(view.causes)) == ["69.2", "23.1", "7.7"]
    assert re.findall(r"width:([\d.]+)%", transfer_bars(view.transfers)) == ["25.0", "100.0"]


def test_history_is_the_share_of_the_time_on_the_air_and_is_bounded() -> None:
    history, view = History(), full_view()

    def at(unix_s: float, airtime_s: float) -> GatewayView:
        whole = msgspec.structs.replace(view.whole, airtime_s=airtime_s)
        return msgspec.structs.replace(view, unix_s=unix_s, whole=whole)

    for step in range(1000):
        second = step * STEP_S
        now = at(second, second * 0.25)
        history.note(now)
        history.note(now)  # another browser's look adds nothing
    assert len(history.points) == SPAN_S / STEP_S
    assert {point.share for point in history.points} == {0.25}
    history.note(at(3000.0, 0.5))  # restarted
    history.note(at(3002.0, 1.5))
    assert history.points[-1].share == 0.5


def test_chart_shows_points_of_its_span_at_a_round_scale() -> None:
    points = [Point(NOW_S - 2 * SPAN_S, 0.9), Point(NOW_S - 300, 0.05), Point(NOW_S, 0.15)]
    drawn = load_chart(points, NOW_S)
    assert "full height: 20.0 %" in drawn
    assert re.search(r'polyline points="300.0,67.5 600.0,22.5"', drawn)
    assert "polyline" not in load_chart([], NOW_S)
