"""UTC reaches the engine: before the link is up, when it was moved, and now and then."""

import asyncio
from collections.abc import Callable
from typing import Any

from tests.runtime.loop_checks import run
from tests.runtime.test_runtime import ScriptedEngine, ScriptedLink
from zacoustic.core.clock import NS_PER_S
from zacoustic.run.clocks import NodeClocks
from zacoustic.run.hostclock import ClockState, HostClock
from zacoustic.run.runner import LinkRunner

YEARS = 10**18


class Clocks:
    """Both clocks of a host, as a test sets them."""

    def __init__(self) -> None:
        self.now = 5 * NS_PER_S
        self.utc = YEARS

    def tick(self, duration_s: float, *, step_s: float = 0.0) -> None:
        """Let time pass, and somebody set the wall clock."""
        self.now += round(duration_s * NS_PER_S)
        self.utc += round((duration_s + step_s) * NS_PER_S)

    def of_node(self, ask: Callable[[], ClockState | None]) -> NodeClocks:
        """Return them as a node has them."""
        host = HostClock(utc_ns=lambda: self.utc, ask=ask)
        return NodeClocks(lambda: self.now, host, stated_error_s=0.01)


class Told(ScriptedEngine):
    """Keeps what it is told of UTC."""

    def __init__(self) -> None:
        super().__init__()
        self.clock: list[tuple[int, int | None, int]] = []

    def handle_clock(self, offset_ns: int, error_ns: int | None, now: int) -> None:
        self.clock.append((offset_ns, error_ns, now))
        self.heard.append(("clock",))


def test_engine_is_told_of_utc_in_time() -> None:
    async def scene() -> None:
        clocks, engine = Clocks(), Told()
        fake: Any = engine
        runner = LinkRunner(fake, ScriptedLink(), clocks=clocks.of_node(lambda: None))
        await runner.start()
        assert engine.heard[0] == ("clock",)
        assert engine.clock == [(YEARS - 5 * NS_PER_S, NS_PER_S // 100, 5 * NS_PER_S)]

        def poke() -> int:
            runner.apply(lambda _, now: None)
            return len(engine.clock)

        clocks.tick(9)
        assert poke() == 1
        clocks.tick(0.5, step_s=0.0005)
        assert poke() == 1  # as much as reading two clocks may differ
        clocks.tick(0.4, step_s=-3600)
        assert poke() == 2
        assert engine.clock[-1][0] == YEARS - 5 * NS_PER_S + NS_PER_S // 2000 - 3600 * NS_PER_S
        clocks.tick(10)
        assert poke() == 3
        await runner.close()

    run(scene())


def test_engine_is_told_what_the_kernel_says_and_not_what_the_file_hopes() -> None:
    async def scene() -> None:
        clocks, engine = Clocks(), Told()
        fake: Any = engine
        said: list[ClockState | None] = [ClockState(error_ns=None), ClockState(error_ns=7), None]
        runner = LinkRunner(fake, ScriptedLink(), clocks=clocks.of_node(lambda: said.pop(0)))
        await runner.start()
        for _ in range(2):
            clocks.tick(10)
            runner.apply(lambda _, now: None)
        assert [error_ns for _, error_ns, _ in engine.clock] == [None, 7, NS_PER_S // 100]
        await runner.close()

    run(scene())


def test_this_computer_can_be_asked() -> None:
    host = HostClock()
    state = host.ask()
    assert state is None or state.error_ns is None or state.error_ns >= 0
    assert host.boot == HostClock().boot
    assert host.utc_ns() > 1.6e18


def test_without_a_wall_clock_the_engine_hears_nothing() -> None:
    async def scene() -> None:
        engine = Told()
        fake: Any = engine
        runner = LinkRunner(fake, ScriptedLink())
        await runner.start()
        await asyncio.sleep(0)
        assert engine.clock == []
        await runner.close()

    run(scene())
