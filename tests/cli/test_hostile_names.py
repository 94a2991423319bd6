"""Verbs of which everything that they show was written by an enemy: names, values, errors."""

import asyncio
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import cbor2
import pytest
import zenoh

from tests.gateway.networkpair import verb
from tests.gateway.networks import free_port, matched, run, zenoh_config, zenoh_router
from tests.hostilenames import HOSTILE, HOSTILE_NAME, assert_harmless, strictly
from tests.tools.boards import DOCUMENTS, NOW_S, WAYS
from zacoustic.app.cli import main

_WORDS: Final = ("up", "topic", "service", "out", "in", "delivered", "not_delivered")


def poisoned(document: Any) -> Any:
    """Put the hostile text into every text of a document."""
    if isinstance(document, str):
        return document if document in _WORDS else f"{document} {HOSTILE}"
    if isinstance(document, dict):
        return {key: poisoned(each) for key, each in document.items()}
    return [poisoned(each) for each in document] if isinstance(document, list) else document


@contextmanager
def enemy() -> Iterator[tuple[zenoh.Session, list[str]]]:
    """Run a router, and a program that says that it is a gateway; gives where the router is."""
    with zenoh_router() as port, zenoh.open(zenoh_config("client", connect=port)) as session:
        documents = {**poisoned(DOCUMENTS | WAYS), "clock": {"now_unix_s": NOW_S}}

        def answer(query: zenoh.Query) -> None:
            with query:
                for name, document in documents.items():
                    query.reply(f"@acoustic/7/{name}", json.dumps(document))

        session.declare_queryable("@acoustic/7/**", answer)
        yield session, ["--connect", f"tcp/127.0.0.1:{port}"]


@pytest.mark.parametrize("words", [["monitor", "--once", "--all"], ["topics"]])
def test_monitor_and_topics_show_names_as_data(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    async def scene() -> None:
        with enemy() as (_, where):
            assert await verb(*words, *where) == 0
            assert await verb(words[0], *words[1:2], *where, "--json") == 0

    pytest.importorskip("rich")
    run(scene())
    shown = capsys.readouterr().out
    text, brace, line = shown.partition("\n{")
    assert "a[/b]c[bold red]" in text
    assert_harmless(text)
    said = [strictly(each) for each in f"{{{line}".splitlines()]
    assert brace
    assert all(HOSTILE in str(each["name"]) for each in said)
    assert_harmless(f"{{{line}")


def test_sub_shows_keys_and_values_as_data(capsys: pytest.CaptureFixture[str]) -> None:
    async def scene(*form: str) -> None:
        with enemy() as (session, where):
            listening = asyncio.create_task(verb("topic", "echo", *where, "--count", "3", *form))
            await matched(session, "evil/number")
            session.put(f"evil/{HOSTILE_NAME}", HOSTILE.encode(), encoding="text/plain")
            session.put("evil/number", cbor2.dumps({"x": math.nan, "y": [math.inf, 1.5]}))
            session.put("evil/bytes", b"\x1b[31m\xff")
            assert await listening == 0

    run(scene())
    printed = capsys.readouterr()
    assert_harmless(printed.out)
    assert_harmless(printed.err)
    run(scene("--json"))
    lines = capsys.readouterr().out.splitlines()
    assert_harmless("\n".join(lines))
    said = {each["key"]: each for each in map(strictly, lines)}
    assert said["evil/number"]["value"] == {"x": None, "y": [None, 1.5]}
    assert said[f"evil/{HOSTILE_NAME}"]["text"] == HOSTILE


def test_error_of_a_call_is_one_harmless_line(capsys: pytest.CaptureFixture[str]) -> None:
    async def scene() -> None:
        with enemy() as (session, where):
            session.declare_queryable(
                "evil/service", lambda query: query.reply_err(HOSTILE.encode())
            )
            assert (
                await verb("service", "call", "evil/service", "x", *where, "--timeout", "10") == 1
            )

    run(scene())
    printed = capsys.readouterr().err
    assert "a[/b]c" in printed
    assert printed.count("\n") == 1
    assert_harmless(printed)


def test_check_shows_a_hostile_file_without_its_passwords(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "fleet.json5"
    section = {
        "address": 1,
        "nodes": [{"address": 1, "name": HOSTILE_NAME}],
        "links": [{"locator": "sim/me:geheim@127.0.0.1:7000#api_token=auch"}],
        "streams": [{"id": 1, "topic": HOSTILE_NAME}],
    }
    file.write_text(json.dumps({"plugins": {"acoustic": section}}), encoding="utf-8")
    for words in ([], ["--json"]):
        assert main(["config", "check", str(file), *words]) == 2  # the link has no such setting
        printed = capsys.readouterr()
        for shown in (printed.out, printed.err):
            assert_harmless(shown)
            assert "geheim" not in shown
            assert "auch" not in shown
        assert "sim/me:***@127.0.0.1:7000#api_token=***" in printed.out


def test_doctor_says_where_it_looked_without_the_password(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "fleet.json5"
    where = f"tcp/me:geheim@127.0.0.1:{free_port()}"
    session = {"mode": "client", "connect": {"endpoints": [where]}}
    section = {"address": 1, "streams": [{"id": 1, "topic": "a"}]}
    file.write_text(json.dumps({**session, "plugins": {"acoustic": section}}), encoding="utf-8")
    for words in ([], ["--json"]):
        assert main(["config", "doctor", str(file), *words]) == 1
        printed = "".join(capsys.readouterr())
        assert "tcp/me:***@127.0.0.1" in printed
        assert "geheim" not in printed
