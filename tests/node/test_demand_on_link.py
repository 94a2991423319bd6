"""On-demand topics and lost nodes in direct mode: a subscription is what is asked for."""

from typing import Any, TypeVar

import pytest

from tests.node.fleet import SECTION, ChannelServer, channel
from tests.runtime.loop_checks import run
from zacoustic import (
    ConfigError,
    DeliveryOutcome,
    Forward,
    Node,
    PeerFound,
    PeerLost,
    Qos,
    SubscribersChanged,
    blocking,
)
from zacoustic.config import Config, config_from_mapping

E = TypeVar("E")

STREAMS: list[dict[str, Any]] = [
    {"id": 10, "topic": "view", "publishers": [2], "depth": 5, "forward": "on_demand"},
    {"id": 11, "topic": "each/{node}", "depth": 5, "forward": "on_demand"},
    {"id": 12, "topic": "log", "publishers": [2], "subscribers": [1], "reliability": "reliable",
     "forward": "on_demand"},
    {"id": 13, "topic": "always"},
]  # fmt: skip


def config(address: int, **settings: Any) -> Config:
    section = {"nodes": SECTION["nodes"], "streams": STREAMS, "address": address, **settings}
    return config_from_mapping(section, source="fleet.json5")


async def happened(node: Node, kind: type[E], number: int = 1) -> E:
    """Wait for an event of a kind, counted from the start of the node."""
    async for event in node.events():
        if isinstance(event, kind):
            number -= 1
            if not number:
                return event
    raise AssertionError("the node has ended")


def test_topic_crosses_as_long_as_a_subscription_is_open() -> None:
    async def main() -> None:
        with channel() as medium:
            shore = Node("shore", config=config(1), link=medium.link(1))
            auv = Node("auv1", config=config(2), link=medium.link(2))
            async with shore, auv:
                publisher = auv.create_publisher(bytes, "view")
                publisher.publish(b"unseen")
                await auv.flush(timeout_s=5)
                assert auv.stats.frames_transmitted == 0
                assert auv.stats.unsubscribed == {10: 1}
                subscription = shore.subscribe(bytes, "view")
                second = shore.subscribe(bytes, "view")
                assert (await happened(auv, SubscribersChanged)).subscribers == (1,)
                publisher.publish(b"seen")
                assert (await subscription.receive()).value == b"seen"
                second.close()
                publisher.publish(b"still seen")
                assert (await subscription.receive()).value == b"still seen"
                subscription.close()
                await shore.flush(timeout_s=60)  # the withdrawal has left
                assert (await happened(auv, SubscribersChanged, 2)).subscribers == ()
                publisher.publish(b"unseen")
                assert auv.stats.unsubscribed == {10: 2}

    run(main())


def test_key_of_one_node_is_asked_of_that_node() -> None:
    async def main() -> None:
        with channel() as medium:
            nodes = [
                Node(name, config=config(address), link=medium.link(address))
                for address, name in ((1, "shore"), (2, "auv1"), (3, "auv2"))
            ]
            async with nodes[0], nodes[1], nodes[2]:
                names = [each.name for each in nodes]
                subscription = nodes[0].subscribe(bytes, f"each/{names[1]}")
                await happened(nodes[1], SubscribersChanged)
                nodes[2].create_publisher(bytes, f"each/{names[2]}").publish(b"unseen")
                nodes[1].create_publisher(bytes, f"each/{names[1]}").publish(b"seen")
                assert (await subscription.receive()).value == b"seen"
                assert nodes[2].stats.frames_transmitted == 0

    run(main())


def test_reliable_sample_without_a_subscriber_ends_as_refused() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node("auv1", config=config(2), link=medium.link(2)) as auv:
                delivery = auv.create_publisher(bytes, "log").publish(b"nobody")
                assert delivery is not None
                assert await delivery is DeliveryOutcome.REFUSED

    run(main())


def test_code_may_not_say_another_forward_than_the_file() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node("auv1", config=config(2), link=medium.link(2)) as auv:
                with pytest.raises(
                    ConfigError, match="always: forward: on_demand; allowed: always"
                ):
                    auv.create_publisher(bytes, "always", Qos(forward=Forward.ON_DEMAND))
                auv.create_publisher(bytes, "view", Qos(depth=2))
                assert auv.find_stream("view").qos.forward is Forward.ON_DEMAND  # type: ignore[union-attr]
            async with Node(2, link=medium.link(2)) as bare:
                with pytest.raises(ConfigError, match="nobody is known who could be asked"):
                    bare.create_publisher(
                        bytes, "view", Qos(forward=Forward.ON_DEMAND), stream_id=9
                    )

    run(main())


def test_lost_and_found_are_events() -> None:
    async def main() -> None:
        with channel() as medium:
            shore = Node("shore", config=config(1, lost_after_s=0.05), link=medium.link(1))
            async with shore:
                lost = {(await happened(shore, PeerLost, number)).address for number in (1, 2)}
                assert lost == {2, 3}
                auv = Node("auv1", config=config(2), link=medium.link(2))
                async with auv:
                    auv.create_publisher(bytes, "always").publish(b"here")
                    assert (await happened(shore, PeerFound)).address == 2

    run(main())


def test_lost_is_an_event_of_a_blocking_node() -> None:
    with ChannelServer() as locator:
        rules = config(1, lost_after_s=0.05)
        with blocking.Node("shore", config=rules, link=locator) as shore:
            lost = next(event for event in shore.events() if isinstance(event, PeerLost))
            assert lost.heard_at is None
