"""Two UDP links on the loopback: as peers of each other, or in a multicast group."""

import socket

from zacoustic.link import Link, registry

GROUP = "239.255.76.67"


def free_port() -> int:
    """Return a port that was free just now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def locators(*, is_group: bool = False, settings: str = "") -> tuple[str, str]:
    """Return the locators of two nodes that hear each other."""
    near, far = free_port(), free_port()
    if is_group:
        both = f"udp/{GROUP}:{near}#interface=127.0.0.1{settings}"
        return both, both
    return (
        f"udp/127.0.0.1:{near}#peers=127.0.0.1:{far}{settings}",
        f"udp/127.0.0.1:{far}#peers=127.0.0.1:{near}{settings}",
    )


class UdpHarness:
    """Two links of this process."""

    addresses = (1, 2)

    def __init__(self, *, is_group: bool = False) -> None:
        self._locators = locators(is_group=is_group)

    async def set_up(self) -> tuple[Link, Link]:
        near, far = self._locators
        return registry.create(near, 1), registry.create(far, 2)

    async def tear_down(self) -> None:
        pass

    async def cut(self) -> bool:
        return False

    async def inject(self, nonsense: bytes) -> bool:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as stranger:
            stranger.setsockopt(
                socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1")
            )
            for locator in self._locators:
                host, _, port = locator.removeprefix("udp/").partition("#")[0].rpartition(":")
                for size in (0, 1, 7, 1200, len(nonsense)):
                    stranger.sendto(nonsense[:size], (host, int(port)))
        return True
