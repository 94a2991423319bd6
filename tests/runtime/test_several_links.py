"""A runner with two links: sound of a simulated medium, and datagrams."""

import asyncio
import random
from functools import partial
from typing import Any

from tests.links.udp_pair import locators
from tests.runtime.loop_checks import run
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, LinkStateChanged, SampleReceived
from zacoustic.core.linktypes import LinkState
from zacoustic.core.profiles.rules import LinkRules, TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.link import registry
from zacoustic.run.runner import LinkRunner
from zacoustic_sim.medium import SimMedium

RULES = TransmitRules(links=(LinkRules(name="sound"), LinkRules(name="radio")), routes={2: "radio"})


def table() -> StreamTable:
    reliable = Qos(reliability=Reliability.RELIABLE, depth=9)
    return StreamTable(
        [
            TopicSpec(stream_id=each, name=name, qos=reliable)
            for each, name in ((1, "sound"), (2, "radio"))
        ],
        nodes={1: "near", 2: "far"},
    )


def publish(stream_id: int, value: bytes, engine: Engine, now: int) -> int:
    return engine.publish(stream_id, value, now)


class Side:
    """A runner with both links, and what it has told."""

    def __init__(self, address: int, medium: SimMedium, radio: str) -> None:
        engine = Engine(
            address=address, table=table(), epoch=address, rng=random.Random(1), rules=RULES
        )
        self.runner = LinkRunner(
            engine, medium.link(address), beside={"radio": registry.create(radio, address)}
        )
        self.events: list[Event] = []
        self.changed = asyncio.Event()

    async def start(self) -> None:
        await self.runner.start(self.take)

    def take(self, event: Event) -> None:
        self.events.append(event)
        self.changed.set()

    async def got(self, stream_id: int) -> Any:
        while True:
            for event in self.events:
                if isinstance(event, SampleReceived) and event.stream_id == stream_id:
                    return event.value
            self.changed.clear()
            await self.changed.wait()


def test_runner_drives_an_engine_on_two_links() -> None:
    async def scenario() -> None:
        nodes = tuple(NodeSpec(address=n, position=(100.0 * n, 0.0, 20.0)) for n in (1, 2))
        medium = SimMedium(Scenario(nodes=nodes, channel="none"), time_scale=50.0)
        radios = locators(settings="&latency_s=0.01")
        near, far = (Side(n, medium, radio) for n, radio in zip((1, 2), radios, strict=True))
        await near.start()
        await far.start()
        states = [event for event in near.events if isinstance(event, LinkStateChanged)]
        assert {each.link for each in states if each.state is LinkState.UP} == {"sound", "radio"}
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
