"""The new configuration, for each node of a recording."""

from collections.abc import Iterable
from pathlib import Path

from zacoustic.config import Config, read_config


def configs_for(path: str | Path, nodes: Iterable[int]) -> dict[int, Config]:
    """Read a configuration for each of the nodes.

    Raises:
        ConfigError: It is wrong, or lacks one of them.
    """
    return {node: read_config(path, address=node) for node in nodes}
