"""The link of the example is one: it passes the battery that all links pass."""

import importlib.util
import socket
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
