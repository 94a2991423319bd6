"""What nodes of ROS 2 see of the gateways, and what that costs on the channel: nothing."""

import asyncio
import json
import time
from contextlib import AsyncExitStack
from typing import Any, Final

import msgspec
import zenoh

from tests.gateway.networks import (
    LIMIT_S,
    Channel,
    config_of,
    fence,
    free_port,
    get,
    local_network,
    matched,
    run,
    zenoh_config,
)
from tests.gateway.rosnode import LATCHED, Node, reply, ros_session
from tests.gateway.rospair import ADD, FIBONACCI, SECTION, STRING, TWIST, Pair, changed, with_pair
from tests.ros import captures
from tests.ros.captures import ADD_HASH, TWIST_HASH
from zacoustic.gateway import Gateway
from zacoustic.ros.attachment import Attachment, read_attachment
from zacoustic.ros.names import interface_of
from zacoustic.ros.tokens import Entity, Token, gid_of, read_token

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
    """Return what the gateway of a local network has declared."""
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
async def test_the_graph_shows_what_lives_at_a_remote_node(pair: Pair) -> None:
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


CAPTURED: Final = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "ros": {"domain": 0},
    "streams": [
        {
            "id": 1,
            "topic": "/chatter",
            "type": STRING,
            "ros": {},
            "publishers": [2],
            "reliability": "reliable",
            "depth": 10,
        },
        {
            "id": 2,
            "topic": "/robot1/cmd_vel",
            "type": TWIST,
            "ros": {},
            "publishers": [2],
            "durability": "transient_local",
        },
        {"id": 3, "service": "/add_two_ints", "type": ADD, "server": 2, "ros": {}},
        {"id": 4, "service": "/other/add_two_ints", "type": ADD, "server": 1, "ros": {}},
    ],
}
"""The streams of the captures."""


@with_pair(CAPTURED)
async def test_what_is_said_is_what_was_captured_field_by_field(pair: Pair) -> None:
    tokens = {(token.kind, token.topic): token for token in await graph(pair.shore, 1)}
    for text in captures.TOKENS:
        seen = read_token(text)
        assert seen is not None
        topic = seen.topic if seen.kind is not Entity.CLIENT else "/other/add_two_ints"
        ours = tokens[seen.kind, topic]
        # Who says it differs, and nothing else.
        node = msgspec.structs.replace(
            ours.node,
            zid=seen.node.zid,
            number=seen.node.number,
            name=seen.node.name,
            namespace=seen.node.namespace,
            enclave=seen.node.enclave,
        )
        same = msgspec.structs.replace(ours, node=node, number=seen.number, topic=seen.topic)
        assert str(same) == text

    told = pair.shore.session.declare_subscriber("0/**", zenoh.handlers.FifoChannel(9))
    asked = pair.auv.session.declare_queryable(captures.ADD_KEY, zenoh.handlers.FifoChannel(9))
    await matched(pair.auv.session, captures.STRING_KEY)
    await matched(pair.auv.session, captures.TWIST_KEY)
    await fence(pair.shore.session)
    pair.auv.publisher("/chatter", STRING)({"data": "hello"})
    sample = await asyncio.to_thread(told.recv)
    assert str(sample.key_expr) == captures.STRING_KEY
    assert sample.payload.to_bytes() == captures.STRING_PAYLOAD
    assert str(sample.encoding) == "application/cdr"
    compare(sample.attachment, captures.STRING_ATTACHMENT, tokens[Entity.PUBLISHER, "/chatter"])
    pair.auv.publisher("/robot1/cmd_vel", TWIST)({"linear": {"x": 1.0}})
    sample = await asyncio.to_thread(told.recv)
    assert str(sample.key_expr) == captures.TWIST_KEY
    assert sample.payload.to_bytes() == captures.TWIST_PAYLOAD
    answer = pair.shore.client("/add_two_ints", ADD).ask({"a": 2, "b": 3})
    query = await asyncio.to_thread(asked.recv)
    assert str(query.key_expr) == captures.ADD_KEY
    assert query.payload is not None
    assert query.payload.to_bytes() == captures.ADD_REQUEST
    (client,) = [token for token in await graph(pair.auv, 2) if token.kind is Entity.CLIENT]
    compare(query.attachment, captures.ADD_ATTACHMENT, client)
    reply(query, pair.auv.message(f"{ADD}_Response").write({"sum": 5}))
    assert (await answer.next())[0] == {"sum": 5}


