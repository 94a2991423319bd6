"""A run of the demo from start to end.

Order of the start: the medium, which prints where it listens; the gateways, which are ready when
they answer queries for their ledgers; the clients, which report when they are ready; then the line
``go``. Order of the end: clients, gateways, medium. Any fault, including a process that dies, ends
the run with a summary that names it, and leaves nothing behind.
"""

import asyncio
import contextlib
import signal
import sys
import tempfile
import time
from collections.abc import Callable, Coroutine, Iterator
from importlib import resources
from pathlib import Path
from typing import Any, Final

from zacoustic.app.tools.demo.children import Child, ChildDiedError
from zacoustic.app.tools.demo.ledgers import LedgerListener
from zacoustic.app.tools.demo.logbook import Logbook
from zacoustic.app.tools.demo.media import Medium
from zacoustic.app.tools.demo.networks import (
    NAMES,
    SHORE,
    VEHICLE,
    LocalNetwork,
    demo_text,
    write_networks,
)
from zacoustic.app.tools.demo.verdict import Summary, summary_of
from zacoustic.app.tools.demo.views import View
from zacoustic.config import config_from_mapping
from zacoustic.config.json5 import parse_json5
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import ZacousticError

DURATION_S: Final = 32.0
"""Default time for which the vehicle reports, s."""
SHORTEST_S: Final = 20.0
"""In less time the console cannot finish its tasks, s."""
LONGEST_S: Final = 40.0
"""With more the demo would take longer than a minute, s."""
TAIL_S: Final = 8.0
"""Time for the last items to cross after that, s: a call takes 3 s."""
START_LIMIT_S: Final = 20.0
"""Time limit for the start of all processes together, s; on an idle machine they need 2."""
_TICK_S: Final = 0.1


