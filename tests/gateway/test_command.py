"""The verb in processes of its own: two gateways, the water between them in a third."""

import asyncio
import json
import signal
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from pathlib import Path
from typing import Any

import cbor2
import pytest
import zenoh

from tests.gateway.networks import (
    LIMIT_S,
    SECTION,
    cbor,
    free_port,
    get,
    hear,
    matched,
    run,
    zenoh_config,
    zenoh_router,
    zenoh_settings,
)

SCENARIO = """{
  seed: 7, profile: "ideal", channel: "none",
  nodes: [ { address: 1, position: [0, 0, 10] }, { address: 2, position: [1, 0, 10] },
           { address: 3, position: [0, 1, 10] } ],
}"""


def write_file(path: Path, mode: str = "router", **endpoints: int) -> Path:
    """Write the file of a gateway."""
    settings = json.loads(zenoh_settings(mode, **endpoints))
    settings["plugins_loading"] = {"enabled": False}
    settings["plugins"] = {"acoustic": {"__required__": False, **SECTION}}
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


async def start(*arguments: object) -> Process:
    command = [sys.executable, "-m", "zacoustic", *map(str, arguments)]
    return await asyncio.create_subprocess_exec(*command, stdout=PIPE, stderr=PIPE)


async def notice(process: Process, event: str) -> dict[str, Any]:
    """Read lines up to one with that event; all of them are JSON."""
    assert process.stdout is not None
    async with asyncio.timeout(LIMIT_S):
        while line := await process.stdout.readline():
            found: dict[str, Any] = json.loads(line)
            if found["event"] == event:
                return found
    assert process.stderr is not None
    raise AssertionError((await process.stderr.read()).decode())


async def ended(process: Process) -> tuple[int, str, str]:
    async with asyncio.timeout(LIMIT_S):
        out, err = await process.communicate()
    assert process.returncode is not None
    return process.returncode, out.decode(), err.decode()


@asynccontextmanager
async def running(*arguments: object) -> AsyncIterator[Process]:
    process = await start(*arguments)
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
            await process.communicate()


async def open_medium(stack: AsyncExitStack, folder: Path) -> str:
    """Start the water in its process; returns its locator."""
    scenario = folder / "scenario.json5"
    scenario.write_text(SCENARIO, encoding="utf-8")
    channel = await stack.enter_async_context(
        running("run", "medium", scenario, "--listen", "127.0.0.1:0", "--json")
    )
    return f"sim/{(await notice(channel, 'listening'))['address']}"


def test_two_gateways_join_their_networks_and_end_on_a_signal(tmp_path: Path) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            link = await open_medium(stack, tmp_path)
            processes, clients = [], []
            file = write_file(tmp_path / "fleet.json5", listen=1)  # where nobody may listen
            for address in (1, 2):
                port = free_port()
                listen = ("--listen", f"tcp/127.0.0.1:{port}")
                process = await stack.enter_async_context(
                    running(
                        "run",
                        "gateway",
                        file,
                        "--address",
                        address,
                        "--link",
                        link,
                        *listen,
                        "--json",
                    )
                )
                started = await notice(process, "started")
                assert (started["address"], started["link"]) == (address, link)
                assert started["endpoints"] == [f"listen tcp/127.0.0.1:{port}"]
                processes.append(process)
                settings = zenoh_config("client", connect=port)
                clients.append(stack.enter_context(zenoh.open(settings)))
            shore, auv = clients
            await matched(auv, "auv1/nav")
            heard = await hear(shore, "auv1/nav")
            auv.put("auv1/nav", cbor(depth=12.5, mode="survey"), encoding="application/cbor")
            assert cbor2.loads(await heard.payload()) == {"depth": 12.5, "mode": "survey"}
            assert (
                (await get(shore, "auv1/echo", b"x")).errors[0].startswith("auv1/echo: NO_SERVER")
            )
            for process, number in zip(processes, (signal.SIGTERM, signal.SIGINT), strict=True):
                process.send_signal(number)
                code, out, err = await ended(process)
                assert (code, err) == (0, "")
                events = [json.loads(line)["event"] for line in out.splitlines()]
                assert events[-1] == "stopped"

    run(main())


