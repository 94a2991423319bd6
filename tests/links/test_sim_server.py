import asyncio
import os
from collections.abc import Awaitable, Callable

import pytest

from tests.runtime.loop_checks import run, until
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.linktypes import LinkState
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link import registry
from zacoustic.testing.linkpair import RecordingReceiver, Side
from zacoustic_sim import server as server_module
from zacoustic_sim.link import SimLink
from zacoustic_sim.medium import SimMedium
from zacoustic_sim.messages import VERSION, Hello, Transmit, encode_message
from zacoustic_sim.server import STRANGERS_LIMIT, MediumServer

CHANNEL = Scenario(
    profile="ideal",
    channel="none",
    nodes=tuple(NodeSpec(address=at, position=(0.0, 0.0, 10.0)) for at in (1, 2, 3)),
)


def case(body: Callable[[MediumServer], Awaitable[None]]) -> None:
    async def main() -> None:
        server = MediumServer(SimMedium(CHANNEL))
        await server.open()
        try:
            await body(server)
        finally:
            await server.close()
            await server.close()

    run(main())


def side(server: MediumServer, address: int, settings: str = "") -> Side:
    return Side(registry.create(f"sim/{server.address}#wait_s=5{settings}", address), address)


async def raw(server: MediumServer) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    return await asyncio.open_connection(server.host, server.port)


async def hung_up(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> bytes:
    """Read to the end of a connection that the server ends."""
    said = b""
    try:
        while data := await reader.read(65_536):
            said += data
    except ConnectionError:
        pass
    writer.transport.abort()
    return said


def test_three_modems_share_the_channel() -> None:
    async def body(server: MediumServer) -> None:
        sides = [side(server, at) for at in (1, 2, 3)]
        for each in sides:
            await each.open()
        await sides[0].send(b"to all")
        for each in sides[1:]:
            await each.hears(b"to all")
        for each in sides:
            await each.close()

    case(body)


def test_second_modem_of_an_address_is_refused_with_a_reason() -> None:
    async def body(server: MediumServer) -> None:
        first, second = side(server, 1), side(server, 1)
        await first.open()
        with pytest.raises(LinkOpenError, match="node 1 is taken by another modem"):
            await second.open()
        with pytest.raises(LinkOpenError, match="no node 7; it has 1, 2, 3"):
            await side(server, 7).open()
        await first.send(b"undisturbed")
        await first.close()

    case(body)


NONSENSE = [
    b"GET / HTTP/1.1\r\n\r\n",
    bytes(range(256)),
    b"\x5a\x5e\x00\x01\xc0",
    b"\x5a\x5e\x00\x00",
    encode_message(Transmit(1, 255, b"before hello")),
    encode_message(Hello(VERSION, 2)) + encode_message(Hello(1, 3)),
    encode_message(Hello(99, 2)),
    encode_message(Hello(VERSION, 0)),
    encode_message(Hello(VERSION, 2)) + os.urandom(1000),
]


@pytest.mark.parametrize("nonsense", NONSENSE, ids=range(len(NONSENSE)))
def test_client_that_talks_nonsense_is_dropped_alone(nonsense: bytes) -> None:
    async def body(server: MediumServer) -> None:
        good = side(server, 1)
        await good.open()
        reader, writer = await raw(server)
        writer.write(nonsense)
        await hung_up(reader, writer)
        other = side(server, 2)  # the place of the bad one is free again
        await other.open()
        await good.send(b"still here")
        await other.hears(b"still here")
        await other.close()
        await good.close()

    case(body)


def test_client_may_dribble_and_leave_in_the_middle() -> None:
    async def body(server: MediumServer) -> None:
        reader, writer = await raw(server)
        for byte in encode_message(Hello(VERSION, 1)):
            writer.write(bytes([byte]))
            await writer.drain()
        assert await reader.read(1)
        writer.write(encode_message(Transmit(1, 255, b"x" * 100))[:50])
        await writer.drain()
        writer.transport.abort()
        again = side(server, 1)
        while True:  # until the server has seen that the first one is gone
            try:
                await again.open()
                break
            except LinkOpenError:
                again = side(server, 1)
        await again.close()

    case(body)


def test_connections_that_say_nothing_are_limited_in_number_and_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    async def number(server: MediumServer) -> None:
        silent = [await raw(server) for _ in range(STRANGERS_LIMIT)]
        await hung_up(*await raw(server))
        for _, writer in silent:
            writer.transport.abort()

    async def duration(server: MediumServer) -> None:
        await hung_up(*await raw(server))

    case(number)
    monkeypatch.setattr(server_module, "HELLO_LIMIT_S", 0.01)
    case(duration)


def test_client_that_does_not_read_is_dropped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server_module, "BACKLOG_LIMIT_BYTES", 10_000)

    async def body(server: MediumServer) -> None:
        _, writer = await raw(server)
        writer.transport.pause_reading()  # type: ignore[attr-defined]
        writer.write(encode_message(Hello(VERSION, 1)))
        await writer.drain()
        good = side(server, 2)
        await good.open()
        gone = [client.gone for client in server._clients if client.address == 1]
        while not gone:
            await good.send(b"let it attach")
            gone = [client.gone for client in server._clients if client.address == 1]
        while not gone[0].is_set():
            await good.send(bytes(512))
        writer.transport.abort()
        await good.close()

    case(body)


