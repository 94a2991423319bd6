"""Limits for visitors of a web page, with real sockets; the visitors are another process."""

import asyncio
import functools
import os
import socket
import sys
import time
from asyncio.subprocess import PIPE
from collections.abc import AsyncIterator, Callable
from contextlib import ExitStack, asynccontextmanager
from typing import Any, Final

import pytest

pytest.importorskip("uvicorn")

from tests.gateway.networks import LIMIT_S, run, zenoh_router
from tests.web.attack import ROOT, attack, fetch
from zacoustic.run.web.connections import Connections, Limits, uvicorn_options
from zacoustic.run.web.front import Front

LINUX: Final = pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
LATEST_S: Final = 3.0
"""On a busy machine; `tests/benchmarks/bench_web.py` measures a second."""
LOST: Final = 1
"""Who says nothing for some time is taken for one of the others, on a busy machine."""
PATIENT: Final = Limits(request_s=1.0, stall_s=1.0, per_peer=4, connections=6)


async def answer(scope: Any, receive: Any, send: Any) -> None:
    """Answer with as many bytes as the path says, when the request is complete."""
    assert scope["type"] == "http"
    while (await receive()).get("more_body"):
        pass
    size = int(scope["path"].strip("/") or 2)
    head = [(b"content-length", str(size).encode())]
    await send({"type": "http.response.start", "status": 200, "headers": head})
    await send({"type": "http.response.body", "body": b"x" * size})


@asynccontextmanager
async def opened(limits: Limits | None = None) -> AsyncIterator[Front]:
    front = Front(answer, "127.0.0.1", 0, hint="this", limits=limits)
    await front.open()
    try:
        yield front
    finally:
        await front.close()


class Visitor:
    """A connection from an address of this computer."""

    def __init__(self, port: int, host: str = "127.0.0.1") -> None:
        self.socket = socket.create_connection(
            ("127.0.0.1", port), timeout=LIMIT_S, source_address=(host, 0)
        )

    def say(self, *lines: str) -> None:
        self.socket.sendall("\r\n".join(lines).encode())

    def ask(self, path: str = "/", host: str = "127.0.0.1") -> bytes:
        self.say(f"GET {path} HTTP/1.1", f"Host: {host}", "", "")
        heard = b""
        while not heard.endswith((b"xx", b"\n0\r\n\r\n")) and (data := self.hear()):
            heard += data
        return heard

    def hear(self) -> bytes:
        """Return what comes next; nothing: the connection was ended."""
        try:
            return self.socket.recv(65536)
        except ConnectionResetError:
            return b""

    def __enter__(self) -> "Visitor":
        return self

    def __exit__(self, *exc_info: object) -> None:
        self.socket.close()


def with_front(use: Callable[[Callable[..., Visitor]], None], limits: Limits = PATIENT) -> None:
    """Use a front from another thread, by visitors that are closed in the end."""

    async def scene() -> None:
        async with opened(limits) as front:
            with ExitStack() as stack:
                come = lambda *host: stack.enter_context(Visitor(front.port, *host))  # noqa: E731
                await asyncio.to_thread(use, come)

    run(scene())


def test_who_keeps_the_server_waiting_makes_room_for_newcomers() -> None:
    def use(come: Callable[..., Visitor]) -> None:
        waiting = [come() for _ in range(4)]
        busy = come()
        assert waiting[0].hear() == b"", "the oldest"
        assert busy.ask().startswith(b"HTTP/1.1 200")
        come(), come()
        assert waiting[1].hear() == waiting[2].hear() == b""
        assert busy.ask().startswith(b"HTTP/1.1 200")

    with_front(use, Limits(per_peer=4))


def test_who_has_most_connections_makes_room_for_others() -> None:
    def use(come: Callable[..., Visitor]) -> None:
        greedy = [come("127.0.0.1") for _ in range(4)]
        others = [come(f"127.0.0.{peer}") for peer in (2, 3, 4)]
        assert greedy[0].hear() == b""
        for each in (*others, *greedy[1:]):
            assert each.ask().startswith(b"HTTP/1.1 200")

    with_front(use, Limits(per_peer=4, connections=6))


@pytest.mark.parametrize(
    "lines",
    [
        (),
        ("GET / HTTP/1.1", "Host: 127.0.0.1", "X"),
        ("POST / HTTP/1.1", "Host: 127.0.0.1", "Content-Length: 99", "", "x"),
        ("GET / HTTP/1.1", "Host: 127.0.0.1", "", "GET / HTTP/1.1", "X"),
    ],
)
def test_a_request_has_its_time(lines: tuple[str, ...]) -> None:
    def use(come: Callable[..., Visitor]) -> None:
        slow, began_at = come(), time.monotonic()
        slow.socket.settimeout(0.05)
        slow.say(*lines)
        while time.monotonic() - began_at < 5:
            try:
                slow.say("x" if lines else "")
                if slow.hear() == b"":
                    break
            except TimeoutError:
                continue
            except OSError:
                break
        assert 0.9 < time.monotonic() - began_at < 2.5

    with_front(use)


def test_a_visitor_who_asks_again_and_again_stays() -> None:
    def use(come: Callable[..., Visitor]) -> None:
        visitor = come()
        for _ in range(20):
            assert visitor.ask().startswith(b"HTTP/1.1 200")
            time.sleep(0.1)

    with_front(use)


def test_a_visitor_who_does_not_read_is_dropped() -> None:
    def use(come: Callable[..., Visitor]) -> None:
        deaf = come()
        deaf.say("GET /30000000 HTTP/1.1", "Host: 127.0.0.1", "", "")
        time.sleep(2.5)
        heard = 0
        while data := deaf.hear():
            heard += len(data)
        assert heard < 30_000_000

    with_front(use)


