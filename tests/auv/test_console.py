"""The page of the console in this process, without a browser; and its command."""

import asyncio
import math
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from examples.auv.__main__ import main
from examples.auv.controlstation import ControlStation
from examples.auv.fates import Fate
from examples.auv.messages import (
    ARM,
    GOTO,
    HOLD,
    NAV,
    RUDDER,
    STOP,
    THRUST,
    Setpoint,
)
from examples.auv.shore import Shore
from tests.auv.stations import Clock, nav, station_at, topics

if TYPE_CHECKING:
    from nicegui.testing import User

    from examples.auv.page import Page

ROOT = Path(__file__).parents[2]


@asynccontextmanager
async def visitor(station: ControlStation) -> "AsyncIterator[tuple[User, list[Page]]]":
    """Open the page of a station without a browser; gives the visitor, and the pages."""
    pytest.importorskip("nicegui")
    from nicegui.testing.user_simulation import user_simulation

    from examples.auv.page import Page

    pages: list[Page] = []

    def root() -> None:
        pages.append(Page(station))

    async with user_simulation(root) as user:
        await user.open("/")
        yield user, pages


def test_page_moves_sliders_shows_the_vehicle_and_stops() -> None:
    ui = pytest.importorskip("nicegui.ui")
    from nicegui.events import GenericEventArguments

    clock = Clock()
    station, carrier = station_at(clock)

    async def visit() -> None:
        async with visitor(station) as (user, pages):
            await user.should_see("not heard yet")
            user.find("arm").click()
            assert await until(lambda: ARM in topics(carrier))
            slider: Any = next(iter(user.find(marker="thrust", kind=ui.slider).elements))
            rudder: Any = next(iter(user.find(marker="rudder", kind=ui.slider).elements))
            slider.value = 15.0
            station.tick()
            assert (THRUST, Setpoint(-15.0)) in carrier.said
            await user.should_see(Fate.GIVEN.value)

            def press(key: str) -> None:
                layout = slider.client.layout
                pages[0]._key(GenericEventArguments(sender=layout, client=slider.client, args=key))

            for key in ("+", "ArrowRight", "ArrowRight", "ArrowLeft", "x"):
                press(key)
            assert (slider.value, rudder.value) == (17.0, 1.0)
            assert station.setpoints.wanted[RUDDER] == pytest.approx(math.radians(1.0))
            press("0")
            assert (slider.value, rudder.value) == (0.0, 0.0)
            press("-")
            assert station.setpoints.wanted[THRUST] == 2.0
            user.find("hold").click()
            assert await until(lambda: HOLD in topics(carrier))
            station.shore.hear(NAV, nav(), clock.now_s)
            pages[0].refresh()
            assert slider.value == 0  # the autopilot steers: what it showed does not hold
            assert not station.setpoints.wanted
            await user.should_see("the autopilot steers")
            await user.should_see("goto")
            await user.should_see("12.3 m")
            north: Any = next(iter(user.find("north m").elements))
            north.value = None
            user.find("go to").click()
            await user.should_see("go to needs north")
            assert GOTO not in topics(carrier)
            press(" ")  # a stop goes another way, with a number that is confirmed to the page
            assert STOP not in topics(carrier)
            user.find("STOP").click()
            assert await until(lambda: topics(carrier).count(STOP) == 1)
            pages[0].refresh()
            await user.should_see("STOP")

    asyncio.run(visit())


def test_page_says_that_everything_starts_and_then_what_has_died() -> None:
    station = ControlStation(Shore(), Clock())

    async def visit() -> None:
        async with visitor(station) as (user, pages):
            await user.should_see("vehicle start")
            user.find("STOP").click()  # there is nothing to be stopped, and nothing fails
            station.trouble = "gateway 1 ended with code 1"
            pages[0].refresh()
            await user.should_see("gateway 1 ended")
            await user.should_not_see("vehicle start")

    asyncio.run(visit())


def test_what_one_page_moves_the_other_shows() -> None:
    station, _ = station_at(Clock())

    async def visit() -> None:
        async with visitor(station) as (user, pages):
            await user.open("/")
            here, there = (page._sliders[THRUST] for page in pages[-2:])
            here.value = 9.0
            pages[-1].refresh()
            assert there.value == 9.0
            assert station.setpoints.wanted == {THRUST: -9.0}
            station.setpoints.reset()
            for page in pages[-2:]:
                page.refresh()
            assert (here.value, there.value) == (0.0, 0.0)
            assert station.setpoints.wanted == {}  # following is not moving

    asyncio.run(visit())


def test_a_port_that_is_taken_is_one_line() -> None:
    pytest.importorskip("nicegui")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        process = run_command("--port", str(port))
    assert process.returncode == 1
    assert process.stdout == ""
    assert process.stderr.count("\n") == 1
    assert f"--port {port}: Address already in use" in process.stderr


@pytest.mark.parametrize("arguments", ["--port 0", "--port 70000", "--port web", "--loss 1"])
def test_an_argument_that_makes_no_sense_is_refused(
    arguments: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["auv", *arguments.split()])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 2
    assert arguments.split()[1] in capsys.readouterr().err


def test_without_nicegui_there_is_one_line_that_says_what_to_install(tmp_path: Path) -> None:
    (tmp_path / "nicegui.py").write_text("raise ModuleNotFoundError(name='nicegui')\n")
    process = run_command(search_first=tmp_path)
    assert process.returncode == 2
    assert process.stderr == (
        "nicegui is missing: pip install '.[console]' in the checkout, or --headless\n"
    )


def run_command(
    *arguments: str, search_first: Path | None = None
) -> subprocess.CompletedProcess[str]:
    begin = "" if search_first is None else f"sys.path.insert(0, {str(search_first)!r}); "
    code = f"import runpy, sys; {begin}runpy.run_module('examples.auv', run_name='__main__')"
    return subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


async def until(condition: Callable[[], bool]) -> bool:
    """Give the page's tasks their turns."""
    for _ in range(200):
        if condition():
            return True
        await asyncio.sleep(0)
    return condition()
