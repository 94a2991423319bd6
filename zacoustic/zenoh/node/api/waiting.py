"""The base of the blocking `Node`, and the functions of an application that it takes.

The rest of `zacoustic.blocking` is generated.
"""

import asyncio
from collections.abc import Callable, Coroutine
from types import TracebackType
from typing import Any, Self, TypeVar

from zacoustic.errors import LocalError
from zacoustic.zenoh.node.api.loopthread import LoopThread
from zacoustic.zenoh.node.api.node import Node

T = TypeVar("T")
Handle = TypeVar("Handle")
Made = TypeVar("Made")

Wrap = Callable[[Handle, LoopThread], Made]
"""Makes the blocking form of a handle."""


class NodeOnLoop:
    """An asyncio node on a loop in a thread of its own; a context manager.

    Args:
        endpoint: The node, not open yet.
    """

    def __init__(self, endpoint: Node) -> None:
        self._endpoint = endpoint
        self._started: LoopThread | None = None

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def open(self) -> None:
        """Start the thread, and open the link or the session; see `zacoustic.Node.open`."""
        thread = LoopThread(f"node {self._endpoint.name}")
        try:
            thread.wait(self._endpoint.open)
        except BaseException:
            thread.stop()
            raise
        self._started = thread

    def close(self) -> None:
        """Close everything, and end the thread. May be called again."""
        if self._started is None:
            return
        try:
            self._started.wait(self._endpoint.close)
        finally:
            if not self._started.is_current:
                thread, self._started = self._started, None
                thread.stop()

    @property
    def _thread(self) -> LoopThread:
        if self._started is None:
            name = self._endpoint.name
            raise LocalError(f"node {name} is not open", hint="use it in `with Node(…)`")
        return self._started


def in_thread(
    execute: Callable[[Made], T], wrap: Wrap[Handle, Made], thread: LoopThread
) -> Callable[[Handle], Coroutine[Any, Any, T]]:
    """Make a coroutine function from a blocking one; each call of it gets a thread."""

    async def pursue(handle: Handle) -> T:
        return await asyncio.to_thread(execute, wrap(handle, thread))

    return pursue


def with_handle(
    decide: Callable[[Made], bool] | None, wrap: Wrap[Handle, Made], thread: LoopThread
) -> Callable[[Handle], bool] | None:
    """Make a function for the loop from one that takes the blocking form of a handle."""
    return None if decide is None else lambda handle: decide(wrap(handle, thread))
