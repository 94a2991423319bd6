"""Runs a coroutine of a test on a fresh loop, with a time limit, and sees that nothing is left."""

import asyncio
import os
import threading
import time
from collections.abc import Callable, Container, Coroutine
from typing import Any, TypeVar

T = TypeVar("T")

# How long what was told to end, a thread or a server's end of a connection, may take on a busy
# machine; nothing tells when a descriptor is closed.
_ENDING_S = 2.0
_LOOK_EVERY_S = 0.01


def run(main: Coroutine[Any, Any, T], *, limit_s: float = 20.0) -> T:
    """Run to the end; no task, thread or descriptor may be left, no exception unseen."""
    unseen: list[dict[str, Any]] = []

    async def limited() -> T:
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: unseen.append(context))
        async with asyncio.timeout(limit_s):
            result = await main
        left = asyncio.all_tasks() - {asyncio.current_task()}
        assert not left, f"tasks left: {left}"
        return result

    threads = set(threading.enumerate())
    descriptors = _descriptors()
    result = asyncio.run(limited())
    assert not unseen, unseen
    left_threads = [each for each in set(threading.enumerate()) - threads if _outlives(each)]
    assert not left_threads, f"threads left: {left_threads}"
    left_open = _left_open(descriptors)
    assert not left_open, f"descriptors left: {left_open}"
    return result


async def until(condition: Callable[[], object], changed: asyncio.Event) -> None:
    """Wait until a condition holds; `changed` is set whenever it may have changed."""
    while not condition():
        changed.clear()
        await changed.wait()


def _outlives(thread: threading.Thread) -> bool:
    """Tell whether a thread goes on; one of Zenoh's, of a test before, may just look in."""
    if type(thread) is not threading.Thread:
        return False
    thread.join(_ENDING_S)
    return thread.is_alive()


def _left_open(before: Container[str]) -> dict[str, str]:
    """Return what is open and was not; a server in another thread may just close its end."""
    until_s = time.monotonic() + _ENDING_S
    while left := {name: to for name, to in _descriptors().items() if name not in before}:
        if time.monotonic() >= until_s:
            break
        time.sleep(_LOOK_EVERY_S)
    return left


def _descriptors() -> dict[str, str]:
    if not os.path.isdir("/proc/self/fd"):
        return {}
    found = {}
    for name in os.listdir("/proc/self/fd"):
        try:
            found[name] = os.readlink(f"/proc/self/fd/{name}")
        except FileNotFoundError:  # the one that listed the directory
            continue
    return found
