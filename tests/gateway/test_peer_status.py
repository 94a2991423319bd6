"""What the modem measured, on the local network: keys, dates, schedule, errors."""

import json
import random
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from tests.gateway.networks import (
    SECTION,
    Channel,
    Heard,
    LocalNetwork,
    config_of,
    free_port,
    get,
    hear,
    run,
    until,
    zenoh_config,
)
from zacoustic.core.base.linktypes import ONE_LINK, LinkMetrics, ModemRead, PeerMeasured
from zacoustic.core.base.timers import Timers
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.peers.contact import Contact, ContactRules
from zacoustic.core.peers.measurements import Measurements
from zacoustic.core.peers.peers import Peers
from zacoustic.core.peers.ranging import RangeFailed, RangeFailure
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import RangeUnavailableError
from zacoustic.gateway import Gateway
from zacoustic.zenoh.gateway.events.said import said
from zacoustic.zenoh.gateway.status.peer_status import PeerStatus
from zacoustic_sim.link import SimConfig, SimLink

ASKS = SimConfig(acknowledges=True)
RANGES = SECTION | {"ranging": [{"by": 1, "to": 2, "every_s": 1}]}


@asynccontextmanager
async def network_on(
    link: SimLink, address: int, section: dict[str, Any] | None = None
) -> AsyncIterator[LocalNetwork]:
    found = LocalNetwork(free_port())
    config = config_of(address, zenoh_config("router", listen=found.port), section)
    async with Gateway(config, link=link, notify=found.notify):
        yield found


async def document(heard: Heard, key: str) -> dict[str, Any]:
    """Wait for a document."""
    while True:
        sample = await heard.next()
        if str(sample.key_expr) == key:
            found: dict[str, Any] = json.loads(sample.payload.to_bytes())
            return found


def test_scheduled_range_is_put_and_answered_under_its_key() -> None:
    async def main() -> None:
        channel = Channel()
        async with (
            network_on(channel.medium.link(1, ASKS), 1, RANGES) as shore,
            network_on(channel.medium.link(2, ASKS), 2, RANGES),
        ):
            with shore.client() as client:
                heard = await hear(client, "@acoustic/1/**")
                found = await document(heard, "@acoustic/1/peer/2/range")
                assert found["range_m"] == 1.0
                assert found["propagation_s"] == pytest.approx(1 / 1500)
                assert found["measured_at_unix_s"] > 1.6e9
                key = "@acoustic/1/peer/2/range"
                replies = await get(client, "@acoustic/1/peer/*/range")
                assert set(replies.good) == {key}
                peers = json.loads((await get(client, "@acoustic/1/peers")).payload(
                    "@acoustic/1/peers"))  # fmt: skip
                assert peers["2"]["metrics"]["range_m"] == 1.0

    run(main())


def test_fixes_and_readings_are_put_as_they_come_and_metrics_come_from_all_of_them() -> None:
    async def main() -> None:
        channel = Channel()
        link = channel.medium.link(1)
        async with network_on(link, 1) as shore:
            with shore.client() as client:
                heard = await hear(client, "@acoustic/1/**")
                receiver = link._receiver
                assert receiver is not None
                fix = LinkMetrics(east_m=30.0, north_m=40.0, up_m=-5.0, accuracy_m=0.4)
                bearing = LinkMetrics(bearing_rad=0.64, elevation_rad=-0.1, integrity=140.0)
                now = channel.medium.clock()
                for metrics in (fix, bearing):
                    receiver.measured(PeerMeasured(address=2, measured_at=now, metrics=metrics))
                receiver.measured(ModemRead(read_at=now, firmware="1.9", battery_v=24.1))
                position = await document(heard, "@acoustic/1/peer/2/position")
                del position["measured_at_unix_s"]
                assert position == {"east_m": 30.0, "north_m": 40.0, "up_m": -5.0,
                                    "accuracy_m": 0.4}  # fmt: skip
                found = (await get(client, "@acoustic/1/**")).good
                told = {
                    key.removeprefix("@acoustic/1/"): json.loads(sample.payload.to_bytes())
                    for key, sample in found.items()
                }
                assert told["peer/2/direction"]["bearing_rad"] == 0.64
                assert "peer/2/range" not in told
                assert (told["modem"]["firmware"], told["modem"]["battery_v"]) == ("1.9", 24.1)
                metrics_of_2 = told["peers"]["2"]["metrics"]
                assert (metrics_of_2["east_m"], metrics_of_2["integrity"]) == (30.0, 140.0)

    run(main())


