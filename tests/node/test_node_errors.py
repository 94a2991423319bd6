"""What a user does wrong is said at once, in one line, with what is allowed."""

import asyncio
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

import msgspec
import pytest

from tests.node.fleet import Arm, Nav, channel, config, free_endpoint, run_on_zenoh
from tests.runtime.loop_checks import run
from zacoustic import (
    Bounds,
    ConfigError,
    LinkOpenError,
    LinkUnavailableError,
    LocalError,
    Node,
    SessionError,
    UnknownStreamError,
    ZacousticError,
)
from zacoustic.zenoh.node.onzenoh import session

FILE = """{ mode: "router", listen: { endpoints: ["tcp/127.0.0.1:7447"] },
  plugins: { acoustic: { %s
    nodes: [ { address: 1, name: "shore" }, { address: 2, name: "auv1" } ],
    streams: [ { id: 1, topic: "note" } ] } } }"""


class Wider(msgspec.Struct):
    depth: Annotated[float, Bounds(0, 6000, step=0.1)]
    mode: str


WRONG: list[tuple[Callable[[Node], object], type[ZacousticError], str]] = [
    (lambda node: node.subscribe(Nav, "auv1/navv"), UnknownStreamError, "no stream is called"),
    (lambda node: node.subscribe(Nav, "/auv1/nav"), UnknownStreamError, "no stream is called"),
    (lambda node: node.subscribe(Nav, "auv1/nav", stream_id=11), ConfigError, "allowed: 10"),
    (lambda node: node.subscribe(bytes, "auv1/nav"), ConfigError, 'allowed: the type "Nav"'),
    (lambda node: node.subscribe(Nav, "note"), ConfigError, "allowed: opaque bytes"),
    (lambda node: node.subscribe("Navv", "auv1/nav"), ConfigError, 'allowed: the type "Nav"'),
    (lambda node: node.subscribe(Wider, "auv1/nav"), ConfigError, r"fields\[0\]"),
    (lambda node: node.subscribe(int, "auv1/nav"), ConfigError, "allowed"),  # type: ignore[type-var]
    (lambda node: node.subscribe(Nav, "auv1/arm"), LocalError, "is a service, not a topic"),
    (lambda node: node.create_client(Arm, "auv1/nav"), LocalError, "is a topic, not a service"),
    (lambda node: node.create_client(Nav, "auv1/arm"), ConfigError, "Request and Response"),  # type: ignore[call-overload]
    (lambda node: node.create_publisher(Nav, "auv1/nav"), LocalError, "not a publisher of auv1"),
    (lambda node: node.subscribe(bytes, "private"), LocalError, "not a subscriber of private"),
    (lambda node: node.subscribe(bytes, "new", stream_id=200), ConfigError, "allowed: 1..175"),
    (lambda node: node.subscribe(bytes, "new", stream_id=10), ConfigError, "10 is taken"),
    (
        lambda node: node.create_client(Arm, "new", stream_id=30),
        ConfigError,
        "give server=ADDRESS",
    ),
]


@pytest.mark.parametrize(("act", "kind", "text"), WRONG)
def test_a_wrong_endpoint_is_refused(
    act: Callable[[Node], object], kind: type[ZacousticError], text: str
) -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node("shore", config=config(), link=medium.link(1)) as node:
                with pytest.raises(kind, match=text) as caught:
                    act(node)
                assert "\n" not in str(caught.value)

    run(main())


def test_without_config_or_stream_id_the_error_says_what_to_give() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node(1, link=medium.link(1)) as node:
                with pytest.raises(LocalError, match=r"give stream_id=1\.\.175, or config=FILE"):
                    node.subscribe(Nav, "auv1/nav")
                with pytest.raises(ConfigError, match="or a msgspec"):
                    node.subscribe("Nav", "auv1/nav", stream_id=1)

    run(main())


