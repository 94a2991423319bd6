"""The wire profile on DESERT's socket: a gateway's engine at one node, such a node at another."""

import asyncio
import random
from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from tests.core.rmw_desert.peer import REQUEST, RESPONSE, SAMPLE, Heard, Peer, packet
from tests.core.rmw_desert.vehicle import ADD, COMMAND, NOTE, POSE, SHORE, TRIGGER, TWIST, table
from tests.links.desert.desert_rig import config, serve, standin
from tests.runtime.loop_checks import until
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, RequestReceived, ResponseReceived, SampleReceived
from zacoustic.run.runner import LinkRunner
from zacoustic_desert.link import DesertLink
from zacoustic_desert.server import StandInServer

FRAMINGS = ("native", "rmw_desert")


class Vehicle:
    """A node of rmw_desert: a TCP client of DESERT's socket, which paces nothing."""

    def __init__(self) -> None:
        self.peer = Peer()
        self.changed = asyncio.Event()

    async def open(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._reader, self._writer = await asyncio.open_connection(host, int(port))
        self._task = asyncio.create_task(self._read())

    async def close(self) -> None:
        self._writer.close()
        await self._writer.wait_closed()
        await self._task

    def say(self, data: bytes) -> None:
        self._writer.write(data)

    async def hear(self) -> Heard:
        await until(lambda: self.peer.heard, self.changed)
        return self.peer.heard.pop(0)

    async def _read(self) -> None:
        while data := await self._reader.read(4096):
            self.peer.hear(data)
            self.changed.set()


class Shore:
    """An engine on the link, and what it told."""

    def __init__(self, address: str, **settings: Any) -> None:
        engine = Engine(address=SHORE, table=table(), epoch=1, rng=random.Random(1))
        self.events: list[Event] = []
        self.changed = asyncio.Event()
        self.runner = LinkRunner(engine, DesertLink(address, config(**settings)))

    def deliver(self, event: Event) -> None:
        self.events.append(event)
        self.changed.set()

    async def next(self, kind: type[Any]) -> Any:
        def found() -> list[Any]:
            return [event for event in self.events if isinstance(event, kind)]

        await until(found, self.changed)
        event = found()[0]
        self.events.remove(event)
        return event

    def apply(self, command: Callable[[Engine, int], Any]) -> Any:
        return self.runner.apply(command)


def publish(value: object, engine: Engine, now: int) -> int:
    return engine.publish(NOTE, value, now)


def both(
    body: Callable[[Shore, Vehicle], Any], *, max_read_length: int = 64, **settings: Any
) -> None:
    """Run a test with both ends of a stand-in in use."""

    async def run(server: StandInServer) -> None:
        shore = Shore(server.addresses[0], max_read_length=max_read_length, **settings)
        vehicle = Vehicle()
        await vehicle.open(server.addresses[1])
        await shore.runner.start(shore.deliver)
        await until(lambda: shore.runner.link_state.value == "up", shore.changed)
        try:
            await body(shore, vehicle)
        finally:
            await shore.runner.close()
            await vehicle.close()
        assert shore.runner.failure is None

    serve(run, standin(max_read_length=max_read_length))


@pytest.mark.parametrize("framing", FRAMINGS)
def test_topics_and_services_cross_both_ways(framing: str) -> None:
    async def body(shore: Shore, vehicle: Vehicle) -> None:
        shore.apply(lambda engine, now: engine.publish(COMMAND, TWIST, now))
        heard = await vehicle.hear()
        assert heard == Heard(SAMPLE, COMMAND, [2.0, 0.0, 0.0, 0.0, 0.0, pytest.approx(1.8)])
        vehicle.say(packet(SAMPLE, POSE, 5.5, 5.5, 0.0, 0.0, 0.0))
        pose = await shore.next(SampleReceived)
        assert pose.value["x"] == 5.5
        shore.apply(lambda engine, now: engine.call(ADD, {"a": 2, "b": 40}, now))
        kind, stream_id, (sequence, a, b) = await vehicle.hear()
        assert (kind, stream_id) == (REQUEST, ADD)
        vehicle.say(packet(RESPONSE, ADD, sequence, a + b))
        assert (await shore.next(ResponseReceived)).value == {"sum": 42}
        vehicle.say(packet(REQUEST, TRIGGER, 500, 0))
        request = await shore.next(RequestReceived)
        answer = {"success": True, "message": "done"}
        shore.apply(lambda engine, now: engine.reply(request.call, answer, now))
        assert await vehicle.hear() == Heard(RESPONSE, TRIGGER, [500, True, "done"])
        assert shore.runner.engine.stats.dropped == {}

    both(body, framing=framing)


def test_a_packet_longer_than_a_read_of_desert_crosses_both_ways() -> None:
    async def body(shore: Shore, vehicle: Vehicle) -> None:
        text = "x" * 127
        shore.apply(lambda engine, now: engine.publish(NOTE, {"data": text}, now))
        assert await vehicle.hear() == Heard(SAMPLE, NOTE, [text])
        vehicle.say(packet(SAMPLE, NOTE, text))
        assert (await shore.next(SampleReceived)).value == {"data": text}

    both(body)


@pytest.mark.parametrize("framing", FRAMINGS)
def test_reads_that_are_shorter_than_its_packets_are_found(framing: str) -> None:
    link = DesertLink("127.0.0.1:4000", config(framing=framing))
    whole = packet(SAMPLE, NOTE, "x" * 40) if framing == "rmw_desert" else b"\0" + b"x" * 42 + b"\0"
    link.stream_opened()
    for number in range(5):
        for piece in (whole[:24], whole[24:]) if number else (whole,):
            link.bytes_received(piece, number * 10**9)
    readings = link.diagnostics()
    assert (readings["pieces"], readings["pieces_cut"]) == (9, 8)
    (finding,) = link.assess({"link": {"diagnostics": readings}})
    assert "they are cut after 24 bytes" in finding.what


def test_a_burst_that_desert_merges_and_cuts_arrives_whole() -> None:
    async def body(shore: Shore, vehicle: Vehicle) -> None:
        vehicle.say(b"".join(packet(SAMPLE, NOTE, f"number {number}") for number in range(30)))
        texts = [(await shore.next(SampleReceived)).value["data"] for _ in range(30)]
        assert texts == [f"number {number}" for number in range(30)]
        for number in range(10):
            value = {"data": f"number {number}"}
            shore.apply(partial(publish, value))
        assert [(await vehicle.hear()).items for _ in range(10)] == [
            [f"number {number}"] for number in range(10)
        ]

    both(body)


@pytest.mark.parametrize("framing", FRAMINGS)
def test_noise_and_half_a_packet_cost_nothing_but_themselves(framing: str) -> None:
    async def body(shore: Shore, vehicle: Vehicle) -> None:
        noise = random.Random(5).randbytes(300)
        vehicle.say(noise + packet(SAMPLE, NOTE, "one")[:6])
        vehicle.say(packet(SAMPLE, NOTE, "two"))
        assert (await shore.next(SampleReceived)).value == {"data": "two"}
        vehicle.say(bytes.fromhex("9999030a0a0755999907000a1affffffff5599990203fe55"))
        vehicle.say(packet(SAMPLE, NOTE, "three"))
        assert (await shore.next(SampleReceived)).value == {"data": "three"}

    both(body, framing=framing)


def test_the_engine_goes_on_when_desert_comes_back() -> None:
    async def run(server: StandInServer) -> None:
        shore = Shore(server.addresses[0])
        await shore.runner.start(shore.deliver)
        await until(lambda: shore.runner.link_state.value == "up", shore.changed)
        vehicle = Vehicle()
        await vehicle.open(server.addresses[1])
        await server.crash()
        await until(lambda: shore.runner.link_state.value == "down", shore.changed)
        await vehicle.close()
        shore.apply(lambda engine, now: engine.publish(NOTE, {"data": "late"}, now))
        server.listen()
        vehicle = Vehicle()
        await vehicle.open(server.addresses[1])
        assert await vehicle.hear() == Heard(SAMPLE, NOTE, ["late"])
        await shore.runner.close()
        await vehicle.close()

    serve(run)