def test_measurements_are_those_of_the_engine_that_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    """An engine that raises is replaced by the next one, and its report with it."""

    def fail(*_: object) -> None:
        raise ValueError("a bug")

    async def main() -> None:
        channel = Channel()
        link = channel.medium.link(1)
        async with network_on(link, 1) as shore:
            with shore.client() as client:
                heard = await hear(client, "@acoustic/1/modem")
                receiver = link._receiver
                assert receiver is not None
                with monkeypatch.context() as broken:
                    broken.setattr(Engine, "handle_carrier", fail)
                    receiver.carrier_changed(True)
                await until(
                    lambda: shore.told("internal_error"),
                    shore.changed,
                )
                now = channel.medium.clock()
                receiver.measured(ModemRead(read_at=now, firmware="1.9"))
                modem = await document(heard, "@acoustic/1/modem")
                assert modem["firmware"] == "1.9"

    run(main())


def test_gateway_whose_link_measures_no_ranges_does_not_start_with_a_schedule() -> None:
    async def main() -> None:
        channel = Channel()
        config = config_of(1, zenoh_config("router", listen=free_port()), RANGES)
        with pytest.raises(RangeUnavailableError, match="this link measures no ranges"):
            await Gateway(config, link=channel.medium.link(1)).start()
        config = config_of(2, zenoh_config("router", listen=free_port()), RANGES)
        async with Gateway(config, link=channel.medium.link(2)):
            pass  # the schedule is not its own

    run(main())


def test_notice_about_a_range_is_one_line() -> None:
    event = RangeFailed(
        range_id=None,
        address=2,
        failure=RangeFailure.UNAVAILABLE,
        text="this link measures no ranges",
    )
    context: Any = None
    notice = said(event, context)
    assert notice is not None
    assert notice.lines() == ["ranging   node 2: this link measures no ranges"]


def test_instant_is_told_once_by_the_clock_of_people_and_stays_the_same() -> None:
    now, unix_s = 100 * NS_PER_S, 1000.0
    known, peers = Measurements(Peers()), Peers()
    rules = ContactRules(lost_after_s={3: 50})
    timers = Timers()
    contact = Contact(1, rules, peers, timers, lambda event: None)
    engine = Engine(address=1, table=StreamTable(), epoch=1, rng=random.Random(1))
    knows = SimpleNamespace(
        measurements=known,
        contact=contact,
        deadlines=engine.deadlines,
        address=1,
        links=engine.links,
    )
    runner: Any = SimpleNamespace(engine=knows)
    peer_status = PeerStatus(runner, clock=lambda: now, unix_s=lambda: unix_s)

    def told() -> dict[str, Any]:
        found: dict[str, Any] = msgspec.to_builtins(peer_status.documents())
        return found

    assert told() == {}
    delay = LinkMetrics(propagation_s=0.5)
    known.handle(PeerMeasured(address=2, measured_at=97 * NS_PER_S, metrics=delay), ONE_LINK)
    before = told()
    assert before == {
        "peer/2/range": {
            "propagation_s": 0.5,
            "range_m": None,
            "integrity": None,
            "measured_at_unix_s": 997.0,
        }
    }
    now, unix_s = 200 * NS_PER_S, 1100.4
    assert told() == before
    known.handle(PeerMeasured(address=2, measured_at=now, metrics=delay), ONE_LINK)
    after = told()["peer/2/range"]
    assert after["measured_at_unix_s"] == 1100.4
    contact.begin(190 * NS_PER_S)
    key = "peer/3/lost"
    here = {"lost": False, "since_unix_s": 1090.4, "heard_at_unix_s": None}
    assert told()[key] == here
    contact.heard(3, 195 * NS_PER_S)
    assert told()[key] == here
    now, unix_s = 250 * NS_PER_S, 1150.4
    timers.fire(now)
    gone = {"lost": True, "since_unix_s": 1150.4, "heard_at_unix_s": 1095.4}
    assert told()[key] == gone
