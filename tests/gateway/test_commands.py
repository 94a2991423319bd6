"""Commands from the shore to a vehicle across the channel: on Zenoh keys, and by the verbs."""

import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from tests.gateway.networkpair import Pair, verb
from tests.gateway.networks import (
    SECTION,
    Channel,
    get,
    hear,
    local_network,
    matched,
    run,
    until,
    zenoh_router,
)
from zacoustic.app.cli import main

NOT_OF_SHORE = SECTION | {"commands_from": [3]}
SILENCE, STREAM = "@acoustic/2/silence", "@acoustic/2/stream/12"


@asynccontextmanager
async def pair(section: dict[str, Any] | None = None) -> AsyncIterator[Pair]:
    async with AsyncExitStack() as stack:
        found = Pair()
        found.channel = Channel()
        found.shore_network = await stack.enter_async_context(local_network(1, found.channel))
        found.auv_network = await stack.enter_async_context(
            local_network(2, found.channel, section=section)
        )
        found.shore = stack.enter_context(found.shore_network.client())
        found.auv = stack.enter_context(found.auv_network.client())
        await matched(found.auv, "chat")
        yield found


async def answer(client: zenoh.Session, key: str, parameters: str = "") -> dict[str, Any]:
    replies = await get(client, f"{key}{parameters}")
    assert not replies.errors, replies.errors
    found: dict[str, Any] = json.loads(replies.payload(key))
    return found


def test_silence_crosses_the_channel_and_so_does_its_end() -> None:
    async def scene() -> None:
        async with pair() as found:
            heard = await hear(found.shore, "chat")
            assert await answer(found.shore, SILENCE) == {
                "address": 2, "silent": False, "commanded": False, "until_utc": None,
            }  # fmt: skip
            silent = await answer(found.shore, SILENCE, "?command=begin;for_s=1800")
            assert (silent["silent"], silent["commanded"]) == (True, True)
            local = await answer(found.auv, SILENCE)
            assert local["until_utc"][:16] == silent["until_utc"][:16]
            before = found.channel.sent_by(2)
            found.auv.put("chat", b"later")
            await answer(found.auv, SILENCE)  # it has been taken in
            assert found.channel.sent_by(2) == before
            assert not (await answer(found.shore, SILENCE, "?command=resume"))["silent"]
            assert await heard.payload() == b"later"
            kept = found.auv_network.told("silence")
            assert [each.facts["silent"] for each in kept] == [True, False]

    run(scene())


def test_topic_is_overridden_from_at_a_remote_node() -> None:
    async def scene() -> None:
        async with pair() as found:
            heard = await hear(found.shore, "chat")
            as_it_was = {
                "address": 2, "stream": 12, "name": "chat",
                "on": True, "min_interval_s": 0.0, "priority": "data",
            }  # fmt: skip
            assert await answer(found.shore, STREAM) == as_it_was
            overridden = await answer(
                found.shore, STREAM, "?on=false;min_interval_s=0.05;priority=background"
            )
            changed = {"on": False, "min_interval_s": 0.05, "priority": "background"}
            assert overridden == as_it_was | changed
            assert await answer(found.auv, STREAM) == overridden
            document = await answer(found.auv, "@acoustic/2/streams")
            (row,) = [each for each in document["streams"] if each["id"] == 12]
            assert row["override"] == changed
            digest = (await answer(found.shore, "@acoustic/1/streams"))["digest"]
            assert document["digest"] == digest
            found.auv.put("chat", b"waits")
            await answer(found.auv, STREAM)
            assert not heard.samples
            await answer(found.shore, STREAM, "?on=true")
            assert await heard.payload() == b"waits"
            assert await answer(found.shore, STREAM, "?reset=true") == as_it_was
            notices = found.auv_network.told("overridden")
            assert [(each.facts["on"], each.facts["commanded_by"]) for each in notices] == [
                (False, 1), (True, 1), (True, 1),
            ]  # fmt: skip
            assert notices[0].lines() == [
                "tuned     12 (chat): off, every 0.05 s at most, background, by node 1"
            ]

    run(scene())


