"""Web pages under attack: a gateway's metrics and the dashboard, with a thousand slow visitors.

    .venv/bin/python tests/benchmarks/bench_web.py [SECONDS]

Both are processes that may have 1,024 descriptors, as usual. For `SECONDS` each (10 unless told
otherwise), a thousand connections stay open and say nothing, a thousand send a byte every half
second, and eight send headers without end, from another process of the same address. A good visitor
asks ten times a second. Printed are his answers and the latest one, the server's descriptors and
the growth of its memory; and, of the gateway, whether it finds its modem again, which is taken away
and comes back meanwhile. Exits 1 when an answer is later than a second or missing, or the modem
stays away. Linux only.
"""

import asyncio
import json
import os
import resource
import sys
import tempfile
import time
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.gateway.networks import SECTION, free_port, zenoh_settings
from tests.processes import killed_at_end
from tests.web.attack import Attacked, attack, fetch

DESCRIPTORS: Final = 1024
ATTACKS: Final = {"silent": 1000, "slow": 1000, "headers": 8}
CHANNEL: Final = {"channel": "none", "nodes": [{"address": 1, "position": [0, 0, 10]},
                                               {"address": 2, "position": [9, 0, 10]}]}  # fmt: skip
MODEM_S: Final = 20.0
"""Time for the gateway to find its modem again."""


@asynccontextmanager
async def running(*words: object) -> AsyncIterator[Process]:
    """Run a verb with the usual number of descriptors."""
    environment = {name: each for name, each in os.environ.items() if "PYTEST" not in name}
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "zacoustic", *map(str, words), stdout=PIPE, env=environment,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (DESCRIPTORS, DESCRIPTORS)),
    )  # fmt: skip
    async with killed_at_end(process):
        yield process


async def line_with(process: Process, key: str) -> str:
    """Return the value of a key in the first line of JSON that has it."""
    assert process.stdout is not None
    while line := await process.stdout.readline():
        found: dict[str, Any] = json.loads(line)
        if found.get(key):
            return str(found[key])
    raise AssertionError(f"no {key}")


async def measure(seconds: float) -> bool:
    """Attack both; returns whether they hold."""
    holds = True
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "scenario.json5").write_text(json.dumps(CHANNEL), encoding="utf-8")
        port, medium = free_port(), free_port()
        settings = json.loads(zenoh_settings("router", listen=port))
        settings["plugins_loading"] = {"enabled": False}
        settings["plugins"] = {"acoustic": {"__required__": False, **SECTION}}
        (folder / "shore.json5").write_text(json.dumps(settings), encoding="utf-8")
        medium_words = (
            "run",
            "medium",
            folder / "scenario.json5",
            "--listen",
            f"127.0.0.1:{medium}",
        )
        gateway = ("run", "gateway", folder / "shore.json5", "--address", 1, "--json",
                   "--link", f"sim/127.0.0.1:{medium}", "--metrics", 0)  # fmt: skip
        page = ("dashboard", "--connect", f"tcp/127.0.0.1:{port}", "--listen", "127.0.0.1:0",
                "--json")  # fmt: skip
        async with running(*medium_words) as modem:
            await asyncio.sleep(2)
            async with running(*gateway) as shore, running(*page) as dashboard:
                urls = (await line_with(shore, "metrics"), await line_with(dashboard, "url"))
                await settled(*urls)
                for name, process, url in zip(
                    ("metrics", "dashboard"), (shore, dashboard), urls, strict=True
                ):
                    for kind, count in ATTACKS.items():
                        found = await attack(process.pid, url, kind, count, seconds=seconds)
                        holds = holds and found.failures == 0 and found.latest_s <= 1
                        show(name, kind, count, found)
                modem.kill()
                await modem.wait()
                attacked = asyncio.create_task(
                    attack(shore.pid, urls[0], "silent", 1000, seconds=MODEM_S)
                )
                await asyncio.sleep(3)
                async with running(*medium_words):
                    took_s = await modem_after(urls[0])
                    await attacked
                print("the gateway's modem is back after", f"{took_s:.1f} s" if took_s else "never")
                holds = holds and took_s is not None
    return holds


def show(name: str, kind: str, count: int, found: Attacked) -> None:
    print(
        f"{name:10}{count:6} {kind:8}{found.answers:5} answers, {found.failures} missing, latest "
        f"{found.latest_s:6.2f} s, {found.descriptors:5} descriptors, +{found.grown_mib:.0f} MiB, "
        f"{found.open_connections} open, {found.taken_mb:.1f} MB taken",
        flush=True,
    )


async def settled(*urls: str) -> None:
    """Wait until all answer, and until the first answers have taken their memory."""
    for url in urls:
        for _ in range(100):
            try:
                await asyncio.to_thread(fetch, url)
            except OSError:
                await asyncio.sleep(0.2)
            else:
                break
        for _ in range(20):
            await asyncio.to_thread(fetch, url)


async def modem_after(url: str) -> float | None:
    """Return how long it takes until the gateway has its modem, s; None: too long."""
    began_at = time.monotonic()
    while time.monotonic() - began_at < MODEM_S:
        try:
            if b'zacoustic_link_up{link="link"} 1.0' in await asyncio.to_thread(fetch, url):
                return time.monotonic() - began_at
        except OSError:
            pass
        await asyncio.sleep(0.3)
    return None


if __name__ == "__main__":
    sys.exit(not asyncio.run(measure(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0)))
