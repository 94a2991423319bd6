"""What nodes of ROS 2 see of the gateways, and what that costs on the water: nothing."""

import asyncio
import json
from contextlib import AsyncExitStack
from typing import Any, Final

import zenoh

from tests.gateway.islands import (
    LIMIT_S,
    Water,
    config_of,
    fence,
    free_port,
    get,
    island,
    matched,
    run,
    zenoh_config,
)
from tests.gateway.rosnode import LATCHED, Node, Told, ros_session
from tests.gateway.rospair import ADD, FIBONACCI, SECTION, STRING, TWIST, Pair, changed, with_pair
from tests.ros.captures import ADD_HASH, TWIST_HASH
from zacoustic.gateway import Gateway
from zacoustic.ros.names import interface_of
from zacoustic.ros.tokens import Entity, Token, read_token

DAY_NS: Final = 24 * 3600 * 10**9
SHORE_SEES: Final = {
    ("NN", "", "", ""),
    ("MS", "/auv1/cmd_vel", TWIST, "2::,1:,:,:,,"),
    ("MP", "/auv1/fix", "sensor_msgs/msg/NavSatFix", "::,1:,:,:,,"),
    ("MP", "/map", STRING, ":1:,1:,:,:,,"),
    ("MP", "/chat", STRING, "2::,8:,:,:,,"),
    ("MS", "/chat", STRING, "2::,8:,:,:,,"),
    ("MP", "/fleet/auv1/name", STRING, "2::,1:,:,:,,"),
    ("MS", "/fleet/shore/name", STRING, "2::,1:,:,:,,"),
    ("SS", "/add", ADD, "::,10:,:,:,,"),
    ("SS", "/fibonacci/_action/send_goal", f"{FIBONACCI}_SendGoal", "::,10:,:,:,,"),
    ("SS", "/fibonacci/_action/get_result", f"{FIBONACCI}_GetResult", "::,10:,:,:,,"),
    ("SS", "/fibonacci/_action/cancel_goal", "action_msgs/srv/CancelGoal", "::,10:,:,:,,"),
    ("MP", "/fibonacci/_action/feedback", f"{FIBONACCI}_FeedbackMessage", "::,10:,:,:,,"),
    ("MP", "/fibonacci/_action/status", "action_msgs/msg/GoalStatusArray", ":1:,1:,:,:,,"),
}
"""Kind, name, type and QoS of what the gateway of the shore declares."""
AUV_CALLS: Final = {
    ("SC", "/add"),
    ("SC", "/fibonacci/_action/send_goal"),
    ("SC", "/fibonacci/_action/get_result"),
    ("SC", "/fibonacci/_action/cancel_goal"),
    ("MS", "/fibonacci/_action/feedback"),
    ("MS", "/fibonacci/_action/status"),
}
"""Kind and name of what the gateway of the vehicle declares as a client."""


async def graph(node: Node, gateway: int) -> list[Token]:
    """Return what the gateway of an island has declared."""
    await fence(node.session)
    loop = asyncio.get_running_loop()
    ended: asyncio.Future[None] = loop.create_future()
    keys: list[str] = []

    def take(reply: Any) -> None:
        keys.append(str(reply.ok.key_expr))

    node.session.liveliness().get(
        f"@ros2_lv/{node.node.domain}/**",
        zenoh.handlers.Callback(take, lambda: loop.call_soon_threadsafe(ended.set_result, None)),
        timeout=LIMIT_S,
    )
    await ended
    tokens = [token for key in keys if (token := read_token(key)) is not None]
    return [token for token in tokens if token.node.name == f"acoustic_gateway_{gateway}"]


@with_pair()
async def test_the_graph_shows_what_lives_beyond_the_water(pair: Pair) -> None:
    tokens = await graph(pair.shore, 1)
    assert {
        (
            token.kind.value,
            token.topic,
            interface_of(token.type),
            str(token.qos) if token.topic else "",
        )
        for token in tokens
    } == SHORE_SEES
    for token in tokens:
        assert token.node.domain == 7
        assert token.node.zid == tokens[0].node.zid
        assert not token.node.zid.startswith("0")
        assert token.node.namespace == "/"
        assert (token.number == token.node.number) == (token.kind is Entity.NODE)
        assert len(str(token).split("/")) == (9 if token.kind is Entity.NODE else 13)
    numbers = [token.number for token in tokens]
    assert len(set(numbers)) == len(numbers)
    hashes = {token.topic: token.hash for token in tokens}
    assert hashes["/auv1/cmd_vel"] == TWIST_HASH
    assert hashes["/add"] == ADD_HASH
    calls = {(token.kind.value, token.topic) for token in await graph(pair.auv, 2)}
    assert calls >= AUV_CALLS


