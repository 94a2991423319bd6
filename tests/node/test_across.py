"""Nodes on two local networks with gateways, and one on a link of its own, in the same water."""

from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import msgspec
import pytest

from tests.node.fleet import (
    Arm,
    Nav,
    channel,
    config,
    free_endpoint,
    run_on_zenoh,
    settle,
    zenoh_config,
)
from zacoustic import DeliveryError, Node, ServiceError
from zacoustic.gateway import Gateway
from zacoustic_sim.medium import SimMedium


@asynccontextmanager
async def zenoh_session(address: int, medium: SimMedium) -> AsyncIterator[str]:
    """Run a gateway that is its local network's router; gives the endpoint."""
    endpoint = free_endpoint()
    settings = zenoh_config("router", listen=[endpoint])
    known = msgspec.structs.replace(config(address), zenoh_config=settings)
    async with Gateway(known, link=medium.link(address)):
        yield endpoint


@asynccontextmanager
async def three_nodes() -> AsyncIterator[tuple[Node, Node, Node]]:
    with channel() as medium:
        async with (
            zenoh_session(1, medium) as shore_endpoint,
            zenoh_session(2, medium) as auv_endpoint,
            Node("shore", config=config(), connect=shore_endpoint) as shore,
            Node("auv1", config=config(), connect=auv_endpoint) as auv,
            Node("auv2", config=config(), link=medium.link(3)) as other,
        ):
            yield shore, auv, other


def test_a_sample_reaches_all_nodes_with_its_source_wherever_they_are() -> None:
    async def main() -> None:
        async with three_nodes() as (shore, auv, other):
            subscriptions = [node.subscribe(Nav, "fleet/{node}/status") for node in (shore, other)]
            await settle(shore, auv)
            publisher = auv.create_publisher(Nav, "fleet/{node}/status")
            await settle(auv)
            publisher.publish(Nav(depth=8.0, mode="survey"))
            for subscription in subscriptions:
                sample = await subscription.receive()
                assert (sample.key, sample.source) == ("fleet/auv1/status", 2)
                assert sample.value == Nav(depth=8.0, mode="survey")

    run_on_zenoh(main())


def test_age_and_encoding_cross_in_both_ways_of_life() -> None:
    async def main() -> None:
        async with three_nodes() as (shore, _, other):
            on_shore = shore.subscribe(bytes, "note")
            await settle(shore)
            publisher = other.create_publisher(bytes, "note")
            publisher.publish(b"hello", encoding="text/markdown")
            sample = await on_shore.receive()
            assert (sample.value, sample.encoding) == (b"hello", "text/markdown")
            assert sample.source == 3
            assert sample.age_s is not None
            publisher.delete()
            assert (await on_shore.receive()).deleted

    run_on_zenoh(main())


def test_calls_from_both_ways_of_life_are_served_and_their_errors_told_apart() -> None:
    async def main() -> None:
        async with three_nodes() as (shore, auv, other):

            def arm(request: Arm.Request) -> Arm.Response:
                if not request.on:
                    raise RuntimeError("the battery is empty")
                return Arm.Response(ok=True)

            clients = [node.create_client(Arm, "auv1/arm") for node in (shore, other)]
            for client in clients:
                with pytest.raises(DeliveryError):  # not a ServiceError: nobody serves
                    await client.call(Arm.Request(on=True))
            auv.create_service(Arm, "auv1/arm", arm)
            await settle(auv)
            for client in clients:
                assert (await client.call(Arm.Request(on=True))).ok
                with pytest.raises(ServiceError, match="the battery is empty"):
                    await client.call(Arm.Request(on=False))

    run_on_zenoh(main())
