"""Harness of the conformance battery: two drivers on emulated modems with real ports."""

import os

from zacoustic.bytestream import ByteStream
from zacoustic.link import Link
from zacoustic.link.emulation.running import RunningEmulation
from zacoustic.link.emulation.server import EmulationServer
from zacoustic.testing.proxy import StreamProxy
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.emulator import EmulatedFleet, scenario_of
from zacoustic_evologics.link import EvologicsLink


class EvologicsHarness:
    """Two emulated modems 150 m apart.

    Args:
        config: Settings of both drivers.
        interpreter: Who reads on the ports.
        is_serial: On pseudo-terminals; otherwise by TCP through proxies that can be cut.
    """

    addresses = (1, 2)
    link_type = EvologicsLink

    def __init__(
        self,
        config: EvologicsConfig | None = None,
        *,
        interpreter: Interpreter = Interpreter.NET,
        is_serial: bool = False,
    ) -> None:
        self._config = config or EvologicsConfig()
        self._interpreter = interpreter
        self._is_serial = is_serial
        self._proxies: list[StreamProxy] = []

    async def set_up(self) -> tuple[Link, Link]:
        fleet = EmulatedFleet(scenario_of(2, spacing_m=150.0), interpreter=self._interpreter)
        self._server = EmulationServer(RunningEmulation(fleet))
        near, far = [await self._link(address) for address in self.addresses]
        return near, far

    async def tear_down(self) -> None:
        for proxy in self._proxies:
            await proxy.close()
        await self._server.close()

    async def cut(self) -> bool:
        for proxy in self._proxies:
            proxy.cut()
        return bool(self._proxies)

    async def inject(self, nonsense: bytes) -> bool:
        for proxy in self._proxies:
            proxy.inject(nonsense)
        return bool(self._proxies)

    async def _link(self, address: int) -> Link:
        if self._is_serial:
            locator = self._server.open_terminal(address).locator
        else:
            place = await self._server.listen(address, "127.0.0.1", 0)
            host, port = place.locator.removeprefix("tcp:").rsplit(":", 1)
            proxy = StreamProxy(host, int(port))
            await proxy.open()
            self._proxies.append(proxy)
            locator = f"tcp:{proxy.address}"
        stream = ByteStream(locator, first_delay_s=0.05, last_delay_s=0.2)
        return self.link_type(stream, self._config, node_address=address)


HAS_TERMINALS = hasattr(os, "openpty")
