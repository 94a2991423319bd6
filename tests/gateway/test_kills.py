"""Sealed gateways in processes of their own, killed again and again: nothing is lost or doubled.

A vehicle publishes a log, photos and carried samples, and serves calls; a relay is between it and
the shore, which never hears it. One of the three gateways is killed at a random instant and started
at once. Programs at both ends are plain Zenoh.

Everything is given to a gateway that runs. A kill waits until the gateway counts all that it was
given, and `_ACCEPTED_S` longer, so it is in the journal by then. A sample whose delivery a kill
interrupts comes again, as docs/config.md says of `journal`; such a kill is one within `_HANDED_S`
of its first arrival.
"""

import asyncio
import contextlib
import json
import random
import time
from asyncio.subprocess import Process
from collections import Counter
from collections.abc import Callable
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Final

import pytest
import zenoh

from tests.gateway.networks import (
    free_port,
    matched,
    run,
    zenoh_config,
    zenoh_settings,
)
from tests.gateway.test_command import notice, running, start

SHORE, RELAY, AUV = 1, 2, 3
NODES: Final = (SHORE, RELAY, AUV)
LOG, PHOTO, CARRIED, ARM = "auv/log", "auv/photo", "auv/carried", "auv/arm"
TOPICS: Final = {LOG: 12, PHOTO: 900, CARRIED: 40}
"""Size of a sample, bytes."""
KILLS: Final = 1000
TIME_SCALE: Final = 10.0
_TAKEN_S, _ACCEPTED_S, _HANDED_S = 60.0, 0.3, 0.5
_CALL_S: Final = 30.0
_END_S: Final = 1800.0
_SILENT_S: Final = 20.0
"""200 s of the channel."""
SCENARIO: Final = {
    "seed": 7,
    "channel": "none",
    "loss": {"frame": 0.1},
    "nodes": [{"address": each, "position": [300.0 * each, 10.0 * each, 10]} for each in NODES],
    "links": [
        {"from": SHORE, "to": AUV, "loss": {"frame": 1}},
        {"from": AUV, "to": SHORE, "loss": {"frame": 1}},
    ],
}
SECTION: Final[dict[str, Any]] = {
    "address": SHORE,
    "nodes": [{"address": each, "name": f"n{each}"} for each in NODES],
    "routes": [{"id": 1, "name": "far", "path": list(NODES), "lifetime_s": 20}],
    "streams": [
        *(
            {
                "id": number, "topic": topic, "publishers": [AUV], "subscribers": [SHORE],
                "reliability": "reliable", "depth": 4000, "journal": True, **more,
            }
            for number, topic, more in (
                (1, LOG, {"link": "far"}),
                (2, PHOTO, {"link": "far"}),
                (3, CARRIED, {"carry": {"by": [RELAY], "after_s": 5, "expires_s": 86400}}),
            )
        ),
        {"id": 4, "service": ARM, "server": AUV, "link": "far", "timeout_s": _CALL_S},
    ],
}  # fmt: skip


