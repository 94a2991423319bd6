"""Who is where: the scenario of a verb's arguments, or a line of modems in calm water."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.channel.scenario import NodeSpec, Scenario, scenario_from_mapping
from zacoustic.errors import ConfigError

DEPTH_M: Final = 10.0
"""Depth of modems in `scenario_of`, m."""
_USUAL: Final = 2


def scenario_of(modems: int, *, spacing_m: float = 500.0, seed: int = 1) -> Scenario:
    """Return a scenario of modems in a line eastwards, on a channel without random losses.

    Args:
        modems: Number of modems; their addresses are 1, 2, …
        spacing_m: Distance between neighbours, m.
        seed: Seed of the scenario.

    Raises:
        ConfigError: More modems than addresses, or none.
    """
    if not 1 <= modems <= 254:
        raise ConfigError(f"{modems} modems; allowed: 1..254")
    nodes = tuple(
        NodeSpec(address=number + 1, position=(spacing_m * number, 0.0, DEPTH_M))
        for number in range(modems)
    )
    return Scenario(nodes=nodes, channel="none", seed=seed)


def read_scenario(arguments: argparse.Namespace, read: Callable[[str], Any]) -> Scenario:
    """Return the scenario of the arguments `--modems` and `--scenario`.

    Args:
        arguments: As declared by `zacoustic.link.emulation.verb.add_scenario`.
        read: Reads a file of JSON5 by its path.

    Raises:
        ConfigError: The file is wrong, or has fewer nodes.
    """
    path: str | None = arguments.scenario
    if path is None:
        return scenario_of(_USUAL if arguments.modems is None else arguments.modems)
    scenario = scenario_from_mapping(read(path), source=path, folder=Path(path).parent)
    count = len(scenario.nodes) if arguments.modems is None else arguments.modems
    if not 1 <= count <= len(scenario.nodes):
        raise ConfigError(f"--modems {count}; the scenario has {len(scenario.nodes)} nodes")
    nodes = scenario.nodes[:count]
    there = {node.address for node in nodes}
    links = tuple(link for link in scenario.links if {link.source, link.target} <= there)
    return msgspec.structs.replace(scenario, nodes=nodes, links=links, traffic=())
