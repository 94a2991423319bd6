"""Emulated modems on their ports, and beside them the gateway's DirectIP for a shore."""

import asyncio
from typing import Final

from zacoustic.link.emulation.running import RunningEmulation
from zacoustic.link.emulation.server import EmulationServer
from zacoustic.link.serving import cannot_listen, place_name
from zacoustic_iridium.directip import (
    HEAD_BYTES,
    Confirmed,
    ForModem,
    FromModem,
    decode,
    encode,
    whole_bytes,
)
from zacoustic_iridium.emulator.fleet import EmulatedSbdFleet
from zacoustic_iridium.emulator.gateway import EmulatedGateway
from zacoustic_iridium.emulator.isu import EmulatedIsu, IsuFaults

_AGAIN_S: Final = 1.0


class SbdServer:
    """Modems, each on its places, and the gateway.

    Args:
        modems: How many; their addresses are 1, 2, …
        shore: Where the gateway delivers by DirectIP; None: modems write to each other.
        session_s: Shortest and longest session, s.
        faults: What goes wrong.
        seed: Of all draws.
        time_scale: How many times faster than real.
    """

    def __init__(
        self,
        modems: int = 2,
        *,
        shore: tuple[str, int] | None = None,
        session_s: tuple[float, float] = (6.0, 30.0),
        faults: IsuFaults | None = None,
        seed: int = 1,
        time_scale: float = 1.0,
    ) -> None:
        self._shore = shore
        self.gateway = EmulatedGateway(None if shore is None else self._deliver)
        self._fleet = EmulatedSbdFleet(
            self.gateway, modems, session_s=session_s, faults=faults or IsuFaults(), seed=seed
        )
        self._running = RunningEmulation(self._fleet, time_scale=time_scale)
        self.modems = EmulationServer(self._running)
        """Serves the modems."""
        self._server: asyncio.Server | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self.places: list[str] = []
        """HOST:PORT of each modem, once `open` has opened them."""

    @property
    def isus(self) -> list[EmulatedIsu]:
        """The modems."""
        return list(self._fleet.isus.values())

    @property
    def directip(self) -> str:
        """HOST:PORT for messages to the modems, once open."""
        assert self._server is not None
        return place_name(*self._server.sockets[0].getsockname()[:2])

    async def open(self, host: str = "127.0.0.1") -> None:
        """Listen on free ports, one a modem and one for the gateway.

        Raises:
            LinkOpenError: The host is none of this computer.
        """
        for address in self._fleet.isus:
            place = await self.modems.listen(address, host, 0)
            self.places.append(place.locator.removeprefix("tcp:"))
        await self.open_gateway(host, 0)

    async def open_gateway(self, host: str, port: int) -> None:
        """Listen for messages to the modems; port 0 takes any free one.

        Raises:
            LinkOpenError: The address cannot be used.
        """
        try:
            self._server = await asyncio.start_server(self._accept, host, port)
        except OSError as error:
            await self.close()
            raise cannot_listen(host, port, error, rival="another emulator") from error

    async def close(self) -> None:
        """Release all ports; may be repeated."""
        for task in self._tasks:
            task.cancel()
        if self._tasks:
            await asyncio.wait(self._tasks)
        await self.modems.close()
        if self._server is not None:
            self._server.close()
            await self._server.wait_closed()
            self._server = None

    # Below the methods above

    def _deliver(self, message: FromModem) -> None:
        task = asyncio.get_running_loop().create_task(self._deliver_until_taken(message))
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _deliver_until_taken(self, message: FromModem) -> None:
        assert self._shore is not None
        while True:
            try:
                _, writer = await asyncio.open_connection(*self._shore)
            except OSError:
                await asyncio.sleep(_AGAIN_S)
                continue
            writer.write(encode(message))
            writer.close()
            return

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await reader.readexactly(HEAD_BYTES)
            size_bytes = whole_bytes(head)
            if size_bytes is not None:
                message = decode(head + await reader.readexactly(size_bytes - HEAD_BYTES))
                if isinstance(message, ForModem):
                    status = self.gateway.queue(message.imei, message.data)
                    self._running.changed_outside()  # it rings
                    writer.write(encode(Confirmed(message.client_id, status)))
        except EOFError:
            pass
        finally:
            writer.close()
