"""A gateway on DESERT's socket, between a Zenoh network and nodes of rmw_desert."""

import asyncio
import json
from collections.abc import Awaitable, Callable
from types import SimpleNamespace
from typing import Any

import cbor2
import msgspec
import zenoh

from tests.core.rmw_desert.peer import REQUEST, RESPONSE, SAMPLE, Heard, packet
from tests.gateway.networks import (
    LocalNetwork,
    cbor,
    fence,
    free_port,
    get,
    hear,
    run,
    until,
    zenoh_config,
)
from tests.links.desert.desert_rig import SCALE, standin
from tests.links.desert.desert_rig import config as desert
from tests.links.desert.test_rmw_desert import Vehicle
from zacoustic.config import config_from_mapping
from zacoustic.core.profiles.entities import DiscoverySpec, EntityKind, RosEntitySeen
from zacoustic.core.streams.table import StreamTable
from zacoustic.gateway import Gateway, Marker, read_marker
from zacoustic.zenoh.gateway.events.said import said
from zacoustic_desert.link import DesertLink
from zacoustic_desert.server import StandInServer

SECTION: dict[str, Any] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "links": [{"locator": "desert/127.0.0.1:4000", "wire": "rmw_desert"}],
    "types": [
        {
            "name": "Pose",
            "fields": [{"name": "x", "type": "float32"}, {"name": "name", "type": "string"}],
        },
        {
            "name": "Add",
            "fields": [{"name": "a", "type": "int64"}, {"name": "b", "type": "int64"}],
        },
        {"name": "Sum", "fields": [{"name": "sum", "type": "int64"}]},
        {"name": "Empty", "fields": []},
    ],
    "streams": [
        {"id": 3, "topic": "auv1/pose", "type": "Pose", "publishers": [2]},
        {"id": 4, "topic": "auv1/goal", "type": "Pose", "publishers": [1], "depth": 9},
        {"id": 5, "service": "auv1/add", "request": "Add", "response": "Sum", "server": 2},
        {"id": 6, "service": "auv1/hasty", "request": "Empty", "response": "Empty", "server": 2,
         "timeout_s": 0.2},
        {"id": 200, "service": "shore/add", "request": "Add", "response": "Sum", "server": 1},
    ],
}  # fmt: skip

Body = Callable[[LocalNetwork, zenoh.Session, Vehicle], Awaitable[None]]


def on_desert(
    body: Body,
    *,
    section: dict[str, Any] | None = None,
    discovery: DiscoverySpec | None = None,
) -> None:
    """Run a test with a gateway at one node of a stand-in and a vehicle at the other."""

    async def main() -> None:
        server = StandInServer(standin(), time_scale=SCALE)
        await server.open()
        found = LocalNetwork(free_port())
        config = config_from_mapping(section or SECTION, source="test")
        config = msgspec.structs.replace(
            config,
            zenoh_config=zenoh_config("router", listen=found.port),
            rules=msgspec.structs.replace(config.rules, discovery=discovery),
        )
        vehicle = Vehicle()
        await vehicle.open(server.addresses[1])
        link = DesertLink(server.addresses[0], desert())
        async with Gateway(config, link=link, notify=found.notify):
            detail = f"connected to DESERT at {server.addresses[0]}"
            up = {"event": "link", "state": "up", "detail": detail, "link": ""}
            await until(lambda: up in [each.record() for each in found.notices], found.changed)
            with found.client() as client:
                await body(found, client, vehicle)
        await vehicle.close()
        await server.close()

    run(main())


def test_samples_cross_between_zenoh_and_rmw_desert() -> None:
    async def body(found: LocalNetwork, client: zenoh.Session, vehicle: Vehicle) -> None:
        heard = await hear(client, "auv1/pose")
        vehicle.say(packet(SAMPLE, 3, 1.5, "auv"))
        sample = await heard.next()
        assert cbor2.loads(sample.payload.to_bytes()) == {"x": 1.5, "name": "auv"}
        assert sample.attachment is not None
        assert read_marker(sample.attachment.to_bytes()) == Marker(acoustic=2)
        client.put("auv1/goal", cbor(x=0.5, name="goal"), encoding="application/cbor")
        assert await vehicle.hear() == Heard(SAMPLE, 4, [0.5, "goal"])
        replies = await get(client, "auv1/pose")
        assert cbor2.loads(replies.payload("auv1/pose")) == {"x": 1.5, "name": "auv"}

    on_desert(body)


