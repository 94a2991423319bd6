"""Acknowledgements of simulated modems: they take time, get lost, and tell the range."""

import asyncio
from collections.abc import Awaitable, Callable

import pytest

from tests.runtime.loop_checks import run, until
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.medium import Emission
from zacoustic.channel.scenario import LinkSpec, NodeSpec, Scenario
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.linktypes import PeerMeasured, TransmitOutcome, TransmitReport
from zacoustic.testing.linkpair import Side
from zacoustic_sim.link import SimConfig
from zacoustic_sim.medium import Observation, SimMedium

SCALE = 50.0
AIRTIME_S = 0.1503 + 4 * 0.011094
ANSWER_S = 0.11 + 0.1503 + 0.011094
DELIVERED, NOT_DELIVERED = TransmitOutcome.DELIVERED, TransmitOutcome.NOT_DELIVERED


class Sent(list[Emission]):
    """Every sound that was made."""

    def __init__(self) -> None:
        super().__init__()
        self.changed = asyncio.Event()

    def observe(self, _: int, what: Observation) -> None:
        if isinstance(what, Emission):
            self.append(what)
            self.changed.set()


def case(
    body: Callable[[SimMedium, list[Side], Sent], Awaitable[None]],
    *,
    config: SimConfig | None = None,
    lossy: tuple[int, int] | None = None,
    scale: float = SCALE,
) -> None:
    nodes = tuple(
        NodeSpec(address=address, position=(1500.0 * (address - 1), 0.0, 10.0))
        for address in (1, 2, 3)
    )
    links = (LinkSpec(source=lossy[0], target=lossy[1], loss=LossSpec(frame=1.0)),) if lossy else ()
    scenario = Scenario(nodes=nodes, channel="none", links=links)

    async def main() -> None:
        sent = Sent()
        medium = SimMedium(
            scenario,
            time_scale=scale,
            observer=sent.observe,
        )
        sides = [
            Side(medium.link(at, config or SimConfig(acknowledges=True)), at) for at in (1, 2, 3)
        ]
        for side in sides[:2]:
            await side.open()
        await body(medium, sides, sent)
        for side in sides:
            await side.close()
            side.receiver.raise_faults()
        medium.close()

    run(main())


async def ask(side: Side, to: int) -> TransmitReport:
    return await side.report(side.transmit(b"far?", to, acknowledge=True))


def lasted_s(report: TransmitReport) -> float:
    return (report.finished_at - report.started_at) / NS_PER_S * SCALE


def test_exchange_takes_both_ways_and_tells_the_range_behind_its_report() -> None:
    async def body(medium: SimMedium, sides: list[Side], sent: Sent) -> None:
        near, far = sides[:2]
        report = await ask(near, 2)
        assert report.outcome is DELIVERED
        assert lasted_s(report) == pytest.approx(AIRTIME_S + 2.0 + ANSWER_S, abs=1e-3)
        (found,) = near.receiver.measurements
        assert isinstance(found, PeerMeasured)
        assert (found.address, found.metrics.range_m) == (2, 1500.0)
        assert found.metrics.propagation_s == pytest.approx(1.0 / SCALE)
        assert abs(found.measured_at - report.finished_at) < NS_PER_S // 100
        assert [each.source for each in sent] == [1, 2]
        assert [frame.frame_bytes for frame in far.receiver.frames] == [b"far?"]
        assert far.receiver.measurements == []
        await near.gap(report)
        await near.send(b"and on")

    case(body)


def test_modem_that_is_not_there_does_not_answer() -> None:
    async def body(medium: SimMedium, sides: list[Side], sent: Sent) -> None:
        report = await ask(sides[0], 3)
        assert report.outcome is NOT_DELIVERED
        assert lasted_s(report) == pytest.approx(AIRTIME_S + 4.0 + ANSWER_S + 0.05, abs=1e-3)
        assert sides[0].receiver.measurements == []
        await sides[0].gap(report)
        assert (await ask(sides[0], 2)).outcome is DELIVERED

    case(body)


@pytest.mark.parametrize("way", [(1, 2), (2, 1)])
def test_lost_frame_and_lost_answer_are_the_same_to_the_sender(way: tuple[int, int]) -> None:
    async def body(medium: SimMedium, sides: list[Side], sent: Sent) -> None:
        report = await ask(sides[0], 2)
        assert report.outcome is NOT_DELIVERED
        assert len(sides[1].receiver.frames) == (way == (2, 1))
        assert sides[0].receiver.measurements == []

    case(body, lossy=way)


def test_modem_that_waits_for_an_answer_gives_one() -> None:
    async def body(medium: SimMedium, sides: list[Side], sent: Sent) -> None:
        near, far = sides[:2]
        ids = (
            near.transmit(b"far?", 2, acknowledge=True),
            far.transmit(b"far?", 1, acknowledge=True),
        )
        reports = [await near.report(ids[0]), await far.report(ids[1])]
        assert [each.outcome for each in reports] == [DELIVERED] * 2
        assert sorted(each.source for each in sent) == [1, 1, 2, 2]

    # Both begin within 0.8 s of the channel, also on a busy computer.
    case(body, scale=5.0)


def test_frame_that_comes_while_the_modem_answers_waits_for_it() -> None:
    async def body(medium: SimMedium, sides: list[Side], sent: Sent) -> None:
        near, far = sides[:2]
        asked = near.transmit(b"far?", 2, acknowledge=True)
        await until(lambda: len(sent) == 2, sent.changed)
        await far.send(b"mine")
        assert (await near.report(asked)).outcome is DELIVERED
        await near.hears(b"mine")
        assert sent[2].started_at >= sent[1].ready_at

    case(body)


def test_broadcast_and_a_modem_without_the_setting_are_not_acknowledged() -> None:
    async def broadcast(medium: SimMedium, sides: list[Side], sent: Sent) -> None:
        assert (await ask(sides[0], 255)).outcome is TransmitOutcome.SENT

    async def plain(medium: SimMedium, sides: list[Side], sent: Sent) -> None:
        told = sides[0].link.capabilities
        assert not (told.acknowledges)
        assert not (told.measures_range)
        assert not (told.measures)
        assert (await ask(sides[0], 2)).outcome is TransmitOutcome.SENT

    case(broadcast)
    case(plain, config=SimConfig())
    case(plain, config=SimConfig(acknowledges=True, addressed=False))


def test_modem_that_leaves_while_it_waits_leaves_a_free_place() -> None:
    async def body(medium: SimMedium, sides: list[Side], sent: Sent) -> None:
        near = sides[0]
        asked = near.transmit(b"far?", 3, acknowledge=True)
        await sides[1].receiver.wait("frame", lambda: sides[1].receiver.carrier, 10.0)
        await near.close()
        assert (await near.report(asked)).outcome is TransmitOutcome.ABORTED
        again = Side(near.link, 1)
        await again.open()
        assert (await ask(again, 2)).outcome is DELIVERED
        await again.close()

    case(body)
