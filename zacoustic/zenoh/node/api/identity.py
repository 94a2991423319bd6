"""The identity of a node: its name, its acoustic address, and their configuration."""

from pathlib import Path

import msgspec

from zacoustic.config import Config, read_config
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import ConfigError


class Identity(msgspec.Struct, frozen=True, kw_only=True):
    """Name, address and configuration of a node."""

    name: str
    """Name for people, and for `{node}` in topics if the configuration lists the node."""
    address: int | None
    """Acoustic address, 1…254; None only on Zenoh."""
    config: Config | None
    """The configuration, or None."""

    def table(self) -> StreamTable:
        """Return the streams in a new table for this node alone."""
        config = self.config
        if config is None:
            return StreamTable()
        specs = [stream.spec for stream in config.table]
        table = config.table
        return StreamTable(
            specs, types=config.types, nodes=config.nodes, model=table.model, wire=table.wire
        )


def identify(
    name_or_address: str | int, *, config: str | Path | Config | None, address: int | None
) -> Identity:
    """Find the identity of a node.

    Args:
        name_or_address: A name, which the configuration may list, or an address.
        config: The configuration, or its file.
        address: The address, if the name does not give it.

    Raises:
        ConfigError: The file is wrong, or the address is not valid.
    """
    if isinstance(name_or_address, int):
        if address not in (None, name_or_address):
            raise ConfigError(f"address: {address}, and {name_or_address} before it; allowed: one")
        address = name_or_address
    if address is not None and not 1 <= address <= 254:
        raise ConfigError(f"address: {address}; allowed: 1..254")
    if config is None:
        return Identity(name=str(name_or_address), address=address, config=None)
    known = _read(config, name_or_address, address)
    return Identity(name=_name(known, name_or_address), address=known.address, config=known)


def _read(config: str | Path | Config, name: str | int, address: int | None) -> Config:
    if isinstance(config, str | Path):
        # Without an address, the name's address in the file counts, else the file's own. So the
        # file needs no address, and one file serves a fleet.
        return read_config(config, address=address or _address_of(config, name))
    if address is None:
        address = next((each for each, known in config.nodes.items() if known == name), None)
    if address is not None and config.nodes and address not in config.nodes:
        known = ", ".join(str(each) for each in config.nodes)
        raise ConfigError(f"{config.source}: address: {address}; allowed: {known}")
    return config if address is None else msgspec.structs.replace(config, address=address)


def _address_of(path: str | Path, name: str | int) -> int | None:
    """Return the address that a file gives to the name; reads nothing else of it."""
    from zacoustic.config.json5 import read_zenoh_config

    _, section = read_zenoh_config(path)
    nodes = section.get("nodes") if isinstance(section, dict) else None
    for node in nodes if isinstance(nodes, list) else ():
        if isinstance(node, dict) and node.get("name") == name:
            found = node.get("address")
            return found if isinstance(found, int) else None
    return None


def _name(config: Config, name_or_address: str | int) -> str:
    if isinstance(name_or_address, str):
        return name_or_address
    return config.name or str(name_or_address)
