"""Orders from a program: on a link, on Zenoh, without asyncio; to others and to oneself."""

import asyncio
from pathlib import Path

import pytest

from tests.node.fleet import ChannelServer, channel, config, run_on_zenoh
from tests.node.test_across import three_nodes
from tests.runtime.loop_checks import run
from zacoustic import (
    CallTimeoutError,
    CommandKind,
    ConfigError,
    DeliveryError,
    LinkClosedError,
    LocalError,
    Node,
    Priority,
    RemoteCommand,
    ServiceError,
    blocking,
)
from zacoustic.core.engine.events import SilenceChanged, StreamOverridden
from zacoustic.core.wire.routing import RoutingKind, RoutingRequest

SILENCE = RemoteCommand(kind=CommandKind.SILENCE, for_s=1800.0)
RESUME = RemoteCommand(kind=CommandKind.RESUME)
OFF = RemoteCommand(kind=CommandKind.OVERRIDE, stream_id=11, on=False, min_interval_s=5.0)


def test_node_is_silenced_and_resumed_and_hears_of_it() -> None:
    async def main() -> None:
        with channel() as medium:
            async with (
                Node("shore", config=config(), link=medium.link(1)) as shore,
                Node("auv1", config=config(), link=medium.link(2)) as auv,
            ):
                found = await shore.command("auv1", SILENCE)
                assert (found.silent, found.commanded) == (True, True)
                assert found.left_s == pytest.approx(1800, abs=60)
                assert not (await shore.command(2, RESUME)).silent
                changes = []
                async for event in auv.events():
                    if isinstance(event, SilenceChanged):
                        changes.append(event.is_silent)
                        if not event.is_silent:
                            break
                # For ten minutes first, and for its time when the shore has heard the vehicle.
                assert changes == [True, True, False]

    run(main())


def test_topic_is_overridden_at_a_remote_node_and_here(tmp_path: Path) -> None:
    async def main() -> None:
        with channel() as medium:
            async with (
                Node("shore", config=config(), link=medium.link(1)) as shore,
                Node("auv1", config=config(), link=medium.link(2), journal=tmp_path) as auv,
            ):
                found = await shore.command("auv1", OFF)
                assert (found.on, found.min_interval_s, found.priority) == (
                    False, 5.0, Priority.DATA,
                )  # fmt: skip
                assert await auv.command("auv1", RemoteCommand(stream_id=11)) == found
                assert (
                    await auv.command(2, RemoteCommand(kind=CommandKind.RESET, stream_id=11))
                ).on
                overridden = []
                async for event in auv.events():
                    if isinstance(event, StreamOverridden):
                        overridden.append((event.on, event.commanded_by))
                        if len(overridden) == 2:
                            break
                assert overridden == [(False, 1), (True, 0)]

    run(main())


def test_command_that_is_refused_raises_with_the_reason() -> None:
    async def main() -> None:
        with channel() as medium:
            async with (
                Node("shore", config=config(), link=medium.link(1)) as shore,
                Node("auv1", config=config(), link=medium.link(2)),
            ):
                with pytest.raises(ServiceError, match="refused by node 2: node 2 has no"):
                    await shore.command(2, RemoteCommand(kind=CommandKind.RESET, stream_id=99))
                with pytest.raises(LocalError, match="stream 20 is no topic"):
                    await shore.command(1, RemoteCommand(stream_id=20))
                with pytest.raises(LocalError, match=r"node 300; allowed: 1\.\.254"):
                    await shore.command(300, RESUME)
                with pytest.raises(LocalError, match="timeout_s is 3600; allowed: at most 600"):
                    await shore.command(2, RESUME, timeout_s=3600)
                with pytest.raises(ConfigError, match='no node is called "boat"'):
                    await shore.command("boat", RESUME)
                with pytest.raises(
                    CallTimeoutError,
                    match="has not answered in time, and may have",
                ):
                    await shore.command(3, RESUME, timeout_s=0.1)

    run(main())


def test_command_under_way_fails_when_the_node_is_closed() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node("shore", config=config(), link=medium.link(1)) as shore:
                waits = asyncio.ensure_future(shore.command(3, SILENCE))
                await asyncio.sleep(0)
            with pytest.raises(LinkClosedError):
                await waits

    run(main())


def test_commands_from_zenoh_reach_all_nodes() -> None:
    async def main() -> None:
        async with three_nodes() as (shore, auv, _):
            found = await shore.command("auv2", SILENCE)
            assert (found.silent, found.commanded) == (True, True)
            assert found.left_s == pytest.approx(1800, abs=60)
            assert not (await auv.command("auv2", RESUME)).silent
            found = await shore.command("auv1", OFF)
            assert (found.on, found.min_interval_s, found.priority) == (False, 5.0, Priority.DATA)
            assert (
                await auv.command("auv1", RemoteCommand(kind=CommandKind.RESET, stream_id=11))
            ).on
            with pytest.raises(ServiceError, match="refused by node 2: node 2 has no"):
                await shore.command(2, RemoteCommand(stream_id=99))
            with pytest.raises(DeliveryError, match="does not publish stream 10"):
                await shore.command(1, RemoteCommand(stream_id=10))
            with pytest.raises(DeliveryError, match="no gateway that knows node 9 is on"):
                await shore.command(9, RESUME)

    run_on_zenoh(main())


def test_commands_about_routes_go_by_the_gateway_of_the_network() -> None:
    async def main() -> None:
        async with three_nodes() as (shore, auv, _):
            heard = RoutingRequest(kind=RoutingKind.HEARD)
            assert (await shore.routing(2, heard)).address == 2
            there = await auv.routing(1, heard)
            assert (there.address, there.heard) == (1, {})
            with pytest.raises(DeliveryError, match="no gateway that knows node 9 is on"):
                await shore.routing(9, heard)

    run_on_zenoh(main())


def test_commands_without_asyncio() -> None:
    with (
        ChannelServer() as locator,
        blocking.Node("shore", config=config(), link=locator) as shore,
        blocking.Node("auv1", config=config(), link=locator),
    ):
        assert shore.command("auv1", SILENCE).silent
        assert not shore.command("auv1", RESUME).silent
