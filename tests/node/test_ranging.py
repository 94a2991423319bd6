"""`Node.range` and the schedule of the configuration, on simulated water."""

import asyncio
import time
from typing import Any

import pytest

from tests.node.fleet import (
    SECTION,
    TIME_SCALE,
    ChannelServer,
    channel,
    config,
    router,
    run_on_zenoh,
)
from tests.runtime.loop_checks import run
from zacoustic import CallTimeoutError, LinkClosedError, LocalError, Node, Range, blocking
from zacoustic.config import Config, config_from_mapping
from zacoustic.core.linktypes import LinkMetrics, ModemRead, PeerMeasured
from zacoustic.errors import ConfigError, RangeUnavailableError
from zacoustic_sim.link import SimConfig
from zacoustic_sim.medium import SimMedium

ASKS = SimConfig(acknowledges=True)


def scheduled(*entries: dict[str, Any]) -> Config:
    return config_from_mapping(SECTION | {"ranging": list(entries)}, source="fleet.json5")


def shore(medium: SimMedium, known: Config | None = None) -> Node:
    return Node("shore", config=known or config(), link=medium.link(1, ASKS))


def test_range_of_a_node_by_address_and_by_name() -> None:
    async def main() -> None:
        with channel() as medium:
            async with (
                shore(medium) as near,
                Node("auv1", config=config(), link=medium.link(2, ASKS)),
                Node("auv2", config=config(), link=medium.link(3)),
            ):
                found = await near.range(2)
                assert isinstance(found, Range)
                assert (found.address, found.range_m) == (2, 500.0)
                assert found.propagation_s == pytest.approx(500 / 1500 / TIME_SCALE)
                assert 0 <= found.age_s(time.monotonic_ns()) < 1
                both = await asyncio.gather(near.range("auv1"), near.range("auv2"))
                assert [each.range_m for each in both] == [500.0, 1000.0]

    run(main())


def test_node_that_is_not_there_times_out_and_the_next_range_is_measured() -> None:
    async def main() -> None:
        with channel() as medium:
            async with (
                shore(medium) as near,
                Node("auv1", config=config(), link=medium.link(2, ASKS)),
            ):
                with pytest.raises(CallTimeoutError) as caught:
                    await near.range("auv2", timeout_s=0.2)
                assert str(caught.value) == (
                    "range to node 3: TIMED_OUT: no range within 0.2 s: not delivered"
                )
                assert (await near.range(2)).range_m == 500.0

    run(main())


@pytest.mark.parametrize(
    ("peer", "error", "message"),
    [
        (1, LocalError, "node 1 is this node"),
        (9, LocalError, "node 9 is not known; allowed: 1 (shore), 2 (auv1), 3 (auv2)"),
        ("nemo", ConfigError, 'no node is called "nemo"; allowed: shore, auv1, auv2'),
    ],
)
def test_wrong_peer_is_a_clear_error(peer: int | str, error: type[Exception], message: str) -> None:
    async def main() -> None:
        with channel() as medium:
            async with shore(medium) as near:
                with pytest.raises(error) as caught:
                    await near.range(peer)
                assert message in str(caught.value)

    run(main())


def test_link_that_measures_no_ranges_says_so_at_once() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node("shore", config=config(), link=medium.link(1)) as near:
                with pytest.raises(RangeUnavailableError, match="this link measures no ranges"):
                    await near.range(2)
            with pytest.raises(RangeUnavailableError, match="this link measures no ranges"):
                await Node(
                    "shore",
                    config=scheduled({"to": 2, "every_s": 5}),
                    link=medium.link(1),
                ).open()

    run(main())


def test_name_without_a_config_and_node_that_is_closed_are_errors() -> None:
    async def main() -> None:
        with channel() as medium:
            near = Node(1, link=medium.link(1, ASKS))
            with pytest.raises(LocalError, match="not open"):
                await near.range(2)
            async with near:
                with pytest.raises(LocalError, match='no node is called "auv1"'):
                    await near.range("auv1")
                waiting = asyncio.ensure_future(near.range(2, timeout_s=60))
                await asyncio.sleep(0)
            with pytest.raises(LinkClosedError, match="closed"):
                await waiting

    run(main())


def test_range_that_is_cancelled_is_not_measured_any_more() -> None:
    async def main() -> None:
        with channel() as medium:
            async with shore(medium) as near:
                waiting = asyncio.ensure_future(near.range(3, timeout_s=60))
                await asyncio.sleep(0)
                waiting.cancel()
                with pytest.raises(asyncio.CancelledError):
                    await waiting
                await near.flush(timeout_s=5)

    run(main())


def test_schedule_of_the_config_makes_events() -> None:
    async def main() -> None:
        with channel() as medium:
            known = scheduled({"to": 2, "every_s": 1}, {"by": 3, "to": 1, "every_s": 1})
            async with (
                shore(medium, known) as near,
                Node("auv1", config=config(), link=medium.link(2, ASKS)),
            ):
                async for event in near.events():
                    if isinstance(event, PeerMeasured):
                        assert (event.address, event.metrics.range_m) == (2, 500.0)
                        break

    run(main())


def test_what_the_link_measures_of_its_own_accord_is_an_event() -> None:
    async def main() -> None:
        with channel() as medium:
            link = medium.link(1, ASKS)
            async with Node("shore", config=config(), link=link) as near:
                receiver = link._receiver
                assert receiver is not None
                fix = LinkMetrics(east_m=3.0, north_m=4.0, up_m=0.0, accuracy_m=0.1)
                receiver.measured(PeerMeasured(address=2, measured_at=1, metrics=fix))
                receiver.measured(ModemRead(read_at=2, battery_v=24.0))
                told: list[object] = []
                async for event in near.events():
                    if isinstance(event, PeerMeasured | ModemRead):
                        told.append(event)
                    if len(told) == 2:
                        break
                assert told == [
                    PeerMeasured(address=2, measured_at=1, metrics=fix),
                    ModemRead(read_at=2, battery_v=24.0),
                ]

    run(main())


def test_blocking_node_waits_for_the_range() -> None:
    with (
        ChannelServer() as locator,
        blocking.Node("shore", config=config(), link=f"{locator}#acknowledges=true") as near,
        blocking.Node("auv1", config=config(), link=locator),
    ):
        assert near.range("auv1").range_m == 500.0
        with pytest.raises(CallTimeoutError, match="TIMED_OUT"):
            near.range(3, timeout_s=0.1)


def test_on_zenoh_the_ranges_are_the_gateways() -> None:
    async def main() -> None:
        with router() as (endpoint, _):
            async with Node("shore", config=config(), connect=endpoint) as near:
                with pytest.raises(RangeUnavailableError) as caught:
                    await near.range("auv1")
                assert "the modem is the gateway's" in str(caught.value)
                assert "get @acoustic/*/peer/2/range" in str(caught.value)

    run_on_zenoh(main())
