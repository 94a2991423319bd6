"""A stand-in with its sockets, links to it, and a harness for the battery."""

import random
from collections.abc import Awaitable, Callable
from typing import Any

from tests.runtime.loop_checks import run
from zacoustic.link import Link
from zacoustic.testing.linkpair import Side
from zacoustic.testing.proxy import StreamProxy
from zacoustic_desert.channel import SampleChannel
from zacoustic_desert.config import DesertConfig
from zacoustic_desert.link import DesertLink
from zacoustic_desert.server import StandInServer
from zacoustic_desert.standin import Observer, StandIn, StandInConfig

SCALE = 50.0


def config(scale: float = SCALE, **settings: Any) -> DesertConfig:
    """Return the settings for a DESERT that is so many times faster."""
    usual: dict[str, Any] = {
        "period_s": 0.2 / scale,
        "listen_s": 0.4 / scale,
        "bit_rate_bps": 48_000.0 * scale,
        "latency_s": 1.0 / scale,
    }
    return DesertConfig(**(usual | settings))


def standin(
    *,
    nodes: int = 2,
    seed: int = 1,
    loss: float = 0.0,
    half_duplex: bool = False,
    observer: Observer | None = None,
    **settings: Any,
) -> StandIn:
    """Return a stand-in in the water of the sample; quiet unless told otherwise."""
    medium = SampleChannel(nodes, random.Random(f"w{seed}"), loss=loss, half_duplex=half_duplex)
    return StandIn(medium, StandInConfig(**settings), rng=random.Random(seed), observer=observer)


def serve(
    body: Callable[[StandInServer], Awaitable[None]],
    behind: StandIn | None = None,
    *,
    listens: bool = True,
    scale: float = SCALE,
    limit_s: float = 20.0,
) -> None:
    """Run a test on the sockets of a stand-in; nothing may be left behind."""

    async def main() -> None:
        server = StandInServer(behind or standin(), time_scale=scale)
        await server.open(start_delay_s=0.0 if listens else None)
        try:
            await body(server)
        finally:
            await server.close()
            await server.close()

    run(main(), limit_s=limit_s)


def side(server: StandInServer, node: int, **settings: Any) -> Side:
    """Return a link to a node, not open yet."""
    return Side(DesertLink(server.addresses[node], config(**settings)), node + 1)


class DesertHarness:
    """Two links to a stand-in, each through a proxy that can cut and disturb."""

    addresses = (1, 2)

    def __init__(self, **settings: Any) -> None:
        self._config = config(**settings)

    async def set_up(self) -> tuple[Link, Link]:
        behind = standin(max_read_length=self._config.max_read_length)
        self.server = StandInServer(behind, time_scale=SCALE)
        await self.server.open()
        self.proxies = []
        for address in self.server.addresses:
            host, _, port = address.rpartition(":")
            self.proxies.append(StreamProxy(host, int(port)))
        for proxy in self.proxies:
            await proxy.open()
        near, far = (DesertLink(proxy.address, self._config) for proxy in self.proxies)
        return near, far

    async def tear_down(self) -> None:
        for proxy in self.proxies:
            await proxy.close()
        await self.server.close()

    async def cut(self) -> bool:
        for proxy in self.proxies:
            await proxy.wait_connected()
            proxy.cut()
        return True

    async def inject(self, nonsense: bytes) -> bool:
        for proxy in self.proxies:
            await proxy.wait_connected()
            proxy.inject(nonsense)
        return True
