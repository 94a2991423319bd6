"""Puts a scenario's node faults (`channel.nodefaults`) on the agenda of a network."""

import random
from collections.abc import Callable
from functools import partial
from typing import Protocol

from zacoustic.channel.faults.nodefaults import CrashSpec
from zacoustic.channel.scenario import Scenario
from zacoustic.core.base.clock import NS_PER_S


class FaultyNetwork(Protocol):
    """The methods of a network that faults need."""

    @property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of all nodes of the network, in order, also of those that are down."""

    @property
    def now(self) -> int:
        """The present instant, ns since the start."""

    def at(self, instant_s: float, action: Callable[[], object]) -> None:
        """Run an action at an instant, s since the start."""

    def is_running(self, address: int) -> bool:
        """Tell whether a node has an engine now."""

    def crash(self, address: int, *, reboots: bool = False) -> None:
        """Crash a node."""

    def start(self, address: int) -> None:
        """Start a node that is down."""

    def set_link(self, address: int, *, up: bool) -> None:
        """Unplug or plug in the modem of a node."""

    def tell_clock(self, address: int) -> None:
        """Tell an engine the time and error of its node's wall clock."""


def schedule_faults(network: FaultyNetwork, scenario: Scenario) -> None:
    """Unplug modems and crash nodes as in the scenario.

    Faults of a node without an engine have no effect.
    """
    faults = scenario.faults
    for span in faults.unplugged:
        if span.node in network.addresses and _is_before(span.from_s, faults.until_s):
            network.at(span.from_s, partial(network.set_link, span.node, up=False))
            network.at(span.to_s, partial(network.set_link, span.node, up=True))
    for clock in faults.clocks:
        if clock.node in network.addresses and clock.error_s is not None:
            tell = partial(network.tell_clock, clock.node)
            for jump in clock.jumps:
                network.at(jump.at_s, tell)
    for index, spec in enumerate(faults.crashes):
        if spec.node not in network.addresses:
            continue
        for instant_s in spec.at_s:
            if _is_before(instant_s, faults.until_s):
                network.at(instant_s, partial(_crash, network, spec))
        if spec.every_s is not None:
            limits = [end_s for end_s in (spec.to_s, faults.until_s) if end_s is not None]
            rng = random.Random(f"{scenario.seed}/crashes/{index}")
            _crash_sometime(network, spec, min(limits, default=None), rng)


def _is_before(instant_s: float, end_s: float | None) -> bool:
    return end_s is None or instant_s < end_s


def _crash(network: FaultyNetwork, spec: CrashSpec) -> None:
    if not network.is_running(spec.node):
        return
    network.crash(spec.node, reboots=spec.reboots)
    now_s = network.now / NS_PER_S
    network.at(now_s + spec.restart_after_s, partial(network.start, spec.node))


def _crash_sometime(
    network: FaultyNetwork, spec: CrashSpec, end_s: float | None, rng: random.Random
) -> None:
    """Crash a node at a random instant, and again after each restart."""
    assert spec.every_s is not None
    crash_s = network.now / NS_PER_S + rng.expovariate(1.0 / spec.every_s)
    if not _is_before(crash_s, end_s):
        return
    network.at(crash_s, partial(_crash, network, spec))
    again = partial(_crash_sometime, network, spec, end_s, rng)
    network.at(crash_s + spec.restart_after_s, again)
