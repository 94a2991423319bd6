import asyncio
import random
from collections import Counter
from collections.abc import Callable

import pytest

from tests.links.desert.desert_rig import config, serve, standin
from tests.runtime.loop_checks import until
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.run.journal import MemoryJournal
from zacoustic.run.runner import LinkRunner
from zacoustic_desert.config import DesertConfig
from zacoustic_desert.link import DesertLink
from zacoustic_desert.server import StandInServer
from zacoustic_desert.standin import Observation

SPEC = TopicSpec(stream_id=10, name="auv1/depth", qos=Qos(depth=50))
SAMPLES = [bytes((number, *range(16))) for number in range(50)]


def publishing(sample: bytes) -> Callable[[Engine, int], int]:
    return lambda engine, now: engine.publish(10, sample, now)


class Ends:
    """Two engines, each on a link to a node of the stand-in."""

    def __init__(self, server: StandInServer, settings: DesertConfig) -> None:
        self.samples: list[bytes] = []
        self.changed = asyncio.Event()
        self.runners = [
            LinkRunner(self._engine(node + 1), DesertLink(address, settings))
            for node, address in enumerate(server.addresses)
        ]

    @staticmethod
    def _engine(address: int) -> Engine:
        epoch = MemoryJournal().recover().boot_epoch
        table = StreamTable([SPEC])
        return Engine(address=address, table=table, epoch=epoch, rng=random.Random(address))

    def _deliver(self, event: Event) -> None:
        if isinstance(event, SampleReceived):
            assert isinstance(event.value, bytes)
            self.samples.append(event.value)
        self.changed.set()

    async def start(self) -> None:
        for runner in self.runners:
            await runner.start(self._deliver)
        await until(
            lambda: all(each.link_state.value == "up" for each in self.runners), self.changed
        )

    async def close(self) -> None:
        for runner in self.runners:
            await runner.close()
            assert runner.failure is None


@pytest.mark.parametrize("max_read_length", [64, 512])
@pytest.mark.parametrize("framing", ["native", "rmw_desert"])
def test_fifty_samples_published_back_to_back_arrive(max_read_length: int, framing: str) -> None:
    behind = standin(max_read_length=max_read_length)

    async def body(server: StandInServer) -> None:
        settings = config(max_read_length=max_read_length, framing=framing)
        ends = Ends(server, settings)
        await ends.start()
        for sample in SAMPLES:
            ends.runners[0].apply(publishing(sample))
        await until(lambda: len(ends.samples) == 50, ends.changed)
        assert ends.samples == SAMPLES
        assert ends.runners[1].engine.stats.dropped == {}
        await ends.close()

    serve(body, behind)


@pytest.mark.parametrize("max_read_length", [64, 512])
def test_each_frame_of_an_engine_is_a_packet(max_read_length: int) -> None:
    sizes: list[int] = []

    def observe(seen: Observation) -> None:
        if (seen.event, seen.node) == ("sent", 0):
            sizes.append(seen.size_bytes)

    behind = standin(max_read_length=max_read_length, observer=observe)

    async def body(server: StandInServer) -> None:
        ends = Ends(server, config(max_read_length=max_read_length))
        await ends.start()
        near = ends.runners[0]
        for sample in SAMPLES:
            near.apply(publishing(sample))
            wanted = len(ends.samples) + 1
            await until(lambda wanted=wanted: len(ends.samples) == wanted, ends.changed)  # type: ignore[misc]
        assert ends.samples == SAMPLES
        # The first ones also carry what makes the nodes known to each other.
        assert Counter(sizes).most_common(1)[0][0] == 30
        assert len(sizes) == near.engine.stats.frames_transmitted
        await ends.close()

    serve(body, behind)
