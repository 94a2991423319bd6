"""What a type checker must know of the endpoints; checked by mypy, never run."""

from collections.abc import Awaitable
from typing import Any, assert_type

import msgspec

from zacoustic import CallContext, Client, Node, Publisher, Sample, Service, Subscription, blocking


class Nav(msgspec.Struct):
    depth: float


class Arm:
    class Request(msgspec.Struct):
        on: bool

    class Response(msgspec.Struct):
        ok: bool


class Raw:
    Request = bytes
    Response = bytes


def arm(request: Arm.Request) -> Arm.Response:
    return Arm.Response(ok=request.on)


async def arm_later(request: Arm.Request, context: CallContext) -> Arm.Response:
    return Arm.Response(ok=context.client is not None and request.on)


def seen(sample: Sample[Nav]) -> None:
    assert_type(sample.value, Nav)
    assert_type(sample.content, Nav | None)


async def topics(node: Node) -> None:
    publisher = node.create_publisher(Nav, "nav")
    assert_type(publisher, Publisher[Nav])
    publisher.publish(Nav(depth=1.0))
    publisher.publish({"depth": 1.0})  # type: ignore[arg-type]
    assert_type(node.create_publisher("Nav", "nav"), Publisher[dict[str, Any]])
    assert_type(node.create_publisher(bytes, "photo"), Publisher[bytes])
    node.create_publisher(int, "count")  # type: ignore[type-var]
    subscription = node.create_subscription(Nav, "nav", seen)
    assert_type(subscription, Subscription[Nav])
    node.create_subscription(bytes, "nav", seen)  # type: ignore[arg-type]
    assert_type(await subscription.receive(), Sample[Nav])
    async for sample in node.subscribe(Nav, "nav"):
        assert_type(sample, Sample[Nav])
        assert_type(sample.value.depth, float)
    async for untyped in node.subscribe("Nav", "nav"):
        assert_type(untyped.value, dict[str, Any])


async def services(node: Node) -> None:
    client = node.create_client(Arm, "arm")
    assert_type(client, Client[Arm.Request, Arm.Response])
    assert_type(await client.call(Arm.Request(on=True)), Arm.Response)
    await client.call(Arm.Response(ok=True))  # type: ignore[arg-type]
    pair = node.create_client((Arm.Request, bytes), "arm")
    assert_type(pair, Client[Arm.Request, bytes])
    assert_type(node.create_client(Raw, "echo"), Client[bytes, bytes])
    assert_type(node.create_client(("ArmRequest", "ArmResponse"), "arm"), Client[Any, Any])
    node.create_client(Nav, "arm")  # type: ignore[call-overload]
    assert_type(node.create_service(Arm, "arm", arm), Service[Arm.Request, Arm.Response])
    node.create_service(Arm, "arm", arm_later)
    node.create_service(Arm, "arm", lambda request: Arm.Response(ok=request.on))
    node.create_service(Raw, "arm", arm)  # type: ignore[call-overload]


def without_asyncio(node: blocking.Node) -> None:
    assert_type(node.create_publisher(Nav, "nav"), blocking.Publisher[Nav])
    for sample in node.subscribe(Nav, "nav"):
        assert_type(sample, Sample[Nav])
    client = node.create_client(Arm, "arm")
    assert_type(client.call(Arm.Request(on=True)), Arm.Response)
    node.create_service(Arm, "arm", arm)
    node.create_service(Arm, "arm", arm_later)  # type: ignore[call-overload]


def awaited(node: Node) -> Awaitable[Arm.Response]:
    return node.create_client(Arm, "arm").call(Arm.Request(on=True))
