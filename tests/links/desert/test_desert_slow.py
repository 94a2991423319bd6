"""DESERT as its script makes it, where the link is told something else, or just what is so."""

import statistics
from collections.abc import Callable
from functools import partial

import pytest

from tests.links.desert.desert_virtual import VirtualDesert
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic_desert.config import DesertConfig
from zacoustic_desert.link import DesertLink

SAMPLES = 12
TABLE = StreamTable(
    [
        TopicSpec(
            stream_id=1,
            name="log",
            publishers=(1,),
            subscribers=(2,),
            qos=Qos(reliability=Reliability.RELIABLE, depth=40),
        )
    ],
    nodes={1: "shore", 2: "auv"},
)


def carry(seed: int, period_s: float, every_s: float, *, told_s: float = 0.2) -> VirtualDesert:
    """Carry twelve samples; all have to arrive, in order, and to be told so."""
    desert = VirtualDesert(
        TABLE, seed=seed, configured=DesertConfig(period_s=told_s), period_s=period_s
    )
    for number in range(SAMPLES):
        sample = bytes((number, *range(11)))
        desert.at(5.0 + number * every_s, partial(desert.publish, 1, 1, sample))
    desert.run(until_s=2000.0)
    events = [event for _, _, event in desert.events]
    received = [event.value[0] for event in events if isinstance(event, SampleReceived)]
    assert received == list(range(SAMPLES))
    ended = [event.outcome for event in events if isinstance(event, DeliveryEnded)]
    assert ended == SAMPLES * [DeliveryOutcome.DELIVERED]
    return desert


def sent(desert: VirtualDesert) -> int:
    """Count the frames of the publisher."""
    return desert.engine(1).stats.frames_transmitted


@pytest.mark.parametrize("every_s", [10.0, 60.0])
@pytest.mark.parametrize("period_s", [4.0, 10.0])
def test_desert_slower_than_the_link_is_told_carries_all_in_few_frames(
    count: Callable[[int], int], period_s: float, every_s: float
) -> None:
    runs = [carry(seed, period_s, every_s) for seed in range(count(400))]
    frames = [sent(run) for run in runs]
    # Without what late answers tell: 50 to 250.
    assert statistics.fmean(frames) <= 18
    assert max(frames) <= 24
    for run in runs:
        assert run.desert.waiting(0) == run.desert.waiting(1) == 0


@pytest.mark.parametrize("every_s", [0.0, 1.0])
@pytest.mark.parametrize("period_s", [4.0, 10.0])
def test_burst_does_not_fill_a_slow_desert(
    count: Callable[[int], int], period_s: float, every_s: float
) -> None:
    frames = [sent(carry(seed, period_s, every_s)) for seed in range(count(400))]
    # When what showed that a CONFIRM was lost was said before that came, and each late answer let
    # all behind it go again: 20 and 24 on average into a period of 10 s.
    assert statistics.fmean(frames) <= 18
    assert max(frames) <= 40


def found(desert: VirtualDesert, told_s: float) -> list[str]:
    """Return what the doctor finds by the round trips that an engine has measured."""
    link = DesertLink("127.0.0.1:4000", DesertConfig(period_s=told_s))
    round_trips_ns = desert.engine(1).stats.round_trips_ns
    peers = {
        str(address): {"round_trip_s": ns_to_seconds(each)}
        for address, each in round_trips_ns.items()
    }
    assert list(peers) == ["2"]
    return [f"{each.what}: {each.cure}" for each in link.assess({"peers": peers})]


# Not in step with a period: then a frame might meet the same instant of it each time.
@pytest.mark.parametrize("every_s", [11.3, 61.7])
def test_doctor_names_a_slow_desert(every_s: float) -> None:
    for period_s in (4.0, 10.0):
        for seed in range(4):
            (finding,) = found(carry(seed, period_s, every_s), 0.2)
            assert "node 2 answers after" in finding
            assert "period_s in the locators of both ends" in finding


@pytest.mark.parametrize("every_s", [5.0, 10.0, 60.0])
def test_doctor_finds_nothing_where_the_period_is_as_told(every_s: float) -> None:
    for seed in range(4):
        assert not found(carry(seed, 0.2, every_s), 0.2)
    assert not found(carry(1, 4.0, 3 * every_s, told_s=4.0), 4.0)
    assert not DesertLink("127.0.0.1:4000").assess({"peers": {"2": {"round_trip_s": None}}})


@pytest.mark.parametrize("every_s", [5.0, 10.0, 60.0])
def test_nobody_counts_on_a_rhythm_behind_a_device_with_access_of_its_own(every_s: float) -> None:
    for seed in range(4):
        # A frame for each sample, one for each answer, and what makes them known to each other.
        assert carry(seed, 0.2, every_s).frames <= 2 * SAMPLES + 4
