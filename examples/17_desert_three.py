"""Three nodes on one DESERT whose modules send to the broadcast address: each hears both others.

Run it: python examples/17_desert_three.py
Here the stand-in plays DESERT; docs/links.md has the lines of a script for the original.
"""

import asyncio
import contextlib
import socket

from zacoustic import Node

NODES = {1: "shore", 2: "auv1", 3: "auv2"}
STATES = {address: 10 + address for address in NODES}  # stream id of each node's state


async def main() -> None:
    places = [f"127.0.0.1:{port}" for port in free_ports(len(NODES))]
    listen = [word for place in places for word in ("--listen", place)]
    modems = ["zacoustic", "run", "modems", "desert", "--modems", str(len(NODES)), *listen]
    quiet = asyncio.subprocess.DEVNULL
    desert = await asyncio.create_subprocess_exec(*modems, stdout=quiet)
    try:
        async with contextlib.AsyncExitStack() as stack:
            nodes = {  # each waits until it is connected
                address: await stack.enter_async_context(Node(address, link=f"desert/{place}"))
                for address, place in zip(NODES, places, strict=True)
            }
            speaking = [asyncio.create_task(speak(*each)) for each in nodes.items()]
            async with asyncio.timeout(100), asyncio.TaskGroup() as tasks:
                for each in nodes.items():
                    tasks.create_task(hear_both(*each))
            for task in speaking:
                task.cancel()
            await asyncio.wait(speaking)
    finally:
        desert.terminate()
        await desert.wait()


def free_ports(count: int) -> list[int]:
    with contextlib.ExitStack() as stack:
        probes = [stack.enter_context(socket.create_server(("127.0.0.1", 0))) for _ in range(count)]
        return [int(probe.getsockname()[1]) for probe in probes]


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
