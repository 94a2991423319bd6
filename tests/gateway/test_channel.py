"""What is in the water, as the gateways tell it: the frame under way, and the last ones."""

import json
from contextlib import AsyncExitStack
from typing import Any

from tests.gateway.networks import SECTION, Channel, get, hear, local_network, matched, run
from zacoustic.zenoh.gateway.status.channel import KEPT

TOPIC: dict[str, Any] = {"id": 31, "topic": "photo", "publishers": [1], "subscribers": [2],
                         "reliability": "reliable", "depth": 4}  # fmt: skip
LARGE = SECTION | {"streams": [*SECTION["streams"], TOPIC]}


async def document(client: Any, address: int) -> dict[str, Any]:
    key = f"@acoustic/{address}/channel"
    found: dict[str, Any] = json.loads((await get(client, key)).payload(key))
    return found


def alike(one: dict[str, Any], other: dict[str, Any]) -> bool:
    return (one["bytes"], one["airtime_s"]) == (other["bytes"], other["airtime_s"])


def test_both_ends_tell_the_same_frames() -> None:
    """What one has sent the other has heard: the same bytes, streams and airtime, in order."""

    async def main() -> None:
        async with AsyncExitStack() as stack:
            sea = Channel(profile="evologics_s2c_18_34", time_scale=100.0)
            a = await stack.enter_async_context(local_network(1, sea, section=LARGE))
            b = await stack.enter_async_context(local_network(2, sea, section=LARGE))
            shore, auv = (stack.enter_context(each.client()) for each in (a, b))
            await matched(shore, "photo")
            heard = await hear(auv, "photo")
            shore.put("photo", bytes(500))
            await heard.next()
            here, there = await document(shore, 1), await document(auv, 2)
            came = [each for each in there["last"] if each["way"] == "in"]
            went = [each for each in here["last"] if each["way"] == "out"]
            if here["transmitting"] is not None:
                went.append(here["transmitting"])
            left = iter(went)
            for heard_frame in came:  # each is one of those that were sent, in their order
                sent_frame = next(each for each in left if alike(heard_frame, each))
                assert sent_frame["airtime_s"] > 0
                # Of an object's first fragments the receiver does not know yet what they are.
                assert heard_frame["streams"] in (sent_frame["streams"], [])
            assert ["photo"] in [each["streams"] for each in came]
            assert came
            assert {each["outcome"] for each in came} == {""}
            assert {each["outcome"] for each in here["last"] if each["way"] == "out"} <= {
                "sent", "delivered"}  # fmt: skip
            instants = [each["begun_unix_s"] for each in went]
            assert instants == sorted(instants)

    run(main())


def test_the_frame_under_way_is_told_and_the_past_is_bounded() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            sea = Channel(profile="evologics_s2c_18_34", time_scale=20.0)
            a = await stack.enter_async_context(local_network(1, sea, section=LARGE))
            b = await stack.enter_async_context(local_network(2, sea, section=LARGE))
            shore, auv = (stack.enter_context(each.client()) for each in (a, b))
            await matched(shore, "photo")
            heard = await hear(auv, "photo")
            shore.put("photo", bytes(range(256)) * 8)
            under_way = []
            while not heard.samples:
                found = await document(shore, 1)
                assert len(found["last"]) <= KEPT
                if found["transmitting"] is not None:
                    under_way.append(found["transmitting"])
            assert under_way
            assert {each["way"] for each in under_way} == {"out"}
            assert ["photo"] in [each["streams"] for each in under_way]
            assert len(found["last"]) == KEPT

    run(main())
