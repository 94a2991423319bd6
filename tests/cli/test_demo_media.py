"""What is between the networks of the demo: each medium tells the logbook the same things."""

import json
from pathlib import Path
from typing import Any

import pytest

from zacoustic.app.cli.tree import whole_tree
from zacoustic.app.tools.demo.logbook import Logbook
from zacoustic.app.tools.demo.media import MEDIA, DesertMedium, Medium, SimMedium
from zacoustic.app.tools.demo.networks import NAMES, SHORE, VEHICLE, write_networks
from zacoustic.app.tools.demo.notes import AnyNote, Arrived, Emitted
from zacoustic.config import read_config
from zacoustic.errors import LinkUnavailableError
from zacoustic.link import registry

LISTENING = {"event": "listening", "addresses": ["127.0.0.1:4000", "127.0.0.1:4001"]}
NOW_S = 100.0


def line(event: str, node: int, size: int = 0, detail: str = "") -> dict[str, Any]:
    """A line as the stand-in prints it."""
    told = {"event": event, "at_s": 1.5, "node": node, "size_bytes": size, "detail": detail}
    read: dict[str, Any] = json.loads(json.dumps(told))
    return read


@pytest.fixture
def medium() -> DesertMedium:
    medium = DesertMedium()
    assert medium.take(LISTENING) == {"event": "listening"}
    return medium


@pytest.fixture
def logbook(medium: Medium, tmp_path: Path) -> Logbook:
    table = read_config(write_networks(tmp_path, medium.locators)[SHORE].file).table
    book = Logbook(table, lambda: NOW_S, propagation_s=medium.propagation_s)
    book.began_at = NOW_S
    return book


def hear(medium: Medium, logbook: Logbook, *lines: dict[str, Any]) -> list[AnyNote]:
    return [note for told in lines for note in logbook.take(medium.child, medium.take(told) or {})]


def test_each_local_network_gets_the_modem_of_its_own_at_desert(
    medium: DesertMedium, tmp_path: Path
) -> None:
    networks = write_networks(tmp_path, medium.locators)
    locators = {
        at: read_config(local_network.file).links[0].locator
        for at, local_network in networks.items()
    }
    assert locators == {1: "desert/127.0.0.1:4000", 2: "desert/127.0.0.1:4001"}


def test_both_networks_get_the_medium_of_the_simulator() -> None:
    medium = SimMedium()
    medium.take({"event": "listening", "address": "127.0.0.1:7"})
    assert medium.locators == dict.fromkeys(NAMES, "sim/127.0.0.1:7")
    assert medium.propagation_s == pytest.approx(1000 / 1500)


@pytest.mark.parametrize("link", MEDIA)
def test_each_medium_is_a_verb_of_the_command_line(link: str, tmp_path: Path) -> None:
    words = MEDIA[link]().verb(tmp_path)
    tree = whole_tree()
    assert tree.is_leaf(tree.path_in(words))
    assert "--json" in words


def test_a_packet_of_desert_waits_sounds_and_arrives(
    medium: DesertMedium, logbook: Logbook
) -> None:
    assert hear(medium, logbook, line("client", 0), line("read", 1, 32)) == []
    assert logbook.waiting[VEHICLE] == 1
    (emitted,) = hear(medium, logbook, line("sent", 1, 32))
    assert isinstance(emitted, Emitted)
    # It listens 0.4 s and sends 36 bytes with 48 kbit/s: what the link says of itself.
    assert (emitted.source, emitted.frame_bytes) == (VEHICLE, 32)
    assert emitted.airtime_s == pytest.approx(0.406)
    assert logbook.waiting[VEHICLE] == 0
    assert logbook.on_the_channel()[0].sound_s == pytest.approx(32 * 8 / 48_000)
    (arrived,) = hear(medium, logbook, line("delivered", 0, 32))
    assert isinstance(arrived, Arrived)
    assert (arrived.source, arrived.target, arrived.outcome) == (VEHICLE, SHORE, "received")
    assert logbook.on_the_channel() == []


@pytest.mark.parametrize(
    ("event", "detail", "outcome"),
    [("lost", "half_duplex", "half_duplex"), ("discarded", "", "no client")],
)
def test_packets_keep_their_order_so_that_the_lost_one_is_known(
    event: str, detail: str, outcome: str, medium: DesertMedium, logbook: Logbook
) -> None:
    hear(
        medium, logbook,
        line("sent", 0, 10), line("sent", 1, 30), line("sent", 0, 20),
        line(event, 1, 10, detail), line("delivered", 0, 30), line("delivered", 1, 20),
    )  # fmt: skip
    frames = [(frame.source, frame.frame_bytes, frame.outcome) for frame in logbook.frames]
    assert frames == [(1, 10, outcome), (2, 30, "received"), (1, 20, "received")]


def test_what_a_client_received_belongs_to_the_packet_that_brought_it(
    medium: DesertMedium, logbook: Logbook
) -> None:
    hear(medium, logbook, line("sent", 1, 32))
    nav = {"count": 0, "lat": 43.1, "lon": 5.9, "depth": 12.3, "heading": 0.0}
    told = {"key": "auv1/nav", "count": 0, "value": nav}
    logbook.take("vehicle", {"event": "put", "at": NOW_S - 0.5, **told})
    logbook.take("console", {"event": "received", "at": NOW_S + 0.34, **told})
    assert [note.stream for note in logbook.frames[0].carried] == ["auv1/nav"]


def test_the_live_view_says_that_desert_listens(medium: DesertMedium, logbook: Logbook) -> None:
    rich_console = pytest.importorskip("rich.console")
    from zacoustic.app.tools.demo.live import LiveView

    console = rich_console.Console(width=120, height=40, force_terminal=True, record=True)
    view = LiveView(console=console, title=medium.title)
    view.begin(logbook)
    hear(medium, logbook, line("read", 0, 20), line("read", 0, 20))
    view.tick()
    view.stop()
    shown = console.export_text()
    assert "DESERT" in shown
    assert "shore listens before it sends, 2 wait" in shown


def test_without_the_link_the_demo_says_what_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(locator: str, node_address: int) -> None:
        raise LinkUnavailableError("no link 'desert'; installed: sim")

    monkeypatch.setattr(registry, "create", absent)
    with pytest.raises(LinkUnavailableError, match="no link 'desert'"):
        DesertMedium().take(LISTENING)
