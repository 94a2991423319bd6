"""The modems of a `VirtualNetwork` on one medium, and their reports to the engines.

`zacoustic.channel.modems` has the behaviour of modems. They outlive the engines: after a crash of
its node, a modem still ends the transmission that it has begun.
"""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType
from typing import Final, Protocol

import msgspec

from zacoustic.channel.agenda import Agenda
from zacoustic.channel.medium import Arrival, Medium, Outcome, Reception
from zacoustic.channel.modems import Ending, Modems, Station
from zacoustic.channel.profiles import ModemProfile
from zacoustic.core.base.linktypes import (
    BROADCAST,
    LinkCapabilities,
    LinkMetrics,
    LinkState,
    PeerMeasured,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.engine.engine import Engine
from zacoustic.testing.virtualnode import VirtualNode

Disturb = Callable[[int, int, int], Sequence[float]]
"""``(source, node, now)``: returns the delays after which an arriving frame is handed over, s:
``(0.0,)`` is normal, ``()`` a loss, more than one a repetition."""


MEASURED: Final = frozenset({"snr_db", "propagation_s", "range_m"})
"""Fields of `LinkMetrics` that an acknowledgement fills."""


class Device(Station[Transmission]):
    """The modem of one node.

    Args:
        node: The computer to which it belongs.
        profile: The kind of modem.
    """

    __slots__ = ("is_unserved", "node")

    def __init__(self, node: VirtualNode, profile: ModemProfile) -> None:
        super().__init__(node.address, profile)
        self.node = node
        self.is_unserved = False
        """Whether the engine has had an input and was not polled since."""


class Modem(msgspec.Struct, frozen=True, kw_only=True):
    """Features of the modems of a network."""

    addressed: bool = True
    """Frames carry their addresses."""
    checked: bool = True
    """Damaged frames do not arrive."""
    framed: bool = True
    """Frames arrive as frames; otherwise as a byte stream."""
    senses_carrier: bool = True
    """The modem reports the beginning and the end of a reception."""
    acknowledges: bool = False
    """The modem acknowledges frames on request and measures the range by that."""
    controls_access: bool = False
    """The modem decides itself when it transmits; it does so at once."""
    mtu_bytes: int | None = None
    """Largest frame, bytes; None: the profile's."""

    def capabilities(self, profile: ModemProfile, propagation_s: float) -> LinkCapabilities:
        """Return the capabilities of a modem with this profile.

        Args:
            profile: The modem.
            propagation_s: Longest propagation delay, one way, s.
        """
        return LinkCapabilities(
            mtu_bytes=self.mtu_bytes or profile.mtu_bytes,
            bit_rate_bps=profile.bit_rate_bps,
            preamble_s=profile.preamble_s,
            gap_s=profile.gap_s,
            propagation_s=propagation_s,
            half_duplex=profile.half_duplex,
            addressed=self.addressed,
            checked=self.checked,
            framed=self.framed,
            acknowledges=self.acknowledges,
            measures=MEASURED if self.acknowledges else frozenset(),
            measures_range=self.acknowledges,
            controls_access=self.controls_access,
            senses_carrier=self.senses_carrier and not profile.separates_senders,
        )

    def answers(self, transmission: Transmission) -> bool:
        """Tell whether the receiving modem acknowledges a frame."""
        asks = transmission.acknowledge and transmission.destination != BROADCAST
        return self.acknowledges and asks


class Serve(Protocol):
    """Polls the engine of a node after an input."""

    def __call__(self, node: VirtualNode) -> None:
        """Poll it until it is dry."""
        ...


class VirtualModems(Modems[Device, Transmission]):
    """The modems of one link.

    Args:
        agenda: Virtual time.
        medium: The channel.
        modem: Features of the modems.
        link: Name of the link in the engines; None: their first one.
        disturb: Loses, delays and repeats frames in addition to the scenario.
        serve: Called after each input of an engine.
        mtu_bytes: Largest frame of single modems, bytes, by address.
    """

    def __init__(
        self,
        agenda: Agenda,
        medium: Medium,
        modem: Modem,
        link: str | None,
        disturb: Disturb | None,
        serve: Serve,
        mtu_bytes: Mapping[int, int] = MappingProxyType({}),
    ) -> None:
        super().__init__(medium, agenda)
        self.modem = modem
        self.senses_carrier = modem.senses_carrier
        self._disturb = disturb
        self._serve = serve
        self._mtu_bytes = mtu_bytes
        self._by = () if link is None else (link,)

    def add(self, node: VirtualNode) -> None:
        """Give a node its modem."""
        self.stations[node.address] = Device(node, self.medium.profile(node.address))

    def capabilities(self, address: int) -> LinkCapabilities:
        """Return the capabilities of a node's modem."""
        modem = self.modem
        if address in self._mtu_bytes:
            modem = msgspec.structs.replace(modem, mtu_bytes=self._mtu_bytes[address])
        return modem.capabilities(self.stations[address].profile, self.farthest_s)

    def connect(self, node: VirtualNode, engine: Engine) -> None:
        """Tell an engine that its modem is there."""
        now = node.clock.local(self.agenda.now)
        engine.handle_link_state(LinkState.UP, now, self.capabilities(node.address), *self._by)
        if self.stations[node.address].carriers:
            engine.handle_carrier(True, now, *self._by)

    def disconnect(self, node: VirtualNode, engine: Engine) -> None:
        """Tell an engine that its modem is gone."""
        now = node.clock.local(self.agenda.now)
        engine.handle_link_state(LinkState.DOWN, now, None, *self._by)

    # Called by the base class

    def asks(self, frame: Transmission) -> bool:
        """Tell whether a frame asks for an acknowledgement that the modems can give."""
        return self.modem.answers(frame)

    def carrier(self, station: Device, is_heard: bool) -> None:
        """Report the carrier to an engine."""
        node = station.node
        if node.engine is not None:
            station.is_unserved = True
            node.engine.handle_carrier(is_heard, node.clock.local(self.agenda.now), *self._by)

    def settle(self, station: Device) -> None:
        """Serve an engine that has had an input."""
        if station.is_unserved:
            station.is_unserved = False
            self._serve(station.node)

    def delays_s(self, reception: Reception) -> Sequence[float]:
        """Lose damaged frames, unless the modems do not check; disturb the others."""
        if reception.outcome is not Outcome.RECEIVED:
            return ()
        if reception.corrupt_seed is not None and self.modem.checked:
            self.lose("corrupt")
            return ()
        if self._disturb is None:
            return reception.delays_s
        arrival = reception.arrival
        disturbed_s = self._disturb(arrival.source, arrival.node, self.agenda.now)
        first_s, *again_s = reception.delays_s
        return (*(first_s + after_s for after_s in disturbed_s), *again_s)

    def hand_over(self, station: Device, reception: Reception, frame: Transmission) -> None:
        """Give a frame to an engine, if it is addressed to the node."""
        node, arrival, addressed = station.node, reception.arrival, self.modem.addressed
        if addressed and frame.destination not in (arrival.node, BROADCAST):
            return
        if node.engine is None or not station.is_up:
            self.lose("node_down" if node.engine is None else "unplugged")
            return
        now = node.clock.local(self.agenda.now)
        station.is_unserved = True
        node.engine.handle_frame(
            ReceivedFrame(
                frame_bytes=reception.damage(frame.frame_bytes),
                received_at=now,
                source=arrival.source if addressed else 0,
                destination=frame.destination if addressed else BROADCAST,
                metrics=LinkMetrics(snr_db=arrival.snr_db, propagation_s=arrival.propagation_s),
            ),
            now,
            *self._by,
        )

    def finished(
        self,
        station: Device,
        frame: Transmission,
        ending: Ending,
        started_at: int,
        answer: Arrival | None,
    ) -> None:
        """Report a frame to its engine, then the range from its acknowledgement."""
        node, engine = station.node, station.node.engine
        if engine is None:
            return
        now = node.clock.local(self.agenda.now)
        report = TransmitReport(
            transmission_id=frame.transmission_id,
            outcome=TransmitOutcome(ending.value),
            started_at=node.clock.local(started_at),
            finished_at=now,
        )
        engine.handle_transmit_report(report, now, *self._by)
        self._serve(node)
        if answer is None or node.engine is not engine:
            return
        metrics = LinkMetrics(
            snr_db=answer.snr_db,
            propagation_s=answer.propagation_s,
            range_m=answer.distance_m,
        )
        measured = PeerMeasured(address=answer.source, measured_at=now, metrics=metrics)
        engine.handle_measurement(measured, now, *self._by)
        self._serve(node)
