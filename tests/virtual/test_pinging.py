"""What a ping costs on the channel: an order that changes nothing, and then a range."""

from functools import partial
from typing import Any

import pytest

from tests.virtual.fleet import line
from tests.virtual.test_ranging import MODEM, table
from zacoustic.app.cli.use.ping import MOST_BYTES, MOST_FRAMES
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, ResponseReceived
from zacoustic.core.peers.ranging import RangeMeasured
from zacoustic.core.streams.commands import RemoteCommand
from zacoustic.testing.virtual import VirtualNetwork

PINGS = 5


class Pinger:
    """Asks as `zacoustic.zenoh.gateway.commands.pings` does."""

    def __init__(self, seed: int) -> None:
        self.sent: list[TraceRecord] = []
        self.answers = self.ranges = 0
        self.medium = VirtualNetwork(
            line(0, 1500, channel="none", seed=seed),
            table(),
            modem=MODEM,
            trace=self.sent.append,
            deliver=self._deliver,
        )

    def ping(self) -> None:
        def ask(engine: Engine, now: int) -> None:
            engine.commands.send(2, RemoteCommand(), now, timeout_s=30)

        self.medium.apply(1, ask)

    def _deliver(self, address: int, event: Event) -> None:
        if isinstance(event, ResponseReceived):
            self.answers += 1
            self.medium.apply(1, lambda engine, now: engine.ranging.request(2, now, timeout_s=10))
        self.ranges += isinstance(event, RangeMeasured)


@pytest.mark.parametrize("pause_s", [8, 60, 600])
def test_a_ping_costs_what_its_help_says(pause_s: int, count: Any) -> None:
    for seed in range(count(100)):
        pinger = Pinger(seed)
        for number in range(PINGS):
            pinger.medium.at(1 + number * pause_s, partial(pinger.ping))
        pinger.medium.run()
        assert (pinger.answers, pinger.ranges) == (PINGS, PINGS), seed
        sizes = [record.size_bytes for record in pinger.sent if record.what == "transmit"]
        assert len(sizes) <= PINGS * MOST_FRAMES, (seed, sizes)
        assert sum(sizes) <= PINGS * MOST_BYTES, (seed, sizes)
