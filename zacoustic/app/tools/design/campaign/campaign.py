"""A campaign: all that decides its figures, in one record for the workers.

It contains the scenario and the configs as read, the swept values as a list for each case, and a
digest of each file that a config names. Two records that differ only in the places of their files
give the same rows, wherever and in whatever order their runs are done.

A cell is one case of each parameter, the last one changing fastest. Runs are numbered by seed
first: run ``seed index × cells + cell``. So all cells have their first seed before any has its
second, and an interrupted campaign has about as many results of each.
"""

import copy
import hashlib
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.campaign.fewer import keep_first
from zacoustic.app.tools.design.campaign.paths import parse_path, put
from zacoustic.app.tools.design.campaign.spec import CampaignSpec, SweepSpec
from zacoustic.channel.recorded import with_recording
from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.channel.tracks import with_tracks
from zacoustic.config import Config, config_from_mapping
from zacoustic.config.json5 import read_json5, read_zenoh_config
from zacoustic.errors import ConfigError

Value = bool | int | float | str
"""Value of a case in a table."""

_CONFIG: Final = "config"
_COUNT: Final = ("nodes", "count")
_SECRETS: Final = "security"  # no part of a simulation, and even a digest of a key is private
_MOST_FILE_BYTES: Final = 1 << 28


class Case(msgspec.Struct, frozen=True):
    """One value of a parameter."""

    value: Value
    """For tables and plots."""
    edits: list[tuple[str, Any]]
    """Path and value of each change."""


class Parameter(msgspec.Struct, frozen=True):
    """One parameter."""

    name: str
    """For tables and plots."""
    cases: list[Case]
    """Its values."""


