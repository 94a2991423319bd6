"""What `zacoustic monitor` draws, and the words that terminal and page share."""

import io

import pytest

pytest.importorskip("rich")

from rich.console import Console

from tests.hostilenames import HOSTILE, assert_harmless
from tests.tools.boards import DOCUMENTS, WAYS, fleet_board, full_view
from zacoustic.app.tools.watch.crowd import MOST_GATEWAYS
from zacoustic.app.tools.watch.terminal import Terminal, picture, waiting_picture
from zacoustic.app.tools.watch.words import rate_words, size_words, state_words, time_words


def drawn(
    changed: dict[str, object] | None = None, *, is_complete: bool = False, width: int = 120
) -> str:
    console = Console(file=io.StringIO(), width=width, record=True)
    console.print(picture([full_view(**changed or {})], is_complete=is_complete))
    return console.export_text()


def line_with(text: str, words: str) -> list[str]:
    return next(line for line in text.splitlines() if words in line).split()


def test_of_many_nodes_those_are_listed_with_which_something_is_amiss() -> None:
    peers = {
        str(address): {
            "name": f"auv{address}",
            "same_table": address != 7,
            "heard_at_unix_s": 900.0 + address,
            "per": 0.6 if address == 9 else 0.0,
        }
        for address in range(1, 42)
        if address != 2
    }
    text = drawn({"peers": peers})
    assert "7 auv7" in text
    assert "9 auv9" in text
    assert "3 auv3" in text  # lost
    assert "8 auv8" not in text
    assert "well: 37 nodes, each heard in the last 99 s" in text
    whole = drawn({"peers": peers}, is_complete=True)
    assert "8 auv8" in whole
    assert "well:" not in whole


def test_of_forty_gateways_those_that_fail_are_drawn_and_the_others_are_counted() -> None:
    console = Console(file=io.StringIO(), width=120, record=True)
    console.print(picture(fleet_board().views()))
    text = console.export_text()
    lines = [line for line in text.splitlines() if "────" in line and "auv" in line]
    assert len(lines) == MOST_GATEWAYS
    assert len(text.splitlines()) < MOST_GATEWAYS * 80
    assert " 39 auv39 " in lines[0]
    assert " 1 auv1 " in lines[1]
    assert "30 auv30" in text
    assert "and 34 gateways, all well" in text


def test_picture_tells_streams_nodes_airtime_transfers_and_events() -> None:
    text = drawn()
    assert " 2 auv1 " in text
    assert "link up   evologics/tcp:h:9200 · native · 1.9 · 64 B at 976 bit/s · 24.1 V" in text
    assert "frames 40 sent, 30 heard, 2 damaged   2 waiting   sending 24 B → 1: auv1/nav" in text
    assert "journal kept, runs 15 min" in " ".join(text.split())
    assert "10.0 % of the last 15 min" in text
    assert line_with(text, "10   auv1/nav") == ["10", "auv1/nav", "20", "3.0", "s", "2/min", "2",
                                           "92.3", "%"]  # fmt: skip
    cmd = line_with(text, "auv1/cmd")
    assert cmd[2:] == ["3", "60", "s", "1/min", "62", "s", "late", "4", "times"]
    assert "differs at 1: stopped" in text
    assert "quiet: 1 stream\n" in text
    shore = line_with(text, "1 shore")
    assert " ".join(shore) == (
        "1 shore 60 s ago 1512 m, 3 min ago 12.5 dB SNR, -38.0 dB 25.0 % of 8"
    )
    assert " ".join(line_with(text, "3 buoy")).endswith("never – – – LOST, another table")
    assert line_with(text, "payload")[:4] == ["payload", "62.3", "69.2", "%"]
    assert "auv1/photo to 1: 5000 B of 20.0 kB there, 8000 B sent" in text
    assert "auv1/plan from 1: delivered, 900 B" in text
    assert "sending 24 B → 1: auv1/nav" in text
    frames = text[text.index("last frames") :]
    assert " ".join(line_with(frames, "auv1/photo")) == (
        "→ all: auv1/nav, auv1/photo 33 0.40 s 10 s not delivered"
    )
    assert frames.index("→ all") < frames.index("← 1: acknowledgements")
    lost, up = text.index("lost 3 buoy"), text.index("link up", text.index("lost 3 buoy"))
    assert lost < up
    assert "dropped off the channel: 2 check, 1 unconfirmed" in text


def test_complete_picture_has_the_quiet_streams_too() -> None:
    assert "quiet: " not in drawn(is_complete=True)
    assert line_with(drawn(is_complete=True), "quiet")[:2] == ["12", "quiet"]


def test_errors_are_shown_longer_than_what_is_usual() -> None:
    usual = [
        {"at_unix_s": 600.0 + number, "event": "peer", "trouble": False, "text": f"peer {number}"}
        for number in range(9)
    ]
    lost = {"at_unix_s": 500.0, "event": "lost", "trouble": True, "text": "lost 3 buoy"}
    text = drawn({"events": {"events": [lost, *usual]}})
    assert "peer 8" in text
    assert "peer 2" not in text
    assert "lost 3 buoy" in text


