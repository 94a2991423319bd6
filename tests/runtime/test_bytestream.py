import asyncio
import contextlib
import errno
import os
import socket
import sys
import threading
from collections.abc import Awaitable, Callable

import pytest

from tests.runtime.loop_checks import run, until
from zacoustic.bytestream import ByteStream, ByteStreamState
from zacoustic.errors import ConfigError, LinkOpenError
from zacoustic.link.bytestream.connection import WRITE_LIMIT_BYTES
from zacoustic.link.bytestream.tcp import TcpConnection


class Listener:
    """Keeps what a stream says."""

    def __init__(self) -> None:
        self.read = bytearray()
        self.instants: list[int] = []
        self.opened = 0
        self.losses: list[str] = []
        self.changed = asyncio.Event()

    def stream_opened(self) -> None:
        self.opened += 1
        self.changed.set()

    def bytes_received(self, data: bytes, received_at: int) -> None:
        self.read += data
        self.instants.append(received_at)
        self.changed.set()

    def stream_lost(self, reason: str) -> None:
        self.losses.append(reason)
        self.changed.set()


class Peer:
    """A TCP server that keeps its connections."""

    def __init__(self) -> None:
        self.read = bytearray()
        self.serving: set[asyncio.Task[None]] = set()
        self.writers: list[asyncio.StreamWriter] = []
        self.changed = asyncio.Event()
        self.server: asyncio.Server | None = None
        self.greeting = b""

    async def listen(self, port: int = 0) -> int:
        self.server = await asyncio.start_server(self._serve, "127.0.0.1", port)
        bound: int = self.server.sockets[0].getsockname()[1]
        return bound

    async def close(self) -> None:
        assert self.server is not None
        self.server.close()
        for writer in self.writers:
            writer.close()
        await self.server.wait_closed()
        await asyncio.gather(*self.serving)
        self.serving.clear()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self.serving.add(task)
        self.writers.append(writer)
        writer.write(self.greeting)
        self.changed.set()
        with contextlib.suppress(ConnectionError):
            while data := await reader.read(65_536):
                self.read += data
                self.changed.set()
        writer.close()


def tcp_case(
    case: Callable[[Peer, ByteStream, Listener], Awaitable[None]], *, greeting: bytes = b""
) -> None:
    async def main() -> None:
        peer, listener = Peer(), Listener()
        peer.greeting = greeting
        port = await peer.listen()
        stream = ByteStream(f"tcp:127.0.0.1:{port}", first_delay_s=0.01, last_delay_s=0.05)
        stream.open(listener)
        try:
            await until(lambda: listener.opened, listener.changed)
            await case(peer, stream, listener)
        finally:
            await stream.close()
            await peer.close()
        assert stream.state is ByteStreamState.CLOSED

    run(main())


def test_tcp_carries_bytes_both_ways_and_stamps_them() -> None:
    async def case(peer: Peer, stream: ByteStream, listener: Listener) -> None:
        assert stream.state is ByteStreamState.OPEN
        assert stream.write(b"ping")
        await until(lambda: peer.read == b"ping", peer.changed)
        peer.writers[0].write(b"pong")
        await until(lambda: listener.read == b"hello pong", listener.changed)
        assert listener.instants == sorted(listener.instants)
        assert (stream.bytes_read, stream.bytes_written) == (10, 4)

    tcp_case(case, greeting=b"hello ")


def test_tcp_has_no_delay_for_small_writes() -> None:
    async def case(peer: Peer, stream: ByteStream, listener: Listener) -> None:
        connection = stream._connection
        assert isinstance(connection, TcpConnection)
        assert connection._transport is not None
        connected = connection._transport.get_extra_info("socket")
        assert connected.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)

    tcp_case(case)


def test_lost_tcp_connection_is_reported_and_made_again() -> None:
    async def case(peer: Peer, stream: ByteStream, listener: Listener) -> None:
        peer.writers[0].close()
        await until(lambda: listener.opened == 2, listener.changed)
        assert listener.losses == [f"{stream.address}: closed by the other side"]
        assert stream.write(b"again")
        await until(lambda: peer.read == b"again", peer.changed)

    tcp_case(case)


def test_write_refuses_what_exceeds_the_buffer() -> None:
    async def case(peer: Peer, stream: ByteStream, listener: Listener) -> None:
        assert not stream.write(bytes(WRITE_LIMIT_BYTES + 1))
        refused = 0
        for _ in range(10_000):  # nobody reads meanwhile: this task does not yield
            if not stream.write(bytes(60_000)):
                refused += 1
                break
        assert refused

    tcp_case(case)


