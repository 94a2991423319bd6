"""The same endpoints on a Zenoh session, beside programs that know Zenoh only."""

import asyncio
import contextlib
import functools
import json
import logging
import queue
import threading
import time
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import cbor2
import pytest
import zenoh

from tests.node.fleet import (
    Arm,
    Nav,
    Raw,
    config,
    plain_client,
    router,
    run_on_zenoh,
    settle,
    zenoh_config,
)
from zacoustic import (
    CallContext,
    CallTimeoutError,
    DeliveryError,
    Durability,
    LinkClosedError,
    LocalError,
    Node,
    OutcomeUnknownError,
    PayloadInvalidError,
    Qos,
    ServiceError,
    UnknownStreamError,
)
from zacoustic.core.engine.events import LinkStateChanged
from zacoustic.core.linktypes import LinkState
from zacoustic.zenoh.session.session import CALLBACKS_LIMIT_S

LIMIT_S = 10.0


@asynccontextmanager
async def two_nodes(*, with_config: bool = True) -> AsyncIterator[tuple[Node, Node, str]]:
    with router() as (endpoint, _):
        shore_config, auv_config = (config(1), config(2)) if with_config else (None, None)
        async with (
            Node("shore", config=shore_config, connect=endpoint) as shore,
            Node("auv1", config=auv_config, connect=[endpoint]) as auv,
        ):
            yield shore, auv, endpoint


async def replies(session: zenoh.Session, key: str, **options: object) -> list[zenoh.Reply]:
    ask = functools.partial(session.get, key, **options)
    return await asyncio.to_thread(lambda: list(ask()))


@pytest.mark.parametrize("with_config", [True, False])
def test_a_struct_travels_as_a_cbor_map_and_arrives_as_its_class(with_config: bool) -> None:
    async def main() -> None:
        async with (
            two_nodes(with_config=with_config) as (shore, auv, endpoint),
            plain_client(endpoint) as plain,
        ):
            arrived: queue.Queue[zenoh.Sample] = queue.Queue()
            plain.declare_subscriber("auv1/nav", arrived.put)
            subscription = shore.subscribe(Nav, "auv1/nav")
            publisher = auv.create_publisher(Nav, "auv1/nav")
            await settle(plain, shore, auv)
            publisher.publish(Nav(depth=12.0, mode="survey"))
            sample = await subscription.receive()
            assert sample.value == Nav(depth=12.0, mode="survey")
            assert (sample.key, sample.source, sample.age_s) == ("auv1/nav", None, None)
            raw = await asyncio.to_thread(arrived.get, timeout=LIMIT_S)
            assert cbor2.loads(raw.payload.to_bytes()) == {"depth": 12.0, "mode": "survey"}
            assert str(raw.encoding) == "application/cbor"
            publisher.delete()
            assert (await subscription.receive()).deleted
            with pytest.raises(PayloadInvalidError, match=r"Nav\.depth"):
                publisher.publish(Nav(depth=-1.0, mode="idle"))
            assert auv.stats.published == ({10: 2} if with_config else {0: 2})
            assert auv.ledger() == []
            await auv.flush()

    run_on_zenoh(main())


def test_json_where_the_stream_says_so_and_any_encoding_that_can_be_read() -> None:
    async def main() -> None:
        async with two_nodes() as (shore, auv, endpoint), plain_client(endpoint) as plain:
            subscription = shore.subscribe(Nav, "json")
            arrived: queue.Queue[zenoh.Sample] = queue.Queue()
            plain.declare_subscriber("json", arrived.put)
            await settle(plain, shore, auv)
            auv.create_publisher("Nav", "json").publish({"depth": 1, "mode": "idle"})
            raw = await asyncio.to_thread(arrived.get, timeout=LIMIT_S)
            assert json.loads(raw.payload.to_bytes()) == {"depth": 1.0, "mode": "idle"}
            assert (await subscription.receive()).encoding == "application/json"
            value = {"depth": 2, "mode": "abort"}
            plain.put("json", cbor2.dumps(value), encoding="application/cbor")
            assert (await subscription.receive()).value.mode == "abort"
            plain.put("json", json.dumps(value))  # no encoding: the stream's
            assert (await subscription.receive()).value.mode == "abort"

    run_on_zenoh(main())


