"""Three nodes on one DESERT whose modules send to the broadcast address: each hears both others.

Run it: python examples/17_desert_three.py
Here the stand-in plays DESERT; docs/links.md has the lines of a script for the original.
"""

import asyncio
import contextlib
import random

from zacoustic import Node
from zacoustic_desert.channel import SampleChannel
from zacoustic_desert.server import StandInServer
from zacoustic_desert.standin import StandIn

NODES = {1: "shore", 2: "auv1", 3: "auv2"}
STATES = {address: 10 + address for address in NODES}  # stream id of each node's state


async def main() -> None:
    seeded = random.Random(1)
    server = StandInServer(StandIn(SampleChannel(len(NODES), seeded), rng=seeded))
    await server.open()
    try:
        async with contextlib.AsyncExitStack() as stack:
            nodes = {
                address: await stack.enter_async_context(Node(address, link=f"desert/{place}"))
                for address, place in zip(NODES, server.addresses, strict=True)
            }
            speaking = [asyncio.create_task(speak(*each)) for each in nodes.items()]
            async with asyncio.timeout(100), asyncio.TaskGroup() as tasks:
                for each in nodes.items():
                    tasks.create_task(hear_both(*each))
            for task in speaking:
                task.cancel()
            await asyncio.wait(speaking)
    finally:
        await server.close()


async def speak(address: int, node: Node) -> None:
    """Publish a state every few seconds, each node at its own pace."""
    name = f"{NODES[address]}/state"
    publisher = node.create_publisher(bytes, name, stream_id=STATES[address])
    while True:
        publisher.publish(f"{NODES[address]} is here".encode())
        await asyncio.sleep(2.0 + address)


async def hear_both(address: int, node: Node) -> None:
    """Wait for a state of each other node."""
    for other in NODES.keys() - {address}:
        name = f"{NODES[other]}/state"
        sample = await node.subscribe(bytes, name, stream_id=STATES[other]).receive()
        print(f"{NODES[address]} hears from node {sample.source}: {sample.value!r}")


if __name__ == "__main__":
    asyncio.run(main())
