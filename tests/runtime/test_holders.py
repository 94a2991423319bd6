"""Who else has a device open: found on Linux, by name."""

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from zacoustic.bytestream import holders
from zacoustic.errors import ConfigError

pytestmark = pytest.mark.skipif(
    not sys.platform.startswith("linux"), reason="other systems do not tell"
)


@contextmanager
def program(opening: str, target: str) -> Iterator[int]:
    """Run a program that has something open."""
    source = f"import os, socket, sys; held = {opening}; print('open', flush=True); input()"
    with subprocess.Popen(
        [sys.executable, "-c", source, target],
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as child:  # fmt: skip
        assert child.stdout is not None
        assert child.stdout.readline() == "open\n"
        yield child.pid
        child.communicate("\n")


def test_program_that_is_connected_is_named_and_this_one_is_not() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        address = f"tcp:127.0.0.1:{port}"
        with socket.create_connection(("127.0.0.1", port)):
            assert holders(address) == []
            opening = "socket.create_connection(('127.0.0.1', int(sys.argv[1])))"
            with program(opening, str(port)) as pid:
                (found,) = holders(address)
                assert found.endswith(f" ({pid})")
        assert holders(address) == []


def test_program_that_has_a_serial_port_is_named() -> None:
    master, slave = os.openpty()
    try:
        path = os.ttyname(slave)
        assert holders(f"serial:{path}") == []
        with program("os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)", path) as pid:
            (found,) = holders(f"serial:{path}")
            assert found.endswith(f" ({pid})")
    finally:
        os.close(master)
        os.close(slave)


def test_address_that_is_none_is_refused() -> None:
    with pytest.raises(ConfigError, match="address"):
        holders("modem")
    assert holders("serial:/dev/nothing-there") == []