@pytest.mark.parametrize(
    ("query", "input_error"),
    [
        ("@acoustic/2/stream/12?on=yes", "BAD_REQUEST: on is yes; allowed: true, false"),
        ("@acoustic/2/stream/12?priority=urgent", "priority is urgent; allowed: real_time, "),
        ("@acoustic/2/stream/12?min_interval_s=often", "min_interval_s is often; allowed: seconds"),
        ("@acoustic/2/stream/12?min_interval_s=-1", "min_interval_s is -1; allowed: 0..86400"),
        ("@acoustic/2/stream/12?reset=true;on=true", "reset is true; allowed: true, and nothing"),
        ("@acoustic/2/stream/12?rate=3", "rate is no parameter of @acoustic/2/stream/12; allowed"),
        ("@acoustic/2/stream/999", "stream_id is 999; allowed: 1..175"),
        ("@acoustic/2/stream/99?on=true", "HANDLER: node 2 has no stream 99"),
        ("@acoustic/2/stream/20?on=true", "HANDLER: stream 20 is no topic"),
        ("@acoustic/2/stream/11?on=true", "HANDLER: node 2 does not publish stream 11"),
        ("@acoustic/1/stream/10?on=true", "BAD_REQUEST: node 1 does not publish stream 10"),
        ("@acoustic/1/silence?command=stop", "command is stop; allowed: begin, "),
        ("@acoustic/2/ping?within_s=soon", "within_s is soon; allowed: seconds above 0"),
        ("@acoustic/2/ping?within_s=١", "within_s is ١; allowed: seconds above 0"),
        ("@acoustic/2/silence?within_s=soon", "within_s is soon; allowed: seconds above 0"),
        ("@acoustic/2/silence?within_s=601", "within_s is 601; allowed: seconds above 0, at most"),
    ],
)
def test_command_that_is_wrong_is_refused_with_the_reason(query: str, input_error: str) -> None:
    async def scene() -> None:
        async with pair() as found:
            replies = await get(found.shore, query)
            assert not replies.good
            assert input_error in replies.errors[0]
            assert len(replies.errors) == 1, replies.errors

    run(scene())


@pytest.mark.parametrize(
    "key",
    [
        "@acoustic/9/silence",
        "@acoustic/0/silence",
        "@acoustic/2/stream/x",
        "@acoustic/2/quiet",
        # Digits, but not those of a number: the first are an Arabic 2 and 1.
        "@acoustic/٢/silence",
        "@acoustic/2/stream/١",
        "@acoustic/2/stream/²",
        "@acoustic/²/ping",
        "@acoustic/2/stream/" + 5000 * "1",
    ],
)
def test_what_is_no_command_is_answered_by_nobody(key: str) -> None:
    async def scene() -> None:
        async with pair() as found:
            replies = await get(found.shore, key)
            assert not replies.good
            assert not replies.errors

    run(scene())


def test_looking_around_commands_nothing_at_a_remote_node() -> None:
    async def scene() -> None:
        async with pair() as found:
            before = len(found.channel.emissions)
            for query in ("@acoustic/*/silence?command=begin", "@acoustic/**"):
                replies = await get(found.shore, query)
                assert not any(key.startswith("@acoustic/2/") for key in replies.good)
            assert "@acoustic/1/silence" not in (await get(found.shore, "@acoustic/**")).good
            assert len(found.channel.emissions) == before
            assert (await answer(found.shore, "@acoustic/1/silence"))["silent"]
            assert not (await answer(found.auv, SILENCE))["silent"]

    run(scene())


def test_of_two_gateways_one_passes_a_command_on_and_each_executes_its_own() -> None:
    async def scene() -> None:
        async with AsyncExitStack() as stack:
            channel = Channel()
            port = stack.enter_context(zenoh_router())
            first = await stack.enter_async_context(local_network(1, channel, join=port))
            await stack.enter_async_context(local_network(3, channel, join=port))
            await until(
                lambda: first.told("redundant"),
                first.changed,
            )
            await stack.enter_async_context(local_network(2, channel))
            shore = stack.enter_context(first.client())
            replies = await get(shore, f"{SILENCE}?command=begin")
            assert list(replies.good) == [SILENCE]
            assert channel.sent_by(3) == 0
            assert await answer(shore, "@acoustic/3/silence") == {
                "address": 3, "silent": False, "commanded": False, "until_utc": None,
            }  # fmt: skip
            found = await answer(shore, "@acoustic/3/silence", "?command=begin")
            assert found["silent"]
            assert channel.sent_by(3) == 0

    run(scene())


