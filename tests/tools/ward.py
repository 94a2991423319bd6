"""Set-ups for `zacoustic config doctor`: real ports, gateways and files, healthy or with a fault.

The command runs in a thread, as it does from a shell, while what it examines lives on the loop.
"""

import asyncio
import contextlib
import json
import os
import struct
import sys
import time
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager, contextmanager
from pathlib import Path
from typing import Any, Final

import msgspec

from tests.gateway.networks import LocalNetwork, config_of, free_port, zenoh_config, zenoh_settings
from zacoustic.app.cli import main
from zacoustic.config import config_from_mapping
from zacoustic.gateway import Gateway
from zacoustic.link import Link
from zacoustic.link.emulation.running import RunningEmulation
from zacoustic.link.emulation.server import EmulationServer
from zacoustic_evologics import Interpreter
from zacoustic_evologics.emulator import EmulatedFleet, scenario_of
from zacoustic_evologics.emulator.hardware.chassis import Behaviour

NODES: Final = [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}]
STREAMS: Final[list[dict[str, Any]]] = [
    {"id": 10, "topic": "auv1/nav", "publishers": [2], "min_interval_s": 60},
    {"id": 11, "topic": "cmd", "publishers": [1]},
]
TDMA: Final = {
    "method": "tdma", "slots": [1, 2], "slot_s": 3, "max_range_m": 1000, "clock_error_s": 0.01,
}  # fmt: skip


class Told(msgspec.Struct, frozen=True):
    """What the command said."""

    code: int
    """Exit code."""
    findings: list[dict[str, str]]
    """What it found."""
    left_out: list[str]
    """What it did not look at."""
    error: str
    """Standard error."""

    @property
    def text(self) -> str:
        """All that was found."""
        return " | ".join(each["what"] for each in self.findings)


def write(folder: Path, *, address: int = 1, zenoh: str = "", **section: Any) -> Path:
    """Write the file of a node."""
    whole: dict[str, Any] = json.loads(zenoh) if zenoh else {"mode": "peer"}
    if not zenoh:
        whole["scouting"] = {"multicast": {"enabled": False}, "gossip": {"enabled": False}}
        whole["listen"] = {"endpoints": []}
    acoustic = {"address": address, "nodes": NODES, "streams": STREAMS, **section}
    path = folder / f"node{address}.json5"
    path.write_text(json.dumps({**whole, "plugins": {"acoustic": acoustic}}), encoding="utf-8")
    return path


def link(locator: str, access: dict[str, Any] | None = None) -> list[dict[str, Any]]:
    """Return the key `links`."""
    return [{"locator": locator, **({"access": access} if access else {})}]


def command(path: Path, *more: str) -> Told:
    """Run the command; for a thread."""
    import io

    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        code = main(["config", "doctor", str(path), "--json", *more])
    said = json.loads(output.getvalue()) if output.getvalue() else {}
    return Told(code, said.get("findings", []), said.get("left_out", []), errors.getvalue())


async def examine(path: Path, *more: str) -> Told:
    """Run the command, while the loop goes on."""
    return await asyncio.to_thread(command, path, *more)


@asynccontextmanager
async def modems(
    settings: dict[str, int] | None = None,
    *,
    firmware: str = "1.9",
    count: int = 2,
    interpreter: Interpreter = Interpreter.NET,
) -> AsyncIterator[EmulationServer]:
    """Run emulated modems, 1500 m from each other, as loud as they can."""
    fleet = EmulatedFleet(
        scenario_of(count, spacing_m=1500.0),
        settings={"L": 0} | (settings or {}),
        behaviour=Behaviour(firmware=firmware),  # type: ignore[arg-type]
        interpreter=interpreter,
    )
    server = EmulationServer(RunningEmulation(fleet))
    try:
        yield server
    finally:
        await server.close()


@asynccontextmanager
async def modem_file(
    folder: Path,
    settings: dict[str, int] | None = None,
    *,
    firmware: str = "1.9",
    behind: str = "",
    access: dict[str, Any] | None = None,
    **section: Any,
) -> AsyncIterator[Path]:
    """Run emulated modems, and write the file of node 1, which has the first of them by TCP.

    Args:
        folder: Of the file.
        settings: Of the modem.
        firmware: Of the modem.
        behind: What the locator says behind the address.
        access: Medium access of the link.
        section: What else the file says.
    """
    async with modems(settings, firmware=firmware) as server:
        place = await server.listen(1, "127.0.0.1", 0)
        locator = f"evologics/{place.locator}{behind}"
        yield write(folder, links=link(locator, access), **section)


def beside(folder: Path, local_network: LocalNetwork, locator: str = "", **section: Any) -> Path:
    """Write the file of a node whose gateway runs, and is the router of a local network."""
    if locator:
        section = {**section, "links": link(locator)}
    return write(folder, zenoh=zenoh_settings("router", listen=local_network.port), **section)


async def problem(path: Path, *more: str) -> Told:
    """Run the command, which has to find something."""
    told = await examine(path, *more)
    assert told.code == 1, told
    return told


@asynccontextmanager
async def gateway(address: int, modem: Link, **section: Any) -> AsyncIterator[LocalNetwork]:
    """Run a gateway that is a router of its own."""
    found = LocalNetwork(free_port())
    whole = {"address": address, "nodes": NODES, "streams": STREAMS, **section}
    config = config_from_mapping(whole, source="test", address=address)
    settings = zenoh_config("router", listen=found.port)
    config = msgspec.structs.replace(config_of(address, settings, whole), table=config.table)
    async with Gateway(config, link=modem, notify=found.notify):
        yield found


class TimeServer(asyncio.DatagramProtocol):
    """Tells the time, perhaps a wrong one."""

    def __init__(self, ahead_s: float) -> None:
        self.ahead_s = ahead_s
        self.transport: Any = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self.transport = transport

    def datagram_received(self, data: bytes, addr: Any) -> None:
        now_s = time.time() + self.ahead_s + 2_208_988_800
        stamp = struct.pack(">II", int(now_s), int(now_s % 1 * 2**32))
        self.transport.sendto(data[:1] + bytes(31) + stamp + stamp, addr)


@asynccontextmanager
async def time_server(ahead_s: float = 0.0) -> AsyncIterator[str]:
    """Run a time server; gives its place."""
    loop = asyncio.get_running_loop()
    transport, _ = await loop.create_datagram_endpoint(
        lambda: TimeServer(ahead_s), local_addr=("127.0.0.1", 0)
    )
    try:
        yield f"127.0.0.1:{transport.get_extra_info('sockname')[1]}"
    finally:
        transport.close()


@contextmanager
def unprivileged(port: str) -> Iterator[None]:
    """Be a user without rights to a port; root is one again afterwards."""
    if sys.platform == "win32" or os.geteuid():
        Path(port).chmod(0)
        yield
        return
    Path(port).chmod(0o600)
    os.seteuid(65_534)
    try:
        yield
    finally:
        os.seteuid(0)


@contextmanager
def full_disk(limit_bytes: int = 65_536) -> Iterator[None]:
    """Let no file of this process grow beyond a limit, as on a disk that is full."""
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
