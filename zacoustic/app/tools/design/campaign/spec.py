"""The file of a campaign: scenario, swept parameters, seeds and shown figures.

::

    { scenario: "water.json5", until_s: 600, seeds: 10,
      sweep: [
        { key: "nodes[1].position[0]", name: "distance, m", values: [500, 1000, 2000] },
        { key: "config.streams[*].codec", name: "codec", values: ["cbor", "packed"] },
        { name: "load", cases: [
            { name: "calm", set: { "traffic[0].every_s": 60, "loss.frame": 0 } },
            { name: "busy", set: { "traffic[0].every_s": 10, "loss.frame": 0.2 } } ] } ],
      figures: ["delivery", "p95_s"], confidence: 0.95 }

A path leads into the scenario; after ``config.`` it leads into the section `plugins.acoustic` of
the config that the scenario names. ``nodes.count`` keeps only the first nodes.
"""

from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.campaign.paths import parse_path
from zacoustic.app.tools.design.sim.simulation import DEFAULT_UNTIL_S
from zacoustic.channel.problem import explain
from zacoustic.config.json5 import read_json5
from zacoustic.core.base.clock import DURATIONS, is_duration
from zacoustic.errors import ConfigError

MOST_CASES: Final = 10_000
MOST_RUNS: Final = 1_000_000
DEFAULT_FIGURES: Final = ("delivery", "p95_s", "utilisation")
"""Default figures of a cell on the page and the terminal."""
SEEDS_ALLOWED: Final = "a number, 1 to 100000, for the seeds from 1 to it; or an array of seeds"

_MOST_SEEDS: Final = 100_000
_SEED_BITS: Final = 63


class CaseSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Values that change together."""

    name: str
    """Name in tables and plots."""
    set: dict[str, Any]
    """Path → value; empty: the scenario unchanged."""


class SweepSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One parameter."""

    key: str | None = None
    """Path of the value; or cases."""
    values: tuple[Any, ...] | None = None
    """Values of the parameter, with a key."""
    cases: tuple[CaseSpec, ...] | None = None
    """Values that change together, without a key."""
    name: str = ""
    """Name in tables and plots; empty: the key."""

    def __post_init__(self) -> None:
        """Check that there is a key with values, or a name with cases.

        Raises:
            ValueError: There is neither, or a path is not valid.
        """
        if (self.key is None) == (self.cases is None):
            raise ValueError(f"key is {self.key!r}; allowed: either key and values, or cases")
        if self.key is not None:
            _check_path("key", self.key)
            if not self.values:
                raise ValueError("values is empty; allowed: at least one value")
            return
        if self.values is not None:
            raise ValueError("values is given beside cases; allowed: with a key")
        if not self.name:
            raise ValueError("name is missing; it is required with cases")
        if not self.cases:
            raise ValueError("cases is empty; allowed: at least one case")
        for index, case in enumerate(self.cases):
            for path in case.set:
                _check_path(f"cases[{index}].set", path)
        names = [case.name for case in self.cases]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f'cases is [… name: "{twice}" …] twice; allowed: each name once')


class CampaignSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The file."""

    scenario: str
    """File of the scenario, relative to this one."""
    sweep: tuple[SweepSpec, ...]
    """The parameters; every combination of their values is a cell."""
    seeds: int | tuple[int, ...]
    """Seeds; each cell runs once with each."""
    until_s: float = DEFAULT_UNTIL_S
    """Length of each run, s of virtual time."""
    figures: tuple[str, ...] = DEFAULT_FIGURES
    """Figures on the page and the terminal."""
    confidence: float = 0.95
    """Confidence of the intervals, 0.5…0.999."""

    def __post_init__(self) -> None:
        """Check the ranges.

        Raises:
            ValueError: A value outside its range, a name twice, or too many runs.
        """
        if not self.scenario:
            raise ValueError('scenario is ""; allowed: the name of a file')
        if not is_duration(self.until_s):
            raise ValueError(f"until_s is {self.until_s!r}; allowed: above 0, {DURATIONS}")
        if not 0.5 <= self.confidence <= 0.999:
            raise ValueError(f"confidence is {self.confidence!r}; allowed: 0.5 to 0.999")
        if not self.figures:
            raise ValueError("figures is []; allowed: at least one")
        self._check_seeds()
        if not self.sweep:
            raise ValueError("sweep is []; allowed: at least one parameter")
        names = [each.name or each.key for each in self.sweep]
        twice = next((name for name in names if names.count(name) > 1), None)
        if twice is not None:
            raise ValueError(f'sweep is [… "{twice}" …] twice; allowed: each name once')
        runs = len(self.all_seeds)
        for each in self.sweep:
            cases = len(each.values or each.cases or ())
            if cases > MOST_CASES:
                raise ValueError(f"sweep is of {cases} values; allowed: at most {MOST_CASES}")
            runs *= cases
        if runs > MOST_RUNS:
            raise ValueError(f"sweep is of {runs} runs in all; allowed: at most {MOST_RUNS}")

    @property
    def all_seeds(self) -> tuple[int, ...]:
        """The seeds one by one."""
        if isinstance(self.seeds, int):
            return tuple(range(1, self.seeds + 1))
        return self.seeds

    def _check_seeds(self) -> None:
        if isinstance(self.seeds, int):
            is_good = 1 <= self.seeds <= _MOST_SEEDS
        else:
            is_good = 1 <= len(self.seeds) <= _MOST_SEEDS and all(
                seed.bit_length() <= _SEED_BITS for seed in self.seeds
            )
            if len(set(self.seeds)) < len(self.seeds):
                raise ValueError("seeds is with one of them twice; allowed: each once")
        if not is_good:
            raise ValueError(f"seeds is {str(self.seeds)[:40]}; allowed: {SEEDS_ALLOWED}")


def read_spec(path: Path) -> CampaignSpec:
    """Read the file of a campaign.

    Raises:
        ConfigError: One line: file, key, value, what is allowed, what to do.
    """
    mapping = read_json5(path)
    try:
        return msgspec.convert(mapping, CampaignSpec)
    except (msgspec.ValidationError, OverflowError) as error:
        problem = explain(error, mapping, CampaignSpec, whole="the campaign")
        is_scenario = isinstance(mapping, dict) and "nodes" in mapping
        raise ConfigError(f"{path}: {problem}", hint=_HINT if is_scenario else "") from None


_HINT: Final = (
    "it looks like a scenario; a campaign names one: "
    '{ scenario: FILE, seeds: 10, sweep: [ { key: "loss.frame", values: [0, 0.2] } ] }'
)


def _check_path(key: str, text: str) -> None:
    try:
        steps = parse_path(text)
    except ValueError as error:
        raise ValueError(f'{key} is "{text}"; {error}') from None
    if steps[0] == "seed":
        raise ValueError(f'{key} is "{text}"; allowed: another one, since seeds says the seeds')