def test_gateway_that_is_killed_is_replaced_by_its_redundant_one(tmp_path: Path) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            link = await open_medium(stack, tmp_path)
            router, beyond = stack.enter_context(zenoh_router()), free_port()
            joined = write_file(tmp_path / "joined.json5", "client", connect=router)
            alone = write_file(tmp_path / "alone.json5", listen=beyond)
            processes = {}
            for address, file in ((1, joined), (3, joined), (2, alone)):
                processes[address] = process = await stack.enter_async_context(
                    running("run", "gateway", file, "--address", address, "--link", link, "--json")
                )
                await notice(process, "started")
            shore = stack.enter_context(zenoh.open(zenoh_config("client", connect=router)))
            auv = stack.enter_context(zenoh.open(zenoh_config("client", connect=beyond)))
            await matched(shore, "chat")
            heard = await hear(auv, "chat")
            shore.put("chat", b"by the first")
            assert await heard.payload() == b"by the first"
            processes[1].kill()
            while (await notice(processes[3], "redundant"))["addresses"] != [3]:
                pass
            assert (await get(shore, "@acoustic/3/link")).good  # behind its declarations
            shore.put("chat", b"by the second")
            assert await heard.payload() == b"by the second"

    run(main())


def test_without_json_it_prints_one_line_per_fact(tmp_path: Path) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            link = await open_medium(stack, tmp_path)
            port = free_port()
            file = write_file(tmp_path / "shore.json5", listen=port)
            process = await stack.enter_async_context(
                running("run", "gateway", file, "--link", link)
            )
            assert process.stdout is not None
            lines: list[str] = []
            async with asyncio.timeout(LIMIT_S):
                while not (lines and lines[-1].startswith("digest")):
                    lines.append((await process.stdout.readline()).decode().rstrip())
            assert "address   1 shore" in lines
            assert f"endpoint  listen tcp/127.0.0.1:{port}" in lines
            assert f"link      {link} (up)" in lines
            process.terminate()
            code, out, err = await ended(process)
            assert (code, out, err) == (0, "stopped\n", "")

    run(main())


def test_errors_of_starting_are_one_line_and_an_exit_code(tmp_path: Path) -> None:
    async def main() -> None:
        port = free_port()
        link = f"sim/127.0.0.1:{free_port()}#wait_s=0.2"
        file = write_file(tmp_path / "shore.json5", "client", connect=port)
        cases: list[tuple[int, str, list[object]]] = [
            (1, f"no Zenoh router at tcp/127.0.0.1:{port}", [file, "--link", link]),
            (2, "names no modem", [file]),
            (2, "address", [file, "--address", 300, "--link", link]),
            (1, "no link 'nosuch'", [file, "--link", "nosuch/x"]),
            (2, "missing.json5", [tmp_path / "missing.json5"]),
        ]
        with zenoh.open(zenoh_config("router", listen=port)):
            taken = write_file(tmp_path / "taken.json5", listen=port)
            code, out, err = await ended(
                await start("run", "gateway", taken, "--link", link, "--json")
            )
            assert (code, out, err.count("\n")) == (1, "", 1)
            assert f"cannot listen on tcp/127.0.0.1:{port}" in err
            code, out, err = await ended(
                await start("run", "gateway", file, "--link", link, "--json")
            )
            waits, error = err.splitlines()
            assert code == 1
            assert "link opening: Connection refused" in waits  # at once, and not at the end only
            assert "no medium at" in error
        for expected, text, arguments in cases:
            code, out, err = await ended(await start("run", "gateway", *arguments))
            assert (code, out, err.count("\n")) == (expected, "", 1), err
            assert text in err

    run(main(), limit_s=120)


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_signal_while_it_waits_for_the_modem_ends_it(
    tmp_path: Path, number: signal.Signals
) -> None:
    async def main() -> None:
        file = write_file(tmp_path / "shore.json5", listen=free_port())
        link = f"sim/127.0.0.1:{free_port()}#wait_s=60"
        async with running("-v", "run", "gateway", file, "--link", link) as process:
            assert process.stderr is not None
            async with asyncio.timeout(LIMIT_S):
                while b"waiting for the medium" not in await process.stderr.readline():
                    pass
            process.send_signal(number)
            code, out, _ = await ended(process)
            assert (code, out) == (0, "stopped\n")

    run(main())
