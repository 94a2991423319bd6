"""Topics of ROS 2 across two gateways."""

import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import Any, Final

from tests.gateway.networks import (
    Channel,
    config_of,
    fence,
    free_port,
    get,
    hear,
    local_network,
    matched,
    run,
    until,
    zenoh_config,
)
from tests.gateway.rosnode import DEFAULT, LATCHED, Node, Told, ros_session
from tests.gateway.rospair import FIX, SECTION, STRING, TWIST, Pair, changed, with_pair
from zacoustic.core.clock import NS_PER_S
from zacoustic.gateway import Gateway
from zacoustic.ros.attachment import Attachment, read_attachment
from zacoustic.ros.qos import RosQos
from zacoustic.ros.tokens import Entity, gid_of

ZERO: Final = {"x": 0.0, "y": 0.0, "z": 0.0}
STEADY: Final = {"linear": ZERO | {"x": 1.25}, "angular": ZERO | {"z": -0.5}}


async def heard(node: Node, name: str, interface: str, qos: RosQos = DEFAULT) -> Told:
    """Subscribe; returns when the router knows it."""
    told = node.subscribe(name, interface, qos)
    await fence(node.session)
    return told


async def ready(node: Node, name: str, interface: str) -> None:
    """Wait until the gateway hears what a node publishes."""
    await matched(node.session, str(node.key(name, interface)))


async def joined(
    source: Node, other: Node, name: str, interface: str
) -> tuple[Callable[[dict[str, Any]], None], Told]:
    """Return how one node publishes and what the other is told, once both ways are there."""
    await ready(source, name, interface)
    told = await heard(other, name, interface)
    return source.publisher(name, interface), told


@with_pair()
async def test_a_message_crosses_as_nodes_of_ros_know_it(pair: Pair) -> None:
    publish, told = await joined(pair.shore, pair.auv, "/auv1/cmd_vel", TWIST)
    before_ns = time.time_ns()
    for sequence in (1, 2):
        publish(STEADY)
        value, beside = await told.next()
        assert value == STEADY
        assert beside.sequence == sequence
        assert before_ns <= beside.stamp_ns <= time.time_ns()
        # The gid leads to the token of a publisher, as in rmw_zenoh.
        token = await pair.auv.available(Entity.PUBLISHER, "/auv1/cmd_vel")
        assert token is not None
        assert beside.gid == gid_of(token)


@with_pair()
async def test_what_crosses_does_not_come_back(pair: Pair) -> None:
    for node in (pair.shore, pair.auv):
        await ready(node, "/chat", STRING)
    shore = await heard(pair.shore, "/chat", STRING)
    auv = await heard(pair.auv, "/chat", STRING)
    from_shore = pair.shore.publisher("/chat", STRING)
    from_auv = pair.auv.publisher("/chat", STRING)
    from_shore({"data": "down"})
    assert (await shore.next())[0] == (await auv.next())[0] == {"data": "down"}
    from_auv({"data": "up"})
    assert (await shore.next())[0] == (await auv.next())[0] == {"data": "up"}
    from_shore({"data": "again"})
    assert (await shore.next())[0] == (await auv.next())[0] == {"data": "again"}
    assert shore.empty()
    assert auv.empty()


