"""What goes wrong in an answer: the visitor's business, unless he has gone."""

import asyncio
from collections.abc import MutableMapping
from typing import Any

import pytest

pytest.importorskip("nicegui")

from zacoustic.app.tools.pages.visitors import Visitors
from zacoustic.run.web.gatekeeper import Gatekeeper, own_names


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


def answer_to(headers: dict[str, str], kind: str = "http") -> list[MutableMapping[str, Any]]:
    """Ask through the gatekeeper; gives what was said to the browser."""
    said: list[MutableMapping[str, Any]] = []

    async def application(scope: object, receive: Any, send: Any) -> None:
        await send({"type": "http.response.start", "status": 200, "headers": []})

    async def hear() -> MutableMapping[str, Any]:
        return {"type": f"{kind}.connect"}

    async def take(message: MutableMapping[str, Any]) -> None:
        said.append(message)

    written = [(name.encode(), value.encode()) for name, value in headers.items()]
    gate = Gatekeeper(application, own_names("bridge.vessel"))
    asyncio.run(gate({"type": kind, "headers": written}, hear, take))
    return said


@pytest.mark.parametrize(
    "headers",
    [
        {"host": "127.0.0.1:8090"},
        {"host": "[::1]:8090", "origin": "http://[::1]:8090"},
        {"host": "localhost:8090", "origin": "http://localhost:8090"},
        {"host": "Bridge.Vessel:8090", "origin": "http://bridge.vessel:8090"},
        {"host": "192.168.0.7"},
    ],
)
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_pages_of_ours_are_answered_and_stand_in_no_other(
    kind: str, headers: dict[str, str]
) -> None:
    (begun,) = answer_to(headers, kind)
    assert begun["status"] == 200
    assert (b"x-frame-options", b"DENY") in begun["headers"]


@pytest.mark.parametrize(
    "headers",
    [
        {},
        {"host": "evil.example:8090"},  # a name that was turned to this address
        {"host": "127.0.0.1.evil.example"},
        {"host": "127.0.0.1:8090", "origin": "http://evil.example"},
        {"host": "127.0.0.1:8090", "origin": "http://127.0.0.1:8091"},
        {"host": "127.0.0.1:8090", "origin": "null"},
        {"host": "localhost", "origin": "http://localhost.evil.example"},
        {"host": "\x1b[31m", "origin": ""},
    ],
)
def test_other_pages_and_names_are_refused(headers: dict[str, str]) -> None:
    begun, body = answer_to(headers)
    assert begun["status"] == 403
    assert body["body"].startswith(b"refused")
    (closed,) = answer_to(headers, "websocket")
    assert closed["type"] == "websocket.close"
