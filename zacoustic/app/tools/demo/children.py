"""The processes of the demo: started, read, and stopped in any case.

Each child reports on standard output, one JSON object a line. The last lines of its standard error
are stored, to show them if it dies. Children get their own process group: Ctrl-C in a terminal
reaches only the demo, which stops them in order.
"""

import asyncio
import contextlib
import json
import os
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Final

from zacoustic.errors import ZacousticError

STDERR_LINES: Final = 6
"""Number of last lines of a child's standard error to store."""
STOP_LIMIT_S: Final = 5.0
"""How long a child may take to stop before it is killed, s."""
_LINE_LIMIT_BYTES: Final = 1 << 20

_OWN_GROUP: dict[str, Any]
if sys.platform == "win32":
    _OWN_GROUP = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP}
    _INTERRUPT = signal.CTRL_BREAK_EVENT
else:
    _OWN_GROUP = {"start_new_session": True}
    _INTERRUPT = signal.SIGTERM

TakeEvent = Callable[[str, dict[str, Any]], None]
"""``(child, object)``: takes each JSON object of a child."""


class ChildDiedError(ZacousticError):
    """A process of the demo ended early; the message has the end of its standard error."""


class Child:
    """One process.

    Args:
        name: Its name for people.
        command: Program and arguments.
        take: Takes its objects.
        reads_input: It ends when its standard input does; otherwise it is interrupted.
    """

    def __init__(
        self, name: str, command: Sequence[str], take: TakeEvent, *, reads_input: bool = False
    ) -> None:
        self.name = name
        self.command = tuple(command)
        self._take = take
        self._reads_input = reads_input
        self._process: asyncio.subprocess.Process | None = None
        self._readers: list[asyncio.Task[None]] = []
        self._problems: deque[str] = deque(maxlen=STDERR_LINES)

    @property
    def exit_code(self) -> int | None:
        """Its exit code; None: it is running."""
        return None if self._process is None else self._process.returncode

    async def start(self) -> None:
        """Start it.

        Raises:
            ChildDiedError: The program cannot be started.
        """
        try:
            process = self._process = await asyncio.create_subprocess_exec(
                *self.command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                limit=_LINE_LIMIT_BYTES,
                env={**os.environ, "PYTHONUNBUFFERED": "1"},
                **_OWN_GROUP,
            )
        except OSError as error:
            raise ChildDiedError(f"{self.name} cannot be started: {error.strerror}") from error
        self._readers = [
            asyncio.create_task(self._read_output(process), name=f"{self.name} output"),
            asyncio.create_task(self._read_problems(process), name=f"{self.name} stderr"),
        ]

    async def watch(self) -> None:
        """Wait until it ends by itself.

        Raises:
            ChildDiedError: It has ended, with any code: no child may end before its stop.
            Exception: Any error of `take`.
        """
        assert self._process is not None
        code, *_ = await asyncio.gather(self._process.wait(), *self._readers)
        said = " | ".join(self._problems) or "it said nothing on standard error"
        raise ChildDiedError(f"{self.name} ended with code {code}: {said}")

    def tell(self, line: str) -> None:
        """Write a line to its standard input; ignore a child that no longer reads."""
        if self._process is not None and self._process.stdin is not None:
            with contextlib.suppress(OSError):
                self._process.stdin.write(f"{line}\n".encode())

    def ask_to_stop(self) -> None:
        """End its standard input, or interrupt it; does not wait."""
        process = self._process
        if process is None or process.returncode is not None:
            return
        with contextlib.suppress(OSError):
            if process.stdin is not None:
                process.stdin.close()
            if not self._reads_input:
                process.send_signal(_INTERRUPT)

    async def stop(self) -> None:
        """Stop it, by force if it takes too long; may be repeated."""
        process = self._process
        if process is None:
            return
        self.ask_to_stop()
        try:
            async with asyncio.timeout(STOP_LIMIT_S):
                await process.wait()
        except TimeoutError:
            pass
        finally:
            # Reached even if the wait itself is cancelled: no process stays behind.
            if process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
        await process.wait()
        for reader in self._readers:
            reader.cancel()
        await asyncio.gather(*self._readers, return_exceptions=True)

    async def _read_output(self, process: asyncio.subprocess.Process) -> None:
        while process.stdout is not None and (line := await process.stdout.readline()):
            with contextlib.suppress(ValueError):
                event = json.loads(line)
                if isinstance(event, dict):
                    self._take(self.name, event)

    async def _read_problems(self, process: asyncio.subprocess.Process) -> None:
        while process.stderr is not None and (line := await process.stderr.readline()):
            text = line.decode(errors="replace").strip()
            if text:
                self._problems.append(text)
