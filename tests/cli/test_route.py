"""`zacoustic route`: show and probe, through a gateway and on a link, and their errors."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.cli.watched import WATCHED, lines_of, pair
from tests.gateway.networkpair import verb
from tests.gateway.networks import SECTION, get, run
from tests.node.fleet import ChannelServer
from zacoustic.app.cli import main
from zacoustic.app.cli.remote.route import _proposed
from zacoustic.app.tools.field.probing import Survey, Way
from zacoustic.config import config_from_mapping

ROUTED: dict[str, Any] = WATCHED | {"routes": [{"id": 3, "name": "far", "path": [1, 2]}]}
ONCE = ["--count", "1", "--node", "1,2"]


def file_of(tmp_path: Path, section: dict[str, Any]) -> str:
    file = tmp_path / "fleet.json5"
    file.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
    return str(file)


def test_probe_and_show_through_a_gateway(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = file_of(tmp_path, ROUTED)

    async def scene() -> None:
        async with pair(section=ROUTED) as found:
            assert await verb("route", "probe", *found.where, *ONCE, "--json") == 0
            probed, _ = capsys.readouterr()
            survey = json.loads(probed)
            assert survey["own"] == 1
            assert survey["over"] == {"1": [], "2": []}
            assert [(each["source"], each["hearer"], each["heard"]) for each in survey["ways"]] == [
                (2, 1, 1), (1, 2, 1)
            ]  # fmt: skip
            assert await verb("route", "show", file, *found.where, "--json") == 0
            (shown,) = lines_of(capsys)
            assert (shown["id"], shown["path"]) == (3, [1, 2])
            assert [(each["node"], each["next_node"]) for each in shown["hops"]] == [(1, 2)]
            before = len(found.channel.emissions)
            await get(found.shore, "@acoustic/*/routing")
            await get(found.shore, "@acoustic/**")
            for wrong in ("do=", "do=probe", "do=heard;run=x", "do=probe;run=1;count=33", "do=ask"):
                replies = await get(found.shore, f"@acoustic/2/routing?{wrong}")
                assert "BAD_REQUEST" in replies.errors[0], wrong
            assert len(found.channel.emissions) == before

    run(scene())


def test_probe_on_a_link(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = file_of(tmp_path, SECTION)

    async def scene(locator: str) -> None:
        from zacoustic import Node

        async with Node("auv1", config=file, link=locator):
            where = ["--link", locator, "--config", file]
            assert await verb("route", "probe", *where, *ONCE) == 0

    with ChannelServer() as locator:
        run(scene(locator))
    out = capsys.readouterr().out
    assert "lost of 1 probes, from the left to the top:" in out
    assert "routes: []," in out


def test_show_without_a_router_prints_the_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["route", "show", file_of(tmp_path, ROUTED)]) == 0
    assert capsys.readouterr().out == "3 far: 1 - 2, 60 s\n"


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["set", "4", "--path", "1,2"], "ID 4; allowed: 3"),
        (["set", "3", "--path", "2,1"], "--path 2,1; allowed: from 1 to 2, as in the file"),
        (["set", "3", "--path", "1,99,2"], "--path 1,99,2: no node 99 in the file"),
    ],
)
def test_a_path_that_does_not_fit_the_file_is_exit_code_2(
    words: list[str], text: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["route", *words, "--config", file_of(tmp_path, ROUTED)]) == 2
    assert text in capsys.readouterr().err


def test_set_show_and_reset_through_a_gateway(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = file_of(tmp_path, ROUTED)

    async def scene() -> None:
        async with pair(section=ROUTED) as found:
            where = [*found.where, "--config", file]
            assert await verb("route", "set", "3", "--path", "1,2", *where, "--json") == 0
            (changed,) = lines_of(capsys)
            assert (changed["revision"], changed["done"]) == (1, [2, 1])
            assert await verb("route", "show", file, *found.where) == 0
            assert "changed at node 1: 1 - 2" in capsys.readouterr().out
            assert await verb("route", "reset", "3", *where) == 0
            assert "revision 2, at all nodes asked" in capsys.readouterr().out
            assert await verb("route", "show", file, *found.where) == 0
            assert "changed" not in capsys.readouterr().out

    run(scene())


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["probe", "--count", "0", "--node", "1"], "--count 0; allowed: 1..32"),
        (["probe", "--count", "33", "--node", "1"], "--count 33; allowed: 1..32"),
        (["probe"], "--node is missing; allowed: addresses, or --config with nodes"),
        (["probe", "--node", "1,x"], "--node 1,x; allowed: addresses 1..254"),
        (
            ["probe", "--node", "1", "--timeout", "601"],
            "--timeout 601; allowed: above 0, 1e-06..600",
        ),
        (["show", "nowhere.json5"], "nowhere.json5"),
        (["set", "3", "--path", "1,2"], "--config is missing"),
        (["set", "3", "--path", "1,1"], "--path is [1, 1]; allowed: 2..16 addresses, each once"),
        (["set", "3", "--path", "1,300"], "--path 1,300; allowed: addresses 1..254"),
        (["reset", "3", "--timeout", "601"], "--timeout 601; allowed: above 0, 1e-06..600"),
    ],
)
def test_wrong_arguments_are_exit_code_2(
    words: list[str], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["route", *words]) == 2
    assert text in capsys.readouterr().err


def test_a_route_is_proposed_for_who_publishes_to_whom_not_only_for_who_asks() -> None:
    topics = [{"id": 1, "topic": "log", "publishers": [1], "subscribers": [3]}]
    nodes = [{"address": each, "name": f"n{each}"} for each in (1, 2, 3)]
    section = {"address": 2, "nodes": nodes, "streams": topics}
    ways = tuple(
        Way(source=source, hearer=hearer, heard=8 if abs(source - hearer) == 1 else 0, sent=8)
        for source in (1, 2, 3)
        for hearer in (1, 2, 3)
        if source != hearer
    )
    found = Survey(own=2, count=8, ways=ways, over={1: (), 2: (), 3: ()}, missing={})
    config = config_from_mapping(section, source="fleet.json5")
    assert [each.path for each in _proposed(found, config)] == [(1, 2, 3)]
    assert _proposed(found, None) == []
