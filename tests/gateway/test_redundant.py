"""Two gateways on one network: no loop, no echo, nothing twice; one takes over from the other."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager

import pytest
import zenoh

from tests.gateway.networks import (
    SECTION,
    TABLE,
    UNRELATED,
    Channel,
    Heard,
    LocalNetwork,
    cbor,
    config_of,
    counts,
    get,
    hear,
    local_network,
    matched,
    run,
    until,
    zenoh_config,
    zenoh_router,
)
from zacoustic.core.streams.table import Stream
from zacoustic.errors import SessionError
from zacoustic.gateway import Gateway
from zacoustic.zenoh.gateway.redundant import RETIRED_S, RedundantGateways

ROUNDS = 5
ROUND_S = 5.0
"""After that, what has not arrived is lost."""


class Fleet:
    """Gateways 1 and 3 on the shore, gateway 2 on the vehicle, a router that outlives them."""

    channel: Channel
    first: LocalNetwork
    second: LocalNetwork
    first_stack: AsyncExitStack
    shore: zenoh.Session
    auv: zenoh.Session


@asynccontextmanager
async def fleet() -> AsyncIterator[Fleet]:
    async with AsyncExitStack() as stack:
        found = Fleet()
        found.channel = Channel()
        router = stack.enter_context(zenoh_router())
        found.first_stack = AsyncExitStack()
        found.first = await found.first_stack.enter_async_context(
            local_network(1, found.channel, join=router)
        )
        await stack.enter_async_context(found.first_stack)
        found.second = await stack.enter_async_context(local_network(3, found.channel, join=router))
        await until(lambda: alive(found.first) == (1, 3), found.first.changed)
        vehicle = await stack.enter_async_context(local_network(2, found.channel))
        found.shore = stack.enter_context(found.first.client())
        found.auv = stack.enter_context(vehicle.client())
        await matched(found.shore, "chat")
        await matched(found.auv, "chat")
        yield found


def alive(of: LocalNetwork) -> tuple[int, ...]:
    """Return the gateways on a local network as its last notice about them says."""
    found: list[tuple[int, ...]] = [()]
    for each in of.notices:
        if each.event == "started":
            others = each.facts["redundant"]  # those that were there before
            found.append(tuple(sorted((*others, each.facts["address"]))) if others else ())
        elif each.event == "redundant":
            found.append(each.facts["addresses"])
    return found[-1]


async def have_arrived(heard: Heard, payloads: set[bytes]) -> bool:
    """Wait for samples; False: some were lost."""
    with contextlib.suppress(TimeoutError):
        async with asyncio.timeout(ROUND_S):
            while not payloads <= {each.payload.to_bytes() for each in heard.samples}:
                await heard.next()
            return True
    return False


def test_one_put_is_one_transmission_and_one_delivery_without_echo() -> None:
    async def main() -> None:
        async with fleet() as here:
            at_shore, at_auv = await hear(here.shore, "chat"), await hear(here.auv, "chat")
            for number in range(5):
                payload = f"shore {number}".encode()
                here.shore.put("chat", payload)
                assert await at_auv.payload() == payload
                assert await at_shore.payload() == payload
            # Behind whatever else is under way, and the other way round.
            here.auv.put("chat", b"end")
            assert await at_shore.payload() == b"end"
            assert await at_auv.payload() == b"end"
            here.shore.put("chat", b"end")
            assert await at_auv.payload() == b"end"
            first, second = [
                (await get(here.shore, f"@acoustic/{each}/streams")).payload(
                    f"@acoustic/{each}/streams"
                )
                for each in (1, 3)
            ]
            assert counts(first, "chat") == {"published": 6, "received": 1, "transmitted": 6}
            assert counts(second, "chat") == {"published": 0, "received": 7, "transmitted": 0}

    run(main())


def test_gateways_of_one_local_network_do_not_speak_at_one_instant() -> None:
    """An event on the local network makes samples for both, and a receiver would hear neither."""

    async def main() -> None:
        channel = Channel(profile="evologics_s2c_18_34", time_scale=2.0)
        async with AsyncExitStack() as stack:
            router = stack.enter_context(zenoh_router())
            first = await stack.enter_async_context(local_network(1, channel, join=router))
            second = await stack.enter_async_context(local_network(3, channel, join=router))
            await until(lambda: alive(first) == (1, 3), first.changed)
            await until(lambda: alive(second) == (1, 3), second.changed)
            vehicle = await stack.enter_async_context(local_network(2, channel))
            shore = stack.enter_context(first.client())
            heard = await hear(stack.enter_context(vehicle.client()), "fleet/*/status")
            for node in ("shore", "buoy"):
                await matched(shore, f"fleet/{node}/status")
            arrived = 0
            for number in range(ROUNDS):
                payloads = {f"{node} {number}".encode() for node in ("shore", "buoy")}
                for node in ("shore", "buoy"):
                    shore.put(f"fleet/{node}/status", f"{node} {number}".encode())
                arrived += await have_arrived(heard, payloads)
            # At one instant none would. A busy computer may hold a gateway up for longer than the
            # tenth of a second that lies between their turns.
            assert arrived > ROUNDS / 2

    run(main())


def test_standby_takes_over_when_the_active_gateway_is_gone() -> None:
    async def main() -> None:
        async with fleet() as here:
            await here.first_stack.aclose()
            await until(lambda: alive(here.second) == (3,), here.second.changed)
            await declared(here.shore, 3)
            at_shore, at_auv = await hear(here.shore, "chat"), await hear(here.auv, "chat")
            here.shore.put("chat", b"through the other one")
            assert await at_auv.payload() == b"through the other one"
            assert await at_shore.payload() == b"through the other one"
            here.auv.put("chat", b"and back")
            assert await at_shore.payload() == b"and back"
            replies = await get(here.shore, "auv1/echo", b"nobody serves it")
            assert len(replies.errors) == 1
            assert "NO_SERVER" in replies.errors[0]

    run(main())


def test_last_value_is_answered_once_and_by_the_one_that_takes_over() -> None:
    async def main() -> None:
        async with fleet() as here:
            at_shore = await hear(here.shore, "auv1/nav")
            await matched(here.auv, "auv1/nav")
            here.auv.put("auv1/nav", cbor(depth=1, mode="idle"))
            await at_shore.next()
            assert len((await get(here.shore, "auv1/nav")).good) == 1
            await here.first_stack.aclose()
            await until(lambda: alive(here.second) == (3,), here.second.changed)
            await declared(here.shore, 3)
            assert len((await get(here.shore, "auv1/nav")).good) == 1

    run(main())


async def declared(session: zenoh.Session, address: int) -> None:
    """Wait until what a gateway has decided to declare is declared: it answers behind that."""
    assert (await get(session, f"@acoustic/{address}/link")).good


def test_service_whose_server_is_a_redundant_gateway_is_left_to_it() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel = Channel()
            a = await stack.enter_async_context(local_network(1, channel))
            await stack.enter_async_context(local_network(2, channel, join=a.port))
            client = stack.enter_context(a.client())
            await until(lambda: alive(a) == (1, 2), a.changed)
            await matched(client, "chat")
            replies = await get(client, "auv1/echo", b"x")
            assert (replies.good, replies.errors) == ({}, [])
            assert channel.emissions == []

    run(main())


def test_each_gateway_says_that_there_is_no_channel_to_its_own_node() -> None:
    async def main() -> None:
        async with fleet() as here:
            for node in (1, 3):
                replies = await get(here.shore, f"@acoustic/{node}/ping")
                assert not replies.good
                assert [
                    f"node {node} is on this local network" in each for each in replies.errors
                ] == [True]

    run(main())


def test_second_gateway_with_the_same_address_is_refused() -> None:
    async def main() -> None:
        channel = Channel()
        async with local_network(1, channel, section=SECTION) as a:
            config = config_of(1, zenoh_config("client", connect=a.port))
            with pytest.raises(SessionError, match="has the address 1"):
                await Gateway(config, link=channel.medium.link(3)).start()
            assert not a.told("redundant")
            assert [each.facts["redundant"] for each in a.told("started")] == [()]

    run(main())


def test_gateway_of_another_fleet_is_not_redundant() -> None:
    async def main() -> None:
        channel = Channel()
        async with (
            local_network(3, channel, section=UNRELATED) as other,
            local_network(1, channel, join=other.port) as a,
            local_network(2, channel),
        ):
            with a.client() as shore:
                await declared(shore, 1)
                documents = await get(shore, "@acoustic/*/streams")
                assert sorted(documents.good) == ["@acoustic/1/streams", "@acoustic/3/streams"]
            for each in (a, other):
                assert not each.told("redundant")
                assert [said.facts["redundant"] for said in each.told("started")] == [()]
            config = config_of(3, zenoh_config("client", connect=other.port))
            with pytest.raises(SessionError, match="has the address 3"):
                await Gateway(config, link=channel.medium.link(2)).start()

    run(main())


# The rule itself


def stream(name: str) -> Stream:
    return TABLE.by_name(name)


def test_lowest_that_may_do_it_does_it() -> None:
    first, third = RedundantGateways(1, lambda: 0), RedundantGateways(3, lambda: 0)
    first.update(3, is_alive=True)
    third.update(1, is_alive=True)
    assert first.forwards(stream("chat"))
    assert not third.forwards(stream("chat"))
    assert first.delivers(stream("auv1/nav"))
    assert not third.delivers(stream("auv1/nav"))
    assert first.proxies(stream("auv1/arm"))
    assert not third.proxies(stream("auv1/arm"))
    third.update(1, is_alive=False)
    assert third.forwards(stream("chat"))
    assert third.delivers(stream("auv1/nav"))
    assert third.proxies(stream("auv1/arm"))


def test_each_gateway_forwards_its_own_keys_of_a_stream_with_node_in_its_name() -> None:
    redundant = RedundantGateways(3, lambda: 0)
    redundant.update(1, is_alive=True)
    assert redundant.forwards(stream("fleet/{node}/status"))
    assert not redundant.delivers(stream("fleet/{node}/status"))


def test_what_nobody_at_a_remote_node_sends_or_wants_is_no_job() -> None:
    vehicle = RedundantGateways(2, lambda: 0)
    assert not vehicle.forwards(stream("auv1/text"))
    assert not vehicle.delivers(stream("auv1/nav"))
    assert not vehicle.proxies(stream("auv1/arm"))
    shore = RedundantGateways(1, lambda: 0)
    shore.update(3, is_alive=True)
    assert not shore.delivers(stream("auv1/text"))


def test_redundant_gateway_that_is_gone_is_of_this_local_network_for_what_it_had_on_the_air() -> (
    None
):
    now = 0
    redundant = RedundantGateways(1, lambda: now)
    assert not redundant.shares_network(3, stream("chat"))
    assert redundant.update(3, is_alive=True)
    assert not redundant.update(3, is_alive=True)
    assert redundant.shares_network(3, stream("chat"))
    redundant.update(3, is_alive=False)
    assert redundant.shares_network(3, stream("chat"))
    now = round(RETIRED_S * 1e9)
    assert not redundant.shares_network(3, stream("chat"))
    assert not redundant.update(1, is_alive=False)
    assert redundant.alive == (1,)


def test_what_went_by_zenoh_alone_is_no_echo_once_the_network_has_parted() -> None:
    """Not even within the time for which others may have frames of that gateway on the air."""
    shore = RedundantGateways(1, lambda: 0, (1, 2, 3))
    for address in (2, 3):
        shore.update(address, is_alive=True)
    assert shore.shares_network(2, stream("chat"))
    shore.update(2, is_alive=False)
    shore.update(3, is_alive=False)
    assert not shore.shares_network(2, stream("chat"))
    part = RedundantGateways(1, lambda: 0, (1, 2, 3))
    part.update(2, is_alive=True)
    part.update(2, is_alive=False)
    assert part.shares_network(2, stream("chat"))  # it was transmitted for node 3


def test_topic_of_no_listed_subscribers_crosses_while_any_node_is_not_here() -> None:
    chat = next(each for each in TABLE if each.name == "chat")
    knows, does_not = RedundantGateways(1, lambda: 0, (1, 2, 3)), RedundantGateways(1, lambda: 0)
    for address in (2, 3):
        assert knows.forwards(chat)
        for each in (knows, does_not):
            each.update(address, is_alive=True)
    assert not knows.forwards(chat)
    assert does_not.forwards(chat)
    knows.update(2, is_alive=False)
    assert knows.forwards(chat)


def test_what_zenoh_brings_to_the_other_node_takes_no_airtime_until_the_network_parts() -> None:
    section = SECTION | {
        "streams": [{"id": 1, "topic": "auv/nav", "publishers": [2], "subscribers": [1]}]
    }

    async def main() -> None:
        channel = Channel()
        with zenoh_router() as deck:
            async with (
                local_network(2, channel, section=section, join=deck) as vehicle,
                AsyncExitStack() as on_deck,
            ):
                shore = await on_deck.enter_async_context(
                    local_network(1, channel, section=section, join=deck)
                )
                await until(lambda: alive(vehicle) == (1, 2), vehicle.changed)
                with vehicle.client() as auv:
                    with shore.client() as program:
                        nav = await hear(program, "auv/nav")
                        await matched(auv, "auv/nav")
                        auv.put("auv/nav", b"on deck")
                        assert await nav.payload() == b"on deck"
                        assert channel.sent_by(2) == 0
                    await on_deck.aclose()
                    async with local_network(1, channel, section=section) as ashore:
                        with ashore.client() as program:
                            nav = await hear(program, "auv/nav")
                            await matched(auv, "auv/nav")  # the gateway wants it now
                            auv.put("auv/nav", b"at sea")
                            assert await nav.payload() == b"at sea"
                    assert channel.sent_by(2) > 0

    run(main())