class Campaign(msgspec.Struct, frozen=True, kw_only=True):
    """All that decides a figure."""

    version: str
    """Version of zacoustic."""
    until_s: float
    """Length of each run, s of virtual time."""
    seeds: list[int]
    """Seeds of each cell."""
    sweep: list[Parameter]
    """The parameters."""
    scenario: Any
    """The scenario as read."""
    configs: dict[str, Any]
    """Sections of the configs, by their names in scenarios."""
    files: dict[str, str]
    """SHA-256 of the files that configs name, by path from the scenario's folder."""
    place: str = ""
    """File of the scenario; does not affect figures."""

    @property
    def cells(self) -> int:
        """Number of cells."""
        return math.prod(len(parameter.cases) for parameter in self.sweep)

    @property
    def runs(self) -> int:
        """Number of runs."""
        return self.cells * len(self.seeds)

    def cell_of(self, run: int) -> int:
        """Return the cell of a run."""
        return run % self.cells

    def seed_of(self, run: int) -> int:
        """Return the seed of a run."""
        return self.seeds[run // self.cells]

    def cases_of(self, cell: int) -> list[Case]:
        """Return the case of each parameter in a cell."""
        cases = []
        for parameter in reversed(self.sweep):
            cell, index = divmod(cell, len(parameter.cases))
            cases.append(parameter.cases[index])
        return cases[::-1]

    def named(self, cell: int) -> str:
        """Return the name of a cell for messages."""
        pairs = zip(self.sweep, self.cases_of(cell), strict=True)
        return ", ".join(f"{parameter.name} = {case.value}" for parameter, case in pairs)

    def identity(self) -> dict[str, str]:
        """Return a digest of each part that decides a figure."""
        return {
            name: hashlib.sha256(
                msgspec.json.encode(getattr(self, name), order="sorted")
            ).hexdigest()
            for name in self.__struct_fields__
            if name != "place"
        }

    def scenario_of(self, cell: int, seed: int) -> tuple[Scenario, dict[int, Config]]:
        """Return the scenario and the configs of a run.

        Raises:
            ConfigError: A swept value is not allowed at its place.
        """
        scenario = self._scenario_of(cell, seed)
        source, folder = f"{self.place} with {self.named(cell)}", Path(self.place).parent
        changes = [(path, value) for path, value in self._edits_of(cell) if _is_of_config(path)]
        if not scenario.config:
            if changes:
                raise ConfigError(
                    f"{source}: {changes[0][0]} is swept, and the scenario names no config",
                    hint='add config: "fleet.json5" to the scenario',
                )
            return scenario, {}
        file = folder / scenario.config
        section = copy.deepcopy(self.configs[scenario.config])
        source = f"{file} with {self.named(cell)}"
        _change(section, ((path.partition(".")[2], value) for path, value in changes), source)
        return scenario, {
            node.address: config_from_mapping(
                section, source=source, address=node.address, folder=file.parent
            )
            for node in scenario.nodes
        }

    def check(self) -> None:
        """Build the cells, as far as they differ.

        Raises:
            ConfigError: A swept value is not allowed at its place.
        """
        seen: set[bytes] = set()
        for cell in range(self.cells):
            edits = self._edits_of(cell)
            # Configs are read for each node; cases that do not change them need only the scenario.
            of_config = [edit for edit in edits if edit[0].startswith((_CONFIG, "nodes"))]
            key = msgspec.json.encode(of_config)
            if key not in seen:
                seen.add(key)
                self.scenario_of(cell, self.seeds[0])
            else:
                self._scenario_of(cell, self.seeds[0])

    def _edits_of(self, cell: int) -> list[tuple[str, Any]]:
        return [edit for case in self.cases_of(cell) for edit in case.edits]

    def _scenario_of(self, cell: int, seed: int) -> Scenario:
        mapping, source = copy.deepcopy(self.scenario), f"{self.place} with {self.named(cell)}"
        edits = (each for each in self._edits_of(cell) if not _is_of_config(each[0]))
        _change(mapping, edits, source)
        if isinstance(mapping, dict):
            mapping["seed"] = seed
        return scenario_from_mapping(mapping, source=source, folder=Path(self.place).parent)

    def check_files(self) -> None:
        """Compare the files that configs name with their digests in the campaign.

        Raises:
            ConfigError: A file is missing or differs.
        """
        folder = Path(self.place).parent
        for name, digest in self.files.items():
            if _digest(folder / name) != digest:
                raise ConfigError(
                    f"{folder / name} is not the file that the campaign was started with",
                    hint="workers need the files that the config names, under the same path",
                )


def campaign_of(spec: CampaignSpec, path: Path, version: str) -> Campaign:
    """Read the files of a campaign.

    Args:
        spec: Its file, parsed.
        path: Path of its file.
        version: Version of zacoustic.

    Raises:
        ConfigError: The scenario or a config is wrong.
    """
    place = (path.parent / spec.scenario).absolute()
    mapping = with_recording(with_tracks(read_json5(place), place.parent), place.parent)
    sweep = [_parameter(each) for each in spec.sweep]
    edits = [edit for each in sweep for case in each.cases for edit in case.edits]
    names = {value for key, value in edits if key == _CONFIG}
    if isinstance(mapping, dict):
        names.add(mapping.get(_CONFIG, ""))
    configs = {
        name: read_zenoh_config(place.parent / name)[1]
        for name in sorted(name for name in names if isinstance(name, str) and name)
    }
    values = [value for _, value in edits]
    return Campaign(
        version=version,
        until_s=spec.until_s,
        seeds=list(spec.all_seeds),
        sweep=sweep,
        scenario=mapping,
        configs=configs,
        files=_files(place.parent, configs, values),
        place=str(place),
    )


def _parameter(spec: SweepSpec) -> Parameter:
    if spec.key is not None:
        cases = [Case(_shown(value), [(spec.key, value)]) for value in spec.values or ()]
        return Parameter(spec.name or spec.key, cases)
    return Parameter(
        spec.name, [Case(case.name, list(case.set.items())) for case in spec.cases or ()]
    )


def _shown(value: object) -> Value:
    if isinstance(value, bool | int | float | str):
        return value
    return msgspec.json.encode(value).decode()


def _is_of_config(path: str) -> bool:
    return path.startswith(f"{_CONFIG}.")


def _change(tree: Any, edits: Iterable[tuple[str, Any]], source: str) -> None:  # noqa: ANN401
    """Apply changes; the number of nodes last, so that indices are those of the file.

    Raises:
        ConfigError: A path does not exist.
    """
    for path, value in sorted(edits, key=lambda edit: parse_path(edit[0]) == _COUNT):
        steps = parse_path(path)
        try:
            if steps == _COUNT:
                keep_first(tree, value)
            else:
                put(tree, steps, copy.deepcopy(value))
        except ValueError as error:
            raise ConfigError(f'{source}: "{path}": {error}') from None


def _files(folder: Path, configs: Mapping[str, Any], values: list[Any]) -> dict[str, str]:
    """Return the digest of each file that a config or a swept value names."""
    names = set(_texts(values))
    for name, section in configs.items():
        within = Path(name).parent
        open_part = (
            {key: value for key, value in section.items() if key != _SECRETS}
            if isinstance(section, dict)
            else section
        )
        for text in itertools.chain(_texts(open_part), _texts(values)):
            names.add(str(within / text))
    found = {name: _digest(folder / name) for name in sorted(names)}
    return {name: digest for name, digest in found.items() if digest}


def _texts(value: object) -> Iterator[str]:
    if isinstance(value, str):
        yield value
    elif isinstance(value, dict):
        for each in value.values():
            yield from _texts(each)
    elif isinstance(value, list):
        for each in value:
            yield from _texts(each)


def _digest(path: Path) -> str:
    """Return the digest of a file; empty: it cannot be read."""
    try:
        if not path.is_file() or path.stat().st_size > _MOST_FILE_BYTES:
            return ""
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError):
        return ""
