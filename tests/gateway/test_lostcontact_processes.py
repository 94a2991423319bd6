"""Lost contact with processes that are killed: the gateway alone, its water, and the shore."""

import asyncio
import json
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

import cbor2
import pytest
import zenoh

from tests.gateway.networks import LIMIT_S, free_port, run, zenoh_config, zenoh_router
from tests.gateway.test_command import notice, open_medium, running, write_file

pytestmark = pytest.mark.timeout(120)
KEY = "auv1/surface"
AFTER_S = 3.0
RULE = {"name": "up", "by": 2, "of": [1], "lost_after_s": AFTER_S, "call": KEY}


def write_fleet(path: Path, mode: str, **endpoints: int) -> Path:
    """Write the file of one side; the shore beats all the time."""
    write_file(path, mode, **endpoints)
    settings = json.loads(path.read_text(encoding="utf-8"))
    section = settings["plugins"]["acoustic"]
    section["nodes"][0]["heartbeat_s"] = 1
    section["lost_contact"] = [RULE]
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


def test_a_vehicle_whose_gateway_is_killed_acts_and_is_armed_again_by_the_shore(
    tmp_path: Path,
) -> None:
    asked: asyncio.Queue[zenoh.Query] = asyncio.Queue()

    async def question() -> zenoh.Query:
        async with asyncio.timeout(LIMIT_S):
            return await asked.get()

    def agree(query: zenoh.Query) -> None:
        with query:
            query.reply(KEY, cbor2.dumps({"success": True}), encoding="application/cbor")

    async def said(vehicle: asyncio.subprocess.Process, state: str) -> dict[str, Any]:
        while (found := await notice(vehicle, "lost_contact"))["state"] != state:
            pass
        return found

    async def main() -> None:
        loop = asyncio.get_running_loop()
        async with AsyncExitStack() as stack:
            port = stack.enter_context(zenoh_router())
            local = stack.enter_context(zenoh.open(zenoh_config("client", connect=port)))
            local.declare_queryable(
                KEY, lambda query: loop.call_soon_threadsafe(asked.put_nowait, query)
            )
            link = await open_medium(stack, tmp_path)
            file = write_fleet(tmp_path / "auv.json5", "client", connect=port)
            command = ("gateway", file, "--address", 2, "--link", link, "--json")
            vehicle = await stack.enter_async_context(
                running(*command, "--journal", tmp_path / "state")
            )
            unanswered = await question()  # of a shore that was never heard
            vehicle.kill()
            await vehicle.communicate()
            vehicle = await stack.enter_async_context(
                running(*command, "--journal", tmp_path / "state")
            )
            agree(await question())
            assert "success" in (await said(vehicle, "acted"))["detail"]
            with unanswered:
                pass

            shore_file = write_fleet(tmp_path / "shore.json5", "router", listen=free_port())
            shore = await stack.enter_async_context(
                running("gateway", shore_file, "--address", 1, "--link", link, "--json")
            )
            restored = await said(vehicle, "restored")
            assert restored["detail"].startswith("node 1 is heard again")
            await notice(shore, "started")
            assert asked.empty()
            shore.kill()
            await shore.communicate()
            agree(await question())
            await said(vehicle, "acted")

    run(main(), limit_s=100)
