"""The audit log: what is asked of a node and through it, and what came of it."""

import itertools
import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.gateway.networks import (
    SECTION,
    Channel,
    cbor,
    config_of,
    free_port,
    get,
    local_network,
    run,
    zenoh_config,
)
from zacoustic.app.cli import main
from zacoustic.gateway import Gateway
from zacoustic.run.audit import MOST_BYTES, AuditEntry, read_audit
from zacoustic.run.journal import journal_in


@asynccontextmanager
async def pair(folder: Path, **more: Any) -> AsyncIterator[tuple[zenoh.Session, zenoh.Session]]:
    """Run two gateways with journals; gives a client of each."""
    channel = Channel()
    async with AsyncExitStack() as stack:
        clients = []
        for address in (1, 2):
            network = await stack.enter_async_context(
                local_network(
                    address,
                    channel,
                    section=SECTION | (more if address == 2 else {}),
                    journal=journal_in(folder, address),
                )
            )
            clients.append(stack.enter_context(network.client()))
        yield clients[0], clients[1]


def _entries(folder: Path, address: int) -> list[tuple[int, int, str, str, str]]:
    read = read_audit(folder / f"node-{address}.audit")
    assert (folder / f"node-{address}.audit").stat().st_mode & 0o777 == 0o600
    # A command that its sender gives again, to prove that it has heard the node, is there twice.
    entries = [(each.by, each.to, each.what, each.about, each.outcome) for each in read]
    return [each for each, _ in itertools.groupby(entries)]


def _serve(query: zenoh.Query) -> None:
    if b"no" in (query.payload.to_bytes() if query.payload else b""):
        query.reply_err(b"not now")
    else:
        query.reply(query.key_expr, b"done")


def test_commands_and_calls_are_in_the_logs_of_both_ends(tmp_path: Path) -> None:
    async def scene() -> None:
        async with pair(tmp_path) as (shore, auv):
            auv.declare_queryable("auv1/echo", _serve)
            assert (await get(auv, "auv1/echo", b"here")).good
            assert (await get(shore, "@acoustic/2/stream/12?on=false")).good
            assert (await get(shore, "@acoustic/2/stream/10?on=false")).good
            assert not (await get(shore, "@acoustic/2/stream/11?on=false")).good
            assert (await get(shore, "auv1/echo", b"yes")).good
            assert (await get(shore, "auv1/echo", b"no")).errors
            assert (await get(auv, "@acoustic/2/silence?command=begin;for_s=1")).good

    run(scene())
    assert _entries(tmp_path, 2) == [
        (1, 0, "tune", "chat", "executed"),
        (1, 0, "tune", "auv1/nav", "executed"),
        (1, 0, "command", "", "refused"),
        (1, 0, "call", "auv1/echo", "received"),
        (1, 0, "call", "auv1/echo", "answered"),
        (1, 0, "call", "auv1/echo", "received"),
        (1, 0, "call", "auv1/echo", "refused"),
        (0, 0, "silence", "", "executed"),
    ]
    assert _entries(tmp_path, 1) == [
        (0, 2, "tune", "chat", "asked"),
        (0, 2, "tune", "chat", "answered"),
        (0, 2, "tune", "auv1/nav", "asked"),
        (0, 2, "tune", "auv1/nav", "answered"),
        (0, 2, "tune", "auv1/text", "asked"),
        (0, 2, "tune", "auv1/text", "failed"),
        (0, 2, "call", "auv1/echo", "asked"),
        (0, 2, "call", "auv1/echo", "answered"),
        (0, 2, "call", "auv1/echo", "asked"),
        (0, 2, "call", "auv1/echo", "failed"),
    ]
    texts = [each.text for each in read_audit(tmp_path / "node-2.audit") if each.text]
    assert any("not now" in text for text in texts)


