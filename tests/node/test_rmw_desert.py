"""A `Node` on DESERT's socket, with a node of rmw_desert at the other end."""

import asyncio
from typing import Any

import pytest

from tests.core.rmw_desert.peer import REQUEST, RESPONSE, SAMPLE, Heard, packet
from tests.links.desert.desert_rig import serve
from tests.links.desert.test_rmw_desert import Vehicle
from zacoustic import CallContext, CallTimeoutError, Node, PayloadInvalidError, RemoteCommand
from zacoustic.config import Config, config_from_mapping
from zacoustic.errors import LocalError, RangeUnavailableError
from zacoustic_desert.server import StandInServer

SECTION: dict[str, Any] = {
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "links": [{"locator": "desert/127.0.0.1:4000", "wire": "rmw_desert"}],
    "types": [
        {"name": "Text", "fields": [{"name": "data", "type": "string"}]},
        {"name": "Empty", "fields": []},
    ],
    "streams": [
        {"id": 3, "topic": "auv1/log", "type": "Text", "publishers": [2]},
        {"id": 4, "topic": "auv1/note", "type": "Text", "publishers": [1]},
        {"id": 5, "service": "auv1/ask", "request": "Text", "response": "Text", "server": 2},
        {"id": 6, "service": "shore/ask", "request": "Empty", "response": "Text", "server": 1},
    ],
}
FAST = "period_s=0.004&listen_s=0.008&bit_rate_bps=2400000&latency_s=0.02"


def config() -> Config:
    return config_from_mapping(SECTION, source="test", address=1)


def test_topics_and_services_of_a_node() -> None:
    async def body(server: StandInServer) -> None:
        vehicle = Vehicle()
        await vehicle.open(server.addresses[1])
        link = f"desert/{server.addresses[0]}#{FAST}"
        async with Node("shore", config=config(), link=link) as node:
            log = node.subscribe("Text", "auv1/log")
            note = node.create_publisher("Text", "auv1/note")
            ask = node.create_client(("Text", "Text"), "auv1/ask")

            def answer(request: Any, context: CallContext) -> dict[str, str]:
                assert request == {}
                assert (context.client, str(context.call_id)[:2]) == (0, "0/")
                return {"data": "here"}

            node.create_service(("Empty", "Text"), "shore/ask", answer)
            note.publish({"data": "hello"})
            assert await vehicle.hear() == Heard(SAMPLE, 4, ["hello"])
            with pytest.raises(PayloadInvalidError, match="NUL"):
                note.publish({"data": "a\0b"})
            vehicle.say(packet(SAMPLE, 3, "diving"))
            sample = await anext(aiter(log))
            assert (sample.value, sample.key, sample.source) == ({"data": "diving"}, "auv1/log", 2)
            call = asyncio.create_task(ask.call({"data": "depth?"}, timeout_s=20))
            _, _, (sequence, question) = await vehicle.hear()
            assert question == "depth?"
            vehicle.say(packet(RESPONSE, 5, sequence, "12.3"))
            assert await call == {"data": "12.3"}
            with pytest.raises(CallTimeoutError):
                await ask.call({"data": "again?"}, timeout_s=0.1)
            assert (await vehicle.hear()).items[1] == "again?"
            vehicle.say(packet(REQUEST, 6, 500, 0))
            assert await vehicle.hear() == Heard(RESPONSE, 6, [500, "here"])
            with pytest.raises(RangeUnavailableError):
                await node.range(2)
            with pytest.raises(LocalError, match="no commands cross"):
                await node.command(2, RemoteCommand())
            await node.flush()
        await vehicle.close()

    serve(body)
