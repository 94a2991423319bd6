"""Reliable topics through gateways: what is put on one network is put on the other, in order."""

import json
from contextlib import AsyncExitStack
from typing import Any

from tests.gateway.networks import SECTION, Channel, get, hear, local_network, matched, run

ORDERS: dict[str, Any] = {
    "id": 30,
    "topic": "orders",
    "publishers": [1],
    "subscribers": [2],
    "reliability": "reliable",
    "depth": 8,
}
RELIABLE = SECTION | {"streams": [*SECTION["streams"], ORDERS]}


def test_samples_cross_reliably_and_their_outcomes_are_counted() -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel = Channel()
            a = await stack.enter_async_context(local_network(1, channel, section=RELIABLE))
            b = await stack.enter_async_context(local_network(2, channel, section=RELIABLE))
            shore, auv = (stack.enter_context(each.client()) for each in (a, b))
            await matched(shore, "orders")
            heard = await hear(auv, "orders")
            for number in range(8):
                shore.put("orders", b"%d" % number)
            assert [await heard.payload() for _ in range(8)] == [b"%d" % n for n in range(8)]
            stream = await health(shore)
            while stream["delivered"] < 8:  # an answer each time: the acknowledgement is on its way
                stream = await health(shore)
            assert {key: stream[key] for key in ("superseded", "expired", "delivering")} == {
                "superseded": 0,
                "expired": 0,
                "delivering": 0,
            }

    async def health(client: Any) -> dict[str, Any]:
        replies = await get(client, "@acoustic/1/streams")
        document = json.loads(replies.payload("@acoustic/1/streams"))
        plain = next(each for each in document["streams"] if each["id"] == 12)
        assert "delivered" not in plain
        return next(each for each in document["streams"] if each["id"] == 30)

    run(main())