def test_a_late_subscription_to_a_latched_topic_has_the_last_samples_at_once() -> None:
    latched = Qos(durability=Durability.TRANSIENT_LOCAL, depth=2)

    async def main() -> None:
        async with two_nodes(with_config=False) as (shore, auv, _):
            publisher = auv.create_publisher(bytes, "map", latched)
            for payload in (b"1", b"2", b"3"):
                publisher.publish(payload)
            await settle(auv)  # else the router may still have samples before it, and routes them
            late = shore.subscribe(bytes, "map", latched)
            assert [(await late.receive()).value for _ in range(2)] == [b"2", b"3"]
            publisher.publish(b"4")
            assert (await late.receive()).value == b"4"

    run_on_zenoh(main())


def test_a_sample_that_is_not_of_the_type_is_dropped_counted_and_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        async with two_nodes() as (shore, _, endpoint), plain_client(endpoint) as plain:
            subscription = shore.subscribe(Nav, "auv1/nav")
            await settle(shore, plain)
            for payload in (b"\xff", cbor2.dumps({"depth": 1e9, "mode": "idle"}), cbor2.dumps([])):
                plain.put("auv1/nav", payload, encoding="application/cbor")
            plain.put("auv1/nav", cbor2.dumps({"depth": 1, "mode": "idle"}))
            assert (await subscription.receive()).value.depth == 1.0
            assert shore.stats.dropped == {"payload": 3}

    with caplog.at_level(logging.WARNING):
        run_on_zenoh(main())
    assert "auv1/nav: a sample was dropped: Nav.depth" in caplog.text


def test_the_mark_of_a_gateway_tells_source_and_age() -> None:
    async def main() -> None:
        async with two_nodes() as (shore, _, endpoint), plain_client(endpoint) as plain:
            subscription = shore.subscribe(bytes, "note")
            await settle(shore, plain)
            mark = cbor2.dumps({"acoustic": 2, "age_s": 1.5})
            plain.put("note", b"marked", attachment=mark, encoding="text/plain")
            plain.put("note", b"foreign", attachment=b"\xff\xff")
            sample = await subscription.receive()
            assert (sample.source, sample.age_s, sample.encoding) == (2, 1.5, "text/plain")
            assert (await subscription.receive()).source is None

    run_on_zenoh(main())


def test_placeholders_cover_the_nodes_and_values_of_the_config_only() -> None:
    async def main() -> None:
        async with two_nodes() as (shore, auv, endpoint), plain_client(endpoint) as plain:
            subscription = shore.subscribe(bytes, "{node}/part/{part}")
            await settle(shore, auv, plain)
            plain.put("stranger/part/battery", b"1")
            plain.put("auv1/part/periscope", b"2")
            auv.create_publisher(bytes, "{node}/part/battery").publish(b"3")
            sample = await subscription.receive()
            assert (sample.key, sample.value) == ("auv1/part/battery", b"3")

    run_on_zenoh(main())


def test_without_a_config_a_subscription_may_be_any_key_expression() -> None:
    async def main() -> None:
        async with two_nodes(with_config=False) as (shore, auv, _):
            subscription = shore.subscribe(bytes, "a/**")
            await settle(shore, auv)
            auv.create_publisher(bytes, "a/b").publish(b"1", encoding="text/plain")
            sample = await subscription.receive()
            assert (sample.key, sample.value, sample.encoding) == ("a/b", b"1", "text/plain")
            for wrong in ("a//b", "a/b/", "a/*"):
                with pytest.raises(ValueError, match="name"):
                    auv.create_publisher(bytes, wrong)
            with pytest.raises(LocalError, match="a//\\*"):
                shore.subscribe(bytes, "a//*")
            with pytest.raises(ValueError, match="they need config=FILE"):
                shore.subscribe(bytes, "fleet/{node}")

    run_on_zenoh(main())


def test_with_a_config_a_name_that_it_lacks_is_refused() -> None:
    async def main() -> None:
        async with two_nodes() as (shore, _, _):
            with pytest.raises(UnknownStreamError, match="auv1/navv"):
                shore.subscribe(Nav, "auv1/navv", stream_id=99)
            with pytest.raises(LocalError, match="not a publisher"):
                shore.create_publisher(Nav, "auv1/nav")

    run_on_zenoh(main())


def test_a_node_does_not_hear_itself() -> None:
    async def main() -> None:
        async with two_nodes() as (shore, auv, _):
            own = auv.subscribe(bytes, "note")
            await settle(auv, shore)
            auv.create_publisher(bytes, "note").publish(b"mine")
            shore.create_publisher(bytes, "note").publish(b"theirs")
            assert (await own.receive()).value == b"theirs"

    run_on_zenoh(main())