def test_what_would_crash_the_vehicle_stays_on_the_local_network_and_is_counted() -> None:
    async def body(found: LocalNetwork, client: zenoh.Session, vehicle: Vehicle) -> None:
        client.put("auv1/goal", cbor(x=0.5, name="x" * 128), encoding="application/cbor")
        client.put("auv1/goal", cbor(x=0.5, name="next"), encoding="application/cbor")
        assert await vehicle.hear() == Heard(SAMPLE, 4, [0.5, "next"])
        dropped = await get(client, "@acoustic/1/dropped")
        report = json.loads(dropped.payload("@acoustic/1/dropped"))
        assert report["local"] == {"auv1/goal": {"payload": 1}}

    on_desert(body)


def test_calls_of_the_local_network_are_answered_from_the_channel_or_fail() -> None:
    async def body(found: LocalNetwork, client: zenoh.Session, vehicle: Vehicle) -> None:
        call = asyncio.create_task(
            get(client, "auv1/add", cbor(a=2, b=40), encoding="application/cbor")
        )
        kind, stream_id, (sequence, a, b) = await vehicle.hear()
        assert (kind, stream_id) == (REQUEST, 5)
        vehicle.say(packet(RESPONSE, 5, sequence, a + b))
        assert cbor2.loads((await call).payload("auv1/add")) == {"sum": 42}
        (error,) = (await get(client, "auv1/hasty", cbor(), encoding="application/cbor")).errors
        assert "unknown" in error

    on_desert(body)


def test_calls_from_the_channel_are_served_on_the_local_network() -> None:
    async def body(found: LocalNetwork, client: zenoh.Session, vehicle: Vehicle) -> None:
        def answer(query: zenoh.Query) -> None:
            with query:
                assert query.payload is not None
                asked = cbor2.loads(query.payload.to_bytes())
                total = cbor(sum=asked["a"] + asked["b"])
                query.reply("shore/add", total, encoding="application/cbor")

        client.declare_queryable("shore/add", answer, complete=True)
        await fence(client)
        vehicle.say(packet(REQUEST, 200, 999, 2, -3))
        assert await vehicle.hear() == Heard(RESPONSE, 200, [999, -1])

    on_desert(body)


def test_beacons_become_notices() -> None:
    async def body(found: LocalNetwork, client: zenoh.Session, vehicle: Vehicle) -> None:
        assert await vehicle.hear() == Heard(SAMPLE, 2, [])
        own = await vehicle.hear()
        assert (own.stream_id, own.items[0]) == (1, "shore")
        beacon = ("talker", "/auv", 0, 16, *range(16), "/auv1/pose", "Pose", False)
        vehicle.say(packet(SAMPLE, 1, *beacon))
        heard = {"event": "entity", "node": "/auv/talker", "kind": "publisher",
                 "topic": "/auv1/pose", "type": "Pose", "leaves": False}  # fmt: skip
        await until(lambda: heard in [each.record() for each in found.notices], found.changed)

    on_desert(body, discovery=DiscoverySpec(beacon_id=1, request_id=2, node_name="shore"))


def test_nobody_is_known_by_address_and_orders_do_not_cross() -> None:
    async def body(found: LocalNetwork, client: zenoh.Session, vehicle: Vehicle) -> None:
        heard = await hear(client, "auv1/pose")
        vehicle.say(packet(SAMPLE, 3, 1.5, "auv"))
        await heard.next()
        peers = (await get(client, "@acoustic/1/peers")).payload("@acoustic/1/peers")
        assert json.loads(peers) == {}
        payload = json.dumps({"for_s": 60}).encode()
        order = await get(client, "@acoustic/2/silence", payload, encoding="application/json")
        assert not order.good
        assert ["no commands cross a link" in each for each in order.errors] == [True]

    on_desert(body)


def test_a_notice_of_an_entity_is_one_line() -> None:
    context: Any = SimpleNamespace(engine=SimpleNamespace(table=StreamTable()))
    here = RosEntitySeen(
        node="talker", namespace="/", kind=EntityKind.PUBLISHER, gid=bytes(16), topic="/pose",
        type="Pose", leaves=False, seen_at=0,
    )  # fmt: skip
    left = msgspec.structs.replace(here, topic="", type="", leaves=True)
    lines = [notice.lines() for each in (here, left) if (notice := said(each, context)) is not None]
    assert lines == [
        ["entity    /talker: publisher /pose Pose"],
        ["entity    /talker: publisher leaves"],
    ]
