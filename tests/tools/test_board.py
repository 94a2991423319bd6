"""The board of `zacoustic monitor`: documents in, ages, rates and shares out."""

import json
from typing import Any

from tests.tools.boards import WAYS, full_board, full_view, put
from zacoustic.app.tools.watch.board import MOST_NAMED, WINDOW_S, Board
from zacoustic.app.tools.watch.views import WaitsView, told

LINK = {"state": "up", "frames_transmitted": 1, "airtime_s": 6.0}
NAV = {"id": 10, "name": "nav", "kind": "topic", "sent_at_unix_s": 990.0, "sent_period_s": 2.0,
       "heard_at_unix_s": 999.0, "heard_period_s": 4.0, "age_s": 1.5, "waiting": 3}  # fmt: skip


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def board_at(clock: Clock) -> Board:
    board = Board(clock)
    take(board, "node", {"name": "auv1", "started_at_unix_s": 900.0})
    take(board, "link", LINK)
    take(board, "streams", {"digest": "ab", "streams": [NAV], "differ": [{"id": 10, "peers": [3]}]})
    return board


def take(board: Board, name: str, document: Any, address: int = 2) -> None:
    board.take(f"@acoustic/{address}/{name}", json.dumps(document).encode())


def test_rates_slow_down_and_ages_grow_while_nothing_comes() -> None:
    clock = Clock()
    board = board_at(clock)
    stream = board.view(2).streams[0]
    assert (stream.sent_ago_s, stream.heard_ago_s, stream.age_s) == (10.0, 1.0, 2.5)
    assert (stream.sent_rate_hz, stream.heard_rate_hz) == (0.1, 0.25)
    assert stream.differs_at == (3,)
    clock.now_s += 99
    stream = board.view(2).streams[0]
    assert (stream.heard_ago_s, stream.heard_rate_hz, stream.age_s) == (100.0, 0.01, 101.5)
    assert board.view(2).waiting == 3


def test_word_of_a_frame_that_waits_holds_as_long_as_it_is_true() -> None:
    clock = Clock()
    board = board_at(clock)
    assert board.view(2).whole.waits is None
    take(board, "link", LINK | {"waits": {"why": "slot", "until_unix_s": 1003.2}})
    assert board.view(2).whole.waits == WaitsView(why="slot", until_unix_s=1003.2, left_s=3.2)
    clock.now_s += 4
    assert board.view(2).whole.waits == WaitsView(why="slot", until_unix_s=1003.2, left_s=0.0)
    clock.now_s += 2
    assert board.view(2).whole.waits is None, "it is over, and nothing new has been told"
    take(board, "link", LINK | {"waits": {"why": "carrier", "until_unix_s": None}})
    assert board.view(2).whole.waits == WaitsView(why="carrier", left_s=None)
    assert board.view(2).links[0].waits == WaitsView(why="carrier", left_s=None)
    board.note_alive(2, is_alive=False)
    assert board.view(2).whole.waits is None, "nobody knows what a gateway does that is gone"
    assert board.view(2).links[0].waits is None
    board.note_alive(2, is_alive=True)
    take(board, "link", LINK | {"waits": None})
    assert board.view(2).whole.waits is None


def test_utilisation_is_that_of_the_window_once_it_was_watched() -> None:
    clock = Clock()
    board = board_at(clock)
    view = board.view(2)
    assert (view.utilisation, view.window_s) == (0.06, 100.0)
    clock.now_s += WINDOW_S / 2
    take(board, "link", LINK | {"airtime_s": 9.0})
    assert board.view(2).window_s == 130.0
    clock.now_s += WINDOW_S / 2
    view = board.view(2)
    assert (view.utilisation, view.window_s) == (3.0 / WINDOW_S, WINDOW_S)
    clock.now_s += WINDOW_S
    assert board.view(2).utilisation == 0.0
    # It was restarted: what it had counted is gone.
    take(board, "node", {"name": "auv1", "started_at_unix_s": clock.now_s})
    take(board, "link", LINK | {"airtime_s": 0.5})
    clock.now_s += 10
    assert board.view(2).utilisation == 0.05


def test_ages_are_by_the_clock_of_the_gateway() -> None:
    clock = Clock()
    board = board_at(clock)
    clock.now_s = 50_000.0
    take(board, "clock", {"now_unix_s": 1000.0})
    view = board.view(2)
    assert (view.streams[0].sent_ago_s, view.uptime_s, view.unix_s) == (10.0, 100.0, 50_000.0)