def test_absent_server_is_named_and_tried_until_it_comes() -> None:
    async def main() -> None:
        peer, listener = Peer(), Listener()
        port = await peer.listen()
        await peer.close()
        stream = ByteStream(f"tcp:127.0.0.1:{port}", first_delay_s=0.01, last_delay_s=0.02)
        assert not stream.write(b"early")
        stream.open(listener)
        with pytest.raises(LinkOpenError, match="open already"):
            stream.open(listener)
        try:
            await until(lambda: len(listener.losses) >= 2, listener.changed)
            assert listener.losses[0] == f"tcp:127.0.0.1:{port}: {os.strerror(errno.ECONNREFUSED)}"
            assert not stream.write(b"early")
            await peer.listen(port)
            await until(lambda: listener.opened == 1, listener.changed)
        finally:
            await stream.close()
            await peer.close()

    run(main())


def test_close_is_immediate_in_every_state_and_may_be_repeated() -> None:
    async def main() -> None:
        peer, listener = Peer(), Listener()
        port = await peer.listen()
        stream = ByteStream(f"tcp:127.0.0.1:{port}", first_delay_s=60.0)
        await stream.close()
        for turns in range(12):
            stream.open(listener)
            for _ in range(turns):  # as far as it gets in so many turns of the loop
                await asyncio.sleep(0)
            await stream.close()
            await stream.close()
        await peer.close()
        losses = len(listener.losses)
        stream.open(listener)
        await until(lambda: len(listener.losses) > losses, listener.changed)
        assert stream.state is ByteStreamState.WAITING
        await stream.close()

    run(main())


def test_no_callback_comes_after_close() -> None:
    async def case(peer: Peer, stream: ByteStream, listener: Listener) -> None:
        peer.writers[0].write(b"x" * 1000)
        await stream.close()
        seen = (len(listener.read), listener.opened, len(listener.losses))
        for _ in range(5):
            await asyncio.sleep(0)
        assert seen == (len(listener.read), listener.opened, len(listener.losses))

    tcp_case(case)


@pytest.mark.parametrize(
    "address",
    ["", "tcp", "tcp:", "tcp:host", "tcp:host:", "tcp::1", "tcp:host:0", "tcp:host:65536",
     "tcp:host:²", "udp:host:1", "serial:", "/dev/ttyUSB0"],
)  # fmt: skip
def test_wrong_address_is_refused_with_what_is_allowed(address: str) -> None:
    with pytest.raises(ConfigError, match="allowed"):
        ByteStream(address)


def test_address_with_colons_of_its_own_is_understood() -> None:
    assert ByteStream("tcp:[::1]:9200")._target == ("::1", 9200)
    assert ByteStream("serial:/dev/serial/by-path/pci-0:1:2")._target == (
        "/dev/serial/by-path/pci-0:1:2"
    )


class Pty:
    """Both ends of a pseudo-terminal; the far end is read and written without blocking."""

    def __init__(self) -> None:
        self.far, self.near = os.openpty()
        self.path = os.ttyname(self.near)
        os.set_blocking(self.far, False)
        self.read = bytearray()
        self.changed = asyncio.Event()

    def listen(self) -> None:
        asyncio.get_running_loop().add_reader(self.far, self._readable)

    def _readable(self) -> None:
        try:
            self.read += os.read(self.far, 65_536)
        except OSError:
            asyncio.get_running_loop().remove_reader(self.far)
        self.changed.set()

    def close(self) -> None:
        if self.far >= 0:
            asyncio.get_running_loop().remove_reader(self.far)
            os.close(self.far)
            os.close(self.near)
            self.far = -1


def pty_case(case: Callable[[Pty, ByteStream, Listener], Awaitable[None]]) -> None:
    async def main() -> None:
        pty, listener = Pty(), Listener()
        stream = ByteStream(f"serial:{pty.path}", first_delay_s=0.01, last_delay_s=0.05)
        stream.open(listener)
        try:
            await until(lambda: listener.opened, listener.changed)
            await case(pty, stream, listener)
        finally:
            await stream.close()
            pty.close()

    run(main())


def test_serial_carries_bytes_both_ways_and_stamps_them() -> None:
    async def case(pty: Pty, stream: ByteStream, listener: Listener) -> None:
        pty.listen()
        assert stream.write(b"+++ATI\n")
        await until(lambda: pty.read == b"+++ATI\n", pty.changed)
        os.write(pty.far, b"OK\r\n\x00\xff")
        await until(lambda: listener.read == b"OK\r\n\x00\xff", listener.changed)
        assert listener.instants == sorted(listener.instants)

    pty_case(case)


