"""On real ports, under faults, a link that was closed leaves no task, thread or descriptor."""

import asyncio
import contextlib
import os
import random
import threading
from typing import Any

import pytest

from tests.links.evologics.driver.harness import HAS_TERMINALS
from tests.runtime.loop_checks import run
from zacoustic.bytestream import ByteStream
from zacoustic.errors import LinkOpenError
from zacoustic.link.emulation.running import RunningEmulation
from zacoustic.link.emulation.server import EmulationServer
from zacoustic.testing.linkpair import Side
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.emulator import EmulatedFleet, FaultKind, FaultPlan, scenario_of
from zacoustic_evologics.link import EvologicsLink

TIMES = 20
RATES = {
    FaultKind.BUSY: 0.2,
    FaultKind.LOST_REPLY: 0.05,
    FaultKind.GARBAGE: 0.1,
    FaultKind.HALF_LINE: 0.05,
    FaultKind.PIECES: 0.1,
    FaultKind.STALE: 0.3,
    FaultKind.DROP_CONNECTION: 0.03,
}
CONFIG = EvologicsConfig(reply_s=0.1)


class Held:
    """What a process holds at an instant."""

    def __init__(self) -> None:
        self.threads = set(threading.enumerate())
        self.tasks: set[asyncio.Task[Any]] = asyncio.all_tasks()
        self.descriptors = len(os.listdir("/proc/self/fd"))


async def use(side: Side, lasting_s: float) -> None:
    """Open a link and send with it, for so long; in whatever state it is then."""
    with contextlib.suppress(TimeoutError, LinkOpenError):
        async with asyncio.timeout(lasting_s):
            await side.link.open(side.receiver)
            while True:
                await side.report(side.transmit(bytes(4), 2, acknowledge=True))


async def _turns() -> None:
    """Let the emulator take, or lose, the clients that are on their way or gone."""
    for _ in range(100):
        await asyncio.sleep(0)


@pytest.mark.skipif(not os.path.isdir("/proc/self/fd"), reason="descriptors cannot be counted")
@pytest.mark.parametrize(
    ("interpreter", "is_serial"), [(Interpreter.NET, False), (Interpreter.AT, True)]
)
def test_links_closed_at_any_instant_leave_nothing(
    interpreter: Interpreter, is_serial: bool
) -> None:
    if is_serial and not HAS_TERMINALS:
        pytest.skip("no pseudo-terminals")
    rng = random.Random(5)

    async def main() -> None:
        fleet = EmulatedFleet(
            scenario_of(2, spacing_m=15.0), interpreter=interpreter, faults=FaultPlan(rates=RATES)
        )
        server = EmulationServer(RunningEmulation(fleet))
        if is_serial:
            place = server.open_terminal(1)
        else:
            place = await server.listen(1, "127.0.0.1", 0)
        try:
            before, closed, opened = Held(), 0, 0
            while closed < TIMES or opened < 3:  # a machine under load takes longer to open one
                stream = ByteStream(place.locator, first_delay_s=0.02, last_delay_s=0.1)
                side = Side(EvologicsLink(stream, CONFIG, node_address=1), 1)
                await use(side, rng.uniform(0.0, 1.2) * max(1.0, closed / TIMES))
                await side.close()
                closed += 1
                side.receiver.raise_faults()
                opened += side.is_up
                assert set(threading.enumerate()) <= before.threads
                await _turns()
                assert asyncio.all_tasks() <= before.tasks
            await _turns()
            assert Held().descriptors <= before.descriptors
        finally:
            await server.close()

    run(main(), limit_s=60.0)
