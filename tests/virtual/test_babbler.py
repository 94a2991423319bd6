"""No emergency of others starves beside a node that talks without pause, and reports go on."""

import statistics
from collections.abc import Callable

import pytest

from tests.virtual.babbling import NEVER, Outcome, Setting, Talk, babble


def _runs(count: int, **setting: bool) -> list[Outcome]:
    """Run that many fleets, of all kinds in turn."""
    kinds = [
        Setting(nodes=nodes, frame_bytes=size, reliable=reliable, talk=talk, **setting)
        for talk in (Talk.ONE, Talk.RELIABLE, Talk.PHOTO, Talk.QUEUE, Talk.ALL)
        for nodes, size in ((3, 33), (6, 64), (10, 8), (3, 64), (6, 8))
        for reliable in (True, False)
    ]
    return [babble(number, kinds[7 * number % len(kinds)]) for number in range(count)]


@pytest.mark.parametrize("senses_carrier", [True, False])
@pytest.mark.parametrize("addressed", [True, False])
def test_emergencies_arrive_beside_a_node_that_talks_without_pause(
    *, addressed: bool, senses_carrier: bool, sized: Callable[..., int]
) -> None:
    runs = _runs(sized(75, share=4), addressed=addressed, senses_carrier=senses_carrier)
    took_s = sorted(each for run in runs for each in run.took_s)
    assert took_s[int(0.95 * len(took_s))] <= (15.0 if senses_carrier else 30.0)
    if senses_carrier:
        assert took_s[-1] < NEVER
        assert took_s[int(0.999 * len(took_s))] <= 60.0


@pytest.mark.parametrize("senses_carrier", [True, False])
@pytest.mark.parametrize("nodes", [3, 10])
def test_others_report_about_as_beside_a_node_that_keeps_to_its_share(
    *, nodes: int, senses_carrier: bool, sized: Callable[..., int]
) -> None:
    def reported(talk: Talk) -> float:
        setting = Setting(nodes=nodes, senses_carrier=senses_carrier, talk=talk)
        runs = range(sized(30, share=4))
        return statistics.mean(babble(seed, setting, emergencies=8).reported for seed in runs)

    assert reported(Talk.ONE) >= 0.7 * reported(Talk.SHARE)
