"""On-demand topics on real Zenoh: who looks at them on one side decides what leaves the other."""

import asyncio
import json
from typing import Any

import pytest

from tests.gateway.networks import (
    LIMIT_S,
    SECTION,
    Channel,
    Heard,
    LocalNetwork,
    cbor,
    get,
    hear,
    local_network,
    run,
    until,
    zenoh_router,
)
from zacoustic.zenoh.gateway.streams import matching

DEMANDED: dict[str, Any] = SECTION | {
    "streams": [
        {"id": 10, "topic": "auv1/nav", "type": "Nav", "publishers": [2], "forward": "on_demand"},
        {"id": 12, "topic": "chat", "depth": 8},
        {"id": 13, "topic": "fleet/{node}/status", "forward": "on_demand"},
        {
            "id": 14,
            "topic": "auv1/log",
            "publishers": [2],
            "subscribers": [1],
            "reliability": "reliable",
            "forward": "on_demand",
        },
    ]
}
NAV = cbor(depth=12.3, mode="survey")


@pytest.fixture(autouse=True)
def _no_grace(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matching, "GRACE_S", 0.0)


async def wanted(where: LocalNetwork, stream: str, *subscribers: int) -> None:
    """Wait until a gateway knows that these subscribe to a topic of it."""

    def last() -> tuple[int, ...] | None:
        known = [
            each.facts["subscribers"]
            for each in where.told("subscribers")
            if each.facts["stream"] == stream
        ]
        return known[-1] if known else None

    await until(lambda: last() == subscribers, where.changed)


def test_nothing_leaves_before_somebody_beyond_looks_and_after_nobody_does() -> None:
    async def scene() -> None:
        channel = Channel()
        async with (
            local_network(1, channel, section=DEMANDED) as shore,
            local_network(2, channel, section=DEMANDED) as auv,
        ):
            with shore.client() as looker, auv.client() as vehicle:
                vehicle.put("auv1/nav", NAV)
                dropped: dict[str, dict[str, int]] = {}
                async with asyncio.timeout(LIMIT_S):
                    while not dropped.get("unsubscribed"):  # it is on its way
                        replies = await get(vehicle, "@acoustic/2/dropped")
                        dropped = json.loads(replies.payload("@acoustic/2/dropped"))
                assert dropped["unsubscribed"] == {"auv1/nav": 1}
                assert channel.emissions == []
                heard = Heard(looker, "auv1/**")
                await wanted(auv, "auv1/nav", 1)
                vehicle.put("auv1/nav", NAV)
                assert str((await heard.next()).key_expr) == "auv1/nav"
                streams = json.loads(
                    (await get(looker, "@acoustic/1/streams")).payload("@acoustic/1/streams")
                )
                assert streams["streams"][0]["subscribed_to"] == [2]
            await wanted(auv, "auv1/log")
            await wanted(auv, "auv1/nav")
            with auv.client() as vehicle:
                vehicle.put("auv1/nav", NAV)
                vehicle.put("auv1/log", b"nobody")
                counts = (0, 0)
                async with asyncio.timeout(LIMIT_S):
                    while counts != (3, 1):  # each subscriber has a thread of its own
                        replies = await get(vehicle, "@acoustic/2/streams")
                        streams = json.loads(replies.payload("@acoustic/2/streams"))
                        nav, *_, log = streams["streams"]
                        counts = (nav["published"], log["refused"])
                assert (nav["transmitted"], nav["subscribers"], log["transmitted"]) == (1, [], 0)

    run(scene())


def test_only_the_nodes_are_asked_of_which_somebody_wants_to_see_something() -> None:
    async def scene() -> None:
        channel = Channel()
        async with (
            local_network(1, channel, section=DEMANDED) as shore,
            local_network(2, channel, section=DEMANDED) as auv,
            local_network(3, channel, section=DEMANDED) as buoy,
        ):
            with shore.client() as looker, auv.client() as vehicle, buoy.client() as other:
                heard = await hear(looker, "fleet/auv1/status")
                await wanted(auv, "fleet/{node}/status", 1)
                assert buoy.told("subscribers") == []
                other.put("fleet/buoy/status", b"unseen")
                vehicle.put("fleet/auv1/status", b"seen")
                assert await heard.payload() == b"seen"
                every = await hear(looker, "fleet/*/status")
                await wanted(buoy, "fleet/{node}/status", 1)
                other.put("fleet/buoy/status", b"now too")
                assert await every.payload() == b"now too"

    run(scene())