@pytest.mark.parametrize(
    ("width", "columns"),
    [
        (120, "id stream sent ago rate heard ago rate age waits airtime"),
        (100, "id stream sent ago heard ago age waits airtime"),
        (60, "id stream sent heard age waits"),
    ],
)
def test_narrow_terminal_gets_fewer_columns_and_no_line_that_is_too_long(
    width: int, columns: str
) -> None:
    text = drawn(width=width)
    assert max(map(len, text.splitlines())) <= width
    assert " ".join(line_with(text, "waits")) == columns
    assert line_with(text, "10   auv1/nav")[:3] == ["10", "auv1/nav", "20"]


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"link": {"state": "down", "detail": "no answer from h:9200"}},
         "link down, no answer from h:9200"),
        ({"link": {"state": "up", "silent": True}}, "SILENT by order or by a quiet window"),
        ({"journal": {"kept": True, "failure": "disk full"}}, "journal fails: disk full"),
    ],
)  # fmt: skip
def test_what_keeps_frames_from_the_channel_is_said_first(
    changed: dict[str, object], words: str
) -> None:
    assert words in state_words(full_view(**changed))
    assert words in drawn(changed)


def test_why_the_next_frame_waits_stands_beside_what_waits() -> None:
    assert "next frame waits" not in drawn()
    link = {"state": "up", "waits": {"why": "carrier", "until_unix_s": None}}
    assert "2 waiting   next frame waits: carrier" in drawn({"link": link})


def test_gateway_of_an_older_version_is_shown_as_far_as_it_tells() -> None:
    told: dict[str, object] = {name: {} for name in DOCUMENTS if name != "link"}
    told["streams"] = {"streams": [{"id": 1, "name": "x", "transmitted": 4}]}
    text = drawn(told)
    assert line_with(text, " x ")[:3] == ["1", "x", "4"]


def test_terminal_shows_one_picture_after_the_other() -> None:
    console = Console(
        file=io.StringIO(), force_terminal=True, width=100, height=50, _environ={"TERM": "xterm"}
    )
    with Terminal(console) as terminal:
        terminal.show(waiting_picture("tcp/h:7447"))
        terminal.show(picture([full_view()]))
    written = console.file.getvalue()  # type: ignore[attr-defined]
    assert written.index("no gateway has been heard on tcp/h:7447") < written.index("auv1/nav")


@pytest.mark.parametrize("width", [80, 120])
def test_several_links_routes_and_lists_of_links_are_a_line_each(width: int) -> None:
    text = drawn(WAYS, width=width)
    assert max(map(len, text.splitlines())) <= width
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert "acoustic up 30 25 88.0 s" in lines
    assert "radio up 10 5 2.0 s" in lines
    frames = "" if width == 80 else "120 98 "
    assert f"far 2–1–4–5 acoustic up {frames}→ 1: 1.4 a frame, 3 given up" in lines
    assert "back passes here → 3: 9.0 a frame, 8 given up" in lines
    assert "radio+acoustic acoustic radio 1 shore" in lines
    assert "radio, in doubt 3 buoy" in lines
    assert "no link 5 auv5" in lines


def test_carried_samples_are_a_line_and_one_for_each_topic() -> None:
    words = "3 of its own wait, 2 of them in custody, 12 of others, 3400 B of 65.5 kB"
    whole = " ".join(drawn(WAYS, width=140).split())
    assert f"carried: {words}, 1 of others refused, no room, 4 of others expired here" in whole
    assert (
        "auv1/log: 3 for 5 wait; 2 of them in custody of 3 buoy, not heard, LOST; "
        "oldest 10 min, first expires in 2.0 h" in whole
    )
    assert "buoy/log: of others 10 for 1, 2 for 5, 3400 B" in whole
    assert "carried:" not in drawn(width=140)


def test_one_link_without_routes_takes_no_line() -> None:
    text = drawn()
    assert not any(words in text for words in ("worst hop", "list of links", "reached by"))


def test_forty_nodes_of_a_list_of_links_are_counted() -> None:
    reach = {str(each): {"radio": "down" if each == 9 else "up"} for each in range(1, 41)}
    bond = {"links": ["radio"], "in_use": "radio", "reach": reach}
    text = drawn({"peers": {}, "bond/main": bond}, width=100)
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert "main radio radio 1, 2 auv1, 3, 4, 5, 6, 7, 8 and 31 more" in lines
    assert "no link 9" in lines


def test_names_of_links_and_routes_are_data_on_a_terminal() -> None:
    hop = {"route": HOSTILE, "next_node": 1, "transmissions": 3}
    bond = {"links": [HOSTILE], "in_use": HOSTILE, "reach": {"1": {HOSTILE: "up"}}}
    peers = {"1": {"name": HOSTILE}}
    evil = HOSTILE.replace("/", "_")
    text = drawn({
        f"link/{evil}": {"state": "up", "detail": HOSTILE}, "link/b": {}, "peers": peers,
        f"route/{evil}": {"path": [1, 2], "link": HOSTILE, "link_state": HOSTILE},
        "relay": {"hops": [hop]}, f"bond/{evil}": bond,
    }, width=2000)  # fmt: skip
    assert_harmless(text)
    assert text.count("c[bold red]") >= 8


@pytest.mark.parametrize(
    ("value", "words"),
    [(None, "–"), (0.04, "0.0 s"), (11.6, "12 s"), (300, "5 min"), (9000, "2.5 h"),
     (200_000, "2.3 d")],
)  # fmt: skip
def test_times_have_a_unit_of_their_size(value: float | None, words: str) -> None:
    assert time_words(value) == words


def test_rates_and_sizes_have_units_of_their_size() -> None:
    assert [rate_words(each) for each in (None, 2.0, 0.2, 0.001)] == ["–", "2/s", "12/min", "3.6/h"]
    sizes = (None, 812, 42_000, 12_000_000)
    assert [size_words(each) for each in sizes] == ["–", "812 B", "42.0 kB", "12.0 MB"]
