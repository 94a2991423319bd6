"""`Node.flush` ends however what is queued leaves: sent, too old, cancelled, pushed out, closed."""

import asyncio
from collections.abc import Callable
from typing import Any, Self

import pytest

from tests.node.fleet import SECTION, channel
from tests.runtime.loop_checks import run
from zacoustic import Config, DeliveryOutcome, LinkClosedError, LocalError, Node, Sample
from zacoustic.config import config_from_mapping
from zacoustic.core.linktypes import LinkCapabilities, LinkState, Transmission
from zacoustic.link import Link, LinkConfig, LinkReceiver

BRIEF = {"lifespan_s": 0.05, "publishers": [1]}
RELIABLE = {"reliability": "reliable", "publishers": [1], "subscribers": [2]}


class DownLink(Link):
    """A modem that is never there."""

    name = "down"
    config_type = LinkConfig
    capabilities = LinkCapabilities(mtu_bytes=64, bit_rate_bps=1000.0)

    @classmethod
    def from_locator(cls, address: str, config: LinkConfig, *, node_address: int) -> Self:
        return cls()

    async def open(self, receiver: LinkReceiver) -> None:
        receiver.state_changed(LinkState.DOWN, "unplugged")

    async def close(self) -> None:
        pass

    def transmit(self, transmission: Transmission) -> None:
        raise AssertionError("nothing goes while a link is down")


def with_streams(*streams: dict[str, Any]) -> Config:
    section = SECTION | {"streams": list(streams)}
    return config_from_mapping(section, source="fleet.json5", address=1)


@pytest.mark.parametrize("extra", [BRIEF, RELIABLE | BRIEF, RELIABLE | BRIEF | {"journal": True}])
def test_a_sample_that_becomes_too_old_ends_the_waiting(extra: dict[str, Any]) -> None:
    config = with_streams({"id": 1, "topic": "note", **extra})

    async def main() -> None:
        async with Node(1, config=config, link=DownLink()) as node:
            delivery = node.create_publisher(bytes, "note").publish(b"x")
            await node.flush(timeout_s=10)
            assert delivery is None or delivery.outcome is DeliveryOutcome.EXPIRED
            assert node.expired() == ({1: 1} if delivery is None else {})

    run(main())


def test_of_several_lifespans_the_longest_counts() -> None:
    config = with_streams(
        {"id": 1, "topic": "note", **BRIEF},
        {"id": 2, "topic": "log", "publishers": [1], "lifespan_s": 0.2},
    )

    async def main() -> None:
        async with Node(1, config=config, link=DownLink()) as node:
            for name in ("note", "log"):
                node.create_publisher(bytes, name).publish(b"x")
            began_s = asyncio.get_running_loop().time()
            await node.flush(timeout_s=10)
            assert asyncio.get_running_loop().time() - began_s > 0.15
            assert node.expired() == {1: 1, 2: 1}

    run(main())


def test_a_sample_that_is_cancelled_meanwhile_ends_the_waiting() -> None:
    config = with_streams({"id": 1, "topic": "orders", **RELIABLE})

    async def main() -> None:
        async with Node(1, config=config, link=DownLink()) as node:
            delivery = node.create_publisher(bytes, "orders").publish(b"x")
            assert delivery is not None
            asyncio.get_running_loop().call_soon(delivery.cancel)
            await node.flush(timeout_s=10)
            assert delivery.outcome is DeliveryOutcome.CANCELLED

    run(main())


def test_a_node_that_is_closed_meanwhile_ends_the_waiting() -> None:
    config = with_streams({"id": 1, "topic": "note", "publishers": [1]})

    async def main() -> None:
        async with Node(1, config=config, link=DownLink()) as node:
            node.create_publisher(bytes, "note").publish(b"x")
            waiting = asyncio.create_task(node.flush(timeout_s=10))
            await asyncio.sleep(0)
            await node.close()
            with pytest.raises(LinkClosedError):
                await waiting

    run(main())


def make_subscription(node: Node, callback: Callable[[Sample[bytes]], None]) -> None:
    node.create_subscription(bytes, "note", callback)


def test_an_endpoint_made_in_a_foreign_thread_is_refused_and_nothing_is_left_of_it() -> None:
    async def main() -> None:
        heard: list[bytes] = []
        section = SECTION | {"streams": [{"id": 1, "topic": "note", "publishers": [2]}]}
        with channel() as medium:
            shore, auv = (
                Node(
                    address,
                    config=config_from_mapping(section, source="f", address=address),
                    link=medium.link(address),
                )
                for address in (1, 2)
            )
            async with shore, auv:
                for make in (
                    lambda: make_subscription(shore, lambda _: heard.append(b"half")),
                    lambda: auv.create_publisher(bytes, "note"),
                ):
                    with pytest.raises(LocalError, match="in the thread of its loop"):
                        await asyncio.to_thread(make)
                whole = shore.subscribe(bytes, "note")
                auv.create_publisher(bytes, "note").publish(b"x")
                assert (await whole.receive()).value == b"x"
                assert heard == []

    run(main())