class Fleet:
    """The three gateways and the programs at both ends.

    Args:
        folder: Where files and journals are.
        stack: Ends everything.
    """

    def __init__(self, folder: Path, stack: AsyncExitStack) -> None:
        self.given: dict[str, list[bytes]] = {each: [] for each in TOPICS}
        self.got: dict[str, list[tuple[float, bytes]]] = {each: [] for each in TOPICS}
        self.ran: Counter[bytes] = Counter()
        self.asked: dict[bytes, str] = {}
        """How each call ended; empty: not yet."""
        self.kills: list[tuple[float, int]] = []
        self._given_before = 0
        """How many samples the former lives of the vehicle's gateway were given."""
        self._arrived = asyncio.Event()
        self._folder = folder
        self._stack = stack
        self._link = ""
        self._ports = {each: free_port() for each in NODES}
        self._running: dict[int, Process] = {}
        self._rng = random.Random(11)
        self._auv: zenoh.Session
        self._shore: zenoh.Session

    async def begin(self) -> None:
        """Start the medium, the gateways and the programs."""
        folder = self._folder
        sea = folder / "sea.json5"
        sea.write_text(json.dumps(SCENARIO), encoding="utf-8")
        medium = await self._stack.enter_async_context(
            running(
                *("run", "medium", sea, "--listen", "127.0.0.1:0", "--json"),
                *("--time-scale", TIME_SCALE),
            )
        )
        self._link = "sim/" + (await notice(medium, "listening"))["address"]
        await _do("key", "new", folder / "fleet.key", "--network", "tests")
        for each, port in self._ports.items():
            settings = json.loads(zenoh_settings("router", listen=port))
            own = {"journal": f"journal{each}", "security": {"key": "fleet.key"}}
            settings["plugins_loading"] = {"enabled": False}
            settings["plugins"] = {"acoustic": {**SECTION, **own}}
            file = folder / f"{each}.json5"
            file.write_text(json.dumps(settings), encoding="utf-8")
            await _do("key", "rejoin", each, "--config", file, "--never", "--yes")
        for each in NODES:
            await self.start(each)
        self._shore, self._auv = (
            self._stack.enter_context(zenoh.open(zenoh_config("client", connect=self._ports[each])))
            for each in (SHORE, AUV)
        )
        loop = asyncio.get_running_loop()

        def heard(sample: zenoh.Sample) -> None:
            at, value = time.monotonic(), sample.payload.to_bytes()
            loop.call_soon_threadsafe(self._take, str(sample.key_expr), at, value)

        def arm(query: zenoh.Query) -> None:
            assert query.payload is not None
            request = query.payload.to_bytes()
            self.ran[request] += 1
            query.reply(ARM, b"armed " + request)

        for topic in TOPICS:
            self._shore.declare_subscriber(topic, heard)
        self._auv.declare_queryable(ARM, arm)
        await self.are_matched()

    async def start(self, address: int) -> None:
        """Start a gateway; the one before is dead."""
        process = await start(
            *("run", "gateway", self._folder / f"{address}.json5", "--address", address),
            *("--link", self._link, "--json"),
        )
        self._running[address] = process
        await notice(process, "started")

        async def drain() -> None:
            assert process.stdout is not None
            while await process.stdout.readline():
                pass

        self._stack.push_async_callback(_end, process, asyncio.create_task(drain()))

    async def are_matched(self) -> None:
        """Wait until the vehicle's gateway takes what the program publishes."""
        for topic in TOPICS:
            await matched(self._auv, topic)

    def publish(self, topic: str) -> None:
        """Publish the next sample of a topic."""
        number = len(self.given[topic])
        value = b"%d " % number
        value += random.Random(number).randbytes(TOPICS[topic] - len(value))
        self.given[topic].append(value)
        self._auv.put(topic, value)

    def call(self) -> None:
        """Call the vehicle from the shore."""
        request = b"call %d" % len(self.asked)
        self.asked[request] = ""

        def told(reply: zenoh.Reply) -> None:
            self.asked[request] = "error" if reply.ok is None else "answered"

        self._shore.get(ARM, told, payload=request, timeout=2 * _CALL_S)

    async def kill_one(self) -> None:
        """Kill a gateway at a random instant while traffic goes on, and start it again."""
        rng = self._rng
        until = time.monotonic() + rng.uniform(0.2, 2.0)
        while time.monotonic() < until:
            topic = rng.choice((LOG, LOG, CARRIED, PHOTO, ARM))
            if topic == ARM:
                self.call()
            elif self.waiting(topic) < 5:
                self.publish(topic)
            await asyncio.sleep(rng.uniform(0.05, 0.3))
        await self.accepted()
        victim = rng.choice(NODES)
        process = self._running[victim]
        self.kills.append((time.monotonic(), victim))
        process.kill()
        await process.wait()
        await self.start(victim)
        if victim == AUV:
            self._given_before = sum(map(len, self.given.values()))
            await self.are_matched()

    async def accepted(self) -> None:
        """Wait until the vehicle's gateway has all that it was given, in its journal."""
        given = sum(map(len, self.given.values())) - self._given_before
        async with asyncio.timeout(_TAKEN_S):
            while (taken := await self.published()) < given:
                pass  # each look is a question to the gateway
        assert taken == given
        await asyncio.sleep(_ACCEPTED_S)

    def _take(self, topic: str, at: float, value: bytes) -> None:
        self.got[topic].append((at, value))
        self._arrived.set()

    def waiting(self, topic: str) -> int:
        """Return how many samples of a topic have not arrived."""
        return len(self.given[topic]) - len({value for _, value in self.got[topic]})

    async def all_is_there(self) -> None:
        """Wait until everything has arrived, for `_END_S` at most."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(_END_S):
                while any(map(self.waiting, TOPICS)):
                    self._arrived.clear()
                    await self._arrived.wait()

    def doubled(self, topic: str) -> list[bytes]:
        """Return the samples that came again although no kill had interrupted their delivery."""
        first: dict[bytes, float] = {}
        wrong = []
        shore_kills = [at for at, node in self.kills if node == SHORE]
        for at, value in self.got[topic]:
            before = first.setdefault(value, at)
            if before != at and not any(abs(kill - before) < _HANDED_S for kill in shore_kills):
                wrong.append(value[:8])
        return wrong

    async def frames(self) -> int:
        """Return how many frames the gateways have transmitted since their starts."""
        total = 0
        for address in NODES:
            with zenoh.open(zenoh_config("client", connect=self._ports[address])) as session:
                found = await _document(session, f"@acoustic/{address}/link")
            total += found["frames_transmitted"]
        return total

    async def published(self) -> int:
        """Return how many samples the vehicle's gateway has taken since its start."""
        streams = (await _document(self._auv, f"@acoustic/{AUV}/streams"))["streams"]
        return sum(each.get("published", 0) for each in streams if each["name"] in TOPICS)


