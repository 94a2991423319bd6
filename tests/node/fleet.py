"""A fleet on simulated water, twenty times faster than sound, and its messages."""

import asyncio
import json
import threading
from collections.abc import AsyncIterator, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Annotated, Any, Final, Literal, TypeVar

import msgspec
import pytest
import zenoh

from zacoustic import Bounds, Config, DeliveryError, Node
from zacoustic.app.tools.demo.networks import free_ports
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.config import config_from_mapping
from zacoustic_sim.medium import SimMedium
from zacoustic_sim.server import MediumServer

T = TypeVar("T")

TIME_SCALE: Final = 200.0

SECTION: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [
        {"address": 1, "name": "shore"},
        {"address": 2, "name": "auv1"},
        {"address": 3, "name": "auv2"},
    ],
    "types": [
        {
            "name": "Nav",
            "fields": [
                {"name": "depth", "type": "float32", "range": [0, 1000], "step": 0.1},
                {"name": "mode", "type": "enum", "values": ["idle", "survey", "abort"]},
            ],
        },
        {"name": "ArmRequest", "fields": [{"name": "on", "type": "bool"}]},
        {"name": "ArmResponse", "fields": [{"name": "ok", "type": "bool"}]},
        {"name": "GotoGoal", "fields": [{"name": "depth", "type": "float64"}]},
        {"name": "GotoFeedback", "fields": [{"name": "left", "type": "float64"}]},
        {"name": "GotoResult", "fields": [{"name": "depth", "type": "float64"}]},
    ],
    "streams": [
        {"id": 10, "topic": "auv1/nav", "type": "Nav", "publishers": [2], "depth": 8},
        {"id": 11, "topic": "note", "depth": 8, "stamp": "age"},
        {"id": 12, "topic": "fleet/{node}/status", "type": "Nav"},
        {
            "id": 13,
            "topic": "{node}/part/{part}",
            "wildcards": [{"name": "part", "values": ["battery", "thruster"]}],
        },
        {"id": 14, "topic": "json", "type": "Nav", "encoding": "application/json"},
        {"id": 15, "topic": "private", "publishers": [1], "subscribers": [2]},
        {
            "id": 20,
            "service": "auv1/arm",
            "request": "ArmRequest",
            "response": "ArmResponse",
            "server": 2,
        },
        {"id": 21, "service": "auv1/echo", "server": 2, "timeout_s": 30},
        {"id": 22, "service": "hush", "server": 3, "timeout_s": 30},
        {
            "id": 30,
            "action": "auv1/goto",
            "goal": "GotoGoal",
            "feedback": "GotoFeedback",
            "result": "GotoResult",
            "server": 2,
        },
        {"id": 31, "action": "auv1/raw", "server": 2},
    ],
}


class Nav(msgspec.Struct):
    depth: Annotated[float, Bounds(0, 1000, step=0.1)]
    mode: Literal["idle", "survey", "abort"]


class Arm:
    class Request(msgspec.Struct):
        on: bool

    class Response(msgspec.Struct):
        ok: bool


class Goto:
    class Goal(msgspec.Struct):
        depth: float

    class Feedback(msgspec.Struct):
        left: float

    class Result(msgspec.Struct):
        depth: float


class Raw:
    Request = bytes
    Response = bytes


def config(address: int = 1) -> Config:
    return config_from_mapping(SECTION, source="fleet.json5", address=address)


def scenario() -> Scenario:
    nodes = tuple(
        NodeSpec(address=address, position=(500.0 * address, 0.0, 20.0)) for address in (1, 2, 3)
    )
    # No collisions: a lost frame is a lost sample, and these tests are about the endpoints.
    return Scenario(nodes=nodes, channel="none", profile="ideal")


@contextmanager
def channel(profile: str = "ideal", time_scale: float = TIME_SCALE) -> Iterator[SimMedium]:
    spec = msgspec.structs.replace(scenario(), profile=profile)
    medium = SimMedium(spec, time_scale=time_scale)
    try:
        yield medium
    finally:
        medium.close()


class ChannelServer:
    """A medium server on a loop in a thread: water for other processes and other loops."""

    def __init__(self, profile: str = "ideal", time_scale: float = TIME_SCALE) -> None:
        self._profile, self._time_scale = profile, time_scale
        self.locator = ""
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._stop = asyncio.Event()
        self._thread = threading.Thread(target=self._run, name="water")

    def __enter__(self) -> str:
        self._thread.start()
        assert self._ready.wait(10)
        return self.locator

    def __exit__(self, *exc_info: object) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()

    def _run(self) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:
            runner.run(self._serve())

    async def _serve(self) -> None:
        with channel(self._profile, self._time_scale) as medium:
            server = MediumServer(medium, "127.0.0.1", 0)
            await server.open()
            self.locator = f"sim/{server.address}"
            self._ready.set()
            await self._stop.wait()
            await server.close()


def run_on_zenoh(main: Coroutine[Any, Any, T], *, limit_s: float = 30.0) -> T:
    """Run to the end; no task or thread may be left. Zenoh's own runtime keeps descriptors."""

    async def limited() -> T:
        async with asyncio.timeout(limit_s):
            result = await main
        left = asyncio.all_tasks() - {asyncio.current_task()}
        assert not left, f"tasks left: {left}"
        return result

    threads = set(threading.enumerate())
    result = asyncio.run(limited())
    for thread in set(threading.enumerate()) - threads:
        thread.join(2)  # Zenoh's callback threads end a moment after their session
        assert not thread.is_alive(), f"{thread} is left"
    return result


def free_endpoint() -> str:
    return f"tcp/127.0.0.1:{free_ports(1)[0]}"


@contextmanager
def router() -> Iterator[tuple[str, zenoh.Session]]:
    """Give a Zenoh router and its endpoint."""
    endpoint = free_endpoint()
    with zenoh.open(zenoh_config("router", listen=[endpoint])) as session:
        yield endpoint, session


@asynccontextmanager
async def plain_client(endpoint: str) -> AsyncIterator[zenoh.Session]:
    """Give a client of the router that knows nothing of zacoustic."""
    session = await asyncio.to_thread(zenoh.open, zenoh_config("client", connect=[endpoint]))
    try:
        yield session
    finally:
        await asyncio.to_thread(session.close)


async def settle(*sessions: Node | zenoh.Session) -> None:
    """Wait until the router, and then the others, know what these have declared.

    A question that nobody answers comes back at once, behind all that was said before it.
    """
    for session in sessions:
        if isinstance(session, Node):
            with pytest.raises(DeliveryError, match="serves"):
                await session.create_client(Raw, "hush").call(b"")
        else:
            assert await asyncio.to_thread(lambda asked: list(asked.get("hush")), session) == []


def zenoh_config(
    mode: str, *, listen: list[str] | None = None, connect: list[str] | None = None
) -> zenoh.Config:
    made = zenoh.Config()
    made.insert_json5("mode", json.dumps(mode))
    made.insert_json5("listen/endpoints", json.dumps(listen or []))
    made.insert_json5("connect/endpoints", json.dumps(connect or []))
    made.insert_json5("scouting/multicast/enabled", "false")
    made.insert_json5("scouting/delay", "1")  # ms: by default a router looks around for 500
    return made
