"""`zacoustic predive` between two gateways in processes of their own, the medium in a third.

The far gateway has another table and no journal, and its computer's clock is 30 s ahead: one run of
the verb names all of it.
"""

import json
import re
import sys
from asyncio.subprocess import PIPE, Process, create_subprocess_exec
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any

from tests.gateway.networks import SECTION, free_port, run, zenoh_settings
from tests.gateway.test_command import ended, notice, open_medium, running, start

AHEAD = """
import sys, time
right = time.time_ns
time.time_ns = lambda: right() + 30_000_000_000
from zacoustic.app.cli import main
sys.exit(main(sys.argv[1:]))
"""


def _file(folder: Path, port: int, **section: Any) -> Path:
    settings = json.loads(zenoh_settings("router", listen=port))
    settings["plugins"] = {"acoustic": {**SECTION, **section}}
    folder.mkdir()
    path = folder / "fleet.json5"
    path.write_text(json.dumps(settings), encoding="utf-8")
    return path


async def _end(process: Process) -> None:
    process.kill()
    await process.communicate()


def test_what_differs_between_two_processes_is_named(tmp_path: Path) -> None:
    streams = [
        {**each, "publishers": [2]} if each.get("topic") == "chat" else each
        for each in SECTION["streams"]
    ]
    assert streams != SECTION["streams"]

    async def scene() -> None:
        async with AsyncExitStack() as stack:
            link = await open_medium(stack, tmp_path)
            here = _file(tmp_path / "here", free_port(), journal="journal")
            there = _file(tmp_path / "there", free_port(), streams=streams)
            near = await stack.enter_async_context(
                running("run", "gateway", here, "--address", 1, "--link", link, "--json")
            )
            await notice(near, "started")
            far = await create_subprocess_exec(
                sys.executable, "-c", AHEAD, "gateway", str(there), "--address", "2",
                "--link", link, "--json", stdout=PIPE, stderr=PIPE,
            )  # fmt: skip
            stack.push_async_callback(_end, far)
            await notice(far, "started")
            code, out, err = await ended(
                await start("predive", here, "--address", 1, "--node", 2, "--link", link, "--json")
            )
            assert (code, err) == (1, "")
            told = json.loads(out)
            text = " | ".join(each["what"] for each in told["findings"])
            assert "table mismatch: node 2" in text
            assert "node 2 auv1 has no journal" in text
            assert re.search(r"the clock of node 2 auv1 is (29|30|31) s ahead of this one", text)
            assert len(told["findings"]) == 3, text
            assert told["took_s"] < 60

    run(scene())
