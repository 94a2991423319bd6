"""Samples larger than a frame through gateways: how far they are, and giving them up."""

import json
import random
from contextlib import AsyncExitStack
from typing import Any

import pytest

from tests.gateway.networks import SECTION, Channel, get, hear, local_network, matched, run

PHOTO = random.Random("photo").randbytes(20_000)
TOPIC: dict[str, Any] = {
    "id": 31,
    "topic": "photo",
    "publishers": [1],
    "subscribers": [2],
    "reliability": "reliable",
    "depth": 4,
}
LARGE = SECTION | {"streams": [*SECTION["streams"], TOPIC], "objects": {"max_bytes": 20_000}}


def channel(time_scale: float = 100.0) -> Channel:
    """Water in which a photo takes six minutes, and here four seconds."""
    return Channel(profile="evologics_s2c_18_34", time_scale=time_scale)


async def document(client: Any, address: int) -> dict[str, Any]:
    key = f"@acoustic/{address}/objects"
    found: dict[str, Any] = json.loads((await get(client, key)).payload(key))
    return found


async def order(client: Any, address: int, parameters: str) -> bool:
    key = f"@acoustic/{address}/objects/cancel"
    found: dict[str, bool] = json.loads((await get(client, f"{key}?{parameters}")).payload(key))
    return found["cancelled"]


async def ended(client: Any, address: int) -> dict[str, Any]:
    """Ask until one has ended: an answer each time, something may be on its way."""
    found = await document(client, address)
    while not found["ended"]:
        found = await document(client, address)
    assert found["sending"] == found["receiving"] == []
    first: dict[str, Any] = found["ended"][0]
    return first


def test_a_photo_crosses_and_both_ends_tell_of_it() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            sea = channel()
            a = await stack.enter_async_context(local_network(1, sea, section=LARGE))
            b = await stack.enter_async_context(local_network(2, sea, section=LARGE))
            shore, auv = (stack.enter_context(each.client()) for each in (a, b))
            await matched(shore, "photo")
            heard = await hear(auv, "photo")
            told = await hear(shore, "@acoustic/1/objects")
            shore.put("photo", PHOTO[:1500], encoding="image/jpeg")
            shore.put("photo", b"small")
            sample = await heard.next()
            assert sample.payload.to_bytes() == PHOTO[:1500]
            assert str(sample.encoding) == "image/jpeg"
            assert await heard.payload() == b"small"
            here, there = await ended(shore, 1), await ended(auv, 2)
            assert (here["outcome"], here["to"], here["missing"]) == ("delivered", 2, [])
            assert (there["outcome"], there["source"], there["stream"]) == ("delivered", 1, "photo")
            assert here["done_bytes"] == there["total_bytes"] == 1500
            while not (last := json.loads(await told.payload()))["ended"]:
                pass
            assert last["ended"] == [here]

    run(main())


def test_a_publisher_gives_it_up() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            sea = channel()
            a = await stack.enter_async_context(local_network(1, sea, section=LARGE))
            shore = stack.enter_context(a.client())
            await matched(shore, "photo")
            shore.put("photo", PHOTO)
            while not (found := await document(shore, 1))["sending"]:
                pass
            assert await order(shore, 1, f"id={found['sending'][0]['id']}")
            assert not await order(shore, 1, f"id={found['sending'][0]['id']}")
            assert (await ended(shore, 1))["outcome"] == "cancelled"
            b = await stack.enter_async_context(local_network(2, sea, section=LARGE))
            heard = await hear(stack.enter_context(b.client()), "photo")
            shore.put("photo", b"small")
            assert await heard.payload() == b"small"

    run(main())


def test_a_subscriber_gives_it_up() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            # A refusal after the first listen window is heard in the one after the whole photo,
            # in seven seconds, for which a busy computer is fast enough.
            sea = channel(50.0)
            a = await stack.enter_async_context(local_network(1, sea, section=LARGE))
            b = await stack.enter_async_context(local_network(2, sea, section=LARGE))
            shore, auv = (stack.enter_context(each.client()) for each in (a, b))
            await matched(shore, "photo")
            shore.put("photo", PHOTO)
            while not (found := await document(auv, 2))["receiving"]:
                pass
            arriving = found["receiving"][0]
            assert (arriving["source"], arriving["stream"]) == (1, "photo")
            assert arriving["done_bytes"] < arriving["total_bytes"] == len(PHOTO)
            parameters = f"source=1;transfer={arriving['transfer']}"
            assert await order(auv, 2, parameters)
            assert not await order(auv, 2, parameters)
            assert (await ended(auv, 2))["outcome"] == "cancelled"
            here = await ended(shore, 1)
            assert (here["outcome"], here["missing"]) == ("refused", [2])

    run(main())


@pytest.mark.parametrize("parameters", ["", "?id=x", "?id=-1", "?source=1", "?transfer=2"])
def test_an_order_that_names_nothing_is_refused(parameters: str) -> None:
    async def main() -> None:
        async with local_network(1, channel(), section=LARGE) as shore:
            with shore.client() as client:
                replies = await get(client, f"@acoustic/1/objects/cancel{parameters}")
                assert not replies.good
                assert "allowed: id, or source and transfer; numbers" in replies.errors[0]

    run(main())


def test_too_large_is_counted_and_everything_under_the_prefix_is_no_order() -> None:
    async def main() -> None:
        async with local_network(1, channel(), section=LARGE) as shore:
            with shore.client() as client:
                await matched(client, "photo")
                client.put("photo", bytes(20_001))
                while True:
                    replies = await get(client, "@acoustic/1/**")
                    assert not replies.errors
                    lost = json.loads(replies.payload("@acoustic/1/dropped"))["local"]
                    if lost:
                        break
                assert lost == {"photo": {"refused": 1}}, lost

    run(main())
