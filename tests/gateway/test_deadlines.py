"""Deadlines on real Zenoh: what stops is counted, and is a key and a notice."""

import json
from functools import partial
from typing import Any

from tests.gateway.networks import (
    SECTION,
    Channel,
    get,
    hear,
    local_network,
    run,
    until,
)

STREAMS: list[dict[str, Any]] = [{"id": 12, "topic": "chat", "depth": 8, "deadline_s": 0.1}]
TIMED: dict[str, Any] = SECTION | {"streams": STREAMS}


def test_late_sample_is_a_key_and_a_notice_and_is_counted() -> None:
    async def scene() -> None:
        channel = Channel()
        async with (
            local_network(1, channel, section=TIMED) as shore,
            local_network(2, channel, section=TIMED) as auv,
        ):
            with shore.client() as client, auv.client() as vehicle:
                heard = await hear(client, "chat")
                vehicle.put("chat", b"here I am")
                await heard.next()
                for where, side in ((shore, "requested"), (auv, "offered")):
                    await until(partial(where.told, "late"), where.changed)
                    (notice,) = where.told("late")
                    facts = notice.facts
                    assert (facts["stream"], facts["address"], facts["side"]) == ("chat", 2, side)
                times = notice.facts["missed"]
                line = f"late      chat of node 2: not published in time ({times})"
                assert notice.lines() == [line]
                key = "@acoustic/1/peer/2/late"
                document = json.loads((await get(client, key)).payload(key))
                assert document["late"] == ["chat"]
                assert document["missed"]["chat"] >= 1
                for address, session in ((1, client), (2, vehicle)):
                    key = f"@acoustic/{address}/streams"
                    document = json.loads((await get(session, key)).payload(key))
                    (row,) = document["streams"]
                    assert row["deadline_missed"] >= 1

    run(scene())