def test_a_command_of_who_may_not_give_any_is_noted_as_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    async def scene() -> None:
        async with pair(tmp_path, commands_from=[3]) as (shore, _):
            assert (await get(shore, "@acoustic/2/silence?command=begin")).errors

    run(scene())
    assert _entries(tmp_path, 2) == [(1, 0, "command", "", "refused")]
    log = str(tmp_path / "node-2.audit")
    assert main(["audit", log]) == 0
    text = capsys.readouterr().out
    assert "node 1 (claimed)  command  refused: node 2 accepts no commands from node 1" in text
    assert main(["audit", log, "--refused", "--by", "1", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["by"], told["node"], told["outcome"]) == (1, 2, "refused")
    assert main(["audit", log, "--by", "3"]) == 1
    assert main(["audit", str(tmp_path / "none")]) == 2


def test_commands_about_routes_are_in_the_log_of_the_node_that_executes_them(
    tmp_path: Path,
) -> None:
    async def scene() -> None:
        async with pair(tmp_path) as (shore, _):
            assert (await get(shore, "@acoustic/2/routing?do=probe;run=7;count=1")).good
            assert (await get(shore, "@acoustic/2/routing?do=heard;run=7")).good
            assert (await get(shore, "@acoustic/2/routing?do=reset;route=1;revision=9")).errors

    run(scene())
    assert _entries(tmp_path, 2) == [
        (1, 0, "route_probe", "run 7", "executed"),
        (1, 0, "route_reset", "route 1", "refused"),
    ]


def test_a_goal_is_in_the_logs_from_its_beginning_to_its_end(tmp_path: Path) -> None:
    async def scene() -> None:
        async with pair(tmp_path) as (shore, auv):

            def serve(query: zenoh.Query) -> None:
                which = str(query.key_expr).rpartition("/")[2]
                answers = {
                    "send_goal": cbor(accepted=True, failure=None, text=""),
                    "get_result": cbor(status="succeeded", result={"depth": 1.5}, text=""),
                }
                query.reply(query.key_expr, answers[which])

            auv.declare_queryable("auv1/goto/_action/*", serve)
            assert (await get(auv, "auv1/goto/_action/send_goal", b"")).good
            goal_id = bytes(range(16))
            goal = cbor(goal_id=goal_id, goal={"depth": 1.5})
            assert (await get(shore, "auv1/goto/_action/send_goal", goal)).good
            named = cbor(goal_id=goal_id)
            assert (await get(shore, "auv1/goto/_action/get_result", named)).good

    run(scene())
    ends = [(each[2], each[4]) for each in _entries(tmp_path, 2)]
    assert ends == [("goal", "received"), ("goal", "accepted"), ("goal", "succeeded")]
    ends = [(each[2], each[4]) for each in _entries(tmp_path, 1)]
    assert ends == [("goal", "asked"), ("goal", "accepted"), ("goal", "succeeded")]


def test_a_long_log_is_set_aside_and_both_parts_are_read(tmp_path: Path) -> None:
    path = tmp_path / "node-1.audit"
    old = b'{"utc":"2026-01-01T00:00:00.000Z","node":1,"by":2,"what":"call","outcome":"received"}\n'
    path.write_bytes(old * (MOST_BYTES // len(old) + 1) + b"no line\n")

    async def scene() -> None:
        async with pair(tmp_path) as (shore, _):
            assert (await get(shore, "@acoustic/2/stream/12?on=false")).good

    run(scene())
    entries: list[AuditEntry] = list(read_audit(path))
    assert path.with_name("node-1.audit.1").stat().st_size >= MOST_BYTES
    assert path.stat().st_size < 10_000
    assert [each.outcome for each in entries[-2:]] == ["asked", "answered"]
    assert entries[0].outcome == "received"


def test_a_report_has_commands_with_their_outcomes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recording = tmp_path / "auv.mcap"

    async def scene() -> None:
        channel = Channel()
        config = config_of(2, zenoh_config("router", listen=free_port()), SECTION)
        auv = Gateway(config, link=channel.medium.link(2), record=recording)
        async with auv, local_network(1, channel) as network:
            with network.client() as shore:
                assert (await get(shore, "@acoustic/2/stream/12?on=false")).good
                assert not (await get(shore, "@acoustic/2/stream/11?on=false")).good

    run(scene())
    assert main(["report", str(recording), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["handled"]
    handled = [(each["node"], each["by"], each["outcome"]) for each in told]
    assert [each for each, _ in itertools.groupby(handled)] == [
        (2, 1, "executed"),
        (2, 1, "refused"),
    ]
    assert main(["report", str(recording)]) == 0
    text = capsys.readouterr().out
    assert "Remote commands, and frames that did not open" in text
    assert "executed" in text
