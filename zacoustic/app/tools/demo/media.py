"""The channel of the demo: for each link the process that emulates it.

A class here knows three things: the verb that serves the channel, the locator of each gateway's
modem, and the meaning of the process's lines. Those of `zacoustic run medium --json` are the
common form; other classes translate theirs into it::

    listening                                       all modems are ready
    waiting     source                              a frame waits for its turn
    emission    source sequence frame_bytes         a frame is transmitted
                airtime_s [sound_s]
    reception   source sequence node outcome        its outcome at the other side
                propagation_s

One more class in `MEDIA` adds one more `zacoustic run demo --link`.
"""

from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Final, TypeAlias

from zacoustic.app.tools.demo.networks import NAMES, SHORE, VEHICLE, demo_text, write_scenario

MediumEvent: TypeAlias = Mapping[str, Any]
"""A line of a process."""

_ANY_PORT: Final = "127.0.0.1:0"


class Medium(ABC):
    """The process between the two sides, for one run."""

    child: ClassVar[str]
    """Name of the process for people."""
    title: ClassVar[str]
    """Title of the live view."""
    propagation_s: float
    """Propagation delay between the two sides, s."""

    def __init__(self) -> None:
        self.locators: dict[int, str] = {}
        """The modem of each local network by its address; complete when `take` has returned that
        the medium is listening."""

    @abstractmethod
    def verb(self, folder: Path) -> tuple[str, ...]:
        """Return the words after `zacoustic` that serve it; write its files into a folder."""

    @abstractmethod
    def take(self, event: MediumEvent) -> MediumEvent | None:
        """Translate a line of the process; None: irrelevant."""


class SimMedium(Medium):
    """The simulator's medium with the scenario of the demo."""

    child = "medium"
    title = "zacoustic: two Zenoh networks, 1000 m of water, EvoLogics S2C 18/34"

    def __init__(self) -> None:
        super().__init__()
        self.propagation_s = _scenario_propagation_s()

    def verb(self, folder: Path) -> tuple[str, ...]:
        """Return the verb of the medium server."""
        return ("run", "medium", str(write_scenario(folder)), "--listen", _ANY_PORT, "--json")

    def take(self, event: MediumEvent) -> MediumEvent:
        """Return a line unchanged."""
        if event.get("event") == "listening":
            self.locators = dict.fromkeys(NAMES, f"sim/{event['address']}")
        return event


class EvologicsMedium(Medium):
    """Emulated S2C modems on TCP ports, on the channel of the simulator's scenario.

    Signals that modems send by themselves carry no frame, and are not shown.
    """

    child = "modems"
    title = "zacoustic: two Zenoh networks, 1000 m of water, emulated S2C modems on TCP ports"
    places: ClassVar[tuple[str, ...]] = ("--listen", _ANY_PORT)
    """Arguments with the places of the modems."""

    def __init__(self) -> None:
        super().__init__()
        self.propagation_s = _scenario_propagation_s()

    def verb(self, folder: Path) -> tuple[str, ...]:
        """Return the verb of the emulator."""
        scenario = str(write_scenario(folder))
        return ("run", "modems", "evologics", "--scenario", scenario, *self.places, "--json")

    def take(self, event: MediumEvent) -> MediumEvent | None:
        """Return a line about a frame unchanged; collect the places one by one."""
        match event.get("event"):
            case "listening":
                self.locators[event["address"]] = f"evologics/{event['locator']}"
                return event if self.locators.keys() == NAMES.keys() else None
            case "emission" if not event["frame_bytes"]:
                return None
            case _:
                return event


class EvologicsSerialMedium(EvologicsMedium):
    """The same modems on pseudo-terminals, which a serial port's driver opens."""

    title = "zacoustic: two Zenoh networks, 1000 m of water, emulated S2C modems on serial lines"
    places = ("--pty",)


class DesertMedium(Medium):
    """The stand-in for DESERT Underwater, with its sample script: two nodes 500 m apart.

    Its packets have no names, but they arrive in order: each node hears only one other. A frame
    costs what the link's capabilities say, including the listening before it; its sound is only the
    last part of that.
    """

    child = "DESERT"
    title = "zacoustic: two Zenoh networks, DESERT Underwater (a stand-in), 500 m of water"
    propagation_s = 500.0 / 1500.0

    def __init__(self) -> None:
        super().__init__()
        self._emissions: Counter[int] = Counter()
        self._receptions: Counter[int] = Counter()

    def verb(self, folder: Path) -> tuple[str, ...]:
        """Return the verb of the stand-in; it needs no file."""
        nodes = str(len(NAMES))
        return ("run", "modems", "desert", "--modems", nodes, "--listen", _ANY_PORT, "--json")

    def take(self, event: MediumEvent) -> MediumEvent | None:
        """Translate a line of the stand-in."""
        from zacoustic.link import registry

        match event.get("event"):
            case "listening":
                places = zip(NAMES, event["addresses"], strict=True)
                self.locators = {address: f"desert/{place}" for address, place in places}
                link = registry.create(self.locators[SHORE], SHORE)
                self._capabilities = link.capabilities
                return {"event": "listening"}
            case "read":
                return {"event": "waiting", "source": _address(event)}
            case "sent":
                return self._emission(_address(event), event["size_bytes"])
            case "delivered" | "lost" | "discarded":
                return self._reception(_address(event), event)
            case _:
                return None

    def _emission(self, source: int, frame_bytes: int) -> MediumEvent:
        sequence = self._emissions[source]
        self._emissions[source] += 1
        return {
            "event": "emission", "source": source, "sequence": sequence, "frame_bytes": frame_bytes,
            "airtime_s": self._capabilities.airtime_ns(frame_bytes) / 1e9,
            "sound_s": frame_bytes * 8 / self._capabilities.bit_rate_bps,
        }  # fmt: skip

    def _reception(self, node: int, event: MediumEvent) -> MediumEvent:
        source = SHORE if node == VEHICLE else VEHICLE
        sequence = self._receptions[source]
        self._receptions[source] += 1
        outcomes = {"delivered": "received", "lost": event["detail"], "discarded": "no client"}
        return {
            "event": "reception", "source": source, "sequence": sequence, "node": node,
            "outcome": outcomes[event["event"]], "propagation_s": self.propagation_s,
        }  # fmt: skip


MEDIA: Final[Mapping[str, type[Medium]]] = {
    "sim": SimMedium,
    "evologics": EvologicsMedium,
    "evologics-serial": EvologicsSerialMedium,
    "desert": DesertMedium,
}
"""The channels by the name of their link; the first is the default."""


def _address(event: MediumEvent) -> int:
    """Return the side of a node of the stand-in, which counts from 0."""
    return tuple(NAMES)[event["node"]]


def _scenario_propagation_s() -> float:
    """Return the propagation delay between the nodes of medium.json5, s."""
    from zacoustic.channel.propagation.position import distance_m
    from zacoustic.channel.scenario import scenario_from_mapping
    from zacoustic.config.json5 import parse_json5

    medium = parse_json5(demo_text("water.json5"), source="water.json5")
    scenario = scenario_from_mapping(medium, source="water.json5")
    near, far = (node.motion().position(0.0) for node in scenario.nodes)
    return distance_m(near, far) / scenario.sound_speed_m_s
