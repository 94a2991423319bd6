"""What the tests of the watching verbs share: two gateways, verbs in threads of their own."""

import json
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from typing import Any

import pytest

from tests.gateway.networkpair import Pair
from tests.gateway.networks import (
    SECTION,
    STREAMS,
    Channel,
    LocalNetwork,
    config_of,
    free_port,
    matched,
    zenoh_config,
)
from zacoustic.gateway import Gateway
from zacoustic_sim.link import SimConfig

WATCHED: dict[str, Any] = SECTION | {
    "streams": [
        *STREAMS,
        {"id": 60, "topic": "auv1/photo", "publishers": [2], "subscribers": [1],
         "reliability": "reliable", "priority": "background"},
    ]
}  # fmt: skip
"""The section of the tests of gateways, with a topic for large samples."""


@asynccontextmanager
async def pair(
    *, acknowledges: bool = True, section: dict[str, Any] | None = None, **options: Any
) -> AsyncIterator[Pair]:
    """Run two local networks; `options` are those of the water."""
    async with AsyncExitStack() as stack:
        found = Pair()
        found.channel = Channel(**options)
        networks = []
        for address in (1, 2):
            place = LocalNetwork(free_port())
            config = config_of(
                address, zenoh_config("router", listen=place.port), section or WATCHED
            )
            link = found.channel.medium.link(address, SimConfig(acknowledges=acknowledges))
            await stack.enter_async_context(Gateway(config, link=link, notify=place.notify))
            networks.append(place)
        found.shore_network, found.auv_network = networks
        found.shore = stack.enter_context(found.shore_network.client())
        found.auv = stack.enter_context(found.auv_network.client())
        await matched(found.auv, "chat")
        yield found


def lines_of(capsys: pytest.CaptureFixture[str]) -> list[dict[str, Any]]:
    """Return what a verb has printed, one JSON object a line."""
    return [json.loads(line) for line in capsys.readouterr().out.splitlines()]
