"""The graph of the network: nodes, edges, routes and places, and its drawing."""

from typing import Any
from xml.etree import ElementTree

import pytest

from tests.hostilenames import HOSTILE, assert_harmless
from tests.tools.boards import NOW_S, WAYS, fleet_board, full_board, full_view, line_board, put
from zacoustic.app.tools.watch.board import Board
from zacoustic.app.tools.watch.graph import MOST_NODES, WIDTH, Edge, Graph, graph_of
from zacoustic.app.tools.watch.graphdrawing import CAPTION, graph_legend, graph_svg, graph_words


def edge_between(graph: Graph, one: int, other: int) -> Edge:
    return next(each for each in graph.edges if each.ends == (one, other))


def elements(graph: Graph, name: str, kind: str) -> list[ElementTree.Element]:
    """Return the elements of a kind, of a drawing that is XML."""
    root = ElementTree.fromstring(graph_svg(graph))
    return [each for each in root.iter(name) if kind in each.get("class", "").split()]


def pair_board(**of_first: Any) -> Board:
    """Return a board of gateways 1 and 2 that hear each other by two links."""
    board = Board(lambda: NOW_S)
    received = {"radio": {"frames": 50, "airtime_s": 1.0}, "sound": {"frames": 4, "airtime_s": 9.0}}
    for address, other in ((1, 2), (2, 1)):
        put(board, "node", {"name": f"n{address}", "started_at_unix_s": NOW_S - 100}, address)
        put(board, "link", {"state": "up"}, address)
        put(board, "streams", {}, address)
        row = {"heard_at_unix_s": NOW_S - address, "received": received}
        put(board, "peers", {str(other): row}, address)
        for link in ("radio", "sound"):
            put(board, f"link/{link}", {"state": "up"}, address)
        reach = {str(other): {"radio": "up", "sound": "up"}}
        put(board, "bond/both", {"links": ["radio", "sound"], "reach": reach}, address)
    for name, document in of_first.items():
        put(board, name.replace("_", "/"), document, 1)
    return board


def test_an_edge_has_a_line_for_each_link_with_what_came_and_the_one_in_use() -> None:
    graph = graph_of(pair_board().views())
    (edge,) = graph.edges
    assert (edge.ends, edge.heard_ago_s, edge.is_lost, edge.hearer) == ((1, 2), 1.0, False, None)
    assert [(way.link, way.frames, way.is_used, way.reach) for way in edge.ways] == [
        ("radio", 100, True, "up"), ("sound", 8, False, "up"),
    ]  # fmt: skip
    assert edge.ways[0].share == pytest.approx(0.02)
    assert edge.ways[1].share == pytest.approx(0.18)
    radio, sound = elements(graph, "path", "edge")
    assert (radio.get("stroke-width"), sound.get("stroke-width")) == ("4", "1.5")
    assert radio.get("stroke") != sound.get("stroke")
    assert [each.text for each in elements(graph, "text", "figures")] == ["100, 2.0 %", "8, 18.0 %"]
    assert "link radio" in graph_legend(graph)


def test_a_link_in_doubt_at_one_end_is_dashed_and_one_that_does_not_reach_is_dotted() -> None:
    reach = {"2": {"radio": "down", "sound": "doubt"}}
    graph = graph_of(pair_board(bond_both={"links": ["radio", "sound"], "reach": reach}).views())
    radio, sound = graph.edges[0].ways
    assert (radio.reach, sound.reach, sound.is_used) == ("down", "doubt", True)
    dashes = [each.get("stroke-dasharray") for each in elements(graph, "path", "edge")]
    assert dashes == ["2 5", "7 5"]


def test_where_only_one_hears_the_other_that_is_said() -> None:
    graph = graph_of(pair_board(peers={}).views())
    assert graph.edges[0].hearer == 2
    assert "1 n1 and 2 n2, only 2 hears the other" in graph_words(graph)


def test_lost_nodes_and_gone_gateways_are_grey() -> None:
    graph = graph_of([full_view(**WAYS)])
    assert {node.address for node in graph.nodes if node.is_grey} == {3}
    assert edge_between(graph, 2, 3).is_lost
    board = pair_board()
    board.note_alive(2, is_alive=False)
    graph = graph_of(board.views())
    assert {node.address for node in graph.nodes if node.is_grey} == {2}
    assert not graph.edges[0].is_lost  # the other one runs, and hears it
    (grey,) = elements(graph, "g", "grey")
    assert "its gateway is gone" in (grey.findtext("title") or "")
    board.note_alive(1, is_alive=False)
    graph = graph_of(board.views())
    assert graph.edges[0].is_lost
    assert len(elements(graph, "g", "grey")) == 2
    assert {each.get("stroke") for each in elements(graph, "path", "lost")} == {"#8a8a8a"}


def test_who_is_heard_over_a_route_alone_has_no_edge() -> None:
    graph = graph_of(line_board().views())
    assert [edge.ends for edge in graph.edges] == [(1, 2), (2, 3), (3, 4), (4, 5)]


