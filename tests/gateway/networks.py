"""Local networks in one process: gateways on simulated water, and plain Zenoh clients.

Every session is on 127.0.0.1, with scouting off, on a port that was free a moment ago. Waiting is
always for something that happens, with a limit.
"""

import asyncio
import json
import time
from collections.abc import AsyncIterator, Callable, Coroutine, Iterator
from contextlib import asynccontextmanager, contextmanager
from typing import Any, Final, TypeVar

import cbor2
import msgspec
import zenoh
import zenoh.ext

from zacoustic.app.tools.demo.networks import free_ports
from zacoustic.channel.medium import Emission
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.config import Config, config_from_mapping
from zacoustic.core.clock import Clock
from zacoustic.core.values.encoding import JSON
from zacoustic.gateway import Gateway, Notice
from zacoustic.run.hostclock import HostClock
from zacoustic.run.journal import Journal
from zacoustic_sim.medium import Observation, SimMedium

T = TypeVar("T")

LIMIT_S: Final = 20.0
"""How long anything may take that a test waits for, s."""

TYPES: Final[list[dict[str, Any]]] = [
    {
        "name": "Nav",
        "fields": [
            {"name": "depth", "type": "float32", "range": [0, 1000], "step": 0.1},
            {"name": "mode", "type": "enum", "values": ["idle", "survey", "abort"]},
        ],
    },
    {"name": "Arm", "fields": [{"name": "arm", "type": "bool"}]},
    {"name": "Armed", "fields": [{"name": "ok", "type": "bool"}]},
    {"name": "Goto", "fields": [{"name": "depth", "type": "float64"}]},
    {"name": "Progress", "fields": [{"name": "left", "type": "float64"}]},
    {"name": "Arrived", "fields": [{"name": "depth", "type": "float64"}]},
]
SENSORS: Final = [{"name": "sensor", "values": ["ctd", "sonar"]}]
STREAMS: Final[list[dict[str, Any]]] = [
    {"id": 10, "topic": "auv1/nav", "type": "Nav", "publishers": [2], "stamp": "age"},
    {"id": 11, "topic": "auv1/text", "publishers": [1, 3], "depth": 4, "priority": "real_time"},
    {"id": 12, "topic": "chat", "depth": 8},
    {"id": 13, "topic": "fleet/{node}/status", "depth": 2},
    {"id": 14, "topic": "auv1/json", "type": "Nav", "publishers": [2], "encoding": JSON},
    {"id": 15, "topic": "{sensor}/raw/{node}", "wildcards": SENSORS},
    {"id": 20, "service": "auv1/arm", "request": "Arm", "response": "Armed", "server": 2},
    {"id": 21, "service": "auv1/echo", "server": 2, "timeout_s": 10},
    {"id": 22, "service": "auv1/hasty", "server": 2, "timeout_s": 0.2},
    {
        "id": 50,
        "action": "auv1/goto",
        "goal": "Goto",
        "feedback": "Progress",
        "result": "Arrived",
        "server": 2,
    },
    {"id": 51, "action": "auv1/raw", "server": 2, "encoding": JSON, "timeout_s": 5},
]
SECTION: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [
        {"address": 1, "name": "shore"},
        {"address": 2, "name": "auv1"},
        {"address": 3, "name": "buoy"},
    ],
    "types": TYPES,
    "streams": STREAMS,
}
"""A section with a stream of each kind."""
TABLE: Final = config_from_mapping(SECTION, source="test").table
UNRELATED: Final[dict[str, Any]] = {
    "address": 3,
    "streams": [{"id": 99, "topic": "unrelated", "publishers": [3]}],
}
"""The section of a gateway that only stands for a router."""


def run(main: Coroutine[Any, Any, T], *, limit_s: float = 60.0) -> T:
    """Run a test on a fresh loop; no task may be left and no exception unseen."""
    unseen: list[dict[str, Any]] = []

    async def limited() -> T:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: unseen.append(context))
        async with asyncio.timeout(limit_s):
            result = await main
        left = asyncio.all_tasks() - {asyncio.current_task()}
        assert not left, f"tasks left: {left}"
        return result

    result = asyncio.run(limited())
    assert not unseen, unseen
    return result


