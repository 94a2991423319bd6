import asyncio
import contextlib

import pytest

from tests.links.desert.desert_rig import serve, side, standin
from tests.runtime.loop_checks import run
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic_desert.server import StandInServer


def place(server: StandInServer, node: int) -> tuple[str, int]:
    host, _, port = server.addresses[node].rpartition(":")
    return host, int(port)


def test_port_refuses_until_it_listens_and_after_a_crash() -> None:
    async def body(server: StandInServer) -> None:
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(*place(server, 0))
        server.listen()
        reader, writer = await asyncio.open_connection(*place(server, 0))
        await server.crash()
        with contextlib.suppress(ConnectionResetError):
            assert await reader.read() == b""
        writer.transport.abort()
        with pytest.raises(ConnectionRefusedError):
            await asyncio.open_connection(*place(server, 0))
        server.listen()
        _, writer = await asyncio.open_connection(*place(server, 0))
        writer.transport.abort()

    serve(body, listens=False)


def test_port_listens_after_its_start_delay() -> None:
    async def main() -> None:
        server = StandInServer(standin(), time_scale=50.0)
        await server.open(start_delay_s=2.0)
        near = side(server, 0)
        await near.open()
        assert "Connection refused" in str(near.receiver.states)
        await near.close()
        await server.close()
        early = StandInServer(standin())
        await early.open(start_delay_s=1000.0)
        await early.close()

    run(main())


def test_bytes_that_the_backlog_holds_are_sent_later() -> None:
    async def body(server: StandInServer) -> None:
        far_reader, far = await asyncio.open_connection(*place(server, 1))
        first_reader, first = await asyncio.open_connection(*place(server, 0))
        second_reader, second = await asyncio.open_connection(*place(server, 0))
        second.write(b"second")
        first.write(b"first")
        assert await far_reader.readexactly(5) == b"first"
        far.write(b"to the first")
        assert await first_reader.readexactly(12) == b"to the first"
        first.close()
        assert await far_reader.readexactly(6) == b"second"
        far.write(b"to the second")
        assert await second_reader.readexactly(13) == b"to the second"
        for writer in (first, second, far):
            writer.close()
            await writer.wait_closed()

    serve(body)


def test_port_in_use_is_a_clear_error() -> None:
    async def body(server: StandInServer) -> None:
        _, port = place(server, 0)
        second = StandInServer(standin(), ports=[0, port])
        with pytest.raises(LinkOpenError, match=f"cannot listen at 127.0.0.1:{port}: Address"):
            await second.open()
        nowhere = StandInServer(standin(), host="no such host")
        with pytest.raises(LinkOpenError, match="cannot listen at no such host:0: "):
            await nowhere.open()

    serve(body)


def test_client_that_does_not_read_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("zacoustic_desert.server.UNREAD_LIMIT_BYTES", 10_000)
    behind = standin(max_read_length=4096, wait_s=0.0, listen_s=0.0)

    async def body(server: StandInServer) -> None:
        _reader, deaf = await asyncio.open_connection(*place(server, 1), limit=1)
        _, writer = await asyncio.open_connection(*place(server, 0))
        left = False
        while not left:
            writer.write(bytes(400_000))
            await writer.drain()
            done = behind.counts["sent"] + 90
            while behind.counts["sent"] < done and not left:
                await asyncio.sleep(0)
                left = behind.counts["left"] > 0
        deaf.transport.abort()
        writer.close()
        await writer.wait_closed()

    serve(body, behind, scale=5000.0)


def test_wrong_arguments_are_named() -> None:
    with pytest.raises(ConfigError, match="3 ports for 2 nodes"):
        StandInServer(standin(), ports=[0, 0, 0])
    with pytest.raises(ConfigError, match="time scale is 0"):
        StandInServer(standin(), time_scale=0.0)
