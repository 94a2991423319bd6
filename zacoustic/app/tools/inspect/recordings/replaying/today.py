"""Today's configuration, for each node of a recording."""

from collections.abc import Iterable
from pathlib import Path

from zacoustic.config import Config, read_config


def configs_for(path: str | Path, nodes: Iterable[int]) -> dict[int, Config]:
    """Read a configuration as each of the nodes reads it.

    Raises:
        ConfigError: It is wrong, or does not know one of them.
    """
    return {node: read_config(path, address=node) for node in nodes}
