"""A server under attack: how late its answers are, and what it holds meanwhile."""

import asyncio
import os
import sys
import time
import urllib.request
from asyncio.subprocess import PIPE, Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Final

import msgspec

from tests.processes import killed_at_end

ROOT: Final = Path(__file__).parents[2]


class Attacked(msgspec.Struct, kw_only=True):
    """What was seen while somebody attacked."""

    answers: int
    """Answers to a visitor who asks ten times a second."""
    failures: int
    """Requests of his that were not answered, or later than 20 s."""
    latest_s: float
    """Longest time until an answer, s."""
    descriptors: int
    """Most descriptors of the server."""
    grown_mib: float
    """Growth of the server's resident memory, MiB."""
    open_connections: int
    """Connections of the attackers that were open in the end."""
    taken_mb: float
    """Bytes of theirs that the system took, MB."""


@asynccontextmanager
async def attackers(port: int, kind: str, count: int) -> AsyncIterator[Process]:
    """Let hostile visitors come."""
    process = await asyncio.create_subprocess_exec(
        sys.executable, "-m", "tests.web.hostile", str(port), kind, str(count),
        stdin=PIPE, stdout=PIPE, cwd=ROOT,
    )  # fmt: skip
    async with killed_at_end(process):
        yield process


async def attack(process_id: int, url: str, kind: str, count: int, *, seconds: float) -> Attacked:
    """Attack a server and ask it meanwhile.

    Args:
        process_id: The server, on Linux.
        url: What a good visitor asks for.
        kind: As of `hostile`.
        count: How many connections.
        seconds: For how long.
    """
    port = int(url.split("/")[2].rpartition(":")[2])
    before = resident_mib(process_id)
    found = Attacked(answers=0, failures=0, latest_s=0, descriptors=0, grown_mib=0,
                     open_connections=0, taken_mb=0)  # fmt: skip
    async with attackers(port, kind, count) as hostile:
        assert hostile.stdout is not None
        assert await hostile.stdout.readline() == b"ready\n"
        ends_at = time.monotonic() + seconds
        while time.monotonic() < ends_at:
            began_at = time.monotonic()
            try:
                await asyncio.to_thread(fetch, url)
                found.answers += 1
            except OSError:
                found.failures += 1
            found.latest_s = max(found.latest_s, time.monotonic() - began_at)
            found.descriptors = max(found.descriptors, descriptors(process_id))
            found.grown_mib = max(found.grown_mib, resident_mib(process_id) - before)
            await asyncio.sleep(0.1)
        assert hostile.stdin is not None
        hostile.stdin.close()
        *_, last = (await hostile.stdout.read()).split(b"\n")[:-1]
        found.open_connections, taken = map(int, last.split())
        found.taken_mb = taken / 1e6
    return found


def fetch(url: str) -> bytes:
    with urllib.request.urlopen(url, timeout=20) as answer:
        return bytes(answer.read())


def descriptors(process_id: int) -> int:
    return len(os.listdir(f"/proc/{process_id}/fd"))


def resident_mib(process_id: int) -> float:
    for line in Path(f"/proc/{process_id}/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024
    raise AssertionError("no VmRSS")