def test_absent_medium_is_waited_for_and_then_named_with_a_hint() -> None:
    async def main() -> None:
        server = MediumServer(SimMedium(CHANNEL))
        await server.open()
        address, port = server.address, server.port
        await server.close()
        link = registry.create(f"sim/{address}#wait_s=0.05", 1)
        receiver = RecordingReceiver()
        with pytest.raises(LinkOpenError) as caught:
            await link.open(receiver)
        assert str(caught.value) == (
            f"no medium at {address} within 0.05 s: Connection refused "
            f"(start it: zacoustic run medium SCENARIO --listen {address})"
        )
        assert receiver.states[0] == (LinkState.OPENING, f"waiting for the medium at {address}")
        assert receiver.states[-1] == (LinkState.OPENING, "Connection refused")

        patient = Side(registry.create(f"sim/{address}#wait_s=10", 1), 1)
        opening = asyncio.ensure_future(patient.open())
        changed = patient.receiver._changed
        await until(lambda: len(patient.receiver.states) >= 2, changed)
        late = MediumServer(SimMedium(CHANNEL), port=port)
        await late.open()
        await opening
        await patient.close()
        await late.close()

    run(main())


def test_link_survives_a_restart_of_the_medium_with_other_channel() -> None:
    async def main() -> None:
        server = MediumServer(SimMedium(CHANNEL))
        await server.open()
        near = side(server, 1)
        await near.open()
        port = server.port
        await server.close()
        await near.receiver.wait("DOWN", lambda: not near.is_up, 10.0)
        other = Scenario(nodes=CHANNEL.nodes, profile="ahoi", channel="none")
        restarted = MediumServer(SimMedium(other), port=port)
        await restarted.open()
        await near.receiver.wait("UP", lambda: near.is_up, 10.0)
        assert near.link.capabilities.mtu_bytes == 64
        await near.close()
        await restarted.close()

    run(main())


def test_port_in_use_is_a_clear_error() -> None:
    async def body(server: MediumServer) -> None:
        second = MediumServer(SimMedium(CHANNEL), server.host, server.port)
        with pytest.raises(LinkOpenError, match=f"cannot listen at {server.address}: Address"):
            await second.open()
        await second.close()
        nowhere = MediumServer(SimMedium(CHANNEL), "no such host")
        with pytest.raises(LinkOpenError, match="cannot listen at no such host:0: "):
            await nowhere.open()

    case(body)


@pytest.mark.parametrize("address", ["tcp:127.0.0.1:7000", "serial:/dev/ttyUSB0"])
def test_address_of_another_kind_of_locator_is_refused(address: str) -> None:
    with pytest.raises(ConfigError, match=r"allowed: sim/HOST:PORT"):
        SimLink.from_locator(address, SimLink.config_type(), node_address=1)


def test_node_address_of_a_link_is_checked() -> None:
    for address in (0, 255, -1):
        with pytest.raises(ConfigError, match=r"allowed: 1\.\.254"):
            SimLink.from_locator("h:1", SimLink.config_type(), node_address=address)
