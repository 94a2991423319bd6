"""A ROS 2 client written by others, across two gateways on emulated modems.

It finds by tokens alone what lives across the channel; publishes, subscribes, calls and serves.
"""

import asyncio
import json
import os
import sys
from contextlib import AsyncExitStack
from pathlib import Path
from typing import Any, Final

from tests.gateway.networks import LIMIT_S, config_of, free_port, run, zenoh_config
from zacoustic.bytestream import ByteStream
from zacoustic.gateway import Gateway
from zacoustic.link.emulation.running import RunningEmulation
from zacoustic.link.emulation.server import EmulationServer
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.emulator import EmulatedFleet, scenario_of
from zacoustic_evologics.link import EvologicsLink

DOMAIN: Final = 5
TWIST: Final = "geometry_msgs/msg/Twist"
STRING: Final = "std_msgs/msg/String"
ADD: Final = "example_interfaces/srv/AddTwoInts"
DEFINITIONS: Final = {
    "std_msgs/msg/String.msg": "string data\n",
    "geometry_msgs/msg/Vector3.msg": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/msg/Twist.msg": "Vector3 linear\nVector3 angular\n",
    "builtin_interfaces/msg/Time.msg": "int32 sec\nuint32 nanosec\n",
    "service_msgs/msg/ServiceEventInfo.msg": (
        "uint8 event_type\nbuiltin_interfaces/Time stamp\nchar[16] client_gid\n"
        "int64 sequence_number\n"
    ),
    "example_interfaces/srv/AddTwoInts.srv": "int64 a\nint64 b\n---\nint64 sum\n",
}
SECTION: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "ros": {"domain": DOMAIN},
    "overlays": [
        {"type": TWIST, "fields": [{"field": "*.*", "range": [-2, 2], "step": 0.01}]},
    ],
    "streams": [
        {
            "id": 11,
            "topic": "/auv1/cmd_vel",
            "type": TWIST,
            "ros": {},
            "codec": "packed",
            "publishers": [1],
            "reliability": "reliable",
        },
        {
            "id": 12,
            "topic": "/auv1/log",
            "type": STRING,
            "ros": {},
            "publishers": [2],
            "reliability": "reliable",
        },
        {"id": 20, "service": "/add", "type": ADD, "server": 2, "ros": {}},
    ],
}


class Peer:
    """One process with the client."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process

    async def next(self) -> dict[str, Any]:
        """Wait for what it says next."""
        assert self._process.stdout is not None
        async with asyncio.timeout(3 * LIMIT_S):
            line = await self._process.stdout.readline()
        assert line, "it has ended"
        said: dict[str, Any] = json.loads(line)
        return said

    async def do(self, order: str, **what: Any) -> None:
        """Have it do something; returns when that is done."""
        self.begin(order, **what)
        assert await self.next() == {"done": order}

    def begin(self, order: str, **what: Any) -> None:
        """Have it do something."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps({"do": order, **what}).encode() + b"\n")

    async def close(self) -> None:
        """End it."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        async with asyncio.timeout(LIMIT_S):
            await self._process.wait()


async def peer(stack: AsyncExitStack, port: int, folder: Path) -> Peer:
    script = Path(__file__).parents[1] / "ros" / "sdkpeer.py"
    process = await asyncio.create_subprocess_exec(
        sys.executable,
        str(script),
        str(port),
        str(DOMAIN),
        str(folder),
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        # Else it looks for definitions on the net, and changes the user's git configuration.
        env={**os.environ, "GIT_ALLOW_PROTOCOL": "none", "HOME": str(folder)},
    )
    started = Peer(process)
    stack.push_async_callback(started.close)
    assert await started.next() == {"ready": True}
    return started


def test_it_publishes_subscribes_calls_and_serves_across_emulated_modems(tmp_path: Path) -> None:
    for name, text in DEFINITIONS.items():
        file = tmp_path / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)

    async def main() -> None:
        fleet = EmulatedFleet(scenario_of(2, spacing_m=150.0))
        server = EmulationServer(RunningEmulation(fleet))
        ports = [free_port(), free_port()]
        async with AsyncExitStack() as stack:
            stack.push_async_callback(server.close)
            for address, port in zip((1, 2), ports, strict=True):
                place = await server.listen(address, "127.0.0.1", 0)
                stream = ByteStream(place.locator, first_delay_s=0.05, last_delay_s=0.2)
                link = EvologicsLink(stream, EvologicsConfig(), node_address=address)
                config = config_of(address, zenoh_config("router", listen=port), SECTION)
                gateway = Gateway(config, link=link, notify=lambda _: None)
                await stack.enter_async_context(gateway)
            shore = await peer(stack, ports[0], tmp_path)
            auv = await peer(stack, ports[1], tmp_path)

            shore.begin("list")
            listed = await shore.next()
            assert listed["services"] == {"/add": [ADD]}
            assert listed["topics"]["/auv1/log"] == [STRING]
            assert listed["topics"]["/auv1/cmd_vel"] == [TWIST]

            await auv.do("subscribe", topic="/auv1/cmd_vel", type=TWIST)
            await auv.do("serve", service="/add")
            await auv.do("advertise", topic="/auv1/log", type=STRING)
            await shore.do("subscribe", topic="/auv1/log", type=STRING)
            await shore.do("advertise", topic="/auv1/cmd_vel", type=TWIST)
            auv.begin("list")  # behind that the router knows what was declared
            await auv.next()
            shore.begin("list")
            await shore.next()

            await shore.do("publish", topic="/auv1/cmd_vel", x=1.25, z=-0.5)
            assert await auv.next() == {"heard": [1.25, -0.5]}
            await auv.do("publish", topic="/auv1/log", data="hello")
            assert await shore.next() == {"heard": "hello"}
            shore.begin("call", service="/add", a=40, b=2)
            assert await auv.next() == {"asked": [40, 2]}
            assert await shore.next() == {"answer": 42}

    run(main(), limit_s=240.0)
