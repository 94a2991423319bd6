"""`Delivery`: what the publisher of a reliable sample learns, with asyncio and without."""

import asyncio
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from tests.node.fleet import SECTION, ChannelServer, channel
from tests.runtime.loop_checks import run
from zacoustic import (
    Config,
    ConfigError,
    Delivery,
    DeliveryError,
    DeliveryOutcome,
    JournalUnavailableError,
    LinkClosedError,
    LocalError,
    Node,
    PayloadTooLargeError,
    Publisher,
    Qos,
    Reliability,
    blocking,
)
from zacoustic.config import config_from_mapping
from zacoustic.core.base.journal import JournalWrite
from zacoustic.core.engine.events import DeliveryEnded, JournalStateChanged
from zacoustic.run.journal import MemoryJournal

RELIABLE = {"reliability": "reliable", "publishers": [1], "subscribers": [2]}


def reliable_config(address: int = 1) -> Config:
    streams: list[dict[str, Any]] = [
        {"id": 130, "topic": "orders", "depth": 8, **RELIABLE},
        {"id": 131, "topic": "target", **RELIABLE},
        {"id": 132, "topic": "brief", "depth": 8, "lifespan_s": 0.05, **RELIABLE},
        {"id": 133, "topic": "log", "depth": 8, "journal": True, **RELIABLE},
    ]
    section = SECTION | {"streams": SECTION["streams"] + streams}
    return config_from_mapping(section, source="fleet.json5", address=address)


def publish(publisher: Publisher[bytes], payload: bytes) -> Delivery:
    delivery = publisher.publish(payload)
    assert delivery is not None
    return delivery


def test_delivered_when_the_other_engine_has_it() -> None:
    async def main() -> None:
        with channel() as medium:
            shore = Node(1, config=reliable_config(), link=medium.link(1))
            auv = Node(2, config=reliable_config(2), link=medium.link(2))
            async with shore, auv:
                subscription = auv.subscribe(bytes, "orders")
                publisher = shore.create_publisher(bytes, "orders")
                deliveries = [publish(publisher, b"%d" % number) for number in range(5)]
                assert deliveries[0].outcome is None
                outcomes = [await delivery for delivery in deliveries]
                assert outcomes == [DeliveryOutcome.DELIVERED] * 5
                assert await deliveries[0] is deliveries[0].outcome, "may be awaited again"
                assert (deliveries[0].missing, deliveries[0].key) == ((), "orders")
                values = [(await subscription.receive()).value for _ in range(5)]
                assert values == [b"0", b"1", b"2", b"3", b"4"]

    run(main())


def test_delete_is_delivered_as_a_sample_is() -> None:
    async def main() -> None:
        with channel() as medium:
            shore = Node(1, config=reliable_config(), link=medium.link(1))
            auv = Node(2, config=reliable_config(2), link=medium.link(2))
            async with shore, auv:
                subscription = auv.subscribe(bytes, "orders")
                delivery = shore.create_publisher(bytes, "orders").delete()
                assert delivery is not None
                assert await delivery is DeliveryOutcome.DELIVERED
                assert (await subscription.receive()).deleted

    run(main())


def test_newer_sample_supersedes_and_an_old_one_expires() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node(1, config=reliable_config(), link=medium.link(1)) as shore:
                target = shore.create_publisher(bytes, "target")
                first, second = publish(target, b"1"), publish(target, b"2")
                assert await first is DeliveryOutcome.SUPERSEDED
                assert first.missing == (2,)
                assert second.outcome is None
                brief = publish(shore.create_publisher(bytes, "brief"), b"x")
                assert await brief is DeliveryOutcome.EXPIRED
                with pytest.raises(TimeoutError):
                    async with asyncio.timeout(0):
                        await second

    run(main())


def test_best_effort_has_no_delivery() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node(1, config=reliable_config(), link=medium.link(1)) as shore:
                assert shore.create_publisher(bytes, "note").publish(b"x") is None

    run(main())


def test_end_of_the_node_ends_the_waiting() -> None:
    async def main() -> None:
        with channel() as medium:
            shore = Node(1, config=reliable_config(), link=medium.link(1))
            await shore.open()
            delivery = publish(shore.create_publisher(bytes, "orders"), b"x")
            waiting = asyncio.create_task(asyncio.wait_for(delivery, 10))
            await asyncio.sleep(0)
            await shore.close()
            with pytest.raises(LinkClosedError):
                await waiting
            with pytest.raises(LinkClosedError):
                await delivery
            assert delivery.outcome is None

    run(main())


def test_other_threads_publish_too() -> None:
    async def main() -> None:
        with channel() as medium:
            shore = Node(1, config=reliable_config(), link=medium.link(1))
            auv = Node(2, config=reliable_config(2), link=medium.link(2))
            async with shore, auv:
                publisher = shore.create_publisher(bytes, "target")
                made: list[Delivery] = []
                thread = threading.Thread(target=lambda: made.append(publish(publisher, b"x")))
                thread.start()
                await asyncio.to_thread(thread.join)
                assert await made[0] is DeliveryOutcome.DELIVERED

    run(main())


class Disk(MemoryJournal):
    """A journal that is written only while it has room."""

    def __init__(self) -> None:
        super().__init__()
        self.has_room = threading.Event()
        self.has_room.set()
        self.is_full = False

    def commit(self, writes: Sequence[JournalWrite]) -> None:
        self.has_room.wait(10)
        if self.is_full:
            raise OSError("no space left")
        super().commit(writes)


