"""Two links over emulated Iridium: two modems, or a modem and its shore."""

import contextlib
import random
import socket
from typing import Final

from zacoustic.link import Link
from zacoustic.testing.proxy import StreamProxy
from zacoustic_iridium.atsea import ModemLink
from zacoustic_iridium.config import IridiumConfig
from zacoustic_iridium.emulator.fleet import FIRST_IMEI
from zacoustic_iridium.emulator.server import SbdServer
from zacoustic_iridium.link import IridiumLink
from zacoustic_iridium.onshore import ShoreLink

CONFIG: Final = IridiumConfig(max_bytes_per_day=10**9, session_s=0.3)
SESSION_S: Final = (0.05, 0.2)


class IridiumHarness:
    """Two modems that write to each other."""

    addresses = (1, 2)

    async def set_up(self) -> tuple[Link, Link]:
        self.server = SbdServer(2, session_s=SESSION_S)
        await self.server.open()
        self.proxies = []
        links = []
        for place in self.server.places:
            host, _, port = place.rpartition(":")
            proxy = StreamProxy(host, int(port))
            await proxy.open()
            self.proxies.append(proxy)
            links.append(ModemLink(f"tcp:{proxy.address}", CONFIG))
        return links[0], links[1]

    async def tear_down(self) -> None:
        for proxy in self.proxies:
            await proxy.close()
        await self.server.close()

    async def cut(self) -> bool:
        for proxy in self.proxies:
            proxy.cut()
        return True

    async def inject(self, nonsense: bytes) -> bool:
        for proxy in self.proxies:
            proxy.inject(nonsense)
        return True


class DirectIpHarness:
    """A modem, and the shore by DirectIP."""

    addresses = (1, 2)

    async def set_up(self) -> tuple[Link, Link]:
        self.server, sea, shore = await sea_and_shore()
        return sea, shore

    async def tear_down(self) -> None:
        await self.server.close()

    async def cut(self) -> bool:
        return False

    async def inject(self, nonsense: bytes) -> bool:
        return False


def _quiet_port() -> int:
    """Find a TCP port to listen on, below those that systems give to outgoing connections."""
    while True:
        port = random.SystemRandom().randrange(20_000, 32_000)
        with contextlib.suppress(OSError), socket.socket() as probe:
            probe.bind(("127.0.0.1", port))
            return port


async def sea_and_shore(config: IridiumConfig = CONFIG) -> tuple[SbdServer, IridiumLink, ShoreLink]:
    """Start an emulated modem with its gateway; return it, and both links, not open yet."""
    port = _quiet_port()
    server = SbdServer(1, shore=("127.0.0.1", port), session_s=SESSION_S)
    await server.open()
    on_shore = IridiumConfig(
        max_bytes_per_day=config.max_bytes_per_day,
        session_s=config.session_s,
        gateway=server.directip,
        imei=str(FIRST_IMEI),
    )
    shore = ShoreLink(f"directip:127.0.0.1:{port}", on_shore)
    return server, ModemLink(f"tcp:{server.places[0]}", config), shore
