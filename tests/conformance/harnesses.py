"""A harness for each registered link, in each condition in which it is to be proven."""

from collections.abc import Callable, Sequence
from typing import Final

from tests.links.desert.desert_rig import DesertHarness
from tests.links.evologics.driver.harness import HAS_TERMINALS, EvologicsHarness
from tests.links.iridium.harness import DirectIpHarness, IridiumHarness
from tests.links.udp_pair import UdpHarness
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.link import Link, registry
from zacoustic.testing.linkpair import LinkHarness
from zacoustic.testing.proxy import StreamProxy
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_sim.link import SimConfig
from zacoustic_sim.medium import SimMedium
from zacoustic_sim.server import MediumServer

SETTINGS: Final = (
    "", "#addressed=false", "#checked=false", "#framed=false", "#senses_carrier=false",
    "#acknowledges=true",
)  # fmt: skip


def scenario(profile: str) -> Scenario:
    """Water that loses nothing, two nodes 150 m apart."""
    return Scenario(
        profile=profile,
        channel="none",
        nodes=(
            NodeSpec(address=1, position=(0.0, 0.0, 10.0)),
            NodeSpec(address=2, position=(150.0, 0.0, 10.0)),
        ),
    )


class SimHarness:
    """Modems in the water of this process."""

    addresses = (1, 2)

    def __init__(self, profile: str, time_scale: float, config: SimConfig) -> None:
        self.medium: SimMedium | None = None
        self._scenario = scenario(profile)
        self._time_scale = time_scale
        self._config = config

    async def set_up(self) -> tuple[Link, Link]:
        self.medium = SimMedium(self._scenario, time_scale=self._time_scale)
        return self.medium.link(1, self._config), self.medium.link(2, self._config)

    async def tear_down(self) -> None:
        assert self.medium is not None
        self.medium.close()

    async def cut(self) -> bool:
        return False

    async def inject(self, nonsense: bytes) -> bool:
        return False


class SimServerHarness:
    """Modems that reach the water by TCP, through a proxy that can be cut."""

    addresses = (1, 2)

    def __init__(self, profile: str, time_scale: float, settings: str) -> None:
        self._scenario = scenario(profile)
        self._time_scale = time_scale
        self._settings = settings

    async def set_up(self) -> tuple[Link, Link]:
        medium = SimMedium(self._scenario, time_scale=self._time_scale)
        self.server = MediumServer(medium)
        await self.server.open()
        self.proxy = StreamProxy(self.server.host, self.server.port)
        await self.proxy.open()
        locator = f"sim/{self.proxy.address}{self._settings}"
        return registry.create(locator, 1), registry.create(locator, 2)

    async def tear_down(self) -> None:
        await self.proxy.close()
        await self.server.close()

    async def cut(self) -> bool:
        self.proxy.cut()
        return True

    async def inject(self, nonsense: bytes) -> bool:
        self.proxy.inject(nonsense)
        return True


MakeHarness = Callable[[], LinkHarness]

_TERMINALS: Final[dict[str, MakeHarness]] = {
    "pty": lambda: EvologicsHarness(is_serial=True),
    "pty-check": lambda: EvologicsHarness(EvologicsConfig(check=True), is_serial=True),
}

HARNESSES: Final[dict[str, dict[str, MakeHarness]]] = {
    "desert": {
        "mrl-64": DesertHarness,
        "mrl-512": lambda: DesertHarness(max_read_length=512),
        "mrl-17": lambda: DesertHarness(max_read_length=17),
        "rmw_desert": lambda: DesertHarness(framing="rmw_desert"),
        "rmw_desert-512": lambda: DesertHarness(framing="rmw_desert", max_read_length=512),
    },
    # In real time: that is what the driver's time limits are made for. Half a minute for each.
    "evologics": {
        "tcp": EvologicsHarness,
        "tcp-AT": lambda: EvologicsHarness(interpreter=Interpreter.AT),
        "tcp-bulk": lambda: EvologicsHarness(EvologicsConfig(bulk=True)),
        **(_TERMINALS if HAS_TERMINALS else {}),
    },
    "iridium": {"tcp": IridiumHarness, "directip": DirectIpHarness},
    "sim": {
        "here": lambda: SimHarness("evologics_s2c_18_34", 50.0, SimConfig()),
        "here-unframed": lambda: SimHarness("nanomodem", 50.0, SimConfig(framed=False)),
        "here-acknowledges": lambda: SimHarness(
            "evologics_s2c_18_34", 50.0, SimConfig(acknowledges=True)
        ),
        "here-ideal": lambda: SimHarness("ideal", 1.0, SimConfig()),
        "here-mtu-8": lambda: SimHarness("waterlinked_m64", 100.0, SimConfig()),
        **{
            f"tcp{settings}": lambda settings=settings: SimServerHarness(  # type: ignore[misc]
                "evologics_s2c_18_34", 50.0, settings
            )
            for settings in SETTINGS
        },
        "tcp-ideal": lambda: SimServerHarness("ideal", 1.0, ""),
    },
    "udp": {"peers": UdpHarness, "group": lambda: UdpHarness(is_group=True)},
}
"""Link → condition → harness. A link stands here as soon as it is registered."""


def conditions(link: str) -> Sequence[str]:
    """Names of the conditions of a link; none if it has no harness, which is a failure."""
    return tuple(HARNESSES.get(link, ()))