def test_stored_when_the_journal_has_it(tmp_path: Path) -> None:
    async def main() -> None:
        with channel() as medium:
            disk = Disk()
            node = Node(1, config=reliable_config(), link=medium.link(1), journal=disk)
            async with node:
                log = node.create_publisher(bytes, "log")
                await publish(log, b"first").stored()
                disk.has_room.clear()
                second = publish(log, b"second")
                with pytest.raises(TimeoutError):
                    async with asyncio.timeout(0.01):
                        await second.stored()
                disk.has_room.set()
                await second.stored()
                await second.stored()
                orders = node.create_publisher(bytes, "orders")
                with pytest.raises(LocalError, match=r"orders is not journalled .say journal"):
                    await publish(orders, b"x").stored()

    run(main())


def test_what_was_stored_is_delivered_by_the_next_life(tmp_path: Path) -> None:
    async def main() -> None:
        with channel() as empty:
            node = Node(1, config=reliable_config(), link=empty.link(1), journal=tmp_path)
            async with node:
                await publish(node.create_publisher(bytes, "log"), b"of a former life").stored()
        with channel() as medium:
            auv = Node(2, config=reliable_config(2), link=medium.link(2))
            async with auv:
                subscription = auv.subscribe(bytes, "log")
                node = Node(1, config=reliable_config(), link=medium.link(1), journal=tmp_path)
                async with node:
                    assert (await subscription.receive()).value == b"of a former life"
                    ended = [e async for e in limited(node) if isinstance(e, DeliveryEnded)]
                    assert [event.outcome for event in ended] == [DeliveryOutcome.DELIVERED]

    async def limited(node: Node) -> Any:
        async for event in node.events():
            yield event
            if isinstance(event, DeliveryEnded):
                return

    run(main())


def test_nothing_is_accepted_that_cannot_be_written_down() -> None:
    async def main() -> None:
        with channel() as medium:
            disk = Disk()
            node = Node(1, config=reliable_config(), link=medium.link(1), journal=disk)
            async with node:
                log = node.create_publisher(bytes, "log")
                disk.is_full = True
                waits = publish(log, b"before anybody knew")
                async for event in node.events():
                    if isinstance(event, JournalStateChanged):
                        break
                with pytest.raises(JournalUnavailableError, match=r"log: not accepted: .*no space"):
                    log.publish(b"x")
                publish(node.create_publisher(bytes, "orders"), b"needs no journal")
                assert waits.outcome is None
                disk.is_full = False

    run(main())


def test_publisher_is_told_what_was_pushed_out_before_it_was_stored() -> None:
    async def main() -> None:
        with channel() as medium:
            disk = Disk()
            node = Node(1, config=reliable_config(), link=medium.link(1), journal=disk)
            async with node:
                disk.has_room.clear()
                log = node.create_publisher(bytes, "log")
                deliveries = [publish(log, b"%d" % number) for number in range(9)]
                with pytest.raises(DeliveryError, match="superseded before it was stored"):
                    await deliveries[0].stored()
                disk.has_room.set()

    run(main())


def test_code_cannot_change_what_both_ends_have_agreed_on() -> None:
    async def main() -> None:
        reliable = Reliability.RELIABLE
        with channel() as medium:
            async with Node(1, config=reliable_config(), link=medium.link(1)) as node:
                with pytest.raises(ConfigError, match="note: reliability: reliable; allowed: best"):
                    node.create_publisher(bytes, "note", Qos(reliability=reliable))
                with pytest.raises(ConfigError, match="orders: depth: 3; allowed: 8"):
                    node.create_publisher(bytes, "orders", Qos(reliability=reliable, depth=3))
                publisher = node.create_publisher(bytes, "orders", Qos(lifespan_s=0.01))
                assert await publish(publisher, b"x") is DeliveryOutcome.EXPIRED
                with pytest.raises(PayloadTooLargeError):
                    publisher.publish(bytes(40_000_000))

    run(main())


def test_reliable_topic_needs_somebody_who_is_listed() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node(1, link=medium.link(1)) as node:
                qos = Qos(reliability=Reliability.RELIABLE)
                with pytest.raises(ConfigError, match="nobody is known to acknowledge"):
                    node.create_publisher(bytes, "orders", qos, stream_id=1)

    run(main())


def test_blocking_delivery_waits_with_a_limit() -> None:
    with (
        ChannelServer() as locator
    ):  # a medium serves one loop, and each of these nodes has its own
        shore = blocking.Node(1, config=reliable_config(), link=locator)
        auv = blocking.Node(2, config=reliable_config(2), link=locator)
        with shore:
            publisher = shore.create_publisher(bytes, "orders")
            delivery = publisher.publish(b"x")
            assert delivery is not None
            with pytest.raises(TimeoutError):
                delivery.wait(timeout_s=0.01)
            assert (delivery.outcome, delivery.missing, delivery.detail) == (None, (), "")
            with auv:
                assert delivery.wait(timeout_s=20) is DeliveryOutcome.DELIVERED
            with pytest.raises(LocalError):
                delivery.stored(timeout_s=1)
            assert shore.create_publisher(bytes, "note").publish(b"x") is None
            assert publisher.delete() is not None
            assert delivery.key == "orders"