def test_a_route_is_a_band_over_its_nodes_with_its_worst_hop() -> None:
    graph = graph_of(line_board().views())
    (path,) = graph.paths
    assert (path.nodes, path.is_poor) == ((1, 2, 3, 4, 5), True)
    assert path.worst is not None
    assert (path.worst[0], path.worst[1].transmissions) == (3, 420)
    assert len(elements(graph, "path", "route")) == 4
    (worst,) = elements(graph, "g", "worst")
    assert "worst hop 3→2: 4.2 transmissions for each frame, 2 given up" in (
        worst.findtext("title") or ""
    )
    assert graph.is_line
    assert len({node.y for node in graph.nodes}) == 1
    assert [node.x for node in graph.nodes] == sorted(node.x for node in graph.nodes)


def test_a_route_whose_ends_are_not_heard_is_drawn_as_far_as_relays_tell() -> None:
    hops = [{"route": "far", "next_node": each, "transmissions": 9} for each in (1, 4)]
    graph = graph_of([full_view(relay={"hops": hops})])
    (path,) = graph.paths
    assert (path.nodes, [leg.ends for leg in path.legs]) == ((), [(2, 1), (2, 4)])
    assert 4 in {node.address for node in graph.nodes}
    assert "route far: neither end is heard here, worst hop 2→" in graph_legend(graph)


def test_forty_nodes_have_a_place_each_and_it_is_always_the_same() -> None:
    views = fleet_board(40).views()
    graph = graph_of(views)
    assert (len(graph.nodes), len(graph.edges), graph.more) == (40, 780, 0)
    places = [(node.x, node.y) for node in graph.nodes]
    assert len(set(places)) == 40
    nearest = min(
        (x - a) ** 2 + (y - b) ** 2 for x, y in places for a, b in places if (x, y) != (a, b)
    )
    assert nearest > 40**2
    assert all(0 < x < WIDTH and 0 < y < graph.height for x, y in places)
    drawn = graph_svg(graph)
    assert drawn == graph_svg(graph_of(list(reversed(views))))
    assert len(drawn) < 400_000
    assert len(graph_words(graph)) < 30_000
    assert elements(graph, "text", "figures") == []


def test_of_more_nodes_the_others_are_counted() -> None:
    peers = {str(each): {"heard_at_unix_s": 990.0} for each in range(3, 240)}
    graph = graph_of([full_view(peers=peers)])
    assert (len(graph.nodes), graph.more) == (MOST_NODES, 238 - MOST_NODES)
    assert graph.nodes[0].address == 2
    assert f"{238 - MOST_NODES} more nodes are not drawn" in graph_legend(graph)


@pytest.mark.parametrize("nodes", range(2, 41))
def test_every_number_of_nodes_is_drawn_within_the_picture(nodes: int) -> None:
    peers = {str(each): {"heard_at_unix_s": 990.0} for each in range(3, nodes + 2)}
    path = list(range(2, min(nodes, 16) + 2))
    for graph in (
        graph_of([full_view(peers=peers)]),
        graph_of([full_view(peers=peers, **{"route/r": {"path": path}})]),
    ):
        assert len(graph.nodes) == nodes
        assert len({(node.x, node.y) for node in graph.nodes}) == nodes
        assert all(20 < node.x < WIDTH - 20 for node in graph.nodes)
        assert all(20 < node.y < graph.height - 20 for node in graph.nodes)
        assert len(elements(graph, "g", "node")) == nodes


def test_a_gateway_alone_and_no_gateway_at_all() -> None:
    graph = graph_of([full_view(peers={})])
    assert graph.is_alone
    assert len(elements(graph, "g", "node")) == 1
    assert graph_of([]).is_alone
    assert "<svg" in graph_svg(graph_of([]))


def test_drawing_has_a_role_a_label_a_title_and_its_caption() -> None:
    graph = graph_of(line_board().views())
    root = ElementTree.fromstring(graph_svg(graph))
    assert root.get("role") == "img"
    assert root.findtext("title") == "network"
    label = root.get("aria-label") or ""
    assert label.startswith("Network: 5 nodes; 5 gateways; 4 pairs in which one hears the other;")
    assert "worst hop 3→2" in label
    assert root.findtext("desc") == label
    assert "Positions are not known" in CAPTION
    assert CAPTION in graph_legend(graph)
    words = graph_words(graph)
    assert "2 n2 and 3 n3: link acoustic, 20 frames, 2.0 % of the time, heard" in words
    assert "http" not in graph_svg(graph) + graph_legend(graph) + words


def test_names_of_nodes_links_and_routes_are_no_markup() -> None:
    evil = HOSTILE.replace("/", "_")
    received = {HOSTILE: {"frames": 7, "airtime_s": 1.0}}
    board = full_board(
        node={"name": HOSTILE, "started_at_unix_s": 100.0},
        peers={"1": {"name": HOSTILE, "heard_at_unix_s": 990.0, "received": received}},
        relay={"hops": [{"route": evil, "next_node": 1, "transmissions": 5}]},
        **{
            f"route/{evil}": {"path": [2, 1, 7], "link": HOSTILE},
            f"link/{evil}": {"state": "up"},
            f"bond/{evil}": {"links": [HOSTILE], "reach": {"1": {HOSTILE: "up"}, "2": {}}},
        },
    )
    graph = graph_of(board.views())
    drawn = graph_svg(graph)
    shown = drawn + graph_legend(graph) + graph_words(graph)
    assert_harmless(shown)
    assert "<script" not in shown
    root = ElementTree.fromstring(drawn)
    assert {each.tag for each in root.iter()} == {
        "svg", "title", "desc", "g", "path", "circle", "text",
    }  # fmt: skip
    assert not any(name.startswith("on") for each in root.iter() for name in each.attrib)
