"""The files of the demo: one for each router, made from `fleet.json5`, and the scenario.

`fleet.json5` is a configuration as a user would write it for two computers. Here both networks are
on one, so each gets a copy with its own port, address and modem.
"""

import contextlib
import itertools
import os
import socket
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.errors import ZacousticError

SHORE: Final = 1
"""Acoustic address of the shore's gateway."""
VEHICLE: Final = 2
"""Acoustic address of the vehicle's gateway."""
NAMES: Final = {SHORE: "shore", VEHICLE: "auv1"}
"""Name of each side by address, as in fleet.json5."""

_FIRST_PORT, _PORTS = 20_000, 12_000
# Processes that begin at one time begin far apart; 997 is a prime.
_NUMBERS: Final = itertools.count(os.getpid() * 997)
_ENDPOINT: Final = "tcp/127.0.0.1:7447"
_ADDRESS: Final = "address: 1,\n"
_LOCATOR: Final = "sim/127.0.0.1:7000"


class LocalNetwork(msgspec.Struct, frozen=True, kw_only=True):
    """One local network."""

    address: int
    """Acoustic address of its gateway."""
    name: str
    """Its name in the fleet."""
    endpoint: str
    """Endpoint of its router, such as ``tcp/127.0.0.1:7447``."""
    file: Path
    """Configuration of its gateway."""


def demo_text(name: str) -> str:
    """Return a file of the demo: `fleet.json5` or `medium.json5`."""
    return resources.files(__package__).joinpath(name).read_text(encoding="utf-8")


def write_scenario(folder: Path) -> Path:
    """Write the scenario into a folder; returns its path."""
    path = folder / "water.json5"
    path.write_text(demo_text("water.json5"), encoding="utf-8")
    return path


def write_networks(folder: Path, locators: str | Mapping[int, str]) -> dict[int, LocalNetwork]:
    """Write a configuration for each network into a folder.

    Args:
        folder: The folder.
        locators: Locator of each modem by address, or one locator for both.

    Returns:
        The networks by address; their ports were free a moment ago.
    """
    networks = {}
    for (address, name), port in zip(NAMES.items(), free_ports(len(NAMES)), strict=True):
        endpoint = f"tcp/127.0.0.1:{port}"
        text = demo_text("fleet.json5")
        for written, instead in (
            (_ENDPOINT, endpoint),
            (_ADDRESS, f"address: {address},\n"),
            (_LOCATOR, locators if isinstance(locators, str) else locators[address]),
        ):
            if text.count(written) != 1:
                raise ZacousticError(f"fleet.json5 of the demo does not have {written!r} once")
            text = text.replace(written, instead)
        file = folder / f"{name}.json5"
        file.write_text(text, encoding="utf-8")
        networks[address] = LocalNetwork(address=address, name=name, endpoint=endpoint, file=file)
    return networks


def free_ports(count: int) -> list[int]:
    """Return free ports of the loopback interface, in order; this process gets others next time.

    They are below those that systems give to outgoing connections: one of these could take a port
    before its server does.

    Raises:
        OSError: There are not so many.
    """
    found: list[int] = []
    for number in itertools.islice(_NUMBERS, _PORTS):
        port = _FIRST_PORT + number % _PORTS
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            found.append(port)
        if len(found) == count:
            return found
    last_port = _FIRST_PORT + _PORTS - 1
    raise OSError(f"fewer than {count} of the ports {_FIRST_PORT}..{last_port} are free")
