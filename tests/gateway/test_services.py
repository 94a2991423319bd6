import asyncio
from collections.abc import Callable
from contextlib import AsyncExitStack

import cbor2
import zenoh

from tests.gateway.networks import LIMIT_S, UNRELATED, Channel, cbor, fence, get, local_network, run
from zacoustic.core.engine.events import CallFailure
from zacoustic.gateway import Marker, read_marker
from zacoustic.zenoh.session.asking.queries import HeldQuery, QueryHandler
from zacoustic.zenoh.session.worker import Worker

Serve = Callable[[zenoh.Query], None]


async def shore_and_server(
    stack: AsyncExitStack, key: str = "", serve: Serve | None = None
) -> zenoh.Session:
    """Open two networks, with a server on that of the vehicle; returns a client on the shore."""
    channel = Channel()
    a = await stack.enter_async_context(local_network(1, channel))
    b = await stack.enter_async_context(local_network(2, channel))
    auv = stack.enter_context(b.client())
    if serve is not None:
        answer = serve

        def on_query(query: zenoh.Query) -> None:
            with query:
                answer(query)

        auv.declare_queryable(key, on_query, complete=True)
        # The local network must know the server before the first call arrives.
        await fence(auv)
    return stack.enter_context(a.client())


def asked(query: zenoh.Query) -> bytes:
    return query.payload.to_bytes() if query.payload is not None else b""


def test_typed_call_crosses_and_is_answered_in_the_encoding_of_the_request() -> None:
    seen: list[tuple[object, str, bytes]] = []

    def serve(query: zenoh.Query) -> None:
        assert query.attachment is not None
        seen.append((cbor2.loads(asked(query)), str(query.encoding), query.attachment.to_bytes()))
        query.reply("auv1/arm", cbor(ok=True), encoding="application/cbor")

    async def main() -> None:
        async with AsyncExitStack() as stack:
            shore = await shore_and_server(stack, "auv1/arm", serve)
            replies = await get(shore, "auv1/arm", cbor(arm=True), encoding="application/cbor")
            reply = replies.good["auv1/arm"]
            assert cbor2.loads(reply.payload.to_bytes()) == {"ok": True}
            assert reply.attachment is not None
            assert read_marker(reply.attachment.to_bytes()) == Marker(acoustic=2)
            replies = await get(shore, "auv1/arm", b'{"arm": false}', encoding="application/json")
            assert replies.payload("auv1/arm") == b'{"ok":true}'
            assert str(replies.good["auv1/arm"].encoding) == "application/json"
        assert [value for value, _, _ in seen] == [{"arm": True}, {"arm": False}]
        assert {encoding for _, encoding, _ in seen} == {"application/cbor"}
        calls = [read_marker(attachment) for _, _, attachment in seen]
        assert {call.acoustic for call in calls if call is not None} == {1}
        # Client, its epoch, stream, number: what a handler can keep for its own idempotence.
        ids = [call.call.split("/") for call in calls if call is not None and call.call is not None]
        assert [len(each) for each in ids] == [4, 4]
        assert ids[0][:3] == ids[1][:3]
        assert ids[0][3] != ids[1][3]

    run(main())


def test_opaque_call_crosses_as_it_is_and_an_empty_one_too() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            shore = await shore_and_server(
                stack, "auv1/echo", lambda query: query.reply("auv1/echo", asked(query)[::-1])
            )
            assert (await get(shore, "auv1/echo", b"\x01\x02")).payload("auv1/echo") == b"\x02\x01"
            assert (await get(shore, "auv1/echo")).payload("auv1/echo") == b""

    run(main())


def test_error_of_the_server_reaches_the_caller() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            shore = await shore_and_server(
                stack, "auv1/arm", lambda query: query.reply_err(b"the hatch is open")
            )
            replies = await get(shore, "auv1/arm", cbor(arm=True))
            assert replies.errors == ["auv1/arm: HANDLER: the hatch is open"]

    run(main())


def test_what_a_server_says_of_itself_is_said_to_the_caller() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            shore = await shore_and_server(
                stack,
                "auv1/arm",
                lambda query: query.reply_err(b"auv1/arm: NO_SERVER: the service was closed"),
            )
            replies = await get(shore, "auv1/arm", cbor(arm=True))
            assert replies.errors == ["auv1/arm: NO_SERVER: the service was closed"]

    run(main())


def test_nobody_who_serves_is_no_server() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            shore = await shore_and_server(stack)
            replies = await get(shore, "auv1/arm", cbor(arm=True))
            assert len(replies.errors) == 1
            assert replies.errors[0].startswith("auv1/arm: NO_SERVER: ")

    run(main())