async def _document(session: zenoh.Session, key: str) -> dict[str, Any]:
    """Return a document of a gateway; a program reconnects some seconds after its restart."""
    async with asyncio.timeout(_TAKEN_S):
        while True:
            replies = await asyncio.to_thread(lambda: [*session.get(key, timeout=20.0)])
            if not replies:
                await asyncio.sleep(0.1)
                continue
            (reply,) = replies
            assert reply.ok is not None
            found: dict[str, Any] = json.loads(reply.ok.payload.to_string())
            return found


async def _do(*arguments: object) -> None:
    process = await start(*arguments)
    out, err = await process.communicate()
    assert process.returncode == 0, (arguments, out, err)


async def _end(process: Process, drain: asyncio.Task[None]) -> None:
    with contextlib.suppress(ProcessLookupError):
        process.kill()
    await process.wait()
    drain.cancel()


@pytest.mark.soak
@pytest.mark.timeout(14_000)
def test_nothing_is_lost_or_doubled_whatever_gateway_is_killed(
    tmp_path: Path, count: Callable[[int], int]
) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            fleet = Fleet(tmp_path, stack)
            await fleet.begin()
            for _ in range(count(KILLS)):
                await fleet.kill_one()
            await fleet.all_is_there()
            for topic in TOPICS:
                assert not fleet.waiting(topic), f"{topic}: {fleet.waiting(topic)} lost"
                assert not fleet.doubled(topic), f"{topic}: again {fleet.doubled(topic)}"
                values = list(dict.fromkeys(value for _, value in fleet.got[topic]))
                if topic != CARRIED:  # its counts may change places
                    assert values == fleet.given[topic], f"{topic}: order"
            await asyncio.sleep(2 * _CALL_S / TIME_SCALE)
            twice = {each: times for each, times in fleet.ran.items() if times > 1}
            assert not twice
            await asyncio.sleep(_SILENT_S)  # for the last acknowledgements
            frames = await fleet.frames()
            await asyncio.sleep(_SILENT_S)
            assert await fleet.frames() == frames, "frames go on although nothing waits"

    run(main(), limit_s=13_900.0)
