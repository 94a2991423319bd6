"""Call a remote service; an error of the handler reaches the caller.

Both nodes on a simulated channel:   python examples/02_service.py
One on a modem, with its name:   python examples/02_service.py auv1 --link sim/127.0.0.1:7000
"""

import argparse
import asyncio
from typing import Literal

import msgspec

from zacoustic import CallContext, CallTimeoutError, Node, ServiceError
from zacoustic.link import Link
from zacoustic.testing import NodeSpec, Scenario
from zacoustic_sim import SimMedium

FLEET = __file__.replace(".py", ".json5")  # ids, ranges and steps are there


class Arm:
    """A service is a class with two classes in it, as in ROS."""

    class Request(msgspec.Struct):
        """Hold something."""

        tool: Literal["gripper", "sampler"]
        force: float

    class Response(msgspec.Struct):
        """It is held."""

        held_s: float


async def hold(request: Arm.Request, context: CallContext) -> Arm.Response:
    print(f"auv1: node {context.client} asks for {request}")
    if request.tool == "sampler":
        raise RuntimeError("the sampler is full")
    if request.force > 40:
        await asyncio.Event().wait()  # a handler that never comes back
    return Arm.Response(held_s=2.5)


async def auv1(link: Link | str) -> None:
    async with Node("auv1", config=FLEET, link=link) as node:
        node.create_service(Arm, "auv1/arm", hold)
        await asyncio.Event().wait()


async def shore(link: Link | str, timeout_s: float) -> None:
    async with Node("shore", config=FLEET, link=link) as node:
        client = node.create_client(Arm, "auv1/arm")
        easy, full = Arm.Request("gripper", 10.0), Arm.Request("sampler", 5.0)
        for request in (easy, full, Arm.Request("gripper", 50.0)):
            try:
                print("shore:", await client.call(request, timeout_s=timeout_s))
            except (ServiceError, CallTimeoutError) as error:
                print("shore:", type(error).__name__, error)


async def simulate(time_scale: float = 20.0) -> None:
    nodes = tuple(NodeSpec(address=n, position=(1000.0 * n, 0.0, 20.0)) for n in (1, 2))
    medium = SimMedium(Scenario(nodes=nodes, channel="none"), time_scale=time_scale)
    serving = asyncio.create_task(auv1(medium.link(2)))
    await shore(medium.link(1), timeout_s=10 / time_scale)
    serving.cancel()
    await asyncio.wait([serving])
    medium.close()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", nargs="?", choices=["shore", "auv1"])
    parser.add_argument("--link", help="locator of the modem")
    given = parser.parse_args()
    if given.link is None:
        asyncio.run(simulate())
    else:
        asyncio.run(auv1(given.link) if given.name == "auv1" else shore(given.link, 30.0))