@pytest.mark.parametrize("with_config", [True, False])
def test_a_call_is_answered(with_config: bool) -> None:
    async def main() -> None:
        async with (
            two_nodes(with_config=with_config) as (shore, auv, endpoint),
            plain_client(endpoint) as plain,
        ):

            async def arm(request: Arm.Request, context: CallContext) -> Arm.Response:
                assert context.client is None
                return Arm.Response(ok=request.on)

            auv.create_service(Arm, "auv1/arm", arm)
            client = shore.create_client(Arm, "auv1/arm")
            await settle(auv, shore, plain)
            assert (await client.call(Arm.Request(on=True))).ok
            payload = cbor2.dumps({"on": False})
            (reply,) = await replies(plain, "auv1/arm", payload=payload, timeout=LIMIT_S)
            assert reply.ok is not None
            assert cbor2.loads(reply.ok.payload.to_bytes()) == {"ok": False}
            (reply,) = await replies(plain, "auv1/arm", payload=b"\xff", timeout=LIMIT_S)
            assert reply.err is not None
            assert b"auv1/arm: BAD_REQUEST: " in reply.err.payload.to_bytes()

    run_on_zenoh(main())


def test_kinds_of_failure_can_be_told_apart(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        async with two_nodes() as (shore, auv, _):
            client = shore.create_client(Arm, "auv1/arm")
            with pytest.raises(DeliveryError, match="nobody serves it"):
                await client.call(Arm.Request(on=True))
            begun = asyncio.Event()

            async def arm(request: Arm.Request) -> Arm.Response:
                if request.on:
                    raise RuntimeError("the battery is empty")
                begun.set()
                await asyncio.Event().wait()
                raise AssertionError

            service = auv.create_service(Arm, "auv1/arm", arm)
            await settle(auv, shore)
            with pytest.raises(ServiceError, match=r"^the battery is empty$"):
                await client.call(Arm.Request(on=True))
            with pytest.raises(CallTimeoutError, match=r"no answer within 0\.1 s"):
                await client.call(Arm.Request(on=False), timeout_s=0.1)
            begun.clear()
            waiting = asyncio.ensure_future(client.call(Arm.Request(on=False)))
            await begun.wait()
            service.close()
            with pytest.raises(DeliveryError, match="the service was closed"):
                await waiting

    run_on_zenoh(main())


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        (b"auv1/echo: TIMED_OUT: no answer before the deadline", CallTimeoutError),
        (b"auv1/echo: UNKNOWN: the server ended without an answer", OutcomeUnknownError),
        (b"auv1/echo: TABLE_MISMATCH: node 2 defines it in another way", DeliveryError),
        (b"auv1/echo: HANDLER: it burns", ServiceError),
        (b"it burns: NO_SERVER: here", ServiceError),
        (b"\xff", ServiceError),
        (b"", ServiceError),
    ],
)
def test_error_replies_of_a_gateway_become_the_errors_that_a_link_gives(
    text: bytes, kind: type[Exception]
) -> None:
    async def main() -> None:
        async with two_nodes() as (shore, _, endpoint), plain_client(endpoint) as plain:
            plain.declare_queryable(
                "auv1/echo", lambda query: query.reply_err(text, encoding="text/plain")
            )
            await settle(plain, shore)
            with pytest.raises(kind) as caught:
                await shore.create_client(Raw, "auv1/echo").call(b"x")
            assert type(caught.value) is kind

    run_on_zenoh(main())


def test_the_exchange_ends_when_the_node_is_closed() -> None:
    async def main() -> None:
        async with two_nodes() as (shore, auv, endpoint), plain_client(endpoint) as plain:
            begun = asyncio.Semaphore(0)

            async def never(_: bytes) -> bytes:
                begun.release()
                await asyncio.Event().wait()
                raise AssertionError

            auv.create_service(Raw, "auv1/echo", never)
            await settle(auv, shore, plain)
            call = asyncio.ensure_future(shore.create_client(Raw, "auv1/echo").call(b"x"))
            asked = asyncio.ensure_future(replies(plain, "auv1/echo", timeout=LIMIT_S))
            for _ in (call, asked):
                await begun.acquire()
            subscription = shore.subscribe(bytes, "note")
            await shore.close()
            with pytest.raises(LinkClosedError, match="the node was closed"):
                await call
            assert [sample async for sample in subscription] == []
            await auv.close()
            (reply,) = await asked
            assert reply.err is not None
            assert b"the service was closed" in reply.err.payload.to_bytes()

    run_on_zenoh(main())


