"""Publish reliably over a channel that loses a third of all frames, and learn the outcomes.

Both nodes on a simulated channel:   python examples/07_reliable.py
One on a modem, with its name:   python examples/07_reliable.py auv1 --link sim/127.0.0.1:7000
"""

import argparse
import asyncio

from zacoustic import Node
from zacoustic.link import Link
from zacoustic.testing import scenario_from_mapping
from zacoustic_sim import SimMedium

FLEET = __file__.replace(".py", ".json5")  # has reliability and depth
CHANNEL = {
    "channel": "none",
    "loss": {"frame": 0.33},
    "nodes": [
        {"address": 1, "position": [0, 0, 5]},
        {"address": 2, "position": [1000, 0, 20]},
    ],
}


async def auv1(link: Link | str) -> None:
    async with Node("auv1", config=FLEET, link=link) as node:
        for topic in ("auv1/waypoint", "auv1/speed"):
            node.create_subscription(
                bytes, topic, lambda each: print("auv1:", each.key, each.value)
            )
        await asyncio.Event().wait()


async def shore(link: Link | str) -> None:
    async with Node("shore", config=FLEET, link=link) as node:
        # A list of things to do: each of them arrives, in order.
        waypoints = node.create_publisher(bytes, "auv1/waypoint")
        deliveries = [waypoints.publish(b"waypoint %d" % number) for number in range(5)]
        # A set-point: only the newest is worth something.
        speed = node.create_publisher(bytes, "auv1/speed")
        deliveries += [speed.publish(b"%d cm/s" % value) for value in (50, 80, 120)]
        for delivery in deliveries:
            if delivery is not None:  # it is None for a best-effort topic
                outcome = await delivery
                print(f"shore: {delivery.key}: {outcome.value}, missing at {delivery.missing}")


async def simulate(time_scale: float = 20.0) -> None:
    medium = SimMedium(scenario_from_mapping(CHANNEL, source="WATER"), time_scale=time_scale)
    listening = asyncio.create_task(auv1(medium.link(2)))
    await shore(medium.link(1))
    listening.cancel()
    await asyncio.wait([listening])
    medium.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="?", choices=["shore", "auv1"])
    parser.add_argument("--link", help="locator of the modem")
    given = parser.parse_args()
    if given.link is None:
        asyncio.run(simulate())
    else:
        asyncio.run(auv1(given.link) if given.name == "auv1" else shore(given.link))
