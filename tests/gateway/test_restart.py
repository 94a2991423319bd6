"""A gateway that restarts: what waits for it is delivered to programs that reconnect to it."""

from contextlib import AsyncExitStack
from pathlib import Path

import pytest

from tests.gateway.networks import (
    Channel,
    LocalNetwork,
    config_of,
    free_port,
    hear,
    local_network,
    matched,
    run,
    zenoh_config,
)
from tests.gateway.test_reliable import RELIABLE
from zacoustic.gateway import Gateway
from zacoustic.zenoh.gateway.streams import matching


def restarting(found: LocalNetwork, channel: Channel, folder: Path) -> Gateway:
    config = config_of(2, zenoh_config("router", listen=found.port), RELIABLE)
    link = channel.medium.link(2)
    return Gateway(config, link=link, journal=folder, notify=found.notify)


def test_a_program_that_reconnects_gets_what_came_before_it(tmp_path: Path) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            channel, auv = Channel(), LocalNetwork(free_port())
            shore = await stack.enter_async_context(local_network(1, channel, section=RELIABLE))
            publisher = stack.enter_context(shore.client())
            await matched(publisher, "orders")
            async with restarting(auv, channel, tmp_path):
                program = stack.enter_context(auv.client())
                heard = await hear(program, "orders")
                publisher.put("orders", b"before")
                assert await heard.payload() == b"before"
            for number in range(3):
                publisher.put("orders", b"%d" % number)
            async with restarting(auv, channel, tmp_path):
                assert [await heard.payload() for _ in range(3)] == [b"0", b"1", b"2"]

    run(main())


def test_a_restart_without_programs_ends_its_wait(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(matching, "RETURN_S", 0.1)
    caplog.set_level("INFO")

    async def main() -> None:
        for _ in range(2):
            channel, auv = Channel(), LocalNetwork(free_port())
            async with restarting(auv, channel, tmp_path):
                assert auv.told("started")

    run(main())
    lines = [each.message for each in caplog.records if "nobody here subscribes" in each.message]
    assert lines == ["restarted, and nobody here subscribes to orders"]
