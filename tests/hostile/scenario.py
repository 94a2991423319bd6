"""`Hostile`: one scenario, drawn from its seed: what the link is, who is there, what goes wrong."""

import random
from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec

from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.base.sizes import SIZES, Sizes
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing import SMALL_SIZES
from zacoustic.testing.virtual import Disturb, Modem

KINDS: Final = (
    "mixed", "foreign", "deaf", "late", "restored", "damaged", "killed", "clock", "crowded",
    "photo", "forged", "silent",
)  # fmt: skip
"""What goes wrong, beside loss, by the seed modulo their number:

mixed      every mechanism, loss to 40 %, jitter within a frame
foreign    frames of a valid foreign fleet with the same addresses, whole and mutated
deaf       no carrier sense, and everybody speaks at the same instants
late       a tenth of the frames comes twice within 120 s, or late
restored   nodes start again with an older copy of their journal
damaged    nodes start again with a part of their journal
killed     nodes crash, also in the middle of a commit
clock      wall clocks jump by years, computers reboot
crowded    four or five nodes, one server, all mechanisms at one peer
photo      objects of some kilobytes beside everything else
forged     SUBSCRIBEs and goals under the addresses of others
silent     a node is ordered to be silent, while clocks jump and computers reboot
"""
CALM_S: Final = 7200.0
"""How long nothing goes wrong, and nothing is said, at the end, s."""

LONGEST_REST_S: Final = 60.0
"""Longest time for which a node that was killed is down, s."""

_MODEMS: Final = (
    Modem(),
    Modem(senses_carrier=False),
    Modem(acknowledges=True),
    Modem(acknowledges=True, senses_carrier=False),
    Modem(checked=False),
    Modem(addressed=False, checked=False),
    Modem(addressed=False, checked=False, senses_carrier=False),
    Modem(addressed=False, checked=False, framed=False),
)


def _undisturbed(source: int, node: int, now: int) -> tuple[float, ...]:
    return (0.0,)


class Setting(msgspec.Struct, frozen=True, kw_only=True):
    """What a fleet has beside one link of all nodes, and how long it is calm at the end."""

    table: StreamTable | None = None
    """The streams; None: those of `fleet.table`."""
    rules: TransmitRules | dict[int, TransmitRules] = TransmitRules()
    sizes: Sizes = SIZES
    is_sealed: bool = False
    mtu_bytes: Mapping[int, int] = {}
    """Largest frame of single nodes, bytes."""
    ends: tuple[int, ...] = ()
    """The nodes that publish and receive; empty: all."""
    beside: Scenario | None = None
    """The medium of a second link, `RADIO`; None: there is none."""
    disturb: Callable[[], Disturb] = lambda: _undisturbed
    """Makes what the first link does with each frame, the same in each run."""
    disturb_beside: Callable[[], Disturb] = lambda: _undisturbed
    babbler: int | None = None
    """A node that publishes twice a second without pause."""
    is_polled: bool = False
    """A node polls the others, for ever."""
    calm_s: float = CALM_S


class Hostile(msgspec.Struct, frozen=True, kw_only=True):
    """One scenario."""

    seed: int
    kind: str
    """One of `KINDS`."""
    modem: Modem
    scenario: Scenario
    addresses: tuple[int, ...]
    busy_s: float
    """How long the nodes speak and things go wrong, s."""
    pause_s: float
    """Mean time between two commands of a node, s."""
    sizes: tuple[int, ...]
    """Sizes of payloads that are drawn from, bytes."""
    together: bool
    """All nodes speak at the same instants."""
    restarts: tuple[tuple[float, int, bool], ...]
    """``(instant, node, reboots)`` of crashes that the drive makes, s."""
    setting: Setting = Setting()
    """What the fleet has beside one link."""


