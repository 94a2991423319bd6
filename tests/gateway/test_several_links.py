"""Gateways with sound and a radio: each stream goes by its link, and health has both."""

import json
from typing import Any

from tests.gateway.networks import SECTION, Channel, get, hear, local_network, matched, run
from tests.links.udp_pair import locators


def section(radio: str) -> dict[str, Any]:
    links = [
        {"name": "acoustic", "locator": "sim/127.0.0.1:1"},
        {"name": "radio", "locator": radio},
    ]
    streams = [
        {**each, "link": "radio"} if each.get("topic") == "chat" else each
        for each in SECTION["streams"]
    ]
    return SECTION | {"links": links, "streams": streams}


def test_streams_cross_by_their_links_and_health_has_each() -> None:
    async def scene() -> None:
        channel = Channel()
        near, far = locators(settings="&latency_s=0.01")
        async with (
            local_network(1, channel, section=section(near)) as shore,
            local_network(2, channel, section=section(far)) as auv,
        ):
            with shore.client() as talker, auv.client() as listener:
                heard = await hear(listener, "chat")
                await matched(talker, "chat")
                talker.put("chat", b"by radio")
                assert await heard.payload() == b"by radio"
                documents = {
                    name: json.loads(
                        (await get(talker, f"@acoustic/1/{name}")).payload(f"@acoustic/1/{name}")
                    )
                    for name in ("link", "link/acoustic", "link/radio")
                }
        assert [each["state"] for each in documents.values()] == ["up"] * 3
        assert documents["link/radio"]["capabilities"]["mtu_bytes"] == 1200
        entries = documents["link/radio"]["ledger"]["entries"]
        assert "chat" in {each["stream"] for each in entries}
        acoustic = documents["link/acoustic"]["ledger"]["entries"]
        assert "chat" not in {each["stream"] for each in acoustic}
        sent = [each["bytes_transmitted"] for each in documents.values()]
        assert sent[0] >= sent[2] > 0
        assert documents["link"]["capabilities"] == documents["link/acoustic"]["capabilities"]

    run(scene())