@with_pair()
async def test_a_stamp_is_rebuilt_from_the_age_by_the_clock_of_the_far_side(pair: Pair) -> None:
    publish, told = await joined(pair.auv, pair.shore, "/auv1/fix", FIX)
    value = pair.auv.zero(FIX)
    value["header"]["frame_id"], value["latitude"] = "gps", 43.5
    made_ns = time.time_ns() - 20_000_000_000
    value["header"]["stamp"] = {"sec": made_ns // 10**9, "nanosec": made_ns % 10**9}
    publish(value)
    came, beside = await told.next()
    assert came["latitude"] == 43.5
    assert came["header"]["frame_id"] == "gps"
    stamp = came["header"]["stamp"]
    seen_ns = stamp["sec"] * 10**9 + stamp["nanosec"]
    # One byte holds an age of twenty seconds to a few per cent.
    assert abs(seen_ns - made_ns) < 3 * 10**9
    assert abs(beside.stamp_ns - made_ns) < 3 * 10**9


@with_pair()
async def test_stamps_of_hours_ago_and_of_no_time_arrive_as_what_they_are(pair: Pair) -> None:
    publish, told = await joined(pair.auv, pair.shore, "/auv1/fix", FIX)
    value = pair.auv.zero(FIX)
    value["header"]["frame_id"] = "gps"
    for ago_s in (600, 3700, 6 * 3600):
        made_s = int(time.time()) - ago_s
        value["header"]["stamp"] = {"sec": made_s, "nanosec": 0}
        publish(value)
        came, beside = await told.next()
        assert abs(came["header"]["stamp"]["sec"] - made_s) <= 2 + 0.05 * ago_s
        assert abs(beside.stamp_ns / 1e9 - made_s) <= 2 + 0.05 * ago_s
    value["header"]["stamp"] = {"sec": int(time.time()) - 40 * 86_400, "nanosec": 0}
    publish(value)
    came, _ = await told.next()
    assert abs(came["header"]["stamp"]["sec"] - (time.time() - 30 * 86_400)) < 60
    for unknown in ({"sec": 0, "nanosec": 0}, {"sec": 123, "nanosec": 0}):  # none; a simulation's
        value["header"]["stamp"] = unknown
        publish(value)
        came, beside = await told.next()
        assert came["header"]["stamp"] == {"sec": 0, "nanosec": 0}
        assert beside.stamp_ns == 0


PICTURE: Final = "sensor_msgs/msg/CompressedImage"


@with_pair(
    changed(
        streams=[
            {"id": 12, "topic": "/auv1/photo", "type": PICTURE, "ros": {"stamp": "age"},
             "publishers": [2], "reliability": "reliable"},
        ],
        overlays=[],
    )
)  # fmt: skip
async def test_a_stamp_of_a_message_in_parts_is_rebuilt_as_well(pair: Pair) -> None:
    publish, told = await joined(pair.auv, pair.shore, "/auv1/photo", PICTURE)
    value = pair.auv.zero(PICTURE)
    value["data"] = bytes(range(256)) * 8
    made_s = int(time.time()) - 40
    value["header"]["stamp"] = {"sec": made_s, "nanosec": 0}
    publish(value)
    came, beside = await told.next()
    assert len(came["data"]) == 2048
    assert abs(came["header"]["stamp"]["sec"] - made_s) <= 5
    assert abs(beside.stamp_ns / 1e9 - made_s) <= 5


TRANSFORMS: Final = "tf2_msgs/msg/TFMessage"


@with_pair(
    changed(
        streams=[
            {"id": 12, "topic": "/tf", "type": TRANSFORMS, "ros": {"stamp": "age"},
             "publishers": [2]},
        ],
        overlays=[],
    )
)  # fmt: skip
async def test_the_stamps_of_transforms_are_rebuilt_by_the_clock_beyond(pair: Pair) -> None:
    await ready(pair.auv, "/tf", TRANSFORMS)
    told = await heard(pair.shore, "/tf", TRANSFORMS)
    publish = pair.auv.publisher("/tf", TRANSFORMS)
    made_s = int(time.time()) - 40
    value: dict[str, Any] = {"transforms": []}
    for number, before_s in enumerate((0, 7)):
        each = pair.auv.zero("geometry_msgs/msg/TransformStamped")
        stamp = {"sec": made_s - before_s, "nanosec": 0}
        each["header"] = {"stamp": stamp, "frame_id": f"frame{number}"}
        value["transforms"].append(each)
    publish(value)
    came, _ = await told.next()
    stamps = [
        each["header"]["stamp"]["sec"] + each["header"]["stamp"]["nanosec"] / 1e9
        for each in came["transforms"]
    ]
    assert abs(stamps[0] - made_s) <= 2.1
    assert abs(stamps[0] - stamps[1] - 7) < 0.01
    assert [each["header"]["frame_id"] for each in came["transforms"]] == ["frame0", "frame1"]


@with_pair()
async def test_a_constant_that_differs_is_counted_and_stays(pair: Pair) -> None:
    publish, told = await joined(pair.auv, pair.shore, "/auv1/fix", FIX)
    value = pair.auv.zero(FIX)
    publish(value | {"header": value["header"] | {"frame_id": "imu"}})
    publish(value | {"header": value["header"] | {"frame_id": "gps"}, "altitude": 1.0})
    assert (await told.next())[0]["altitude"] == 1.0


def test_a_subscription_that_joins_a_latched_topic_an_hour_later_has_it_at_once() -> None:
    passed_ns = 0

    def clock() -> int:
        return time.monotonic_ns() + passed_ns

    async def main() -> None:
        nonlocal passed_ns
        channel = Channel()
        async with AsyncExitStack() as stack:
            a = await stack.enter_async_context(
                local_network(1, channel, section=SECTION, clock=clock)
            )

            def node(name: str) -> Node:
                return Node(stack.enter_context(ros_session(a.port)), name, domain=7)

            early = await heard(node("early"), "/map", STRING, LATCHED)
            async with local_network(2, channel, section=SECTION) as b:
                with ros_session(b.port) as session:
                    publish = Node(session, "mapper", domain=7).publisher("/map", STRING, LATCHED)
                    publish({"data": "the map"})
                    assert (await early.next())[0] == {"data": "the map"}
                    publish({"data": "a newer map"})
                    assert (await early.next())[0] == {"data": "a newer map"}
            # Nobody is left across the channel: it comes from the gateway of this local network.
            passed_ns = 3600 * NS_PER_S
            value, beside = await node("late").subscribe("/map", STRING, LATCHED).next()
            assert value == {"data": "a newer map"}
            assert beside.sequence == 2
            volatile = await heard(node("volatile"), "/map", STRING)
            again = await node("later").subscribe("/map", STRING, LATCHED).next()
            assert again == (value, beside)
            assert volatile.empty()

    run(main())


def test_what_was_latched_before_the_gateway_began_crosses_too() -> None:
    async def main() -> None:
        channel = Channel()
        async with AsyncExitStack() as stack:
            b = await stack.enter_async_context(
                local_network(3, channel, section={"address": 3, "streams": []})
            )
            auv = Node(stack.enter_context(ros_session(b.port)), "autopilot", domain=7)
            auv.publisher("/map", STRING, LATCHED)({"data": "the map"})
            await fence(auv.session)
            a = await stack.enter_async_context(local_network(1, channel, section=SECTION))
            shore = Node(stack.enter_context(ros_session(a.port)), "operator", domain=7)
            told = await heard(shore, "/map", STRING, LATCHED)
            await stack.enter_async_context(local_network(2, channel, section=SECTION, join=b.port))
            assert (await told.next())[0] == {"data": "the map"}

    run(main())


@with_pair()
async def test_topics_with_the_name_of_the_node_are_told_apart(pair: Pair) -> None:
    await ready(pair.auv, "/fleet/auv1/name", STRING)
    told = await heard(pair.shore, "/fleet/auv1/name", STRING)
    pair.auv.publisher("/fleet/auv1/name", STRING)({"data": "Nemo"})
    assert (await told.next())[0] == {"data": "Nemo"}
    token = await pair.shore.available(Entity.PUBLISHER, "/fleet/auv1/name")
    assert token is not None
    assert token.node.name == "acoustic_gateway_1"
    subscription = await pair.auv.available(Entity.SUBSCRIPTION, "/fleet/auv1/name")
    assert subscription is not None


@with_pair()
async def test_a_get_is_answered_from_the_last_message(pair: Pair) -> None:
    await ready(pair.shore, "/auv1/cmd_vel", TWIST)
    told = await heard(pair.auv, "/auv1/cmd_vel", TWIST)
    pair.shore.publisher("/auv1/cmd_vel", TWIST)(STEADY)
    _, beside = await told.next()
    key = str(pair.auv.key("/auv1/cmd_vel", TWIST))
    sample = (await get(pair.auv.session, key)).good[key]
    assert pair.auv.message(TWIST).read(sample.payload.to_bytes())[0] == STEADY
    assert sample.attachment is not None
    assert read_attachment(sample.attachment.to_bytes()) == beside


@with_pair()
async def test_nonsense_on_a_key_of_ros_harms_nothing(pair: Pair) -> None:
    await ready(pair.shore, "/auv1/cmd_vel", TWIST)
    told = await heard(pair.auv, "/auv1/cmd_vel", TWIST)
    key = str(pair.shore.key("/auv1/cmd_vel", TWIST))
    for payload in (b"", b"\0\1\0\0", b"nonsense" * 9):
        pair.shore.session.put(key, payload)
        pair.shore.session.put(key, payload, attachment=b"nonsense")
    pair.shore.session.delete(key)
    pair.shore.session.put(
        key,
        pair.shore.message(TWIST).write(STEADY | {"linear": ZERO | {"x": 99.0}}),
        attachment=Attachment(sequence=1, stamp_ns=0, gid=bytes(16)).encode(),
    )
    pair.shore.publisher("/auv1/cmd_vel", TWIST)(STEADY)
    while (await told.next())[0] != STEADY:
        pass


@with_pair(changed(ros={"domain": 3, "distro": "humble"}), distro="humble")
async def test_keys_of_humble_have_no_hash(pair: Pair) -> None:
    assert str(pair.shore.key("/chat", STRING)).endswith("/TypeHashNotSupported")
    await ready(pair.shore, "/chat", STRING)
    told = await heard(pair.auv, "/chat", STRING)
    pair.shore.publisher("/chat", STRING)({"data": "from Humble"})
    assert (await told.next())[0] == {"data": "from Humble"}


def test_networks_of_two_distributions_and_domains_hear_each_other() -> None:
    async def main() -> None:
        channel = Channel()
        other = changed(ros={"domain": 42, "distro": "humble"})
        async with AsyncExitStack() as stack:
            a = await stack.enter_async_context(local_network(1, channel, section=SECTION))
            b = await stack.enter_async_context(local_network(2, channel, section=other))
            shore = Node(stack.enter_context(ros_session(a.port)), "operator", domain=7)
            auv = Node(
                stack.enter_context(ros_session(b.port)), "autopilot", distro="humble", domain=42
            )
            await ready(shore, "/auv1/cmd_vel", TWIST)
            told = await heard(auv, "/auv1/cmd_vel", TWIST)
            shore.publisher("/auv1/cmd_vel", TWIST)(STEADY)
            assert (await told.next())[0] == STEADY

    run(main())


def test_one_end_may_be_of_ros_and_the_other_not() -> None:
    async def main() -> None:
        channel = Channel()
        streams = [dict(stream) for stream in SECTION["streams"] if stream["id"] == 14]
        plain = [{"id": 14, "topic": "chat", "type": STRING, "depth": 8}]
        async with AsyncExitStack() as stack:
            a = await stack.enter_async_context(
                local_network(1, channel, section=changed(streams=streams))
            )
            b = await stack.enter_async_context(
                local_network(2, channel, section=changed(streams=plain))
            )
            shore = Node(stack.enter_context(ros_session(a.port)), "operator", domain=7)
            auv = stack.enter_context(b.client())
            await ready(shore, "/chat", STRING)
            samples = await hear(auv, "chat")
            shore.publisher("/chat", STRING)({"data": "to Zenoh"})
            assert b"to Zenoh" in await samples.payload()
            told = await heard(shore, "/chat", STRING)
            await matched(auv, "chat")
            auv.put("chat", b'{"data": "to ROS"}', encoding="application/json")
            assert (await told.next())[0] == {"data": "to ROS"}

    run(main())


ON_DEMAND: Final = {
    "id": 14,
    "topic": "/chat",
    "type": STRING,
    "ros": {},
    "depth": 8,
    "publishers": [2],
    "forward": "on_demand",
}


@with_pair(changed(streams=[ON_DEMAND]))
async def test_a_topic_on_demand_crosses_when_a_node_subscribes(pair: Pair) -> None:
    await ready(pair.auv, "/chat", STRING)
    publish = pair.auv.publisher("/chat", STRING)
    publish({"data": "nobody listens"})
    await fence(pair.auv.session)
    told = await heard(pair.shore, "/chat", STRING)
    wanted = {"subscribers": (1,), "stream": "chat"}
    await until(
        lambda: any(
            all(notice.facts.get(key) == value for key, value in wanted.items())
            for notice in pair.b.notices
        ),
        pair.b.changed,
    )
    publish({"data": "somebody does"})
    assert (await told.next())[0] == {"data": "somebody does"}


def test_without_time_stamps_a_latched_topic_still_crosses() -> None:
    async def main() -> None:
        channel = Channel()
        async with AsyncExitStack() as stack:
            port = free_port()
            settings = zenoh_config("router", listen=port)
            settings.insert_json5("timestamping/enabled", "false")
            config = config_of(1, settings, SECTION)
            await stack.enter_async_context(
                Gateway(config, link=channel.medium.link(1), notify=lambda _: None)
            )
            b = await stack.enter_async_context(local_network(2, channel, section=SECTION))
            shore = Node(stack.enter_context(ros_session(port)), "operator", domain=7)
            auv = Node(stack.enter_context(ros_session(b.port)), "mapper", domain=7)
            told = await heard(shore, "/map", STRING, LATCHED)
            auv.publisher("/map", STRING, LATCHED)({"data": "the map"})
            assert (await told.next())[0] == {"data": "the map"}

    run(main())


@with_pair()
async def test_two_latched_publishers_keep_their_samples_apart(pair: Pair) -> None:
    told = await heard(pair.shore, "/map", STRING, LATCHED)
    others = [pair.auv, pair.node(2, "mapper")]
    for number, node in enumerate(others):
        node.publisher("/map", STRING, LATCHED)({"data": f"map {number}"})
        assert (await told.next())[0] == {"data": f"map {number}"}
    late = pair.node(1, "late").subscribe("/map", STRING, LATCHED)
    got = [(await late.next())[0]["data"] for _ in others]
    assert got == ["map 0", "map 1"]
