"""Transmit silence as a service of the gateway, and the verb that asks for it."""

import asyncio
import json
from pathlib import Path
from typing import Any

import pytest

from tests.gateway.networks import SECTION, Channel, free_port, get, local_network, run, until
from zacoustic.app.cli import main


async def verb(*arguments: str) -> int:
    """Run the command line in a thread of its own."""
    return await asyncio.to_thread(main, ["silence", *arguments])


async def state(client: Any, parameters: str = "") -> dict[str, Any]:
    replies = await get(client, f"@acoustic/1/silence{parameters}")
    assert not replies.errors
    found: dict[str, Any] = json.loads(replies.payload("@acoustic/1/silence"))
    return found


def test_command_keeps_the_modem_silent_until_it_is_resumed() -> None:
    async def scene() -> None:
        channel = Channel()
        async with local_network(1, channel) as shore:
            with shore.client() as client:
                assert await state(client) == {
                    "address": 1, "silent": False, "commanded": False, "until_utc": None,
                }  # fmt: skip
                found = await state(client, "?command=begin;for_s=1800")
                assert found["silent"]
                assert found["commanded"]
                assert found["until_utc"].endswith("Z")
                client.put("chat", b"not now")
                client.put("auv1/text", b"nor the urgent one")
                assert (await state(client))["silent"]
                await asyncio.sleep(0)
                assert channel.emissions == []
                assert not (await state(client, "?command=resume"))["silent"]
                await until(lambda: channel.emissions, channel.changed)
                kept = shore.told("silence")
                assert [each.facts["silent"] for each in kept] == [True, False]

    run(scene())


@pytest.mark.parametrize(
    ("parameters", "input_error"),
    [
        ("?command=stop", "command is stop; allowed: begin, resume"),
        ("?command=begin;for_s=-1", "for_s is -1; allowed: with command=begin, seconds above 0"),
        ("?command=begin;for_s=soon", "for_s is soon"),
        ("?command=resume;for_s=3", "for_s is 3"),
        ("?for_s=3", "for_s is 3"),
    ],
)
def test_command_that_is_wrong_is_refused(parameters: str, input_error: str) -> None:
    async def scene() -> None:
        async with local_network(1, Channel()) as shore:
            with shore.client() as client:
                replies = await get(client, f"@acoustic/1/silence{parameters}")
                assert not replies.good
                assert input_error in replies.errors[0]
                assert not (await state(client))["silent"]

    run(scene())


def test_quiet_window_is_told() -> None:
    async def scene() -> None:
        section = SECTION | {
            "quiet": [{"from": "00:00", "to": "12:00"}, {"from": "12:00", "to": "00:00"}]
        }
        async with local_network(1, Channel(), section=section) as shore:
            with shore.client() as client:
                found = await state(client)
                assert (found["silent"], found["commanded"]) == (True, False)

    run(scene())


def test_verb_commands_asks_and_resumes(capsys: pytest.CaptureFixture[str]) -> None:
    async def scene() -> None:
        async with local_network(1, Channel()) as shore:
            where = ["--connect", f"tcp/127.0.0.1:{shore.port}"]
            assert await verb(*where) == 0
            assert await verb("--for", "30m", *where) == 0
            assert await verb("--json", "--node", "1", *where) == 0
            assert await verb("resume", *where) == 0
            assert await verb("until-resumed", *where) == 0
            assert await verb("--node", "9", *where) == 1

    run(scene())
    captured = capsys.readouterr()
    free, commanded, as_json, resumed, endless = captured.out.splitlines()
    assert free == "node 1: transmits"
    assert commanded.startswith("node 1: silent, commanded, until 2")
    assert json.loads(as_json)["silent"] is True
    assert resumed == "node 1: transmits"
    assert endless == "node 1: silent, commanded, until it is resumed"
    assert "no gateway that knows node 9 is on this local network" in captured.err


@pytest.mark.parametrize(
    ("arguments", "input_error"),
    [
        (["--for", "soon"], "--for soon; allowed: a time above 0, such as 90s, 30m, 2h, 1d"),
        (["--for", "0m"], "--for 0m; allowed"),
        (["resume", "--for", "3s"], "--for 3s; allowed: not with resume"),
        (["--node", "300"], "--node 300; allowed: 1..254"),
        (["--timeout", "0"], "--timeout 0; allowed: above 0"),
        (["stop"], "command stop; allowed: resume, until-resumed"),
    ],
)
def test_arguments_that_are_wrong(
    arguments: list[str], input_error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["silence", *arguments]) == 2
    assert input_error in capsys.readouterr().err


def test_router_that_is_not_there_is_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["silence", "--connect", f"tcp/127.0.0.1:{free_port()}"]) == 1
    assert "no Zenoh router at" in capsys.readouterr().err


def test_permit_log_has_every_emission(tmp_path: Path) -> None:
    log = tmp_path / "deep" / "permit.jsonl"

    async def scene() -> None:
        channel = Channel()
        section = SECTION | {"permit_log": str(log)}
        async with local_network(1, channel, section=section) as shore:
            with shore.client() as client:
                client.put("chat", b"hello")
                await until(lambda: channel.sent_by(1), channel.changed)
                await get(client, "@acoustic/1/link")

    run(scene())
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert len(lines) == 1
    assert lines[0]["node"] == 1
    assert lines[0]["destination"] == 255
    assert lines[0]["outcome"] == "sent"
    assert lines[0]["utc"].startswith("20")
    assert lines[0]["bytes"] > 5