def test_verbs_command_and_tell_how_it_ended(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    async def scene() -> list[int]:
        async with pair() as found:
            verbs = (
                ("silence", "--node", "2"),
                ("silence", "--node", "2", "--for", "30m", "--json"),
                ("resume", "--node", "2"),
                ("stream", "--node", "2", "--id", "12", "--off", "--rate", "0.1"),
                ("stream", "--node", "2", "--id", "12", "--reset", "--json"),
                ("stream", "--node", "2", "--id", "20", "--off"),
                ("silence", "--node", "9", "--for", "1m"),
            )
            return [await verb(*arguments, *found.where) for arguments in verbs]

    assert run(scene()) == [0, 0, 0, 0, 0, 1, 1]
    captured = capsys.readouterr()
    free, silent, resumed, off, reset = captured.out.splitlines()
    assert free == resumed == "node 2: transmits"
    assert json.loads(silent)["commanded"] is True
    assert off == "node 2, stream 12 chat: off, every 10 s at most, priority data"
    assert json.loads(reset) == {
        "address": 2, "stream": 12, "name": "chat",
        "on": True, "min_interval_s": 0.0, "priority": "data",
    }  # fmt: skip
    assert "zacoustic stream: refused by node 2: stream 20 is no topic" in captured.err
    assert "no gateway that knows node 9 is on this local network" in captured.err


def test_node_that_takes_no_commands_says_so(capsys: pytest.CaptureFixture[str]) -> None:
    async def scene() -> int:
        async with pair(NOT_OF_SHORE) as found:
            return await verb("silence", "--node", "2", "--for", "30m", *found.where)

    assert run(scene()) == 1
    assert "refused by node 2: node 2 accepts no commands from node 1" in capsys.readouterr().err


def test_node_that_does_not_answer_in_time_is_exit_code_3(
    capsys: pytest.CaptureFixture[str],
) -> None:
    async def scene() -> list[int]:
        async with local_network(1, Channel()) as shore:
            where = ["--connect", f"tcp/127.0.0.1:{shore.port}", "--timeout", "0.3"]
            return [
                await verb("silence", "--node", "2", "--for", "30m", *where),
                await verb("resume", "--node", "2", "--json", *where),
                await verb("stream", "--node", "2", "--id", "12", *where),
            ]

    assert run(scene()) == [3, 3, 3]
    captured = capsys.readouterr()
    assert captured.out == ""
    first, _, last = captured.err.splitlines()
    assert "node 2 has not answered in time, and may have executed it" in first
    assert last.endswith("node 2 has not answered in time")


@pytest.mark.parametrize(
    ("arguments", "input_error"),
    [
        (["resume", "--node", "0"], "--node 0; allowed: 1..254"),
        (["resume", "--timeout", "601"], "--timeout 601; allowed: above 0, 1e-06..600"),
        (["silence", "--for", "400d"], "for_s is 3.456e+07; allowed: 0.1..31622400"),
        (["stream", "--id", "12"], "the following arguments are required: --node"),
        (["stream", "--node", "2"], "STREAM; allowed: one, by its name or id"),
        (["stream", "--node", "2", "--id", "300"], "stream_id is 300; allowed: 1..175"),
        (["stream", "--node", "2", "--id", "3", "--on", "--off"], "not allowed with argument"),
        (["stream", "--node", "2", "--id", "3", "--rate", "0"], "--rate 0; allowed: above 0"),
        (["stream", "--node", "2", "--id", "3", "--rate", "1e-9"], "--rate 1e-09; allowed: "),
        (["stream", "--node", "2", "--id", "3", "--priority", "x"], "--priority x; allowed: real_"),
        (["stream", "--node", "2", "--id", "3", "--reset", "--rate", "1"], "--reset; allowed: not"),
    ],
)
def test_arguments_that_are_wrong(
    arguments: list[str], input_error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert input_error in capsys.readouterr().err


def test_override_outlives_a_restart_of_the_gateway(tmp_path: Path) -> None:
    async def scene() -> None:
        section = SECTION | {"journal": str(tmp_path)}
        for expected in (True, False):
            async with local_network(2, Channel(), section=section) as found:
                with found.client() as client:
                    assert (await answer(client, STREAM))["on"] is expected
                    assert not (await answer(client, STREAM, "?on=false"))["on"]

    run(scene())