def test_peers_causes_transfers_and_events() -> None:
    board = board_at(Clock())
    take(board, "peers", {"1": {"name": "shore", "heard_at_unix_s": 980.0, "per": 0.5,
                                "delivered": 1, "not_delivered": 1, "metrics": {"snr_db": 12.0},
                                "same_table": True},
                          "3": {"name": "buoy"}})  # fmt: skip
    take(board, "peer/1/range", {"range_m": 812.0, "measured_at_unix_s": 970.0})
    take(board, "peer/3/lost", {"lost": True})
    take(board, "peer/3/late", {"late": ["buoy/status"]})
    nav = {"id": 10, "stream": "nav", "cause": "payload", "bytes": 30, "airtime_s": 4.5}
    hello = {"id": 0, "stream": "", "cause": "hello", "bytes": 10, "airtime_s": 1.5}
    take(board, "ledger", {"entries": [nav, hello]})
    photo = {"id": 7, "to": 1, "stream": "photo", "done_bytes": 0, "total_bytes": 100}
    ended = {"source": 1, "stream": None, "outcome": "expired"}
    take(board, "objects", {"sending": [photo], "ended": [ended]})
    take(board, "dropped", {"channel": {"check": 2, "payload": 1}, "superseded": {"nav": 4}})
    up = {"at_unix_s": 1, "event": "link", "text": "link up"}
    take(board, "events", {"events": [up, {"at_unix_s": 995, "event": "lost", "trouble": True}]})
    view = board.view(2)
    shore, buoy = view.peers
    assert (shore.address, shore.name, shore.heard_ago_s, shore.snr_db) == (1, "shore", 20.0, 12.0)
    assert (shore.range_m, shore.range_ago_s, shore.per, shore.exchanges) == (812.0, 30.0, 0.5, 2)
    assert (buoy.is_lost, buoy.late, buoy.heard_ago_s) == (True, ("buoy/status",), None)
    assert [(each.cause, each.share, each.airtime_s) for each in view.causes] == [
        ("payload", 0.75, 4.5), ("hello", 0.25, 1.5),
    ]  # fmt: skip
    assert (view.streams[0].airtime_share, view.streams[0].useless) == (0.75, 4)
    assert view.frames_damaged == 2
    assert [(each.stream, each.direction, each.peer, each.outcome) for each in view.transfers] == [
        ("photo", "to", 1, None), ("", "from", 1, "expired"),
    ]  # fmt: skip
    assert [(each.event, each.is_trouble, each.ago_s) for each in view.events] == [
        ("lost", True, 5.0), ("link", False, 999.0),
    ]  # fmt: skip


def test_what_is_no_document_is_counted_or_left_alone() -> None:
    board = Board(Clock())
    assert board.addresses() == []
    board.take("@acoustic/2/link", b"rubbish")
    board.take("@acoustic/2/link", b'{"state": 3}')
    board.take("@acoustic/2/link", b'{"diagnostics": ' + b"[" * 100_000)
    assert board.unreadable == 3
    for key in ("@acoustic/2", "other/2/link", "@acoustic/x/link", "@acoustic/2/peer/x/range",
                "@acoustic/2/peer/3/what", "@acoustic/2/nothing"):  # fmt: skip
        board.take(key, b"rubbish")
    assert board.unreadable == 3
    board.note_alive(2, is_alive=False)
    assert board.views() == []
    board = board_at(Clock())
    board.note_alive(2, is_alive=False)
    assert not board.view(2).is_alive


def test_links_routes_hops_and_lists_of_links() -> None:
    view = full_view(**WAYS)
    assert [(each.name, each.state, each.frames_sent, each.airtime_s) for each in view.links] == [
        ("acoustic", "up", 30, 88.0), ("radio", "up", 10, 2.0),
    ]  # fmt: skip
    (far,) = view.routes
    assert (far.name, far.path, far.link, far.link_state) == ("far", (2, 1, 4, 5), "acoustic", "up")
    assert (far.frames_sent, far.frames_heard) == (120, 98)
    assert [(each.route, each.next_node, each.passed_on, each.given_up) for each in view.hops] == [
        ("far", 1, 100, 3), ("back", 3, 10, 8),
    ]  # fmt: skip
    assert view.carry is not None
    assert (view.carry.own, view.carry.in_custody, view.carry.carried_bytes) == (3, 2, 3400)
    own, others = view.carry.streams
    assert (own.stream, own.own, own.custodians) == ("auv1/log", {5: 3}, {3: 2})
    assert (own.oldest_s, own.ends_in_s) == (600.0, 7200.0)
    assert (others.carried, others.oldest_s, others.ends_in_s) == ({1: 10, 5: 2}, None, None)
    (bond,) = view.bonds
    assert (bond.name, bond.in_use, bond.again) == ("radio+acoustic", "acoustic", 4)
    assert told(bond)["reach"]["3"] == {"radio": "doubt", "acoustic": "down"}
    assert [(each.address, each.link) for each in view.peers] == [
        (1, "radio"), (3, "radio"), (5, None),
    ]  # fmt: skip
    shore, buoy, far_end = view.peers
    assert shore.received is not None
    assert [(each.link, each.frames) for each in shore.received] == [("acoustic", 20), ("radio", 5)]
    assert (buoy.received, far_end.received) == (None, ())


def test_a_link_that_is_down_reaches_nobody_whatever_its_list_says() -> None:
    board = full_board(**WAYS)
    put(board, "link/radio", {"state": "down"})
    assert [each.link for each in board.view(2).peers] == ["acoustic", None, None]


def test_a_gateway_of_one_link_has_that_one() -> None:
    view = full_view()
    assert [(each.name, each.state, each.frames_sent) for each in view.links] == [("", "up", 40)]
    assert (view.routes, view.hops, view.bonds, view.carry) == ((), (), (), None)
    assert {each.link for each in view.peers} == {None}


def test_a_restart_with_another_file_takes_links_and_routes_away() -> None:
    board = full_board(**WAYS)
    put(board, "node", {"name": "auv1", "started_at_unix_s": 990.0})
    put(board, "route/near", {"path": [2, 1]})
    view = board.view(2)
    assert [each.name for each in view.routes] == ["near"]
    assert (len(view.links), view.hops, view.bonds, view.carry) == (1, (), (), None)


def test_whoever_puts_names_without_end_fills_no_memory() -> None:
    board = full_board()
    for number in range(2 * MOST_NAMED):
        for kind in ("link", "route", "bond"):
            put(board, f"{kind}/x{number}", {})
    put(board, "relay", {"hops": [{"route": f"r{each}", "next_node": 1} for each in range(999)]})
    put(board, "bond/x0", {"again": 7})
    view = board.view(2)
    numbers = {len(each) for each in (view.links, view.routes, view.bonds, view.hops)}
    assert numbers == {MOST_NAMED}
    assert view.bonds[0].again == 7
    for key in ("link/a/b", "route", "bond", "other/a", "peer/1"):
        put(board, key, {"name": 3})
    assert board.unreadable == 0