def compare(said: zenoh.ZBytes | None, captured: bytes, token: Token) -> None:
    """Compare an attachment with a captured one: the form is the same, the content our own."""
    assert said is not None
    content, seen = said.to_bytes(), read_attachment(captured)
    assert len(content) == len(captured)
    assert content[16] == captured[16]
    ours = read_attachment(content)
    assert ours is not None
    assert seen is not None
    assert ours.sequence == 1  # rmw_zenoh begins with it; the client that was captured with 0 too
    assert ours.gid == gid_of(token)
    assert abs(ours.stamp_ns - time.time_ns()) < 60 * 10**9
    again = Attachment(sequence=ours.sequence, stamp_ns=seen.stamp_ns, gid=seen.gid)
    whole = Attachment(sequence=seen.sequence, stamp_ns=seen.stamp_ns, gid=seen.gid)
    assert again.encode()[8:] == captured[8:]
    assert whole.encode() == captured


@with_pair()
async def test_a_proxy_goes_when_a_program_here_serves_and_comes_back_after_it(pair: Pair) -> None:
    name = "/add"
    own = pair.node(1, "own_server")
    watcher = pair.node(1, "watcher")
    assert await watcher.available(Entity.SERVER, name) is not None
    served = own.serve(name, ADD, lambda asked: {"sum": -1})
    client = pair.shore.client(name, ADD)
    while any(token.topic == name for token in await graph(pair.shore, 1)):
        pass  # asked again, since a session misses a token that goes and comes while it subscribes
    assert [value for value, _ in await client.call({"a": 2, "b": 3})] == [{"sum": -1}]
    for each in served:
        each.undeclare()
    while not any(token.topic == name for token in await graph(pair.shore, 1)):
        pass
    pair.auv.serve(name, ADD, lambda asked: {"sum": asked["a"] + asked["b"]})
    await fence(pair.auv.session)
    assert [value for value, _ in await client.call({"a": 2, "b": 3})] == [{"sum": 5}]


def test_servers_of_a_node_that_is_lost_are_not_there_until_it_is_back() -> None:
    async def main() -> None:
        channel = Channel()
        section = changed(heartbeat_s=1, lost_after_s=2)
        async with AsyncExitStack() as stack:
            a = await stack.enter_async_context(local_network(1, channel, section=section))
            node = Node(stack.enter_context(ros_session(a.port)), "operator", domain=7)
            async with local_network(2, channel, section=section):
                assert await node.available(Entity.SERVER, "/add") is not None
            await node.available(Entity.SERVER, "/add", is_there=False)
            await node.available(Entity.SERVER, "/fibonacci/_action/send_goal", is_there=False)
            # What is published may still come from somebody else.
            assert await node.available(Entity.PUBLISHER, "/chat") is not None
            async with local_network(2, channel, section=section):
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
        counts = json.loads(found.payload(key))["local"]


class Clock:
    """A clock that is set."""

    def __init__(self) -> None:
        self.now = 10**9

    def __call__(self) -> int:
        return self.now


def test_a_day_of_nodes_and_endpoints_puts_nothing_on_the_channel() -> None:
    async def main() -> None:
        channel = Channel()
        clock = Clock()
        # For latched topics a gateway without a journal shows its boot epoch, whoever is there.
        streams = [each for each in SECTION["streams"] if "durability" not in each]
        section = SECTION | {"streams": streams}
        async with AsyncExitStack() as stack:
            gateways, ports = [], [free_port(), free_port()]
            for address, port in zip((1, 2), ports, strict=True):
                config = config_of(address, zenoh_config("router", listen=port), section)
                gateway = Gateway(
                    config, link=channel.medium.link(address), notify=lambda _: None, clock=clock
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
                    assert gateway._session is not None
                    gateway._session.runner.apply(lambda engine, now: None)
                await asyncio.sleep(0)
            for gateway in gateways:
                assert gateway._session is not None
                assert gateway._session.runner.engine.poll_timeout() is None
            assert channel.emissions == []

    run(main())


def test_two_gateways_on_one_local_network_do_not_hear_each_other_as_nodes() -> None:
    async def main() -> None:
        channel = Channel()
        nodes = [*SECTION["nodes"], {"address": 3, "name": "buoy"}]
        section = changed(nodes=nodes)
        async with AsyncExitStack() as stack:
            a = await stack.enter_async_context(local_network(1, channel, section=section))
            await stack.enter_async_context(local_network(3, channel, section=section, join=a.port))
            b = await stack.enter_async_context(local_network(2, channel, section=section))
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
