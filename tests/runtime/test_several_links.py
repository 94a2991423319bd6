"""A runner with two links: sound of a simulated medium, and datagrams."""

import asyncio
import json
import logging
import random
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import pytest

from tests.links.udp_pair import locators
from tests.runtime.loop_checks import run
from tests.runtime.test_runtime import ScriptedLink
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, LinkStateChanged, SampleReceived
from zacoustic.core.linktypes import LinkCapabilities, LinkState, ModemRead
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.schedule.linkseal import SealRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link import Link, LinkReceiver, registry
from zacoustic.run.clocks import NodeClocks
from zacoustic.run.hostclock import HostClock
from zacoustic.run.permitlog import PermitLog
from zacoustic.run.runner import LinkRunner
from zacoustic.seal.ccm import FleetCipher
from zacoustic.seal.keys import new_key
from zacoustic_sim.medium import SimMedium

RULES = TransmitRules(
    links=(LinkRules(name="sound"), LinkRules(name="radio")), links_of_streams={2: "radio"}
)


def table() -> StreamTable:
    reliable = Qos(reliability=Reliability.RELIABLE, depth=9)
    return StreamTable(
        [
            TopicSpec(stream_id=each, name=name, qos=reliable)
            for each, name in ((1, "sound"), (2, "radio"))
        ],
        nodes={1: "near", 2: "far"},
    )


def two_nodes() -> SimMedium:
    nodes = tuple(NodeSpec(address=n, position=(100.0 * n, 0.0, 20.0)) for n in (1, 2))
    return SimMedium(Scenario(nodes=nodes, channel="none"), time_scale=50.0)


class Absent(ScriptedLink):
    """Cannot be opened, some times."""

    def __init__(self, *failures: Exception) -> None:
        super().__init__()
        self.failures = list(failures)
        self.attempts = 0

    async def open(self, receiver: LinkReceiver) -> None:
        self.attempts += 1
        receiver.state_changed(LinkState.OPENING, f"attempt {self.attempts}")
        if self.failures:
            raise self.failures.pop(0)
        await super().open(receiver)


def publish(stream_id: int, value: bytes, engine: Engine, now: int) -> int:
    return engine.publish(stream_id, value, now)


class Side:
    """A runner with both links, and what it has told."""

    def __init__(
        self,
        address: int,
        medium: SimMedium,
        radio: Link,
        *,
        pads: tuple[int, ...] = (),
        **more: Any,
    ) -> None:
        engine = Engine(
            address=address,
            table=table(),
            epoch=address,
            rng=random.Random(1),
            rules=msgspec.structs.replace(RULES, sealing=SealRules(pad_bytes=pads)),
            cipher=FleetCipher(new_key("test")) if pads else None,
        )
        self.runner = LinkRunner(engine, medium.link(address), beside={"radio": radio}, **more)
        self.events: list[Event] = []
        self.changed = asyncio.Event()

    async def start(self) -> None:
        await self.runner.start(self.take)

    def take(self, event: Event) -> None:
        self.events.append(event)
        self.changed.set()

    async def got(self, stream_id: int) -> Any:
        def samples() -> list[Any]:
            return [
                event.value
                for event in self.events
                if isinstance(event, SampleReceived) and event.stream_id == stream_id
            ]

        await self.until(lambda: bool(samples()))
        return samples()[0]

    async def up(self, *links: str) -> None:
        """Wait until these links are up."""
        await self.until(lambda: {name for name, state in self.states() if state} >= {*links})

    def states(self) -> list[tuple[str, bool]]:
        """Return which link went up or down, in order."""
        return [
            (each.link, each.state is LinkState.UP)
            for each in self.events
            if isinstance(each, LinkStateChanged)
        ]

    async def until(self, holds: Callable[[], bool]) -> None:
        while not holds():
            self.changed.clear()
            await self.changed.wait()