@with_pair()
async def test_a_proxy_goes_when_a_program_here_serves_and_comes_back_after_it(pair: Pair) -> None:
    name = "/add"
    own = pair.node(1, "own_server")
    watcher = pair.node(1, "watcher")
    assert await watcher.available(Entity.SERVER, name) is not None
    served = own.serve(name, ADD, lambda asked: {"sum": -1})
    client = pair.shore.client(name, ADD)
    changed = Told()
    pair.shore.session.liveliness().declare_subscriber(
        "@ros2_lv/7/**", lambda sample: changed.tell(str(sample.key_expr))
    )
    while any(token.topic == name for token in await graph(pair.shore, 1)):
        await changed.next()
    assert [value for value, _ in await client.call({"a": 2, "b": 3})] == [{"sum": -1}]
    for each in served:
        each.undeclare()
    while not any(token.topic == name for token in await graph(pair.shore, 1)):
        await changed.next()
    pair.auv.serve(name, ADD, lambda asked: {"sum": asked["a"] + asked["b"]})
    await fence(pair.auv.session)
    assert [value for value, _ in await client.call({"a": 2, "b": 3})] == [{"sum": 5}]


def test_servers_of_a_node_that_is_lost_are_not_there_until_it_is_back() -> None:
    async def main() -> None:
        water = Water()
        section = changed(heartbeat_s=1, lost_after_s=2)
        async with AsyncExitStack() as stack:
            a = await stack.enter_async_context(island(1, water, section=section))
            node = Node(stack.enter_context(ros_session(a.port)), "operator", domain=7)
            async with island(2, water, section=section):
                assert await node.available(Entity.SERVER, "/add") is not None
            await node.available(Entity.SERVER, "/add", is_there=False)
            await node.available(Entity.SERVER, "/fibonacci/_action/send_goal", is_there=False)
            # What is published may still come from somebody else.
            assert await node.available(Entity.PUBLISHER, "/chat") is not None
            async with island(2, water, section=section):
                assert await node.available(Entity.SERVER, "/add") is not None

    run(main())


@with_pair()
async def test_endpoints_that_do_not_fit_a_stream_are_explained(pair: Pair) -> None:
    for name, interface in (("/map", "std_msgs/msg/Int32"), ("/map", STRING)):
        pair.shore.endpoint(Entity.SUBSCRIPTION, name, interface)
    pair.shore.endpoint(Entity.SUBSCRIPTION, "/map", STRING, LATCHED)
    key = "@acoustic/1/dropped"
    counts: dict[str, Any] = {}
    while counts.get("map", {}).get("graph") != 2:
        found = await get(pair.shore.session, key)
        counts = json.loads(found.payload(key))["island"]


class Clock:
    """A clock that is set."""

    def __init__(self) -> None:
        self.now = 10**9

    def __call__(self) -> int:
        return self.now


def test_a_day_of_nodes_and_endpoints_puts_nothing_on_the_water() -> None:
    async def main() -> None:
        water = Water()
        clock = Clock()
        async with AsyncExitStack() as stack:
            gateways, ports = [], [free_port(), free_port()]
            for address, port in zip((1, 2), ports, strict=True):
                config = config_of(address, zenoh_config("router", listen=port), SECTION)
                gateway = Gateway(
                    config, link=water.medium.link(address), notify=lambda _: None, clock=clock
                )
                gateways.append(await stack.enter_async_context(gateway))
            for port in ports:
                sessions = [stack.enter_context(ros_session(port)) for _ in range(10)]
                for number, session in enumerate(sessions):
                    node = Node(session, f"node_{number}", domain=7)
                    for index in range(5):
                        kind = list(Entity)[1:][index % 4]
                        node.endpoint(kind, f"/node_{number}/thing_{index}", STRING)
                for session in sessions:
                    await fence(session)
            for _ in range(24 * 6):
                clock.now += DAY_NS // (24 * 6)
                for gateway in gateways:
                    assert gateway._junction is not None
                    gateway._junction.runner.apply(lambda engine, now: None)
                await asyncio.sleep(0)
            for gateway in gateways:
                assert gateway._junction is not None
                assert gateway._junction.runner.engine.poll_timeout() is None
            assert water.emissions == []

    run(main())


def test_two_gateways_on_one_island_do_not_hear_each_other_as_nodes() -> None:
    async def main() -> None:
        water = Water()
        nodes = [*SECTION["nodes"], {"address": 3, "name": "buoy"}]
        section = changed(nodes=nodes)
        async with AsyncExitStack() as stack:
            a = await stack.enter_async_context(island(1, water, section=section))
            await stack.enter_async_context(island(3, water, section=section, join=a.port))
            b = await stack.enter_async_context(island(2, water, section=section))
            shore = Node(stack.enter_context(ros_session(a.port)), "operator", domain=7)
            auv = Node(stack.enter_context(ros_session(b.port)), "autopilot", domain=7)
            told, back = auv.subscribe("/chat", STRING), shore.subscribe("/chat", STRING)
            await fence(shore.session)
            await fence(auv.session)
            servers = [
                token
                for gateway in (1, 3)
                for token in await graph(shore, gateway)
                if token.topic == "/add"
            ]
            assert [token.node.name for token in servers] == ["acoustic_gateway_1"]
            await matched(shore.session, str(shore.key("/chat", STRING)))
            publish = shore.publisher("/chat", STRING)
            for number in range(4):
                publish({"data": f"{number}"})
                assert (await told.next())[0] == {"data": f"{number}"}
                assert (await back.next())[0] == {"data": f"{number}"}
            answer = auv.publisher("/chat", STRING)
            answer({"data": "up"})
            assert (await back.next())[0] == (await told.next())[0] == {"data": "up"}
            assert told.empty()
            assert back.empty()

    run(main())
