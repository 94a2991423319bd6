"""What a link waits for is logged where everybody sees it, once for each thing."""

import logging
from typing import Any

import pytest

from tests.runtime.loop_checks import run
from tests.runtime.test_runtime import ScriptedEngine, ScriptedLink
from zacoustic.core.linktypes import LinkState
from zacoustic.run.runner import LinkRunner


def test_warnings_are_one_for_each_thing_that_is_waited_for(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def scene() -> None:
        fake: Any = ScriptedEngine()
        runner = LinkRunner(fake, ScriptedLink())
        await runner.start()
        caplog.clear()
        runner.sides[0].detail = ""
        runner.sides[0].state_changed(LinkState.OPENING, "connecting")
        for _ in range(9):
            runner.sides[0].state_changed(
                LinkState.OPENING, "/dev/modem: in use by another program"
            )
        for _ in range(9):
            runner.sides[0].state_changed(LinkState.DOWN, "/dev/modem: No such file or directory")
        runner.sides[0].state_changed(LinkState.UP, "S2C")
        runner.sides[0].state_changed(LinkState.DOWN, "/dev/modem: No such file or directory")
        assert (runner.link_state, runner.link_detail[:10]) == (LinkState.DOWN, "/dev/modem")
        await runner.close()

    with caplog.at_level(logging.INFO):
        run(scene())
    said = [each.getMessage() for each in caplog.records if each.levelno >= logging.WARNING]
    assert [each.partition(": link ")[2] for each in said] == [
        "opening: /dev/modem: in use by another program",
        "down: /dev/modem: No such file or directory",
        "down: /dev/modem: No such file or directory",
    ]
