"""On-demand topics in any water: in the end every publisher knows who wants what."""

import random
from collections.abc import Callable
from functools import partial

import msgspec
import pytest

from zacoustic.channel.faults.nodefaults import JournalSpec
from zacoustic.core.base.qos import Forward, Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import Event
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.scenarios import draw_scenario
from zacoustic.testing.virtual import VirtualNetwork

BLOCKS = range(10)
VIEWS = (10, 11, 17, 40)
LOG = 30
ALWAYS = 12
CALM_S = 3 * 3600.0
ROUND_S = 400.0
LAST_RESTART_S = 300.0


def fleet(nodes: int, *, journal: bool = True) -> StreamTable:
    view = Qos(forward=Forward.ON_DEMAND, depth=3)
    reliable = Qos(forward=Forward.ON_DEMAND, depth=5, reliability=Reliability.RELIABLE)
    return StreamTable(
        [
            *(TopicSpec(stream_id=each, name=f"view{each}", qos=view) for each in VIEWS),
            TopicSpec(stream_id=LOG, name="log", qos=reliable, journal=journal),
            TopicSpec(stream_id=ALWAYS, name="always", qos=Qos(depth=3)),
        ],
        nodes={address: f"n{address}" for address in range(1, nodes + 1)},
    )


class Watched:
    """Nodes that want this and that, and publish it, while everything goes wrong."""

    def __init__(self, seed: int) -> None:
        drawn = draw_scenario(seed)
        self.rng = random.Random(f"demand {seed}")
        self.until_s = drawn.busy_s
        self.wanted: dict[int, dict[int, frozenset[int]]] = {}
        """What the present life of each node wants: node → stream → publishers."""
        self.published: dict[bytes, int] = {}
        self.calm: list[TraceRecord] = []
        self.violations: list[str] = []
        keeps = self.rng.random() < 0.6
        faults = drawn.scenario.faults
        if not keeps:
            faults = msgspec.structs.replace(faults, journal=JournalSpec(keeps=False))
        # When it is calm all hear each other, wherever they have gone.
        scenario = msgspec.structs.replace(drawn.scenario, faults=faults, channel="none")
        nodes = len(drawn.casts)
        self.wanted = {address: {} for address in range(1, nodes + 1)}
        self.network = VirtualNetwork(
            scenario,
            fleet(nodes, journal=keeps),
            modem=drawn.modem,
            digest=False,
            trace=self.trace,
            lives=self.live,
            deliver=self.deliver,
        )
        for address in self.network.addresses:
            self.later(address, self.rng.uniform(0, 30), self.change)
            self.later(address, self.rng.uniform(0, 30), self.publish)

    def later(self, address: int, after_s: float, act: Callable[[int], None]) -> None:
        at_s = self.network.now / NS_PER_S + after_s
        if at_s < self.until_s:
            self.network.at(at_s, partial(act, address))

    def change(self, address: int) -> None:
        """Want something else."""
        if self.network.is_running(address):
            others = [each for each in self.network.addresses if each != address]
            sources = frozenset(each for each in others if self.rng.random() < 0.5)
            self.want(address, self.rng.choice((*VIEWS, LOG)), sources)
        mean_s = self.rng.choice((3, 3, 100))  # by fits and starts
        self.later(address, self.rng.expovariate(1 / mean_s), self.change)

    def want(self, address: int, stream_id: int, sources: frozenset[int]) -> None:
        self.wanted[address][stream_id] = sources
        self.network.apply(
            address, lambda engine, now: engine.subscriptions.want(stream_id, now, sources)
        )

    def publish(self, address: int) -> None:
        if self.network.is_running(address):
            stream_id = self.rng.choice((*VIEWS, LOG, ALWAYS))
            self.network.publish(address, stream_id, self.rng.randbytes(4))
        self.later(address, self.rng.expovariate(1 / 40), self.publish)

    def live(self, address: int, is_alive: bool) -> None:
        if not is_alive:
            self.wanted[address] = {}
        else:
            for stream_id in self.rng.sample(VIEWS, self.rng.randint(0, 2)):
                self.later(address, self.rng.uniform(0, 5), partial(self.change_one, stream_id))

    def change_one(self, stream_id: int, address: int) -> None:
        if self.network.is_running(address):
            others = frozenset(self.network.addresses) - {address}
            self.want(address, stream_id, others)

    def trace(self, record: TraceRecord) -> None:
        if record.what != "transmit":
            return
        engine = self.network.engine(record.node)
        for stream_id in record.streams:
            if stream_id in VIEWS and not engine.subscriptions.subscribers(
                engine.table.by_id(stream_id)
            ):
                self.violations.append(f"{record}: sent to nobody")
        self.calm.append(record)

    def deliver(self, address: int, event: Event) -> None:
        """Events are of no interest."""

    def run(self) -> None:
        self.network.run(until_s=self.until_s)
        # When it is calm everybody says something now and then, wanted or not.
        start_s = self.until_s + LAST_RESTART_S
        for address in self.network.addresses:
            for number, stream_id in enumerate(4 * (ALWAYS, *VIEWS, LOG)):
                at_s = start_s + ROUND_S * (number + address / 10)
                self.network.at(at_s, partial(self.say, address, stream_id))
        self.network.run(until_s=start_s + CALM_S)

    def say(self, address: int, stream_id: int) -> None:
        self.network.publish(address, stream_id, b"calm")

    def differences(self) -> list[str]:
        found = []
        for publisher in self.network.addresses:
            engine = self.network.engine(publisher)
            for stream_id in (*VIEWS, LOG):
                wanted = {
                    address
                    for address, wants in self.wanted.items()
                    if publisher in wants.get(stream_id, ())
                }
                subscribers = engine.subscriptions.subscribers(engine.table.by_id(stream_id))
                if subscribers != wanted:
                    found.append(
                        f"node {publisher}, stream {stream_id}: {subscribers}; wanted by {wanted}"
                    )
        return found


@pytest.mark.parametrize("number", BLOCKS)
def test_in_the_end_every_publisher_knows_who_wants_what(
    count: Callable[[int], int], number: int
) -> None:
    for seed in range(number, count(600), len(BLOCKS)):
        watched = Watched(seed)
        watched.run()
        assert not watched.violations, f"seed {seed}: {watched.violations[:3]}"
        assert not watched.differences(), f"seed {seed}: {watched.differences()}"
        for address in watched.network.addresses:
            engine = watched.network.engine(address)
            assert engine.poll_timeout() is None, f"seed {seed}: node {address} has a timer"
