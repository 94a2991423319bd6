"""Clients and services in direct mode, over simulated water."""

import asyncio
import logging
import time

import msgspec
import pytest

from tests.node.fleet import Arm, Raw, channel, config
from tests.runtime.loop_checks import run
from zacoustic import (
    CallContext,
    CallTimeoutError,
    DeliveryError,
    LinkClosedError,
    LocalError,
    Node,
    PayloadInvalidError,
    ServiceError,
)
from zacoustic_sim.medium import SimMedium


def two_nodes(medium: SimMedium) -> tuple[Node, Node]:
    shore = Node("shore", config=config(), link=medium.link(1))
    return shore, Node("auv1", config=config(), link=medium.link(2))


def test_a_call_is_answered_by_a_function() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                auv.create_service(Arm, "auv1/arm", lambda request: Arm.Response(ok=request.on))
                client = shore.create_client(Arm, "auv1/arm")
                assert await client.call(Arm.Request(on=True)) == Arm.Response(ok=True)
                assert not (await client.call(Arm.Request(on=False), timeout_s=20)).ok

    run(main())


def test_a_handler_may_wait_and_may_take_the_context() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                contexts: list[CallContext] = []

                async def echo(request: bytes, context: CallContext) -> bytes:
                    contexts.append(context)
                    await asyncio.sleep(0)
                    return request[::-1]

                auv.create_service(Raw, "auv1/echo", echo)
                client = shore.create_client((bytes, bytes), "auv1/echo")
                answers = await asyncio.gather(client.call(b"abc"), client.call(b"12"))
                assert list(answers) == [b"cba", b"21"]
                assert {(each.service, each.client) for each in contexts} == {("auv1/echo", 1)}
                ids = [each.call_id or "" for each in contexts]
                assert [len(each.split("/")) for each in ids] == [4, 4]
                assert ids[0] != ids[1]
                left_s = (contexts[0].deadline_at - time.monotonic_ns()) / 1e9
                assert 0 < left_s < 30

    run(main())


def test_a_handler_with_a_default_argument_takes_no_context() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:

                def echo(request: bytes, times: int = 2) -> bytes:
                    return request * times

                auv.create_service(Raw, "auv1/echo", echo)
                assert await shore.create_client(Raw, "auv1/echo").call(b"x") == b"xx"

    run(main())


def test_without_a_config_client_and_service_share_the_id() -> None:
    async def main() -> None:
        with channel() as medium:
            auv = Node(2, link=medium.link(2))
            async with Node(1, link=medium.link(1)) as shore, auv:
                auv.create_service(Arm, "arm", lambda _: Arm.Response(ok=True), stream_id=20)
                client = shore.create_client(Arm, "arm", stream_id=20, server=2)
                assert (await client.call(Arm.Request(on=True))).ok

    run(main())


def test_what_a_handler_raises_reaches_the_caller_with_its_text(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:

                def refuse(request: Arm.Request) -> Arm.Response:
                    raise RuntimeError("the battery is empty" if request.on else "")

                auv.create_service(Arm, "auv1/arm", refuse)
                client = shore.create_client(Arm, "auv1/arm")
                with pytest.raises(ServiceError, match=r"^the battery is empty$"):
                    await client.call(Arm.Request(on=True))
                with pytest.raises(ServiceError, match=r"^RuntimeError$"):
                    await client.call(Arm.Request(on=False))

    with caplog.at_level(logging.WARNING):
        run(main())
    assert "auv1/arm: the handler failed" in caplog.text


def test_a_response_that_is_none_is_an_error_of_the_service() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                auv.create_service(
                    ("ArmRequest", "ArmResponse"), "auv1/arm", lambda _: {"ok": "perhaps"}
                )
                with pytest.raises(ServiceError, match=r"ArmResponse\.ok"):
                    await shore.create_client(Arm, "auv1/arm").call(Arm.Request(on=True))

    run(main())


def test_kinds_of_failure_can_be_told_apart() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                client = shore.create_client(Arm, "auv1/arm")
                with pytest.raises(DeliveryError, match="no program serves auv1/arm"):
                    await client.call(Arm.Request(on=True))
                with pytest.raises(PayloadInvalidError):
                    await client.call(Arm.Request(on="maybe"))  # type: ignore[arg-type]
                forever = asyncio.Event()

                async def never(_: Arm.Request) -> Arm.Response:
                    await forever.wait()
                    raise AssertionError

                service = auv.create_service(Arm, "auv1/arm", never)
                with pytest.raises(CallTimeoutError, match="unknown"):
                    await client.call(Arm.Request(on=True), timeout_s=0.2)
                with pytest.raises(LocalError, match="timeout_s is 0"):
                    await client.call(Arm.Request(on=True), timeout_s=0)
                service.close()
                client.close()
                with pytest.raises(LocalError, match="client of auv1/arm is closed"):
                    await client.call(Arm.Request(on=True))

    run(main())


def test_streams_that_differ_fail_the_call() -> None:
    class Other(msgspec.Struct):
        level: int

    async def main() -> None:
        with channel() as medium:
            auv = Node(2, link=medium.link(2))
            async with Node(1, link=medium.link(1)) as shore, auv:
                auv.create_service((Other, Other), "arm", lambda request: request, stream_id=20)
                client = shore.create_client(Arm, "arm", stream_id=20, server=2)
                with pytest.raises(DeliveryError, match="in another way"):
                    await client.call(Arm.Request(on=True))

    run(main())


def test_closing_a_service_tells_those_who_wait() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                begun = asyncio.Event()

                async def never(_: Arm.Request) -> Arm.Response:
                    begun.set()
                    await asyncio.Event().wait()
                    raise AssertionError

                service = auv.create_service(Arm, "auv1/arm", never)
                with pytest.raises(LocalError, match="served by this node already"):
                    auv.create_service(Arm, "auv1/arm", never)
                call = asyncio.ensure_future(
                    shore.create_client(Arm, "auv1/arm").call(Arm.Request(on=True))
                )
                await begun.wait()
                service.close()
                with pytest.raises(DeliveryError, match="the service was closed"):
                    await call
                auv.create_service(Arm, "auv1/arm", lambda _: Arm.Response(ok=True))

    run(main())


def test_a_cancelled_call_frees_its_number_and_a_closed_node_fails_its_calls() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node("shore", config=config(), link=medium.link(1)) as shore:
                client = shore.create_client(Arm, "auv1/arm")
                calls = [asyncio.ensure_future(client.call(Arm.Request(on=True))) for _ in "ab"]
                await asyncio.sleep(0)
                calls[0].cancel()
                with pytest.raises(asyncio.CancelledError):
                    await calls[0]
            with pytest.raises(LinkClosedError, match="the node was closed"):
                await calls[1]

    run(main())


def test_who_serves_is_checked_when_the_endpoint_is_made() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                with pytest.raises(LocalError, match=r"served by node 2; this is node 1 \(shore\)"):
                    shore.create_service(Arm, "auv1/arm", lambda _: Arm.Response(ok=True))
                with pytest.raises(LocalError, match="cannot call itself"):
                    auv.create_client(Arm, "auv1/arm")
                with pytest.raises(ValueError, match="server: 3; allowed: 2"):
                    shore.create_client(Arm, "auv1/arm", server=3)

    run(main())
