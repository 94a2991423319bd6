"""The configuration of a fleet, for programs that are not a node and open no modem."""

from collections.abc import Mapping
from pathlib import Path

import msgspec

from zacoustic.config import Config, config_from_mapping
from zacoustic.config.json5 import read_zenoh_config

_ANYBODY = 1


def read_fleet(path: str | Path, *, with_model: bool = True) -> Config:
    """Read the common part of a fleet's configuration; without `address`, for its first node.

    Args:
        path: File of the configuration.
        with_model: Otherwise the key `model` is ignored: its file may not exist yet.

    Raises:
        ConfigError: As for `zacoustic.config.read_config`.
    """
    zenoh_config, section = read_zenoh_config(path)
    if isinstance(section, Mapping):
        section = dict(section)
        if not with_model:
            section.pop("model", None)
        if "address" not in section:
            section["address"] = _first_address(section.get("nodes"))
    config = config_from_mapping(section, source=str(path), folder=Path(path).parent)
    return msgspec.structs.replace(config, zenoh_config=zenoh_config)


def _first_address(nodes: object) -> object:
    if isinstance(nodes, list) and nodes and isinstance(nodes[0], Mapping):
        return nodes[0].get("address", _ANYBODY)
    return _ANYBODY
