"""Two gateways with a client at each, and the command line beside them."""

import asyncio

import zenoh

from tests.gateway.networks import Channel, LocalNetwork
from zacoustic.app.cli import main


class Pair:
    """A gateway on the shore, one on the vehicle, a client at each."""

    channel: Channel
    shore_network: LocalNetwork
    auv_network: LocalNetwork
    shore: zenoh.Session
    auv: zenoh.Session

    @property
    def where(self) -> list[str]:
        """The arguments of a verb on the shore."""
        return ["--connect", f"tcp/127.0.0.1:{self.shore_network.port}"]


async def verb(*arguments: str) -> int:
    """Run the command line in a thread of its own."""
    return await asyncio.to_thread(main, list(arguments))
