"""Processes that tests start."""

from asyncio.subprocess import Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager


@asynccontextmanager
async def killed_at_end(process: Process) -> AsyncIterator[Process]:
    """Give a process, and kill it at the end unless it has ended; its pipes are closed then."""
    try:
        yield process
    finally:
        if process.returncode is None:
            process.kill()
        await process.communicate()
