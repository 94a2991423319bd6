"""The channel of a `VirtualNetwork` and its modems: from a transmission to its receptions.

`zacoustic.channel.Medium` computes the sound; here are the modems. They outlive the engines: a
modem ends what it has begun, also after a crash of its node.
"""

import random
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

from zacoustic.channel.acknowledgement import ACKNOWLEDGEMENT_BYTES, patience_ns, turnaround_ns
from zacoustic.channel.agenda import Agenda
from zacoustic.channel.faults import corrupt
from zacoustic.channel.medium import Arrival, Emission, Medium, Reception
from zacoustic.channel.position import Position
from zacoustic.core.base.clock import seconds_to_ns
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
from zacoustic.testing.virtualmodem import Device, Modem
from zacoustic.testing.virtualnode import VirtualNode

Disturb = Callable[[int, int, int], Sequence[float]]
"""``(source, node, now)``: what becomes of a frame that arrives: it is handed over after each of
these times, s; ``(0.0,)`` is as it should be, ``()`` a loss, more than one a repetition."""


class Serve(Protocol):
    """Polls the engine of a node after an input."""

    def __call__(self, node: VirtualNode) -> None:
        """Poll it until it is dry."""
        ...


class VirtualMedium:
    """Medium and modems of one link.

    Args:
        agenda: Virtual time.
        medium: What sound does.
        modem: What the modems do by themselves.
        nodes: By address.
        link: Name that the engines have for the link; None: it is their first one.
        disturb: Loses, delays and repeats frames in addition to the scenario.
        serve: Called after each input that an engine has got.
    """

    def __init__(
        self,
        agenda: Agenda,
        medium: Medium,
        modem: Modem,
        nodes: Mapping[int, VirtualNode],
        link: str | None,
        disturb: Disturb | None,
        serve: Serve,
    ) -> None:
        self.modem = modem
        self.link = link
        self.devices = {address: Device(medium.profile(address)) for address in medium.addresses}
        """The modems, by address of their nodes."""
        self._nodes = nodes
        self.losses: dict[str, int] = {}
        """What became of the frames that did not arrive, by outcome."""
        self._agenda = agenda
        self._medium = medium
        self._disturb = disturb
        self._serve = serve
        self.farthest_s = medium.scenario.farthest_s
        """Longest propagation delay, one way, s."""
        self._by = () if link is None else (link,)

    def capabilities(self, address: int) -> LinkCapabilities:
        """Return what the modem of a node can do."""
        return self.modem.capabilities(self.devices[address].profile, self.farthest_s)

    def connect(self, node: VirtualNode, engine: Engine) -> None:
        """Tell an engine that its modem is there."""
        now, device = node.clock.local(self._agenda.now), self.devices[node.address]
        engine.handle_link_state(LinkState.UP, now, self.capabilities(node.address), *self._by)
        if device.carriers:
            engine.handle_carrier(True, now, *self._by)

    def disconnect(self, node: VirtualNode, engine: Engine) -> None:
        """Tell an engine that its modem is gone."""
        now = node.clock.local(self._agenda.now)
        engine.handle_link_state(LinkState.DOWN, now, None, *self._by)

    def move(self, address: int, position: Position) -> None:
        """Tell where a modem is from now on."""
        self._medium.move(address, position, self._agenda.now)

    def transmit(self, node: VirtualNode, engine: Engine, transmission: Transmission) -> None:
        """Take a frame from an engine; its report follows."""
        now, device = self._agenda.now, self.devices[node.address]
        if device.is_up and device.transmits_until > now:  # its modem is acknowledging
            at = device.transmits_until
            self._agenda.push(at, self._transmit_late, node, engine, transmission)
            return
        if not device.is_up:
            self._agenda.push(
                now, self._report, node, engine, transmission, TransmitOutcome.ABORTED, now
            )
            return
        emission = self._emit(node, len(transmission.frame_bytes))
        for arrival in emission.arrivals:
            self._expect(arrival, self._take, transmission)
        if self.modem.answers(transmission):
            device.exchange = (transmission, now)
            limit_ns = patience_ns(device.profile, self.farthest_s)
            self._agenda.push(
                emission.ends_at + limit_ns, self._end_exchange, node, engine, transmission, None
            )
        else:
            self._agenda.push(
                emission.ends_at,
                self._report,
                node,
                engine,
                transmission,
                TransmitOutcome.SENT,
                now,
            )

    def _transmit_late(self, node: VirtualNode, engine: Engine, transmission: Transmission) -> None:
        # What was not given to the modem before its engine was gone is never sent.
        if node.engine is engine:
            self.transmit(node, engine, transmission)

    def _emit(self, node: VirtualNode, size_bytes: int) -> Emission:
        emission = self._medium.transmit(node.address, size_bytes, self._agenda.now)
        self.devices[node.address].transmits_until = emission.ends_at
        if emission.unheard:
            self._lose("blackout", len(emission.unheard))
        return emission

    def _report(
        self,
        node: VirtualNode,
        engine: Engine,
        transmission: Transmission,
        outcome: TransmitOutcome,
        started_at: int,
    ) -> None:
        if node.engine is not engine:
            return
        now = node.clock.local(self._agenda.now)
        report = TransmitReport(
            transmission_id=transmission.transmission_id,
            outcome=outcome,
            started_at=node.clock.local(started_at),
            finished_at=now,
        )
        engine.handle_transmit_report(report, now, *self._by)
        self._serve(node)

    # Arrivals

    def _expect(
        self,
        arrival: Arrival,
        take: Callable[[Reception, Transmission], bool],
        transmission: Transmission,
    ) -> None:
        profile = self._medium.profile(arrival.node)
        heard = (
            self.modem.senses_carrier
            and arrival.snr_db >= profile.detection_snr_db
            and not profile.separates_senders
            and arrival.node in self._nodes
        )
        if heard:
            self._agenda.push(arrival.starts_at, self._begin_carrier, arrival.node)
        self._agenda.push(arrival.ends_at, self._arrive, arrival, take, transmission, heard)

    def _begin_carrier(self, address: int) -> None:
        node, device = self._nodes[address], self.devices[address]
        device.carriers += 1
        if device.carriers == 1 and node.engine is not None:
            node.engine.handle_carrier(True, node.clock.local(self._agenda.now), *self._by)
            self._serve(node)

    def _end_carrier(self, address: int) -> VirtualNode | None:
        """Report the end of a carrier; return the node if its engine needs service."""
        node, device = self._nodes[address], self.devices[address]
        device.carriers -= 1
        if device.carriers or node.engine is None:
            return None
        node.engine.handle_carrier(False, node.clock.local(self._agenda.now), *self._by)
        return node

    def _arrive(
        self,
        arrival: Arrival,
        take: Callable[[Reception, Transmission], bool],
        transmission: Transmission,
        heard: bool,
    ) -> None:
        reception = self._medium.finish(arrival)
        # No node is served between the two inputs, so none transmits before it knows the frame.
        silent = self._end_carrier(arrival.node) if heard else None
        is_served = False
        if reception.is_received:
            is_served = take(reception, transmission)
        else:
            self._lose(reception.outcome.value)
        if silent is not None and not is_served:
            self._serve(silent)

    def _lose(self, outcome: str, number: int = 1) -> None:
        self.losses[outcome] = self.losses.get(outcome, 0) + number

    def _take(self, reception: Reception, transmission: Transmission) -> bool:
        """A frame has come to a modem; returns whether its node has been served."""
        arrival, frame_bytes = reception.arrival, transmission.frame_bytes
        damaged = reception.corrupt_seed is not None
        if damaged and self.modem.checked:
            self._lose("corrupt")
            return False
        if reception.corrupt_seed is not None:
            frame_bytes = corrupt(frame_bytes, random.Random(reception.corrupt_seed))
        delays_s: Sequence[float] = (0.0,)
        if self._disturb is not None:
            delays_s = self._disturb(arrival.source, arrival.node, self._agenda.now)
        is_asked = self.modem.answers(transmission) and arrival.node == transmission.destination
        if delays_s and is_asked and not damaged:
            at = self._agenda.now + turnaround_ns(self._medium.profile(arrival.node))
            self._agenda.push(at, self._acknowledge, arrival, transmission)
        is_served = False
        for after_s in (*delays_s, *reception.duplicates_after_s):
            if after_s := after_s + reception.delay_s:
                at = self._agenda.now + seconds_to_ns(after_s)
                self._agenda.push(at, self._receive, arrival, transmission, frame_bytes)
            else:
                is_served |= self._receive(arrival, transmission, frame_bytes)
        return is_served

    def _receive(self, arrival: Arrival, transmission: Transmission, frame_bytes: bytes) -> bool:
        """A modem hands over a frame; returns whether its node has been served."""
        node = self._nodes.get(arrival.node)
        if node is None:
            return False
        addressed = self.modem.addressed
        if addressed and transmission.destination not in (arrival.node, BROADCAST):
            return False
        if not self.devices[arrival.node].is_up or node.engine is None:
            self._lose("unplugged" if node.engine is not None else "node_down")
            return False
        now = node.clock.local(self._agenda.now)
        node.engine.handle_frame(
            ReceivedFrame(
                frame_bytes=frame_bytes,
                received_at=now,
                source=arrival.source if addressed else 0,
                destination=transmission.destination if addressed else BROADCAST,
                metrics=LinkMetrics(snr_db=arrival.snr_db, propagation_s=arrival.propagation_s),
            ),
            now,
            *self._by,
        )
        self._serve(node)
        return True

    # Acknowledgements of the modems

    def _acknowledge(self, arrival: Arrival, transmission: Transmission) -> None:
        """The modem that has received a frame acknowledges it, unless it is transmitting itself."""
        node, asker = self._nodes.get(arrival.node), self._nodes.get(arrival.source)
        device = self.devices[arrival.node]
        if node is None or asker is None or not device.is_up:
            return
        if device.transmits_until > self._agenda.now:
            return
        for answer in self._emit(node, ACKNOWLEDGEMENT_BYTES).arrivals:
            self._expect(answer, self._be_answered, transmission)

    def _be_answered(self, reception: Reception, transmission: Transmission) -> bool:
        """An acknowledgement has come to a modem; returns whether its node has been served."""
        answer = reception.arrival
        asker = self._nodes.get(answer.node)
        if asker is None or asker.engine is None or reception.corrupt_seed is not None:
            return False
        exchange = self.devices[answer.node].exchange
        if exchange is None or exchange[0] is not transmission:
            return False
        if self._disturb is None or self._disturb(answer.source, answer.node, self._agenda.now):
            self._end_exchange(asker, asker.engine, transmission, answer)
            return True
        return False

    def _end_exchange(
        self, node: VirtualNode, engine: Engine, transmission: Transmission, answer: Arrival | None
    ) -> None:
        """The acknowledgement has come, or will not come any more."""
        device = self.devices[node.address]
        if device.exchange is None or device.exchange[0] is not transmission:
            return
        started_at, device.exchange = device.exchange[1], None
        outcome = TransmitOutcome.DELIVERED if answer else TransmitOutcome.NOT_DELIVERED
        self._report(node, engine, transmission, outcome, started_at)
        if answer is not None and node.engine is engine:
            now = node.clock.local(self._agenda.now)
            metrics = LinkMetrics(
                snr_db=answer.snr_db,
                propagation_s=answer.propagation_s,
                range_m=answer.distance_m,
            )
            measured = PeerMeasured(address=answer.source, measured_at=now, metrics=metrics)
            engine.handle_measurement(measured, now, *self._by)
            self._serve(node)
