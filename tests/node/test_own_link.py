"""The link of the example is one: it passes the battery that all links pass."""

import importlib.util
import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any, Final

import pytest

from tests.runtime.loop_checks import run
from zacoustic.link import Link
from zacoustic.testing.conformance import CHECKS, Check

EXAMPLE: Final = Path(__file__).parents[2] / "examples" / "06_write_your_own_link.py"


def load() -> Any:
    spec = importlib.util.spec_from_file_location("write_your_own_link", EXAMPLE)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class UdpHarness:
    addresses = (1, 2)

    async def set_up(self) -> tuple[Link, Link]:
        link_type: type[Link] = load().BenchLink
        with socket.socket(type=socket.SOCK_DGRAM) as probe:
            probe.bind(("127.0.0.1", 0))
            self._port = probe.getsockname()[1] - 1
        locator, config = f"127.0.0.1:{self._port}", link_type.config_type()
        near, far = (
            link_type.from_locator(locator, config, node_address=each) for each in self.addresses
        )
        return near, far

    async def tear_down(self) -> None:
        pass

    async def cut(self) -> bool:
        return False  # datagrams have no connection

    async def inject(self, nonsense: bytes) -> bool:
        with socket.socket(type=socket.SOCK_DGRAM) as sender:
            for address in self.addresses:
                sender.sendto(nonsense, ("127.0.0.1", self._port + address))
        return True


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_the_link_of_the_example_keeps_the_contract(check: Check) -> None:
    run(check(UdpHarness()))


PLUG_IN: Final = """[zacoustic.links]
bench = your_package:BenchLink
"""
BY_LOCATOR: Final = """
import asyncio, sys
from zacoustic import Node

async def main():
    near, far = (Node(each, link=f"bench/127.0.0.1:{sys.argv[1]}") for each in (1, 2))
    async with near as talker, far as listener:
        subscription = listener.subscribe(bytes, "hello", stream_id=1)
        talker.create_publisher(bytes, "hello", stream_id=1).publish(b"by locator")
        sample = await subscription.receive()
        print(sample.source, sample.value.decode())

asyncio.run(main())
"""


def test_installed_in_a_package_of_its_own_it_is_known_by_its_locator(tmp_path: Path) -> None:
    (tmp_path / "your_package.py").write_bytes(EXAMPLE.read_bytes())
    metadata = tmp_path / "your_package-1.0.dist-info"
    metadata.mkdir()
    (metadata / "METADATA").write_text("Metadata-Version: 2.1\nName: your-package\nVersion: 1.0\n")
    (metadata / "entry_points.txt").write_text(PLUG_IN)
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}

    def out(*words: str) -> str:
        command = [sys.executable, *words]
        done = subprocess.run(
            command, env=environment, capture_output=True, text=True, timeout=60, check=False
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    listed = out("-m", "zacoustic", "links")
    assert "bench" in listed
    assert "your-package 1.0" in listed
    with socket.socket(type=socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        base = probe.getsockname()[1] - 1
    assert out("-c", BY_LOCATOR, str(base)) == "1 by locator\n"
