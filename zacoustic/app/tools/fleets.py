"""The nodes of a scenario: config and stream table of each."""

from pathlib import Path
from typing import Final

from zacoustic.channel.scenario import Scenario
from zacoustic.config import Config, read_config
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import ConfigError

_FIRST_OPAQUE_ID: Final = 1


def configs_of(scenario: Scenario, path: Path) -> dict[int, Config]:
    """Return the config of each node; empty if the scenario names no file.

    Raises:
        ConfigError: The file is wrong.
    """
    if not scenario.config:
        return {}
    file = path.parent / scenario.config
    return {node.address: read_config(file, address=node.address) for node in scenario.nodes}


def tables_of(
    scenario: Scenario, configs: dict[int, Config], source: str
) -> dict[int, StreamTable]:
    """Return the table of each node: the config's, or one of opaque topics.

    Raises:
        ConfigError: The traffic calls a service, and there is no config.
    """
    if configs:
        return {address: config.table for address, config in configs.items()}
    topics = dict.fromkeys(traffic.topic for traffic in scenario.traffic if traffic.topic)
    if any(traffic.service for traffic in scenario.traffic):
        raise ConfigError(
            f"{source}: traffic calls a service, but the scenario names no config",
            hint='add config: "fleet.json5"',
        )
    specs = [
        TopicSpec(stream_id=_FIRST_OPAQUE_ID + index, name=topic)
        for index, topic in enumerate(topics)
    ]
    nodes = {node.address: node.name or f"node{node.address}" for node in scenario.nodes}
    return {node.address: StreamTable(specs, nodes=nodes) for node in scenario.nodes}
