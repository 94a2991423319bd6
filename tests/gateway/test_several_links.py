"""Gateways with sound and a radio: each stream goes by its link, and health has both."""

import json
import socket
from typing import Any

import pytest

from tests.gateway.networks import (
    SECTION,
    Channel,
    LocalNetwork,
    config_of,
    free_port,
    get,
    hear,
    local_network,
    matched,
    run,
    zenoh_config,
)
from tests.links.udp_pair import locators
from tests.runtime.loop_checks import until
from zacoustic.gateway import Gateway


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


def test_gateway_starts_without_its_radio_and_gets_it_later() -> None:
    async def scene() -> None:
        channel = Channel()
        near, _ = locators()
        host, _, port = near.removeprefix("udp/").partition("#")[0].rpartition(":")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as rival:
            rival.bind((host, int(port)))
            async with local_network(1, channel, section=section(near)) as shore:

                def said(state: str) -> list[str]:
                    facts = [each.facts for each in shore.told("link")]
                    return [
                        x["detail"] for x in facts if (x["link"], x["state"]) == ("radio", state)
                    ]

                await until(lambda: said("down"), shore.changed)
                assert "in use" in said("down")[0]
                with shore.client() as client:
                    replies = await get(client, "@acoustic/1/link/*")
                    radio = json.loads(replies.payload("@acoustic/1/link/radio"))
                    assert (radio["state"], radio["detail"]) == ("down", said("down")[0])
                    acoustic = json.loads(replies.payload("@acoustic/1/link/acoustic"))
                    assert acoustic["state"] == "up"
                rival.close()
                await until(lambda: said("up"), shore.changed)

    run(scene())


def test_metrics_have_each_link_by_its_name() -> None:
    pytest.importorskip("prometheus_client")
    from tests.gateway.test_metrics import scrape

    async def scene() -> None:
        channel = Channel()
        near, _ = locators()
        found = LocalNetwork(free_port())
        config = config_of(1, zenoh_config("router", listen=found.port), section(near))
        link = channel.medium.link(1)
        place = ("127.0.0.1", 0)
        async with Gateway(config, link=link, notify=found.notify, metrics=place):
            url = found.told("started")[0].facts["metrics"]
            values: dict[str, float] = {}
            while values.get("radio") != 1:
                values = {
                    dict(labels)["link"]: value
                    for (name, labels), value in (await scrape(url)).items()
                    if name == "zacoustic_link_up"
                }
            assert values == {"acoustic": 1, "radio": 1}
            names = {
                (name, dict(labels).get("link"))
                for name, labels in await scrape(url)
                if name in ("zacoustic_airtime_seconds_total", "zacoustic_frames_received_total")
            }
            assert len(names) == 4

    run(scene())
