"""`AT!LC1` and `AT!UT`: what a modem changes, it says."""

import pytest

from tests.links.evologics.emulator.sea import Host, Sea
from zacoustic_evologics.at.notifications import ClockOffset, DeliveredIm, SourceLevel


def exchange(sea: Sea, host: Host, times: int) -> None:
    for _ in range(times):
        host.say(b"AT*SENDIM,1,2,ack,x\n")
        sea.run()


@pytest.mark.parametrize(
    ("spacing_m", "level", "told"), [(1500.0, 3, [2, 1]), (1.0, 0, [1]), (150.0, 3, [])]
)
def test_level_follows_from_how_the_modem_is_heard(
    spacing_m: float, level: int, told: list[int]
) -> None:
    sea = Sea(spacing_m=spacing_m, settings={"ZX": 1, "LC": 1, "L": level})
    near, _ = sea.host(1), sea.host(2)
    exchange(sea, near, 4)
    assert len(near.all_of(DeliveredIm)) == 4
    assert [each.level for each in near.all_of(SourceLevel)] == told
    assert near.say(b"AT?L\n") == [str(told[-1] if told else level)]


def test_level_stays_without_the_setting() -> None:
    sea = Sea(spacing_m=1500.0, settings={"ZX": 1})
    near, _ = sea.host(1), sea.host(2)
    exchange(sea, near, 2)
    assert near.all_of(SourceLevel) == []
    assert near.say(b"AT?L\n") == ["3"]


def test_clock_that_is_set_tells_by_how_much() -> None:
    sea = Sea(settings={"ZX": 1})
    host = sea.host(1)
    sea.wait(20.0)
    assert host.say(b"AT!UT100\n") == ["OK", "RTO,80000000"]
    assert host.first(ClockOffset).offset_us == 80_000_000
    assert Sea().host(1).say(b"AT!UT100\n") == ["OK"]