def test_no_thread_of_zenoh_is_left_behind_a_closed_node() -> None:
    """One that comes back to an interpreter which has ended aborts the process."""

    async def main() -> None:
        with router() as (endpoint, _):
            async with Node("x", connect=endpoint) as node:
                node.subscribe(bytes, "note")
                node.create_service(Raw, "echo", bytes)
                with pytest.raises(LocalError):
                    node.subscribe(bytes, "a//*")  # Zenoh takes no callback, and drops none
                await settle(node)
                assert zenoh_threads()
                closing_at_s = time.monotonic()
            assert zenoh_threads() == []
            assert time.monotonic() - closing_at_s < CALLBACKS_LIMIT_S

    run_on_zenoh(main())


def zenoh_threads() -> list[str]:
    """Name the worker, and the threads that Zenoh calls back on."""
    names = [thread.name for thread in threading.enumerate()]
    return [name for name in names if name == "zenoh" or "pyo3" in name]


def test_the_connection_to_the_router_is_an_event_and_its_loss_is_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        with router() as (endpoint, session):
            async with Node("x", connect=endpoint) as node:
                states: list[LinkState] = []
                async for event in node.events():
                    assert isinstance(event, LinkStateChanged)
                    states.append(event.state)
                    if len(states) == 2:
                        break
                    await asyncio.to_thread(session.close)
                assert states == [LinkState.UP, LinkState.DOWN]
        with router() as (endpoint, _):
            async with Node("y", connect=endpoint) as node:
                await anext(node.events())

    run_on_zenoh(main())
    assert [record.message for record in caplog.records] == [
        "the Zenoh router is gone; nothing comes or goes until it is back"
    ]


def test_the_file_of_a_router_tells_where_to_connect() -> None:
    async def main() -> None:
        with router() as (endpoint, _):
            known = config(1)
            port = endpoint.rpartition(":")[2]
            file = zenoh_config("router", listen=[f"tcp/0.0.0.0:{port}"])
            with_file = type(known)(
                **{
                    **{name: getattr(known, name) for name in known.__struct_fields__},
                    "zenoh_config": file,
                }
            )
            async with (
                Node("shore", config=with_file) as shore,
                Node("auv1", config=config(2), connect=endpoint) as auv,
            ):
                subscription = shore.subscribe(bytes, "note")
                await settle(shore, auv)
                auv.create_publisher(bytes, "note").publish(b"x")
                assert (await subscription.receive()).value == b"x"
            assert json.loads(file.get_json("mode")) == "router"

    run_on_zenoh(main())


def test_a_flood_leaves_the_depth_and_no_more() -> None:
    async def main() -> None:
        async with two_nodes() as (shore, auv, _):
            subscription = shore.subscribe(bytes, "note")
            publisher = auv.create_publisher(bytes, "note")
            await settle(shore, auv)
            for number in range(20_000):
                publisher.publish(number.to_bytes(4, "big"))
            deadline = time.monotonic() + 20
            end = b"end"
            last = b""
            while last != end and time.monotonic() < deadline:
                publisher.publish(end)  # Zenoh drops what a full link has no room for, also the end
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(0.5):
                        last = (await subscription.receive()).value
            assert last == end
            assert len(subscription._mailbox) <= 10

    run_on_zenoh(main())


def test_a_wildcard_calls_no_service() -> None:
    async def main() -> None:
        async with two_nodes() as (_, auv, endpoint), plain_client(endpoint) as plain:
            called: list[bytes] = []

            def echo(request: bytes) -> bytes:
                called.append(request)
                return request

            auv.create_service(Raw, "auv1/echo", echo)
            await settle(plain, auv)

            def ask(key: str) -> list[str]:
                replies = plain.get(key, payload=b"x", timeout=LIMIT_S)
                errors = [each.err for each in replies]
                return [error.payload.to_string() if error is not None else "" for error in errors]

            (refused,) = await asyncio.to_thread(ask, "auv1/*")
            assert "a wildcard calls no service, only auv1/echo itself does" in refused
            assert called == []
            assert await asyncio.to_thread(ask, "auv1/echo") == [""]
            assert called == [b"x"]

    run_on_zenoh(main())