def test_serial_keeps_the_order_of_many_pieces() -> None:
    async def case(pty: Pty, stream: ByteStream, listener: Listener) -> None:
        pty.listen()
        sent = bytes(range(256)) * 64
        for start in range(0, len(sent), 512):
            assert stream.write(sent[start : start + 512])
        await until(lambda: len(pty.read) == len(sent), pty.changed)
        assert pty.read == sent
        for start in range(0, len(sent), 1024):
            os.write(pty.far, sent[start : start + 1024])
            end = start + 1024
            await until(lambda: len(listener.read) >= end, listener.changed)  # noqa: B023
        assert listener.read == sent

    pty_case(case)


def test_serial_port_that_nobody_reads_blocks_neither_loop_nor_close() -> None:
    async def case(pty: Pty, stream: ByteStream, listener: Listener) -> None:
        while stream.write(bytes(1000)):
            pass

    pty_case(case)


def test_lost_serial_port_is_reported_and_closed_without_a_trace() -> None:
    async def case(pty: Pty, stream: ByteStream, listener: Listener) -> None:
        pty.close()
        await until(lambda: listener.losses, listener.changed)
        assert stream.address in listener.losses[0]
        assert not stream.write(b"x")
        await until(lambda: len(listener.losses) >= 2, listener.changed)
        cure = "is it connected, and is that its name?"
        assert listener.losses[-1] == f"{stream.address}: {os.strerror(errno.ENOENT)}: {cure}"

    pty_case(case)


def test_serial_port_in_use_is_called_so() -> None:
    async def case(pty: Pty, stream: ByteStream, listener: Listener) -> None:
        second, other = ByteStream(stream.address, first_delay_s=0.01), Listener()
        second.open(other)
        await until(lambda: other.losses, other.changed)
        await second.close()
        assert other.losses[0] == f"{stream.address}: in use by another program"

    pty_case(case)


def test_reset_gives_the_connection_up_and_makes_a_new_one() -> None:
    async def case(peer: Peer, stream: ByteStream, listener: Listener) -> None:
        stream.reset("the modem does not answer")
        stream.reset("twice")
        await until(lambda: listener.opened == 2, listener.changed)
        assert listener.losses == [f"{stream.address}: the modem does not answer"]

    tcp_case(case)

    async def serial_case(pty: Pty, stream: ByteStream, listener: Listener) -> None:
        stream.reset("the modem does not answer")
        await until(lambda: listener.opened == 2, listener.changed)

    pty_case(serial_case)


async def give_up_and_close(stream: ByteStream, turns: int) -> None:
    """Close while a connection is being closed already; a device that reads nothing delays that."""
    while stream.write(bytes(1000)):
        pass
    stream.reset("the modem takes no more bytes")
    for _ in range(turns):  # as far as it gets in so many turns of the loop
        await asyncio.sleep(0)
    await stream.close()


@pytest.mark.parametrize("turns", [1, 2])
def test_closed_stream_has_no_thread_of_a_connection_before(turns: int) -> None:
    async def case(pty: Pty, stream: ByteStream, listener: Listener) -> None:
        await give_up_and_close(stream, turns)
        left = [each.name for each in threading.enumerate() if each.name.endswith(pty.path)]
        assert left == []

    pty_case(case)


@pytest.mark.parametrize("turns", [1, 2])
def test_closed_stream_has_no_socket_of_a_connection_before(turns: int) -> None:
    async def case(peer: Peer, stream: ByteStream, listener: Listener) -> None:
        for writer in peer.writers:
            writer.transport.pause_reading()  # type: ignore[attr-defined]
        connected = stream._connection._transport.get_extra_info("socket")  # type: ignore[union-attr]
        await give_up_and_close(stream, turns)
        assert connected.fileno() == -1

    tcp_case(case)


@pytest.mark.skipif(sys.platform == "win32", reason="uvloop does not run there")
def test_tcp_works_on_the_loop_of_uvloop() -> None:
    uvloop = pytest.importorskip("uvloop")

    async def main() -> None:
        peer, listener = Peer(), Listener()
        stream = ByteStream(f"tcp:127.0.0.1:{await peer.listen()}")
        stream.open(listener)
        await until(lambda: listener.opened, listener.changed)
        assert stream.write(b"ping")
        await until(lambda: peer.read == b"ping", peer.changed)
        peer.writers[0].write(b"pong")
        await until(lambda: listener.read == b"pong", listener.changed)
        await stream.close()
        await peer.close()

    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        runner.run(main())