def test_runner_drives_an_engine_on_two_links() -> None:
    async def scenario() -> None:
        medium = two_nodes()
        radios = locators(settings="&latency_s=0.01")
        near, far = (
            Side(n, medium, registry.create(radio, n))
            for n, radio in zip((1, 2), radios, strict=True)
        )
        await near.start()
        await far.start()
        await near.up("sound", "radio")
        for stream_id, value in ((1, b"by sound"), (2, b"by radio")):
            near.runner.apply(partial(publish, stream_id, value))
            assert await far.got(stream_id) == value
        for name, stream_id in (("sound", 1), ("radio", 2)):
            ledger = near.runner.engine.stats.links[name].ledger()
            assert {entry.stream_id for entry in ledger} <= {0, stream_id}
            assert stream_id in {entry.stream_id for entry in ledger}
        assert far.runner.side("radio").link.diagnostics()["received"] != 0
        assert near.runner.link is near.runner.side("sound").link
        await near.runner.close()
        await far.runner.close()
        medium.close()

    run(scenario(), limit_s=30.0)


def test_further_link_that_cannot_be_opened_is_told_and_opened_later(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    async def scenario() -> None:
        monkeypatch.setattr("zacoustic.run.linkside.FIRST_DELAY_S", 1e-3)
        medium = two_nodes()
        reasons = ("no such port", "no such port", "no such port", "the port is in use")
        radio = Absent(*map(LinkOpenError, reasons))
        side = Side(1, medium, radio)
        await side.start()
        side.runner.apply(partial(publish, 2, b"waits for the radio"))
        assert not side.states().count(("radio", True))
        await side.up("sound", "radio")
        assert (radio.attempts, radio.closed) == (5, 4)
        assert side.runner.side("radio").detail == "scripted"
        await side.until(lambda: bool(radio.sent))
        await side.runner.close()
        assert radio.closed == 5
        medium.close()

    with caplog.at_level(logging.WARNING):
        run(scenario(), limit_s=30.0)
    assert [each.getMessage() for each in caplog.records] == [
        "node 1: radio down: no such port",
        "node 1: radio down: the port is in use",
    ]


def test_link_that_opens_and_still_waits_is_shown_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    class Waiting(Absent):
        async def open(self, receiver: LinkReceiver) -> None:
            if self.failures:
                raise self.failures.pop(0)
            receiver.state_changed(LinkState.OPENING, "waits for the modem")
            self.is_open.set()

        def __init__(self, *failures: Exception) -> None:
            super().__init__(*failures)
            self.is_open = asyncio.Event()

    async def scenario() -> None:
        monkeypatch.setattr("zacoustic.run.linkside.FIRST_DELAY_S", 1e-3)
        medium, radio = two_nodes(), Waiting(LinkOpenError("no such port"))
        side = Side(1, medium, radio)
        await side.start()
        seen = side.runner.side("radio")
        await radio.is_open.wait()
        await side.until(lambda: seen.state is LinkState.OPENING)
        assert seen.detail == "waits for the modem"
        await side.runner.close()
        medium.close()

    run(scenario(), limit_s=30.0)


def test_close_ends_the_attempts_to_open_a_further_link() -> None:
    class Slow(Absent):
        async def open(self, receiver: LinkReceiver) -> None:
            self.attempts += 1
            await asyncio.Event().wait()

    async def scenario() -> None:
        medium = two_nodes()
        for radio in (Slow(), Absent(LinkOpenError("no such port"))):
            side = Side(1, medium, radio)
            await side.start()
            await side.runner.close()
            assert (radio.attempts, radio.closed > 0) == (1, True)
        medium.close()

    run(scenario(), limit_s=30.0)  # no task is left


def test_first_link_that_cannot_be_opened_ends_the_attempts_of_the_others() -> None:
    async def scenario() -> None:
        engine = Engine(address=1, table=table(), epoch=1, rng=random.Random(1), rules=RULES)
        first, radio = ScriptedLink(opens=False), Absent(LinkOpenError("no such port"))
        runner = LinkRunner(engine, first, beside={"radio": radio})
        with pytest.raises(LinkOpenError, match="the port is in use"):
            await runner.start()
        assert (first.closed, radio.closed > 0) == (1, True)

    run(scenario(), limit_s=30.0)  # no task is left


class Sized(ScriptedLink):
    """Comes up with frames of some length; shorter ones than any link may have are refused."""

    def __init__(self, mtu_bytes: int) -> None:
        super().__init__()
        self.mtu_bytes = mtu_bytes

    async def open(self, receiver: LinkReceiver) -> None:
        self.receiver = receiver
        self.come_up()

    def come_up(self) -> None:
        assert self.receiver is not None
        self.capabilities = LinkCapabilities(mtu_bytes=self.mtu_bytes, bit_rate_bps=1e6)
        self.receiver.state_changed(LinkState.UP, "scripted")


@pytest.mark.parametrize(
    ("mtu_bytes", "pads", "why"),
    [
        (7, (), "mtu_bytes is 7; allowed: at least 8"),
        (
            16,
            (32, 64),
            "security: this link has room for sealed frames of 16 bytes; allowed: at least",
        ),
        (63, (32, 64), "security.pad: 64; this link has room for sealed frames of 63 bytes;"),
    ],
)
def test_a_link_whose_frames_are_too_short_is_down_and_the_others_go_on(
    mtu_bytes: int,
    pads: tuple[int, ...],
    why: str,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def scenario() -> None:
        monkeypatch.setattr("zacoustic.run.linkside.FIRST_DELAY_S", 1e-3)
        medium, radio = two_nodes(), Sized(mtu_bytes)
        side = Side(1, medium, radio, pads=pads)
        seen = side.runner.side("radio")
        await side.start()
        await side.up("sound")
        await side.until(lambda: seen.state is LinkState.DOWN)
        assert why in seen.detail
        side.runner.apply(partial(publish, 1, b"by sound"))
        side.runner.apply(partial(publish, 2, b"by radio"))
        assert not side.states().count(("radio", True))
        assert radio.sent == []
        radio.mtu_bytes = 64
        if pads:  # the modem was set up anew
            radio.come_up()
        await side.up("radio")
        await side.until(lambda: bool(radio.sent))
        assert {len(each.frame_bytes) for each in radio.sent} <= ({*pads} or {*range(65)})
        radio.mtu_bytes = mtu_bytes
        if pads:
            radio.come_up()
            assert (seen.state, side.states()[-1]) == (LinkState.DOWN, ("radio", False))
        assert side.runner.failure is None
        await side.runner.close()
        medium.close()

    with caplog.at_level(logging.WARNING):
        run(scenario(), limit_s=30.0)
    assert why in caplog.records[0].getMessage()


def test_a_first_link_whose_frames_are_too_short_ends_the_start_and_later_goes_down() -> None:
    async def scenario() -> None:
        engine = partial(
            Engine,
            address=1,
            table=table(),
            epoch=1,
            rng=random.Random(1),
            rules=TransmitRules(sealing=SealRules(pad_bytes=(64,))),
            cipher=FleetCipher(new_key("test")),
        )
        runner = LinkRunner(engine(), Sized(63))
        with pytest.raises(ConfigError, match=r"security\.pad: 64; .* allowed: lengths up to that"):
            await runner.start()
        link = Sized(64)
        runner = LinkRunner(engine(), link)
        await runner.start()
        link.mtu_bytes = 63
        link.come_up()
        assert (runner.link_state, runner.failure) == (LinkState.DOWN, None)
        assert "security.pad: 64" in runner.link_detail
        await runner.close()

    run(scenario(), limit_s=30.0)


def test_fault_of_a_further_link_stops_the_runner() -> None:
    async def scenario() -> None:
        medium = two_nodes()
        side = Side(1, medium, Absent(LinkOpenError("no such port"), RuntimeError("a bug")))
        await side.start()
        with pytest.raises(RuntimeError, match="a bug"):
            await side.runner.wait_failed()
        await side.runner.close()
        medium.close()

    run(scenario(), limit_s=30.0)


def test_permit_log_names_the_link_and_has_the_level_of_its_modem(tmp_path: Path) -> None:
    async def scenario() -> None:
        medium = two_nodes()
        path = tmp_path / "permits"
        clocks = NodeClocks(host=HostClock())
        side = Side(1, medium, Absent(), permit_log=PermitLog(path), clocks=clocks)
        await side.start()
        await side.up("sound", "radio")
        first = side.runner.side("sound")
        first.measured(ModemRead(read_at=1, source_level_db=184.0))
        for stream_id in (1, 2):
            side.runner.apply(partial(publish, stream_id, b"x"))
        reports = side.runner.engine.stats.links
        await side.until(lambda: all(each.reports for each in reports.values()))
        await side.runner.close()
        medium.close()
        lines = [json.loads(each) for each in path.read_text().splitlines()]
        assert {(each["link"], each["source_level_db"]) for each in lines} == {
            ("sound", 184.0),
            ("radio", None),
        }

    run(scenario(), limit_s=30.0)
