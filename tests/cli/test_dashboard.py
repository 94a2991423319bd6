"""`zacoustic dashboard` as a process: it serves, and ends on a signal."""

import asyncio
import os
import signal
import socket
import sys
import urllib.error
import urllib.request
from asyncio.subprocess import PIPE

import pytest

from tests.gateway.networks import LIMIT_S, run, zenoh_router
from zacoustic.app.cli import main

pytest.importorskip("nicegui")

PATHS = ("/", "/favicon.ico", "/none", "/_nicegui_ws/socket.io/?EIO=4&transport=polling")


def test_page_is_served_until_ctrl_c() -> None:
    async def scene() -> None:
        with zenoh_router() as port:
            where = ["--connect", f"tcp/127.0.0.1:{port}", "--listen", "127.0.0.1:0"]
            command = [sys.executable, "-m", "zacoustic", "dashboard", *where]
            # NiceGUI takes a program that pytest has started for a test of its own.
            environment = {name: each for name, each in os.environ.items() if "PYTEST" not in name}
            process = await asyncio.create_subprocess_exec(
                *command, stdout=PIPE, stderr=PIPE, env=environment
            )
            assert process.stdout is not None
            async with asyncio.timeout(LIMIT_S):
                line = (await process.stdout.readline()).decode()
                url = line.removeprefix("page ").strip()
                await asyncio.to_thread(fetch, url)
                await asyncio.to_thread(leave_early, url)
                for headers in ({"Host": "evil.example"}, {"Origin": "http://evil.example"}):
                    assert await asyncio.to_thread(status_of, url, headers) == 403
                page = await asyncio.to_thread(fetch, url)
                for _ in range(2):  # somebody is impatient
                    process.send_signal(signal.SIGINT)
                _, errors = await process.communicate()
            assert "zacoustic" in page
            assert (process.returncode, errors.decode()) == (0, "")

    run(scene())


def leave_early(url: str) -> None:
    """Ask for this and that, speak no HTTP, and never wait for an answer."""
    port = int(url.rpartition(":")[2])
    asked = [f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n" for path in PATHS]
    for said in [*asked, "who is there?\r\n\r\n"]:
        for _ in range(5):
            with socket.create_connection(("127.0.0.1", port)) as connection:
                connection.sendall(said.encode())


def status_of(url: str, headers: dict[str, str]) -> int:
    """Ask as the browser of somebody who has an evil page open."""
    try:
        with urllib.request.urlopen(urllib.request.Request(url, headers=headers)) as answer:
            return int(answer.status)
    except urllib.error.HTTPError as error:
        return error.code


def fetch(url: str) -> str:
    """Read a page that is served soon."""
    while True:
        try:
            with urllib.request.urlopen(url, timeout=LIMIT_S) as answer:
                return str(answer.read().decode())
        except ConnectionRefusedError:
            continue
        except urllib.error.URLError as error:
            if not isinstance(error.reason, ConnectionRefusedError):
                raise


def test_places_that_cannot_be_served_are_one_line(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["dashboard", "--listen", "nowhere"]) == 2
    assert "allowed: HOST:PORT" in capsys.readouterr().err
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["dashboard", "--listen", f"127.0.0.1:{port}"]) == 1
    assert f"cannot listen at 127.0.0.1:{port}" in capsys.readouterr().err
    assert main(["dashboard", "--node", "0", "--listen", "127.0.0.1:0"]) == 2
