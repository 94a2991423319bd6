"""Publish and subscribe with modems and nothing else: no Zenoh, no configuration file.

Both nodes on a simulated channel:   python examples/01_pub_sub.py
One on a modem, with its role:   python examples/01_pub_sub.py vehicle --link sim/127.0.0.1:7000
"""

import argparse
import asyncio
import itertools
from typing import Annotated, Literal

import msgspec

from zacoustic import Bounds, Node, Qos, Stamp
from zacoustic.link import Link
from zacoustic.testing import NodeSpec, Scenario
from zacoustic_sim import SimMedium

ADDRESSES = {"shore": 1, "vehicle": 2}
NAV_ID = 10  # on the channel a topic is one byte, the same on all nodes


class Nav(msgspec.Struct):
    """Where the vehicle is. Bounds and steps make values small, and are checked on both sides."""

    lat: Annotated[float, Bounds(-90, 90, step=1e-6, unit="deg")]
    lon: Annotated[float, Bounds(-180, 180, step=1e-6, unit="deg")]
    depth: Annotated[float, Bounds(0, 1000, step=0.1, unit="m")]
    mode: Literal["idle", "survey", "abort"] = "survey"


# The newest sample only, and one byte with its age when it is sent.
LATEST = Qos(depth=1, stamp=Stamp.AGE)


async def vehicle(link: Link | str, period_s: float) -> None:
    async with Node(ADDRESSES["vehicle"], link=link) as node:
        publisher = node.create_publisher(Nav, "auv1/nav", LATEST, stream_id=NAV_ID)
        for number in itertools.count():
            publisher.publish(Nav(lat=54.32 + number * 1e-4, lon=10.14, depth=10.0 + number))
            await asyncio.sleep(period_s)
            sent = sum(entry.transmitted_bytes for entry in node.ledger())
            print(f"vehicle: {node.stats.frames_transmitted} frames, {sent} bytes")


async def shore(link: Link | str, samples: int) -> None:
    async with Node(ADDRESSES["shore"], link=link) as node:
        subscription = node.subscribe(Nav, "auv1/nav", LATEST, stream_id=NAV_ID)
        for _ in range(samples):
            sample = await subscription.receive()
            print(f"shore: {sample.value} from node {sample.source}, {sample.age_s} s old")


async def simulate(time_scale: float = 20.0) -> None:
    nodes = tuple(NodeSpec(address=n, position=(1000.0 * n, 0.0, 20.0)) for n in (1, 2))
    medium = SimMedium(Scenario(nodes=nodes, channel="none"), time_scale=time_scale)
    publishing = asyncio.create_task(vehicle(medium.link(2), period_s=5.0 / time_scale))
    await shore(medium.link(1), samples=5)
    publishing.cancel()
    await asyncio.wait([publishing])
    medium.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("role", nargs="?", choices=list(ADDRESSES))
    parser.add_argument("--link", help="locator of the modem")
    arguments = parser.parse_args()
    if arguments.link is None:
        asyncio.run(simulate())
    elif arguments.role == "vehicle":
        asyncio.run(vehicle(arguments.link, period_s=5.0))
    else:
        asyncio.run(shore(arguments.link, samples=100))