MAKE: list[tuple[Callable[[], Node], type[ZacousticError], str]] = [
    (lambda: Node("shore", link="sim/127.0.0.1:1"), ConfigError, "has no address"),
    (lambda: Node(300, link="sim/127.0.0.1:1"), ConfigError, r"300; allowed: 1\.\.254"),
    (lambda: Node(1, address=2, link="sim/127.0.0.1:1"), ConfigError, "allowed: one"),
    (lambda: Node(1, link="nosuch/x"), LinkUnavailableError, "no link 'nosuch'"),
    (lambda: Node(1, link="sim"), ConfigError, "names no link"),
    (lambda: Node(1, link="sim/127.0.0.1:1#wait_s=0.05"), LinkOpenError, "no medium at"),
    (lambda: Node(1, link="sim/x:1", connect="tcp/x:1"), ConfigError, "one of the two"),
    (lambda: Node(9, config=config(), link="sim/127.0.0.1:1"), ConfigError, "allowed: 1, 2, 3"),
    (lambda: Node(1, config="nosuch.json5"), ConfigError, "nosuch.json5"),
    (lambda: Node("x", connect="nonsense"), SessionError, "nonsense"),
]


@pytest.mark.parametrize(("make", "kind", "text"), MAKE)
def test_a_node_that_cannot_open_leaves_nothing_behind(
    make: Callable[[], Node], kind: type[ZacousticError], text: str
) -> None:
    async def main() -> None:
        node = make()
        with pytest.raises(kind, match=text):
            await node.open()
        await node.close()
        with pytest.raises(LocalError, match="closed"):
            node.ledger()

    (run_on_zenoh if kind is SessionError else run)(main())


def test_no_router_is_an_error_in_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "CONNECT_TIMEOUT_MS", 100)

    async def main() -> None:
        endpoint = free_endpoint()
        with pytest.raises(SessionError, match="no Zenoh router at") as caught:
            await Node("x", connect=endpoint).open()
        assert endpoint in str(caught.value)
        assert "\n" not in str(caught.value)

    run_on_zenoh(main())


def test_a_cancelled_open_leaves_nothing_behind(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(session, "CONNECT_TIMEOUT_MS", 100)

    async def main() -> None:
        opening = asyncio.ensure_future(Node("x", connect=free_endpoint()).open())
        await asyncio.sleep(0)
        opening.cancel()
        with pytest.raises(asyncio.CancelledError):
            await opening

    run_on_zenoh(main())


def test_a_node_is_for_one_life() -> None:
    async def main() -> None:
        with channel() as medium:
            node = Node(1, link=medium.link(1))
            with pytest.raises(LocalError, match="node 1 is not open"):
                node.subscribe(Nav, "nav", stream_id=1)
            async with node:
                with pytest.raises(LocalError, match="opened already"):
                    await node.open()
            await node.close()
            with pytest.raises(LocalError, match="opened already"):
                await node.open()

    run(main())


@pytest.mark.parametrize(
    ("head", "arguments", "address"),
    [
        ("address: 2,", {"name_or_address": "shore"}, 1),
        ("", {"name_or_address": "auv1"}, 2),
        ("address: 2,", {"name_or_address": "planner"}, 2),
        ("address: 2,", {"name_or_address": "planner", "address": 1}, 1),
        ("", {"name_or_address": 2}, 2),
    ],
)
def test_the_address_comes_from_name_argument_or_file(
    tmp_path: Path, head: str, arguments: dict[str, Any], address: int
) -> None:
    async def main() -> None:
        path = tmp_path / "fleet.json5"
        path.write_text(FILE % head)
        with channel() as medium:
            link = medium.link(address)
            async with Node(**arguments, config=path, link=link) as node:
                assert node.address == address
                assert node.topics() == ["note"]

    run(main())


def test_a_file_without_the_address_of_this_name_says_so(tmp_path: Path) -> None:
    async def main() -> None:
        path = tmp_path / "fleet.json5"
        path.write_text(FILE % "")
        with pytest.raises(ConfigError, match=r"fleet\.json5: plugins\.acoustic\.address"):
            await Node("planner", config=path, link="sim/127.0.0.1:1").open()

    run(main())
