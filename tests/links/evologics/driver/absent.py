"""A node whose computer fails while its S2C modem goes on, as in `tests.virtual.absent`.

The modem of the absent node acknowledges burst data that nobody reads. How the modems treat burst
data is a guess by seed.
"""

import random
from collections.abc import Iterable
from functools import partial

from tests.links.evologics.driver.crew import CrewedSea, CrewNode
from tests.virtual.absent import (
    ABSENT_S,
    CRASHES_AT_S,
    NEVER,
    RANGE_M,
    Kind,
    Outcome,
    give,
    kind_of,
    table,
    talk,
)
from zacoustic.core.clock import ns_to_seconds
from zacoustic.core.engine.events import Event
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.emulator import EmulatedFleet, burst_guess, scenario_of
from zacoustic_evologics.emulator.observation import Observation, SignalEmitted

_GIVER, _ABSENT = 1, 2


class Absence:
    """One run.

    Args:
        seed: Everything follows from it.
        kinds: What waits for the absent node.
    """

    def __init__(self, seed: int, kinds: Iterable[Kind]) -> None:
        self._arrived: dict[Kind, float] = {}
        self._back_at: int | None = None
        self._sounds_ns = 0
        guess = burst_guess(seed)
        fleet = EmulatedFleet(
            scenario_of(2, spacing_m=RANGE_M, seed=seed + 1),
            behaviour=guess.behaviour,
            settings=guess.settings,
            observer=self._observe,
        )
        rules = TransmitRules(contact=ContactRules(announces=True))
        self.sea = CrewedSea(fleet, table(), self._deliver, config=EvologicsConfig(), rules=rules)
        self.sea.until(lambda: all(node.is_up for node in self.sea.crew))
        self._giver, self._absent = self.sea.crew
        for turn in range(3):  # they get to know each other
            for node in self.sea.crew:
                self.sea.after(30.0 * turn + 10.0 * node.address, partial(self._apply, node, talk))
        self.sea.run(CRASHES_AT_S)
        self._kinds = tuple(kinds)
        self._rng = random.Random(seed)

    def run(self) -> Outcome:
        """Let the node be absent, and come back."""
        self.sea.crash(self._absent)
        given = len(self._giver.given)
        sounds_ns = self._sounds_ns
        for kind in self._kinds:
            self.sea.after(
                self._rng.uniform(0.0, 1.0), partial(self._apply, self._giver, partial(give, kind))
            )
        self.sea.run(ABSENT_S)
        frames = len(self._giver.given) - given
        airtime_s = ns_to_seconds(self._sounds_ns - sounds_ns)
        self._back_at = self.sea.now
        self.sea.restart(self._absent, 2)
        awaited = {kind for kind in self._kinds if kind is not Kind.COMMAND}
        for _ in range(180):
            if not awaited <= self._arrived.keys():
                self.sea.run(10.0)
        arrived_s: dict[Kind, float] = {kind: self._arrived.get(kind, NEVER) for kind in awaited}
        return Outcome(frames=frames, airtime_s=airtime_s, arrived_s=arrived_s)

    def _observe(self, observation: Observation) -> None:
        if isinstance(observation, SignalEmitted) and observation.node == _GIVER:
            self._sounds_ns += observation.signal.duration_ns

    def _apply(self, node: CrewNode, command: object) -> None:
        assert callable(command)
        self.sea.apply(node, command)

    def _deliver(self, node: CrewNode, event: Event) -> None:
        kind = kind_of(event) if node.address == _ABSENT else None
        if kind is not None and self._back_at is not None:
            self._arrived.setdefault(kind, ns_to_seconds(self.sea.now - self._back_at))