def hostile(seed: int) -> Hostile:
    """Draw the scenario of a seed."""
    rng = random.Random(f"hostile {seed}")
    kind = KINDS[seed % len(KINDS)]
    fitting = [each for each in _MODEMS if kind != "deaf" or not each.senses_carrier]
    modem = rng.choice([each for each in fitting if kind != "forged" or each.addressed])
    overhead = 2 * (not modem.addressed) + 4 * (not modem.checked) + 3 * (not modem.framed)
    mtu_bytes = min(64, rng.choice((40, 64, 64)) + overhead)
    modem = msgspec.structs.replace(modem, mtu_bytes=mtu_bytes)
    count = rng.choice((4, 5)) if kind == "crowded" else rng.choice((2, 2, 3))
    addresses = tuple(range(1, count + 1))
    busy_s = rng.choice((120.0, 300.0))
    loss = rng.choice((0.0, 0.1, 0.2, 0.4))
    spread_m = rng.choice((10, 150, 700))
    crashing = kind in ("restored", "damaged", "killed", "clock", "silent")
    restarts = sorted(
        (rng.uniform(10, busy_s), rng.choice(addresses), kind in ("clock", "silent"))
        for _ in range(rng.choice((1, 2, 4)) if crashing else 0)
    )
    nodes = [
        {
            "address": address,
            "position": [rng.uniform(-spread_m, spread_m), rng.uniform(-spread_m, spread_m), 20],
        }
        for address in addresses
    ]
    links = [
        {"from": source, "to": target, "loss": {"frame": rng.uniform(0, loss), "until_s": busy_s}}
        for source in addresses
        for target in addresses
        if source != target and loss
    ]
    drawn: dict[str, Any] = {
        "seed": seed, "channel": "none", "nodes": nodes, "links": links,
        "faults": _faults(rng, kind, addresses, busy_s, restarts),
    }  # fmt: skip
    return Hostile(
        seed=seed,
        kind=kind,
        modem=modem,
        scenario=scenario_from_mapping(drawn, source=f"hostile {seed}"),
        addresses=addresses,
        busy_s=busy_s,
        pause_s=rng.choice((10.0, 25.0)) * count,
        sizes=(3, 8, 20, 300, 3000) if kind == "photo" else (3, 8, 20, 150),
        together=kind == "deaf" or rng.random() < 0.2,
        restarts=tuple(restarts),
    )


def small(seed: int) -> Hostile:
    """Draw the scenario of a seed, with the number windows of `SMALL_SIZES`."""
    drawn = hostile(seed)
    setting = msgspec.structs.replace(drawn.setting, sizes=SMALL_SIZES)
    return msgspec.structs.replace(drawn, setting=setting)


def _faults(
    rng: random.Random,
    kind: str,
    addresses: tuple[int, ...],
    busy_s: float,
    restarts: list[tuple[float, int, bool]],
) -> dict[str, Any]:
    faults: dict[str, Any] = {"until_s": busy_s}
    if kind == "late":
        faults |= {
            "duplicate": 0.1, "duplicate_after_s": [0.0, 120.0],
            "jitter_s": rng.choice((0.0, 0.0, 5.0, 30.0)),
        }  # fmt: skip
    elif rng.random() < 0.3:
        faults |= {"duplicate": 0.1, "duplicate_after_s": [0.0, 2.0]}
    if kind in ("killed", "restored", "damaged"):
        untold = rng.choice((0.0, 0.5, 1.0))
        faults["journal"] = {"commit_s": rng.choice((0.0, 0.05, 1.0)), "untold": untold}
    if kind in ("clock", "silent"):
        year_s = 31_557_600.0
        faults["clocks"] = [
            {
                "node": address,
                "offset_s": rng.choice((0.0, -50 * year_s, 3600.0)),
                "error_s": 1.0,
                "jumps": [
                    {
                        "at_s": rng.uniform(0, busy_s),
                        "by_s": rng.choice((-1, 1)) * rng.choice((3600.0, year_s)),
                    }
                    for _ in range(rng.randint(0, 3))
                ],
            }
            for address in addresses
        ]  # fmt: skip
        for clock in faults["clocks"] if kind == "silent" else ():
            # A clock that is set while its computer is off, and then taken for right, tells nobody.
            clock["jumps"] = [
                jump
                for jump in clock["jumps"]
                if not any(
                    node == clock["node"] and at_s <= jump["at_s"] <= at_s + LONGEST_REST_S
                    for at_s, node, _ in restarts
                )
            ]
    return faults