def test_reliable_topic_is_delivered_while_somebody_looks() -> None:
    async def scene() -> None:
        channel = Channel()
        async with (
            local_network(1, channel, section=DEMANDED) as shore,
            local_network(2, channel, section=DEMANDED) as auv,
        ):
            with shore.client() as looker, auv.client() as vehicle:
                heard = await hear(looker, "auv1/log")
                await wanted(auv, "auv1/log", 1)
                vehicle.put("auv1/log", b"kept")
                assert await heard.payload() == b"kept"

    run(scene())


def test_gateway_that_is_itself_a_client_sees_the_lookers_of_its_router() -> None:
    async def scene() -> None:
        channel = Channel()
        with zenoh_router() as port:
            async with (
                local_network(1, channel, section=DEMANDED, join=port) as shore,
                local_network(2, channel, section=DEMANDED) as auv,
            ):
                with shore.client() as looker, auv.client() as vehicle:
                    heard = await hear(looker, "auv1/nav")
                    await wanted(auv, "auv1/nav", 1)
                    vehicle.put("auv1/nav", NAV)
                    await heard.next()

    run(scene())


def test_looker_that_was_there_before_the_gateway_counts() -> None:
    async def scene() -> None:
        channel = Channel()
        with zenoh_router() as port:
            lookout = LocalNetwork(port)
            with lookout.client() as looker:
                heard = await hear(looker, "auv1/nav")
                async with (
                    local_network(2, channel, section=DEMANDED) as auv,
                    local_network(1, channel, section=DEMANDED, join=port),
                ):
                    await wanted(auv, "auv1/nav", 1)
                    with auv.client() as vehicle:
                        vehicle.put("auv1/nav", NAV)
                        await heard.next()

    run(scene())


def test_looker_that_is_back_at_once_costs_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(matching, "GRACE_S", 3600.0)

    async def scene() -> None:
        channel = Channel()
        async with (
            local_network(1, channel, section=DEMANDED) as shore,
            local_network(2, channel, section=DEMANDED) as auv,
        ):
            with shore.client() as looker:
                await hear(looker, "auv1/nav")
                await wanted(auv, "auv1/nav", 1)
            with shore.client() as looker, auv.client() as vehicle:
                heard = await hear(looker, "auv1/nav")
                vehicle.put("auv1/nav", NAV)
                await heard.next()
                assert len(auv.told("subscribers")) == 1

    run(scene())


def test_redundant_gateway_that_takes_over_asks_in_its_place() -> None:
    async def scene() -> None:
        channel = Channel()
        with zenoh_router() as port:
            lookout = LocalNetwork(port)
            with lookout.client() as looker:
                async with (
                    local_network(2, channel, section=DEMANDED) as auv,
                    local_network(3, channel, section=DEMANDED, join=port),
                ):
                    async with local_network(1, channel, section=DEMANDED, join=port):
                        heard = await hear(looker, "auv1/nav")
                        await wanted(auv, "auv1/nav", 1)
                    await wanted(auv, "auv1/nav", 1, 3)
                    with auv.client() as vehicle:
                        vehicle.put("auv1/nav", NAV)
                        await heard.next()

    run(scene())


def test_lost_node_is_a_key_and_a_notice() -> None:
    async def scene() -> None:
        channel = Channel()
        nodes = [dict(each) for each in SECTION["nodes"]]
        nodes[1]["lost_after_s"] = 0.05
        async with local_network(1, channel, section=SECTION | {"nodes": nodes}) as shore:
            with shore.client() as client:
                await until(lambda: shore.told("lost"), shore.changed)
                assert shore.told("lost")[0].facts["address"] == 2
                key = "@acoustic/1/peer/2/lost"
                found = json.loads((await get(client, key)).payload(key))
                assert found["lost"] is True
                assert found["heard_at_unix_s"] is None
                assert found["since_unix_s"] > 1e9
                heard = await hear(client, key)
                async with local_network(2, channel) as auv:
                    with auv.client() as vehicle:
                        vehicle.put("chat", b"here I am")
                        await until(lambda: shore.told("found"), shore.changed)
                        assert shore.told("found")[0].lines() == ["found     2 auv1"]
                await heard.next()
                assert shore.told("lost")[0].lines() == ["lost      2 auv1: not heard any more"]

    run(scene())