def test_server_that_ends_without_an_answer_may_have_run() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            shore = await shore_and_server(stack, "auv1/arm", lambda query: None)
            replies = await get(shore, "auv1/arm", cbor(arm=True))
            assert replies.errors == ["auv1/arm: UNKNOWN: the server ended without an answer"]

    run(main())


def test_bad_answer_of_the_server_is_an_error() -> None:
    answers = iter([b"\xff", cbor(ok=7)])

    async def main() -> None:
        async with AsyncExitStack() as stack:
            shore = await shore_and_server(
                stack, "auv1/arm", lambda query: query.reply("auv1/arm", next(answers))
            )
            for _ in range(2):
                replies = await get(shore, "auv1/arm", cbor(arm=True))
                assert len(replies.errors) == 1
                assert replies.errors[0].startswith("auv1/arm: HANDLER: ")

    run(main())


def test_bad_request_and_wildcard_are_refused_on_the_spot() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            shore = await shore_and_server(stack)
            refusals = [
                await get(shore, "auv1/arm", b"\xff"),
                await get(shore, "auv1/arm", cbor(arm="yes")),
                await get(shore, "auv1/arm"),
                await get(shore, "auv1/echo", bytes(600)),
                await get(
                    shore, "auv1/arm", cbor(arm=True), attachment=Marker(acoustic=2).encode()
                ),
                await get(shore, "*/arm", cbor(arm=True)),
            ]
            assert [len(replies.errors) for replies in refusals] == [1] * 6
            texts = [replies.errors[0] for replies in refusals]
            assert [text.split(": ")[1] for text in texts] == [
                *["BAD_REQUEST"] * 4, "NO_SERVER", "BAD_REQUEST"
            ]  # fmt: skip
            assert all(text.count("auv1/") == 1 for text in texts[:5])
            assert "arm is missing" in texts[2]
            assert "came off the channel" in texts[4]
            assert "wildcard" in texts[5]

    run(main())


def test_call_without_an_answer_ends_at_the_deadline_of_the_stream() -> None:
    held: list[zenoh.Query] = []

    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel = Channel()
            a = await stack.enter_async_context(local_network(1, channel))
            b = await stack.enter_async_context(local_network(2, channel))
            auv, shore = stack.enter_context(b.client()), stack.enter_context(a.client())
            auv.declare_queryable("auv1/hasty", held.append)
            await fence(auv)
            replies = await get(shore, "auv1/hasty", b"")
            assert replies.errors == ["auv1/hasty: TIMED_OUT: no answer before the deadline"]
        for query in held:
            query.drop()  # type: ignore[no-untyped-call]

    run(main())


def test_call_that_waits_when_the_gateway_stops_gets_an_error() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel = Channel()
            # The gateway is a client of a router that outlives it.
            router = await stack.enter_async_context(local_network(3, channel, section=UNRELATED))
            shore = stack.enter_context(router.client())
            async with local_network(1, channel, join=router.port):
                waiting = asyncio.ensure_future(get(shore, "auv1/arm", cbor(arm=True)))
                async with asyncio.timeout(LIMIT_S):
                    while not channel.sent_by(1):
                        channel.changed.clear()
                        await channel.changed.wait()
            assert (await waiting).errors == ["auv1/arm: UNKNOWN: the gateway is stopping"]

    run(main())


def test_too_many_calls_at_once_are_refused_and_none_is_left_silent() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            shore = await shore_and_server(stack)
            calls = [get(shore, "auv1/hasty", b"x") for _ in range(400)]
            everything = await asyncio.gather(*calls)
            assert [len(replies.errors) for replies in everything] == [1] * 400

    run(main())


def test_handler_answers_each_query_once_and_refuses_what_is_too_much() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel = Channel()
            a = await stack.enter_async_context(local_network(3, channel, section=UNRELATED))
            server, client = stack.enter_context(a.client()), stack.enter_context(a.client())
            worker, rung = Worker("test"), asyncio.Event()
            came: list[HeldQuery] = []
            loop = asyncio.get_running_loop()

            def ring() -> None:
                loop.call_soon_threadsafe(rung.set)

            handler = QueryHandler(worker, ring, limit=1, closed_text="closed")
            server.declare_queryable("asked", lambda query: handler.admit(came.append, query))
            await fence(server)
            first = asyncio.ensure_future(get(client, "asked"))
            await rung.wait()
            assert (await get(client, "asked")).errors == [
                "asked: NO_SERVER: 1 queries are held already"
            ]
            handler.serve()
            [held] = came
            assert held.refuse(CallFailure.HANDLER, "first")
            assert not held.refuse(CallFailure.HANDLER, "second")
            assert (await first).errors == ["asked: HANDLER: first"]
            handler.close()
            assert (await get(client, "asked")).errors == ["asked: NO_SERVER: closed"]
            assert (len(handler), handler.refused) == (0, 1)
            await worker.close(limit_s=LIMIT_S)

    run(main())
