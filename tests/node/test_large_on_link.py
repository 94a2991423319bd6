"""Samples larger than a frame, on a link: how far they are, giving them up, refusing them."""

import random
import threading
from typing import Any

import pytest

from tests.node.fleet import SECTION, ChannelServer, channel
from tests.runtime.loop_checks import run
from zacoustic import (
    Config,
    Delivery,
    DeliveryOutcome,
    LocalError,
    Node,
    PayloadTooLargeError,
    blocking,
)
from zacoustic.config import config_from_mapping
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState

S2C = "evologics_s2c_18_34"
"""A modem on which a photo takes six minutes, and here two seconds."""
SLOWER = 20.0
"""Time scale at which a refusal is in time for its sender's listen window on a busy computer too.
One that comes too late is heard in the next window, after the whole photo."""
LATE_S = 60.0
"""Time limit of a test with such a refusal, s: the whole photo takes 18."""
PHOTO = random.Random("photo").randbytes(20_000)
STREAM: dict[str, Any] = {
    "id": 140,
    "topic": "photo",
    "publishers": [1],
    "subscribers": [2],
    "reliability": "reliable",
    "depth": 4,
    "max_bytes": 20_000,
}


def config(address: int = 1, **photo: object) -> Config:
    section = SECTION | {"streams": [*SECTION["streams"], STREAM | photo]}
    return config_from_mapping(section, source="fleet.json5", address=address)


async def under_way(node: Node) -> ObjectProgress:
    """Wait until part of a large sample has come."""
    async for event in node.events():
        if isinstance(event, ObjectProgress) and event.state is ObjectState.UNDER_WAY:
            return event
    raise AssertionError


def test_progress_is_told_at_both_ends() -> None:
    part = PHOTO[:3000]

    async def main() -> None:
        with channel(S2C) as medium:
            shore = Node(1, config=config(), link=medium.link(1))
            auv = Node(2, config=config(2), link=medium.link(2))
            async with shore, auv:
                photos = auv.subscribe(bytes, "photo")
                publisher = shore.create_publisher(bytes, "photo")
                deliveries = [publisher.publish(value) for value in (part, b"small")]
                arriving = await under_way(auv)
                assert (arriving.peer, arriving.total_bytes) == (1, len(part))
                assert [(await photos.receive()).value for _ in range(2)] == [part, b"small"]
                for delivery in deliveries:
                    assert isinstance(delivery, Delivery)
                    assert await delivery is DeliveryOutcome.DELIVERED
                first, second = deliveries
                assert first is not None
                assert second is not None
                assert second.progress is None, "it fits a frame"
                assert first.progress is not None
                assert first.progress.state is ObjectState.DELIVERED
                assert first.progress.done_bytes == first.progress.total_bytes == len(part)
                with pytest.raises(LocalError, match="cannot be refused"):
                    shore.refuse(first.progress)
                assert not auv.refuse(arriving), "it is over"

    run(main())


def test_flush_ends_with_the_last_answer_though_nothing_is_transmitted_after_it() -> None:
    async def main() -> None:
        with channel(S2C) as medium:
            shore = Node(1, config=config(), link=medium.link(1))
            auv = Node(2, config=config(2), link=medium.link(2))
            async with shore, auv:
                delivery = shore.create_publisher(bytes, "photo").publish(PHOTO[:3000])
                await shore.flush(timeout_s=20)
                assert delivery is not None
                assert delivery.outcome is DeliveryOutcome.DELIVERED

    run(main())


def test_a_publisher_gives_it_up() -> None:
    async def main() -> None:
        with channel(S2C) as medium:
            shore = Node(1, config=config(), link=medium.link(1))
            auv = Node(2, config=config(2), link=medium.link(2))
            async with shore, auv:
                photos = auv.subscribe(bytes, "photo")
                publisher = shore.create_publisher(bytes, "photo")
                delivery = publisher.publish(PHOTO)
                assert delivery is not None
                await under_way(auv)
                delivery.cancel()
                assert await delivery is DeliveryOutcome.CANCELLED
                assert delivery.missing == (2,)
                delivery.cancel()
                other = publisher.publish(PHOTO)
                assert other is not None
                thread = threading.Thread(target=other.cancel)
                thread.start()
                assert await other is DeliveryOutcome.CANCELLED
                thread.join()
                publisher.publish(b"small")
                assert (await photos.receive()).value == b"small"
                with pytest.raises(PayloadTooLargeError, match="photo: the payload is 20001 bytes"):
                    publisher.publish(bytes(20_001))

    run(main())


def test_a_subscriber_refuses_it() -> None:
    async def main() -> None:
        with channel(S2C, SLOWER) as medium:
            shore = Node(1, config=config(), link=medium.link(1))
            auv = Node(2, config=config(2), link=medium.link(2))
            async with shore, auv:
                publisher = shore.create_publisher(bytes, "photo")
                delivery = publisher.publish(PHOTO)
                assert delivery is not None
                assert auv.refuse(await under_way(auv))
                assert await delivery is DeliveryOutcome.REFUSED
                assert delivery.missing == (2,)

    run(main(), limit_s=LATE_S)


def test_a_subscriber_takes_less() -> None:
    async def main() -> None:
        with channel(S2C, SLOWER) as medium:
            shore = Node(1, config=config(), link=medium.link(1))
            auv = Node(2, config=config(2, max_bytes=5000), link=medium.link(2))
            async with shore, auv:
                delivery = shore.create_publisher(bytes, "photo").publish(PHOTO)
                assert delivery is not None
                assert await delivery is DeliveryOutcome.REFUSED
                assert delivery.detail == "2: 2"

    run(main(), limit_s=LATE_S)


def test_blocking() -> None:
    with ChannelServer(S2C, SLOWER) as locator:
        shore = blocking.Node(1, config=config(), link=locator)
        auv = blocking.Node(2, config=config(2), link=locator)
        with shore, auv:
            publisher = shore.create_publisher(bytes, "photo")
            first, second = publisher.publish(PHOTO), publisher.publish(PHOTO)
            assert first is not None
            assert second is not None
            told = (
                event
                for event in auv.events()
                if isinstance(event, ObjectProgress) and event.state is ObjectState.UNDER_WAY
            )
            assert auv.refuse(next(told))
            assert first.wait(timeout_s=LATE_S) is DeliveryOutcome.REFUSED
            second.cancel()
            assert second.wait(timeout_s=LATE_S) is DeliveryOutcome.CANCELLED
            assert first.progress is not None
            assert first.progress.state is ObjectState.REFUSED
