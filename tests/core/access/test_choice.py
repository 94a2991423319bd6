"""Which policy a link gets, and why a choice cannot work."""

import random

import pytest

from zacoustic.core.linktypes import LinkCapabilities
from zacoustic.core.schedule.access import (
    Aloha,
    AlohaSpec,
    CarrierSense,
    CarrierSenseSpec,
    Delegated,
    DelegatedSpec,
    PollingSpec,
    Tdma,
    TdmaSpec,
    Wanted,
    choose,
)
from zacoustic.core.schedule.access.polling import Polled, Poller
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.errors import ConfigError

PLAIN = LinkCapabilities(mtu_bytes=64, bit_rate_bps=640, preamble_s=0.2)
SENSING = LinkCapabilities(mtu_bytes=64, bit_rate_bps=640, senses_carrier=True)
CONTROLLING = LinkCapabilities(mtu_bytes=64, bit_rate_bps=640, controls_access=True)
SLOTS = TdmaSpec(slots=(1, 2), slot_s=3.0, clock_error_s=0.01, max_range_m=1500)
TURNS = PollingSpec(poller=1, nodes=(2, 3))


def chosen(spec: AccessSpec | None, capabilities: LinkCapabilities, address: int = 1) -> object:
    return choose(spec, capabilities, address, random.Random(1))


def test_link_says_what_is_natural_for_it() -> None:
    assert isinstance(chosen(None, CONTROLLING), Delegated)
    assert isinstance(chosen(None, SENSING), CarrierSense)
    assert isinstance(chosen(None, PLAIN), Aloha)


def test_each_choice_gives_its_policy() -> None:
    assert isinstance(chosen(DelegatedSpec(), CONTROLLING), Delegated)
    assert isinstance(chosen(AlohaSpec(), SENSING), Aloha)
    assert isinstance(chosen(CarrierSenseSpec(), SENSING), CarrierSense)
    assert isinstance(chosen(SLOTS, PLAIN), Tdma)
    assert isinstance(chosen(TURNS, PLAIN, 1), Poller)
    assert isinstance(chosen(TURNS, PLAIN, 3), Polled)


def test_device_that_controls_access_is_never_waited_for() -> None:
    access = choose(None, CONTROLLING, 1, random.Random(1))
    access.handle_carrier(True, 1)
    assert access.ready_at(Wanted(0), 2) == 0


@pytest.mark.parametrize(
    ("spec", "capabilities", "reason"),
    [
        (DelegatedSpec(), PLAIN, r'access.method: "delegated"; this link does not control access'),
        (SLOTS, CONTROLLING, r'access.method: "tdma"; this link controls access by itself'),
        (CarrierSenseSpec(), PLAIN, r"does not tell when somebody else is heard"),
        (
            TdmaSpec(slots=(1, 2), slot_s=2.0, clock_error_s=0.01, max_range_m=1500),
            PLAIN,
            r"access.slot_s: 2 s; the largest frame of this link takes 1.000 s and the guard 1.0\d+"
            r" s; allowed: at least 2.0\d+",
        ),
        (AlohaSpec(slot_s=0.9), PLAIN, r"access.slot_s: 0.9 s; the largest frame .* 1.000 s"),
        (PollingSpec(poller=1, nodes=(2,), turn_s=1.0), PLAIN, r"access.turn_s: 1 s; the largest"),
    ],
)
def test_choice_that_cannot_work_on_a_link_says_why(
    spec: AccessSpec, capabilities: LinkCapabilities, reason: str
) -> None:
    with pytest.raises(ConfigError, match=reason):
        chosen(spec, capabilities)


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"slots": ()}, "slots: \\(\\); allowed: a list of addresses of nodes, 1..1024"),
        ({"slots": (1, 255)}, r"slots\[1\]: 255; allowed: the address of a node"),
        ({"slot_s": 0.0}, "slot_s: 0.0; allowed: seconds, above 0"),
        ({"clock_error_s": -0.1}, "clock_error_s: -0.1; allowed: seconds, 0 or more"),
        ({"max_range_m": None}, "guard_s: is missing; allowed: exactly one of"),
        ({"guard_s": 1.0}, "guard_s: beside max_range_m; allowed: exactly one of"),
        ({"max_range_m": None, "guard_s": 0.02}, "no time for sound to travel"),
        ({"slot_s": 1.0}, r"slot_s: 1 s is not more than its guard of 1\.\d+ s"),
        ({"beacon_s": 60.0}, "beacon_s: without clock"),
    ],
)
def test_schedule_that_cannot_work_anywhere_says_why(
    settings: dict[str, object], reason: str
) -> None:
    sound: dict[str, object] = {
        "slots": (1, 2), "slot_s": 3.0, "clock_error_s": 0.01, "max_range_m": 1500.0,
    }  # fmt: skip
    with pytest.raises(ConfigError, match=reason):
        TdmaSpec(**(sound | settings))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"nodes": ()}, "nodes: \\(\\); allowed: a list of addresses of nodes, at least 1"),
        ({"nodes": (1, 2)}, "nodes: 1 is the poller"),
        ({"nodes": (0,)}, r"nodes\[0\]: 0; allowed"),
        ({"poller": 300}, r"poller: 300; allowed"),
        ({"turn_s": 6.0}, "turn_s: 6.0; allowed: seconds, above 0, at most 5.1"),
    ],
)
def test_polling_that_cannot_work_anywhere_says_why(
    settings: dict[str, object], reason: str
) -> None:
    with pytest.raises(ConfigError, match=reason):
        PollingSpec(**({"poller": 1, "nodes": (2, 3)} | settings))  # type: ignore[arg-type]