class Mission:
    """One run.

    Args:
        view: Shows it.
        medium: The process between the two sides, for this run only.
        duration_s: Time for which the vehicle reports, s.
    """

    def __init__(self, view: View, medium: Medium, *, duration_s: float = DURATION_S) -> None:
        self.is_interrupted = False
        """Whether Ctrl-C was pressed."""
        self._view = view
        self._medium = medium
        self._duration_s = duration_s
        self._children: list[Child] = []
        self._background: list[asyncio.Task[None]] = []
        self._ready: dict[str, asyncio.Event] = {}
        self._over = asyncio.Event()
        self._ledgers: LedgerListener | None = None

    async def run(self) -> Summary:
        """Run it; returns when all processes have ended.

        Raises:
            ZacousticError: The files of the demo are wrong, or a file cannot be written.
        """
        with tempfile.TemporaryDirectory(prefix="zacoustic-demo-") as name:
            folder = Path(name)
            propagation_s = self._medium.propagation_s
            self._logbook = Logbook(_fleet_table(), time.monotonic, propagation_s=propagation_s)
            problems: tuple[str, ...] = ()
            self._failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()
            self._view.begin(self._logbook)
            with _signals_into(self._end):
                try:
                    await self._guarded(self._steps(folder))
                except ZacousticError as error:
                    problems = (str(error),)
                finally:
                    await self._stop()
                    self._view.stop()
            return summary_of(self._logbook, problems)

    def _end(self, number: signal.Signals) -> None:
        if not self._failed.done():
            self.is_interrupted = number == signal.SIGINT
            self._failed.set_exception(ChildDiedError(f"ended by {number.name}"))

    async def _steps(self, folder: Path) -> None:
        self._watch(self._tick())
        try:
            async with asyncio.timeout(START_LIMIT_S):
                await self._start(folder)
        except TimeoutError as error:
            waiting = sorted(name for name, event in self._ready.items() if not event.is_set())
            late = ", ".join(waiting) or "a gateway"
            raise ChildDiedError(f"not ready after {START_LIMIT_S:g} s: {late}") from error
        self._logbook.began_at = time.monotonic()
        for child in self._children:
            if child.name in ("vehicle", "console"):
                child.tell("go")
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self._duration_s + TAIL_S):
                await self._over.wait()
        await self._settle()

    async def _settle(self) -> None:
        """Wait until the modems have transmitted all that they got from the gateways."""
        assert self._ledgers is not None
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(TAIL_S):
                await self._ledgers.refresh()
                while self._logbook.ledger_bytes != self._logbook.transmitted_bytes:
                    await asyncio.sleep(_TICK_S)
                    await self._ledgers.refresh()

    async def _start(self, folder: Path) -> None:
        program = (sys.executable, "-m", "zacoustic")
        await self._begin(self._medium.child, *program, *self._medium.verb(folder))
        await self._ready[self._medium.child].wait()
        networks = write_networks(folder, self._medium.locators)
        for local_network in networks.values():
            await self._begin(
                f"gateway {local_network.name}", *program, "run", "gateway", str(local_network.file)
            )
        self._ledgers = LedgerListener(networks.values(), self._logbook.take_ledger)
        await self._ledgers.open()
        for address in NAMES:
            self._ready[f"gateway {NAMES[address]}"].set()
            self._take(f"gateway {NAMES[address]}", {"event": "ready"})
        await self._begin_client("vehicle", networks[VEHICLE], f"{self._duration_s}")
        await self._begin_client("console", networks[SHORE])
        for event in self._ready.values():
            await event.wait()

    async def _begin_client(self, name: str, local_network: LocalNetwork, *arguments: str) -> None:
        script = str(resources.files(__package__).joinpath(f"{name}.py"))
        # -P: do not search the folder of the script, with our modules in it, for imports.
        command = (sys.executable, "-P", script, local_network.endpoint, *arguments)
        await self._begin(name, *command, reads_input=True)

    async def _begin(self, name: str, *command: str, reads_input: bool = False) -> None:
        child = Child(name, command, self._take, reads_input=reads_input)
        self._ready[name] = asyncio.Event()
        await child.start()
        self._children.append(child)
        self._watch(child.watch())

    def _take(self, child: str, record: dict[str, Any]) -> None:
        line = self._medium.take(record) if child == self._medium.child else record
        for note in self._logbook.take(child, line or {}):
            self._view.note(note)
        if child in self._logbook.ready:
            self._ready[child].set()
        if self._logbook.has_all_crossed and not self._logbook.on_the_channel():
            self._over.set()

    async def _tick(self) -> None:
        while True:
            self._view.tick()
            await asyncio.sleep(_TICK_S)

    def _watch(self, work: Coroutine[Any, Any, None]) -> None:
        """Run some work in the background; if it fails, so does the run."""
        task = asyncio.create_task(work)
        self._background.append(task)
        task.add_done_callback(self._take_failure)

    def _take_failure(self, task: asyncio.Task[None]) -> None:
        if task.cancelled() or self._failed.done():
            return
        error = task.exception()
        if error is not None:
            self._failed.set_exception(error)

    async def _guarded(self, work: Coroutine[Any, Any, None]) -> None:
        """Do some work, unless something else fails first."""
        task = asyncio.create_task(work)
        try:
            await asyncio.wait({task, self._failed}, return_when=asyncio.FIRST_COMPLETED)
            if self._failed.done():
                self._failed.result()
            task.result()
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def _stop(self) -> None:
        """Stop everything, in order; ignore errors meanwhile."""
        for task in self._background:
            task.cancel()
        await asyncio.gather(*self._background, return_exceptions=True)
        if self._ledgers is not None:
            await self._ledgers.close()
        medium = self._medium.child
        children = [child for child in reversed(self._children) if child.name != medium]
        await asyncio.gather(*(child.stop() for child in children))
        for child in self._children:
            await child.stop()


def _fleet_table() -> StreamTable:
    """Return the streams of the demo."""
    whole: Any = parse_json5(demo_text("fleet.json5"), source="fleet.json5")
    return config_from_mapping(whole["plugins"]["acoustic"], source="fleet.json5").table


@contextlib.contextmanager
def _signals_into(end: Callable[[signal.Signals], None]) -> Iterator[None]:
    """Let signals end the run in order, however many come; on Windows asyncio handles Ctrl-C."""
    loop = asyncio.get_running_loop()
    caught = [] if sys.platform == "win32" else [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]
    for number in caught:
        loop.add_signal_handler(number, end, number)
    try:
        yield
    finally:
        for number in caught:
            loop.remove_signal_handler(number)
