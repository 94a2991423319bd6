"""The processes of a dive: two emulated S2C modems, a gateway on each side, the vehicle.

The children are started and stopped as those of `zacoustic run demo`; whoever steers sits in this
process, as a client of the shore's router. Where the vehicle says that it truly is, its modem is.
"""

import asyncio
import json
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any, Final

from examples.auv.roswords import FLEET, shore_section
from examples.auv.start import SHORE, VEHICLE, modem_at
from zacoustic import ZacousticError
from zacoustic.app.tools.demo.children import Child
from zacoustic.app.tools.demo.networks import free_ports
from zacoustic.json5 import read_json5

START_LIMIT_S: Final = 60.0
_HERE: Final = Path(__file__).parent
_ENDPOINT: Final = "tcp/127.0.0.1:7447"

Told = Callable[[str, dict[str, Any]], None]


class Expedition:
    """What is there once everything runs."""

    def __init__(
        self, shore_endpoint: str, failed: "asyncio.Future[None]", *, ros: bool = False
    ) -> None:
        self.ros = ros
        """The vehicle is a node of ROS 2."""
        self.shore_endpoint = shore_endpoint
        """Router of the shore."""
        self.failed = failed
        """Is done with an exception when a process has died."""


def fleet_text(address: int, endpoint: str, *, ros: bool) -> str:
    """Return the configuration of a gateway.

    Args:
        address: Its acoustic address.
        endpoint: Where its router listens.
        ros: The vehicle is a node of ROS 2; the shore's network stays plain Zenoh.
    """
    file = FLEET if ros else _HERE / "fleet.json5"
    if not ros:
        return file.read_text(encoding="utf-8").replace(_ENDPOINT, endpoint)
    whole: Any = read_json5(file)
    whole["listen"]["endpoints"] = [endpoint]
    section = whole["plugins"]["acoustic"]
    section["ros"]["packages"] = str(file.parent / section["ros"]["packages"])
    if address == SHORE:
        whole["plugins"]["acoustic"] = shore_section()
    return json.dumps(whole)


@asynccontextmanager
async def expedition(
    folder: Path, told: Told, *, loss: float = 0.0, ros: bool = False
) -> AsyncIterator[Expedition]:
    """Run everything but the shore's client.

    Args:
        folder: For files.
        told: Takes the objects of the processes: name, and an object.
        loss: Share of the frames that is lost, each way.
        ros: The vehicle is a node of ROS 2, and its gateway serves ROS.

    Raises:
        ZacousticError: A process does not start in time.
    """
    locators: dict[int, str] = {}
    ready: dict[str, asyncio.Event] = {}
    children: list[Child] = []
    watching: list[asyncio.Task[None]] = []
    failed: asyncio.Future[None] = asyncio.get_running_loop().create_future()

    def take(name: str, said: dict[str, Any]) -> None:
        if name == "modems" and said.get("event") == "listening":
            locators[said["address"]] = f"evologics/{said['locator']}"
        if said.get("event") in ("ready", "started") or len(locators) == 2:
            ready[name].set()
        if name == "vehicle" and said.get("event") == "place":
            here = modem_at(said["north_m"], said["east_m"], said["depth_m"])
            children[0].tell(json.dumps({"address": VEHICLE, "position": here}))
        told(name, said)

    def ended(task: asyncio.Task[None]) -> None:
        if not task.cancelled() and (error := task.exception()) and not failed.done():
            failed.set_exception(error)

    async def begin(name: str, *command: str, reads_input: bool = False) -> None:
        child = Child(name, command, take, reads_input=reads_input)
        ready[name] = asyncio.Event()
        await child.start()
        children.append(child)
        task = asyncio.create_task(child.watch())
        task.add_done_callback(ended)
        watching.append(task)
        waiting = asyncio.ensure_future(ready[name].wait())
        either: set[asyncio.Future[Any]] = {waiting, failed}
        await asyncio.wait(either, return_when=asyncio.FIRST_COMPLETED)
        waiting.cancel()
        if failed.done():
            failed.result()

    async def start() -> str:
        program = (sys.executable, "-m", "zacoustic")
        water = folder / "water.json5"
        text = (_HERE / "water.json5").read_text(encoding="utf-8")
        water.write_text(text.replace("seed: 7,", f"seed: 7, loss: {{ frame: {loss} }},"))
        modems = ("run", "modems", "evologics", "--scenario", str(water), "--listen", "127.0.0.1:0")
        await begin("modems", *program, *modems, "--positions", "-", "--json")
        endpoints = dict(
            zip(
                (SHORE, VEHICLE),
                (f"tcp/127.0.0.1:{port}" for port in free_ports(2)),
                strict=True,
            )
        )
        for address, endpoint in endpoints.items():
            file = folder / f"node{address}.json5"
            file.write_text(fleet_text(address, endpoint, ros=ros), encoding="utf-8")
            arguments = ("--address", str(address), "--link", locators[address], "--json")
            await begin(f"gateway {address}", *program, "run", "gateway", str(file), *arguments)
        vehicle = (sys.executable, "-m", "examples.auv.vehicle", endpoints[VEHICLE])
        await begin("vehicle", *vehicle, *["--ros"] * ros, reads_input=True)
        return endpoints[SHORE]

    try:
        try:
            async with asyncio.timeout(START_LIMIT_S):
                endpoint = await start()
        except TimeoutError as error:
            late = next(name for name, event in ready.items() if not event.is_set())
            raise ZacousticError(f"{late} is not ready after {START_LIMIT_S:g} s") from error
        yield Expedition(endpoint, failed, ros=ros)
    finally:
        for task in watching:
            task.cancel()
        await asyncio.gather(*watching, return_exceptions=True)
        for child in reversed(children):
            await child.stop()
        if failed.done():
            failed.exception()
