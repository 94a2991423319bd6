"""The scripted dive between processes, in real time, with its events and its verdict."""

import asyncio
import math
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, Final

from examples.auv.dive import Dive
from examples.auv.expedition import expedition
from examples.auv.session import open_session
from examples.auv.shore import Shore
from examples.auv.zenohshore import ZenohShore
from zacoustic import ZacousticError
from zacoustic.command import EXIT_INTERRUPTED, stopped_by_signals, until_stopped
from zacoustic.console import one_line

_PAUSE_S = 0.2
ACCOUNT_LIMIT_S: Final = 150.0
"""Longer than any command of the dive, s: by then each has an outcome."""
_SHOWN = ("event", "lost", "status", "text", "service", "accepted", "reason")


async def headless(*, loss: float = 0.0, ros: bool = False) -> int:
    """Run the dive, until it is over or interrupted; returns the exit code."""
    stop = asyncio.Event()
    with stopped_by_signals(stop):
        code = await until_stopped(stop, _dive(loss=loss, ros=ros))
    return EXIT_INTERRUPTED if code is None else code


async def _dive(*, loss: float, ros: bool) -> int:
    begun = time.monotonic()

    def note(line: str) -> None:
        sys.stdout.write(f"{time.monotonic() - begun:7.1f} s  {one_line(line)}\n")
        sys.stdout.flush()

    def told(name: str, said: dict[str, Any]) -> None:
        if said.get("event") in ("ready", "started", "stopped", "shore", "goal", "served"):
            what = ", ".join(f"{key} {value}" for key, value in said.items() if key in _SHOWN)
            note(f"{name}: {what}")

    shore = Shore()
    with tempfile.TemporaryDirectory(prefix="zacoustic-auv-") as folder:
        try:
            async with expedition(Path(folder), told, loss=loss, ros=ros) as running:
                with await asyncio.to_thread(open_session, running.shore_endpoint) as session:
                    carrier = ZenohShore(session, shore, ros=ros)
                    dive = Dive(shore, carrier, note)
                    ends_at_s = math.inf
                    while not dive.is_over or carrier.unaccounted():
                        if running.failed.done():
                            running.failed.result()
                        now_s = time.monotonic()
                        carrier.drain(now_s)
                        dive.poke(now_s)
                        if dive.is_over:
                            ends_at_s = min(ends_at_s, now_s + ACCOUNT_LIMIT_S)
                        if now_s >= ends_at_s:
                            break
                        await asyncio.sleep(_PAUSE_S)
                    dive.problems += carrier.unaccounted()
        except ZacousticError as error:
            note(f"failed: {error}")
            return 1
    for problem in dive.problems:
        note(f"complaint: {problem}")
    if not dive.problems:
        note(f"all {sum(carrier.published.values())} samples, calls and goals have ended")
    note("the dive went as it should" if not dive.problems else "the dive failed")
    return 1 if dive.problems else 0