def free_port() -> int:
    """Find a port that nobody listens on now."""
    return free_ports(1)[0]


def zenoh_settings(mode: str, *, listen: int | None = None, connect: int | None = None) -> str:
    """Write settings of a session on this computer alone, as JSON."""
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting": {"delay": 0, "multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "listen": {"endpoints": [f"tcp/127.0.0.1:{listen}"] if listen else []},
    }
    if connect:
        settings["connect"] = {"endpoints": [f"tcp/127.0.0.1:{connect}"]}
    return json.dumps(settings)


def zenoh_config(
    mode: str, *, listen: int | None = None, connect: int | None = None
) -> zenoh.Config:
    """Make settings of a session on this computer alone."""
    return zenoh.Config.from_json5(zenoh_settings(mode, listen=listen, connect=connect))


def config_of(
    address: int, settings: zenoh.Config, section: dict[str, Any] | None = None
) -> Config:
    """Make the config of a node, without a locator."""
    config = config_from_mapping(section or SECTION, source="test", address=address)
    return msgspec.structs.replace(config, zenoh_config=settings)


@contextmanager
def zenoh_router(port: int | None = None) -> Iterator[int]:
    """Run a router without a gateway; gives its port."""
    port = port or free_port()
    with zenoh.open(zenoh_config("router", listen=port)):
        yield port


def counts(streams: bytes, name: str) -> dict[str, int]:
    """Return how often a stream was published, received and transmitted, of a health document."""
    (entry,) = [each for each in json.loads(streams)["streams"] if each["name"] == name]
    return {what: entry[what] for what in ("published", "received", "transmitted")}


class Channel:
    """Simulated water with nodes 1, 2 and 3, and what was sent in it."""

    def __init__(
        self, *, profile: str = "ideal", time_scale: float = 1.0, frame_loss: float = 0.0
    ) -> None:
        nodes = [
            {"address": address, "position": [distance_m, 0, 10]}
            for address, distance_m in ((1, 0), (2, 1), (3, 0.5))
        ]
        settings = {"seed": 7, "profile": profile, "channel": "none", "nodes": nodes}
        settings["loss"] = {"frame": frame_loss}
        scenario = scenario_from_mapping(settings, source="test")
        self.emissions: list[Emission] = []
        self.changed = asyncio.Event()
        self.medium = SimMedium(scenario, time_scale=time_scale, observer=self._observe)

    def _observe(self, _: int, observation: Observation) -> None:
        if isinstance(observation, Emission):
            self.emissions.append(observation)
        self.changed.set()

    def sent_by(self, address: int) -> int:
        """Count the frames of a node."""
        return sum(1 for emission in self.emissions if emission.source == address)


class LocalNetwork:
    """A gateway, the port of its router, and what it said."""

    def __init__(self, port: int) -> None:
        self.port = port
        self.notices: list[Notice] = []
        self.changed = asyncio.Event()

    def notify(self, notice: Notice) -> None:
        self.notices.append(notice)
        self.changed.set()

    def told(self, event: str) -> list[Notice]:
        """Return the notices of one kind."""
        return [each for each in self.notices if each.event == event]

    @contextmanager
    def client(self) -> Iterator[zenoh.Session]:
        """Connect a plain Zenoh client."""
        with zenoh.open(zenoh_config("client", connect=self.port)) as session:
            yield session


@asynccontextmanager
async def local_network(
    address: int,
    channel: Channel,
    *,
    section: dict[str, Any] | None = None,
    join: int | None = None,
    journal: Journal | None = None,
    clock: Clock = time.monotonic_ns,
    host: HostClock | None = None,
) -> AsyncIterator[LocalNetwork]:
    """Run a gateway: as a router of its own, or as a client of the one at port `join`."""
    found = LocalNetwork(join or free_port())
    settings = (
        zenoh_config("client", connect=join) if join else zenoh_config("router", listen=found.port)
    )
    config = config_of(address, settings, section)
    link = channel.medium.link(address)
    async with Gateway(
        config, link=link, journal=journal, notify=found.notify, clock=clock, host=host
    ):
        yield found