def test_a_visitor_who_reads_slowly_stays() -> None:
    def use(come: Callable[..., Visitor]) -> None:
        slow = come()
        slow.say("GET /30000000 HTTP/1.1", "Host: 127.0.0.1", "", "")
        heard = 0
        while heard < 30_000_000:
            data = slow.socket.recv(1_000_000)
            assert data
            heard += len(data)
            time.sleep(len(data) / 10_000_000)

    with_front(use)


def test_headers_have_a_size_and_hosts_a_name() -> None:
    def use(come: Callable[..., Visitor]) -> None:
        big = come()
        big.say("GET / HTTP/1.1", "Host: 127.0.0.1", "X: " + "a" * 20_000)
        assert big.hear().startswith(b"HTTP/1.1 400")
        assert come().ask(host="evil.example").startswith(b"HTTP/1.1 403")

    with_front(use, Limits())


class Standing:
    """A connection as the limits see it."""

    def __init__(self, peer: str, *, waits: bool = True, has_request: bool = False) -> None:
        self.peer = peer
        self.is_waiting = waits
        self.has_request = has_request
        self.is_dropped = False

    def drop(self) -> None:
        self.is_dropped = True


def test_nobody_is_dropped_whose_request_has_come_or_is_being_answered() -> None:
    connections: Any = Connections(Limits(per_peer=3))
    standing = [Standing("a", waits=False), Standing("a", has_request=True), Standing("a")]
    for each in (*standing, newest := Standing("a", has_request=True)):
        connections.admit(each)
    assert [each.is_dropped for each in standing] == [False, False, True]
    for each in (standing[2], standing[2]):
        connections.leave(each)
    connections.admit(last := Standing("a", has_request=True))
    assert (newest.is_dropped, last.is_dropped) == (False, True), "no room"


def test_a_web_socket_lasts_and_is_forgotten_when_it_ends() -> None:
    from uvicorn import Config
    from uvicorn.server import ServerState

    async def echo(scope: Any, receive: Any, send: Any) -> None:
        await receive()
        await send({"type": "websocket.accept"})
        while (await receive())["type"] != "websocket.disconnect":
            pass

    async def scene() -> None:
        options = uvicorn_options(PATIENT)
        config = Config(echo, lifespan="off", log_config=None, **options)
        config.load()
        loop = asyncio.get_running_loop()
        make = functools.partial(
            options["http"], config=config, server_state=ServerState(), app_state={}
        )
        server = await loop.create_server(make, "127.0.0.1", 0)
        connections = options["http"].args[0]

        def upgrade(port: int) -> Visitor:
            visitor = Visitor(port)
            visitor.say(
                "GET / HTTP/1.1", "Host: 127.0.0.1", "Upgrade: websocket", "Connection: Upgrade",
                "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==", "Sec-WebSocket-Version: 13", "", "",
            )  # fmt: skip
            assert visitor.hear().startswith(b"HTTP/1.1 101")
            return visitor

        visitor = await asyncio.to_thread(upgrade, server.sockets[0].getsockname()[1])
        await asyncio.sleep(3 * PATIENT.request_s)
        assert connections._count == 1
        visitor.socket.settimeout(0)
        with pytest.raises(BlockingIOError):
            visitor.socket.recv(1)
        visitor.socket.close()
        async with asyncio.timeout(LIMIT_S):
            while connections._count:  # noqa: ASYNC110
                await asyncio.sleep(0.05)
        server.close()

    run(scene())


@LINUX
@pytest.mark.parametrize(("kind", "count"), [("slow", 1200), ("silent", 1200), ("headers", 8)])
def test_a_front_answers_under_attack(kind: str, count: int) -> None:
    async def scene() -> None:
        async with opened() as front:
            url = f"http://127.0.0.1:{front.port}/1000"
            before = len(os.listdir("/proc/self/fd"))
            found = await attack(os.getpid(), url, kind, count, seconds=3)
            told = str(found)
            assert found.failures <= LOST, told
            assert found.latest_s < LATEST_S, told
            assert found.descriptors - before < 800, told
            assert found.grown_mib < 64, told
            if kind == "headers":
                assert found.taken_mb > 20, told

    run(scene())


@LINUX
def test_the_dashboard_answers_under_attack() -> None:
    pytest.importorskip("nicegui")

    async def scene() -> None:
        # NiceGUI takes a program that pytest has started for a test of its own.
        environment = {name: each for name, each in os.environ.items() if "PYTEST" not in name}
        with zenoh_router() as port:
            words = ["--connect", f"tcp/127.0.0.1:{port}", "--listen", "127.0.0.1:0"]
            process = await asyncio.create_subprocess_exec(
                sys.executable, "-m", "zacoustic", "dashboard", *words,
                stdout=PIPE, env=environment, cwd=ROOT,
            )  # fmt: skip
            try:
                assert process.stdout is not None
                async with asyncio.timeout(LIMIT_S):
                    url = (await process.stdout.readline()).decode().removeprefix("page ").strip()
                await asyncio.to_thread(come_up, url)
                for kind, count in (("slow", 1200), ("headers", 8)):
                    found = await attack(process.pid, url, kind, count, seconds=3)
                    told = f"{kind}: {found}"
                    assert found.failures <= LOST, told
                    assert found.latest_s < LATEST_S, told
                    assert found.descriptors < 800, told
                    assert found.grown_mib < 100, told
            finally:
                process.kill()
                await process.communicate()

    run(scene(), limit_s=120)


def come_up(url: str) -> None:
    """Wait until a page is there, and until its first visitors have taken their memory."""
    served = 0
    while served < 5:
        try:
            fetch(url)
            served += 1
        except OSError:
            time.sleep(0.1)
