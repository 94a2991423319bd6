"""What goes wrong in an answer: the visitor's business, unless he has gone."""

import asyncio
from collections.abc import MutableMapping
from typing import Any

import pytest

pytest.importorskip("nicegui")

from zacoustic.tools.webpage import Visitors


def ask(*, has_left: bool, begins: bool = False) -> None:
    """Ask an application that fails, perhaps when it has begun to answer."""
    said: list[MutableMapping[str, Any]] = []

    async def hear() -> MutableMapping[str, Any]:
        return {"type": "http.disconnect" if has_left else "http.request"}

    async def take(message: MutableMapping[str, Any]) -> None:
        said.append(message)

    async def application(scope: object, receive: Any, send: Any) -> None:
        await receive()
        if begins:
            await send({"type": "http.response.start"})
        raise RuntimeError("broken")

    asyncio.run(Visitors(application)({"type": "http"}, hear, take))
    assert not said


def test_who_leaves_before_the_answer_begins_is_no_error() -> None:
    ask(has_left=True)


def test_faults_are_raised_for_who_stays_and_for_an_answer_that_has_begun() -> None:
    with pytest.raises(RuntimeError, match="broken"):
        ask(has_left=False)
    with pytest.raises(RuntimeError, match="broken"):
        ask(has_left=True, begins=True)