class Heard:
    """Samples of one subscriber, waited for on the loop.

    Args:
        session: The session.
        expression: Its keys.
        history: How many samples of each key from before it wants.
    """

    def __init__(self, session: zenoh.Session, expression: str, history: int = 0) -> None:
        self.samples: list[zenoh.Sample] = []
        self._queue: asyncio.Queue[zenoh.Sample] = asyncio.Queue()
        loop = asyncio.get_running_loop()

        def take(sample: zenoh.Sample) -> None:
            loop.call_soon_threadsafe(self._keep, sample)

        if not history:
            session.declare_subscriber(expression, take)
            return
        self._advanced = zenoh.ext.declare_advanced_subscriber(
            session,
            expression,
            zenoh.handlers.Callback(take),
            history=zenoh.ext.HistoryConfig(detect_late_publishers=True, max_samples=history),
        )

    def _keep(self, sample: zenoh.Sample) -> None:
        self.samples.append(sample)
        self._queue.put_nowait(sample)

    async def next(self) -> zenoh.Sample:
        """Wait for the next sample."""
        async with asyncio.timeout(LIMIT_S):
            return await self._queue.get()

    async def payload(self) -> bytes:
        """Wait for the next sample's payload."""
        return (await self.next()).payload.to_bytes()


async def hear(session: zenoh.Session, expression: str) -> Heard:
    """Subscribe; returns when the router knows it."""
    heard = Heard(session, expression)
    await fence(session)
    return heard


async def fence(session: zenoh.Session) -> None:
    """Wait until the router has taken in all that a client has declared and put."""
    assert not (await get(session, "nobody/answers/this")).good


async def matched(session: zenoh.Session, key: str, *, matching: bool = True) -> None:
    """Wait until somebody, or nobody, subscribes to a key, as seen from a session."""
    found = asyncio.Event()
    loop = asyncio.get_running_loop()
    publisher = session.declare_publisher(key)

    def tell(status: zenoh.MatchingStatus) -> None:
        if status.matching is matching:
            loop.call_soon_threadsafe(found.set)

    listener = publisher.declare_matching_listener(tell)
    status: Any = publisher.matching_status  # an object, not the bool that the stub promises
    try:
        if status.matching is not matching:
            async with asyncio.timeout(LIMIT_S):
                await found.wait()
    finally:
        listener.undeclare()  # type: ignore[no-untyped-call]
        publisher.undeclare()  # type: ignore[no-untyped-call]


class Replies:
    """The end of a `get`, taken apart."""

    def __init__(self, replies: list[zenoh.Reply]) -> None:
        self.good = {str(reply.ok.key_expr): reply.ok for reply in replies if reply.ok is not None}
        self.errors = [reply.err.payload.to_string() for reply in replies if reply.err is not None]

    def payload(self, key: str) -> bytes:
        return self.good[key].payload.to_bytes()


async def get(
    session: zenoh.Session,
    selector: str,
    payload: bytes | None = None,
    *,
    encoding: str | None = None,
    attachment: bytes | None = None,
) -> Replies:
    """Ask, and wait for the end of the replies."""
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[None] = loop.create_future()
    replies: list[zenoh.Reply] = []
    session.get(
        selector,
        zenoh.handlers.Callback(
            replies.append, lambda: loop.call_soon_threadsafe(ended.set_result, None)
        ),
        payload=payload,
        encoding=encoding,
        attachment=attachment,
        timeout=LIMIT_S,
        consolidation=zenoh.ConsolidationMode.NONE,
    )
    await ended
    return Replies(replies)


async def until(condition: Callable[[], object], changed: asyncio.Event) -> None:
    """Wait until a condition holds; `changed` is set whenever it may have changed."""
    async with asyncio.timeout(LIMIT_S):
        while not condition():
            changed.clear()
            await changed.wait()


def cbor(**fields: object) -> bytes:
    """Write a value as applications do."""
    return cbor2.dumps(fields)
