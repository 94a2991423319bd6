"""The same modems behind real sockets and pseudo-terminals, on a fast clock."""

import asyncio
import sys

import pytest

from tests.runtime.loop_checks import run
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link.emulation.running import RunningEmulation
from zacoustic.link.emulation.server import EmulationServer, Place
from zacoustic_evologics import Interpreter
from zacoustic_evologics.emulator import EmulatedFleet, scenario_of

FAST = 50.0


def server_of(modems: int = 2, interpreter: Interpreter = Interpreter.NET) -> EmulationServer:
    fleet = EmulatedFleet(scenario_of(modems, spacing_m=1500.0), interpreter=interpreter)
    return EmulationServer(RunningEmulation(fleet, time_scale=FAST))


def place_of(locator: str) -> tuple[str, int]:
    _, host, port = locator.split(":")
    return host, int(port)


async def connect(place: Place) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection(*place_of(place.locator))


def test_two_tcp_clients_exchange_a_message_through_the_medium() -> None:
    async def main() -> None:
        server = server_of()
        near = await server.listen(1, "127.0.0.1", 0)
        far = await server.listen(2, "127.0.0.1", 0)
        near_reader, near_writer = await connect(near)
        far_reader, far_writer = await connect(far)
        far_writer.write(b"AT?AL\n")
        assert await far_reader.readline() == b"2\r\n"
        loop = asyncio.get_running_loop()
        started_at = loop.time()
        near_writer.write(b"AT*SENDIM,64,2,ack," + b"x" * 64 + b"\n")
        assert await near_reader.readline() == b"OK\r\n"
        assert (await far_reader.readline()).startswith(b"RECVIM,64,1,2,ack,860338,")
        assert await near_reader.readline() == b"DELIVEREDIM,2\r\n"
        assert loop.time() - started_at >= 3.1 / FAST
        near_writer.close()
        far_writer.close()
        await server.close()

    run(main())


def test_several_clients_share_a_modem_and_may_come_and_go() -> None:
    async def main() -> None:
        server = server_of()
        place = await server.listen(1, "127.0.0.1", 0)
        first, second = await connect(place), await connect(place)
        for reader, writer in (first, second):
            writer.write(b"AT@ZX1\nAT?ZX\n")
            assert await reader.readline() == b"OK\r\n"
            assert await reader.readline() == b"1\r\n"
        first[1].close()
        await first[1].wait_closed()
        second[1].write(b"AT*SENDIM,1,2,noack,x\n")
        assert await second[0].readline() == b"OK\r\n"
        assert (await second[0].readline()).startswith(b"SENDSTART,2,im,")
        second[1].close()
        await server.close()
        await server.close()

    run(main())


def test_reset_closes_the_connection_and_nobody_listens_until_the_modem_is_back() -> None:
    async def main() -> None:
        server = server_of()
        place = await server.listen(1, "127.0.0.1", 0)
        reader, writer = await connect(place)
        writer.write(b"ATZ0\n")
        assert await reader.read() == b""
        writer.close()
        with pytest.raises(ConnectionError):
            await connect(place)
        while True:
            try:
                reader, writer = await connect(place)
            except ConnectionError:
                await asyncio.sleep(0)
                continue
            break
        writer.write(b"AT?AL\n")
        assert await reader.readline() == b"1\r\n"
        writer.close()
        await server.close()

    run(main())


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_serial_client_opens_a_pseudo_terminal_again_and_again() -> None:
    import serial

    def talk(path: str) -> list[bytes]:
        with serial.Serial(path, 19_200, timeout=5, exclusive=True) as port:
            port.write(b"+++AT?AL\r")
            first = port.readline()
            port.write(b"+++AT*SENDIM,4,2,ack,a\r\nb\r")
            return [first, port.readline(), port.readline()]

    async def main() -> None:
        server = server_of(interpreter=Interpreter.AT)
        place = server.open_terminal(1)
        path = place.locator.removeprefix("serial:")
        for _ in range(2):
            assert await asyncio.to_thread(talk, path) == [
                b"+++AT?AL:1:1\r\n", b"+++AT*SENDIM:2:OK\r\n", b"+++AT:13:DELIVEREDIM,2\r\n",
            ]  # fmt: skip
        await server.close()
        # The thread of `to_thread` belongs to the loop.
        await asyncio.get_running_loop().shutdown_default_executor()

    run(main())


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_terminal_that_nobody_reads_does_not_block_the_fleet() -> None:
    async def main() -> None:
        server = server_of()
        silent = server.open_terminal(1).locator.removeprefix("serial:")
        place = await server.listen(1, "127.0.0.1", 0)
        with open(silent, "wb", buffering=0) as port:  # noqa: ASYNC230
            for _ in range(100):
                port.write(b"AT&V\n")
                await asyncio.sleep(0)
            reader, writer = await connect(place)
            writer.write(b"AT?AL\n")
            assert await reader.readline() == b"1\r\n"
            writer.close()
        await server.close()

    run(main())


def test_wrong_places_and_scales_are_errors() -> None:
    async def main() -> None:
        server = server_of()
        place = await server.listen(1, "127.0.0.1", 0)
        with pytest.raises(LinkOpenError, match="cannot listen"):
            await server.listen(2, *place_of(place.locator))
        await server.close()

    run(main())
    with pytest.raises(ConfigError, match="time scale"):
        RunningEmulation(EmulatedFleet(scenario_of(1)), time_scale=0.0)
    with pytest.raises(ConfigError, match="modems"):
        scenario_of(255)
    with pytest.raises(ConfigError, match="setting XY"):
        EmulatedFleet(scenario_of(1), settings={"XY": 1})
    with pytest.raises(ConfigError, match="setting AM is 3"):
        EmulatedFleet(scenario_of(1), settings={"AM": 3})
