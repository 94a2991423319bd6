"""`zacoustic monitor` against real gateways: once, as JSON, live on a terminal."""

import asyncio
import json
import os
import signal
import subprocess
import sys
from asyncio.subprocess import PIPE

import pytest

from tests.cli.watched import lines_of, pair
from tests.gateway.networkpair import verb
from tests.gateway.networks import LIMIT_S, cbor, hear, run, zenoh_router
from zacoustic.app.cli import main


def test_once_shows_what_holds(capsys: pytest.CaptureFixture[str]) -> None:
    async def scene() -> None:
        async with pair() as found:
            heard = await hear(found.shore, "auv1/nav")
            payload = cbor(depth=1.0, mode="survey")
            found.auv.put("auv1/nav", payload, encoding="application/cbor")
            await heard.next()
            assert await verb("monitor", *found.where, "--once", "--json") == 0
            (view,) = lines_of(capsys)
            assert (view["address"], view["name"], view["link_state"]) == (1, "shore", "up")
            assert view["is_alive"]
            assert 0 <= view["uptime_s"] < LIMIT_S
            assert view["streams"][0]["heard"] == 1
            peer = view["peers"][0]
            assert (peer["address"], peer["name"], peer["same_table"]) == (2, "auv1", True)
            assert peer["heard_ago_s"] < LIMIT_S
            assert await verb("monitor", *found.where, "--once", "--all") == 0
            text = capsys.readouterr().out
            assert " 1 shore " in text
            assert "auv1/nav" in text

    run(scene())


def test_json_goes_on_and_follows_the_gateway_until_it_is_gone() -> None:
    async def scene() -> None:
        async with asyncio.timeout(LIMIT_S):
            async with pair() as found:
                words = ["monitor", *found.where, "--json", "--interval", "0.05"]
                command = [sys.executable, "-m", "zacoustic", *words]
                process = await asyncio.create_subprocess_exec(*command, stdout=PIPE, stderr=PIPE)
                assert process.stdout is not None
                assert json.loads(await process.stdout.readline())["streams"][2]["heard"] == 0
                found.auv.put("chat", b"hello")
                while True:
                    view = json.loads(await process.stdout.readline())
                    if view["streams"][2]["heard"] == 1:
                        break
            # Both gateways have ended, and the router with them.
            process.send_signal(signal.SIGINT)
            _, errors = await process.communicate()
            assert (process.returncode, errors.decode()) == (0, "")

    run(scene())


def test_gateway_that_ends_is_said_to_be_gone() -> None:
    from tests.gateway.networks import Channel, local_network
    from zacoustic.app.tools.watch.watching import Watch

    async def scene() -> None:
        with zenoh_router() as port:
            async with (
                asyncio.timeout(LIMIT_S),
                local_network(3, Channel(), join=port),
                Watch(None, [f"tcp/127.0.0.1:{port}"]) as watch,
            ):
                async with local_network(1, Channel(), join=port):
                    while 1 not in watch.board.addresses():
                        watch.changed.clear()
                        await watch.changed.wait()
                    assert watch.board.view(1).is_alive
                while watch.board.view(1).is_alive:
                    watch.changed.clear()
                    await watch.changed.wait()
                assert watch.board.view(3).is_alive

    run(scene())


@pytest.mark.skipif(sys.platform == "win32", reason="a terminal of Unix")
def test_live_view_draws_on_a_terminal_and_ends_on_ctrl_c() -> None:
    pytest.importorskip("rich")

    async def scene() -> None:
        async with pair() as found, asyncio.timeout(LIMIT_S):
            import pty

            ours, theirs = pty.openpty()
            command = [sys.executable, "-m", "zacoustic", "monitor", *found.where]
            environment = {**os.environ, "TERM": "xterm", "COLUMNS": "120", "LINES": "40"}
            process = await asyncio.create_subprocess_exec(
                *command, stdin=theirs, stdout=theirs, stderr=PIPE, env=environment
            )
            os.close(theirs)
            drawn = b""
            while b"1 shore" not in drawn:
                drawn += await asyncio.to_thread(os.read, ours, 65_536)
            process.send_signal(signal.SIGINT)
            assert process.stderr is not None
            errors = await process.stderr.read()
            assert await process.wait() == 0
            os.close(ours)
            assert errors == b""

    run(scene())


@pytest.mark.skipif(sys.platform == "win32", reason="a shell of Unix")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_job_in_the_background_of_a_script_ends_on_a_signal(number: signal.Signals) -> None:
    """Its shell has had SIGINT ignored, which a process inherits."""
    pytest.importorskip("rich")
    with zenoh_router() as port:
        program = [sys.executable, "-m", "zacoustic"]
        words = ["monitor", "--connect", f"tcp/127.0.0.1:{port}"]
        process = subprocess.Popen(
            ["sh", "-c", 'trap "" INT; exec "$@"', "sh", *program, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        assert process.stdout is not None
        assert b"no gateway has been heard" in process.stdout.readline()
        process.send_signal(number)
        _, errors = process.communicate(timeout=LIMIT_S)
        assert (process.returncode, errors) == (0, b"")


def test_once_without_a_gateway_is_exit_code_1(capsys: pytest.CaptureFixture[str]) -> None:
    with zenoh_router() as port:
        assert main(["monitor", "--once", "--connect", f"tcp/127.0.0.1:{port}"]) == 1
    assert "no gateway is on this network" in capsys.readouterr().err
    assert main(["monitor", "--interval", "0"]) == 2
