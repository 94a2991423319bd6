"""Dialogues on the modems of an emulated fleet, in virtual time."""

import heapq
import itertools
from collections.abc import Callable
from functools import partial

from zacoustic.channel.scenario import Scenario
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkState,
    Measurement,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic_evologics.at.framing import Interpreter
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.dialogue import AtDialogue
from zacoustic_evologics.driver.events import (
    CarrierChanged,
    ConnectionUseless,
    Event,
    FrameHeard,
    LinkChanged,
    Measured,
    TransmissionEnded,
)
from zacoustic_evologics.driver.states import State
from zacoustic_evologics.emulator import EmulatedFleet, PortBytes, PortClosed


class Node:
    """One dialogue, its port, and all that it has told."""

    def __init__(self, address: int, dialogue: AtDialogue) -> None:
        self.address = address
        self.dialogue = dialogue
        self.port_id: int | None = None
        self.frames: list[ReceivedFrame] = []
        self.reports: list[TransmitReport] = []
        self.changes: list[tuple[int, LinkState, str]] = []
        self.carrier: list[bool] = []
        self.measurements: list[Measurement] = []
        self.transmissions = 0

    @property
    def is_ready(self) -> bool:
        return self.dialogue.state is State.READY

    @property
    def due_at(self) -> int | None:
        """When `expire` is to be called, ns."""
        return self.dialogue.poll_timeout()

    def expire(self, now: int) -> None:
        """Let happen what is due."""
        self.dialogue.handle_timeout(now)

    def take(self, event: Event, now: int) -> None:
        """Keep what the dialogue tells."""
        match event:
            case FrameHeard():
                self.frames.append(event.frame)
            case TransmissionEnded():
                self.reports.append(event.report)
            case LinkChanged():
                self.changes.append((now, event.state, event.detail))
            case CarrierChanged():
                self.carrier.append(event.busy)
            case Measured():
                self.measurements.append(event.measurement)
            case _:
                pass


class Sea:
    """Modems, dialogues and the time."""

    def __init__(
        self,
        scenario: Scenario,
        *,
        config: EvologicsConfig | None = None,
        fleet: EmulatedFleet | None = None,
        interpreter: Interpreter = Interpreter.NET,
        is_serial: bool = False,
    ) -> None:
        self.now = 0
        self.fleet = fleet or EmulatedFleet(scenario, interpreter=interpreter)
        self.is_serial = is_serial
        config = config or EvologicsConfig()
        self.nodes = {
            address: self.make_node(
                address, AtDialogue(config, node_address=address, is_serial=is_serial)
            )
            for address in self.fleet.addresses
        }
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._count = itertools.count()
        for node in self.nodes.values():
            self._connect(node)

    def make_node(self, address: int, dialogue: AtDialogue) -> Node:
        """Put a node on its modem."""
        return Node(address, dialogue)

    def __getitem__(self, address: int) -> Node:
        return self.nodes[address]

    def after(self, delay_s: float, act: Callable[[], None]) -> None:
        heapq.heappush(self._heap, (self.now + seconds_to_ns(delay_s), next(self._count), act))

    def run(self, duration_s: float) -> None:
        end = self.now + seconds_to_ns(duration_s)
        while (at := self._next_at()) is not None and at <= end:
            self._step(at)
        self.now = end

    def until(self, condition: Callable[[], object], limit_s: float = 60.0) -> None:
        end = self.now + seconds_to_ns(limit_s)
        while not condition():
            at = self._next_at()
            assert at is not None, "nothing is to happen any more"
            assert at <= end, f"not within {limit_s} s: {self.voyage()}"
            self._step(at)

    def make_ready(self) -> None:
        self.until(lambda: all(node.is_ready for node in self.nodes.values()))

    def voyage(self) -> str:
        return "; ".join(
            f"{node.address} {node.dialogue.state.value}: {node.dialogue.detail}"
            for node in self.nodes.values()
        )

    def transmit(
        self, source: int, content: bytes, to: int = BROADCAST, *, acknowledge: bool = False
    ) -> int:
        node = self.nodes[source]
        node.transmissions += 1
        node.dialogue.transmit(
            Transmission(
                transmission_id=node.transmissions,
                frame_bytes=content,
                destination=to,
                acknowledge=acknowledge,
            ),
            self.now,
        )
        self._serve(node)
        self._deliver()
        return node.transmissions

    def send(
        self, source: int, content: bytes, to: int = BROADCAST, *, acknowledge: bool = False
    ) -> TransmitReport:
        node = self.nodes[source]
        transmission_id = self.transmit(source, content, to, acknowledge=acknowledge)
        found: list[TransmitReport] = []

        def is_there() -> bool:
            found[:] = [each for each in node.reports if each.transmission_id == transmission_id]
            return bool(found)

        self.until(is_there)
        assert len(found) == 1
        return found[0]

    def cut(self, address: int) -> None:
        """Cut the connection from the host's side."""
        node = self.nodes[address]
        if node.port_id is not None:
            self.fleet.close_port(node.port_id, now=self.now)
            self._lose(node, "cut")

    # Below the methods above

    def _next_at(self) -> int | None:
        instants = [self.fleet.poll_timeout(), self._heap[0][0] if self._heap else None]
        instants += [node.due_at for node in self.nodes.values()]
        return min((at for at in instants if at is not None), default=None)

    def _step(self, at: int) -> None:
        self.now = max(self.now, at)
        due_at = self.fleet.poll_timeout()
        if due_at is not None and due_at <= self.now:
            self.fleet.handle_timeout(self.now)
        elif self._heap and self._heap[0][0] <= self.now:
            heapq.heappop(self._heap)[2]()
        else:
            for node in self.nodes.values():
                due_at = node.due_at
                if due_at is not None and due_at <= self.now:
                    node.expire(self.now)
                    self._serve(node)
                    break
        self._deliver()

    def _deliver(self) -> None:
        """Hand over what the modems say."""
        while (output := self.fleet.poll_output()) is not None:
            match output:
                case PortBytes(port_id, content):
                    for node in self.nodes.values():
                        if node.port_id == port_id:
                            node.dialogue.handle_bytes(content, self.now)
                            self._serve(node)
                case PortClosed(port_id):
                    for node in self.nodes.values():
                        if node.port_id == port_id:
                            self._lose(node, "closed by the other side")
                case _:
                    pass

    def _connect(self, node: Node) -> None:
        try:
            node.port_id = self.fleet.open_port(
                node.address, now=self.now, is_serial=self.is_serial
            )
        except ConnectionRefusedError:
            self.after(0.2, partial(self._connect, node))
            return
        node.dialogue.handle_opened(self.now)
        self._serve(node)

    def _lose(self, node: Node, reason: str) -> None:
        node.port_id = None
        node.dialogue.handle_lost(reason, self.now)
        self._serve(node)
        self.after(0.2, partial(self._connect, node))

    def _serve(self, node: Node) -> None:
        self._write(node)
        while (event := node.dialogue.poll_event()) is not None:
            node.take(event, self.now)
            self._write(node)  # a received frame may have caused one, as on the link itself
            if isinstance(event, ConnectionUseless) and node.port_id is not None:
                port_id, node.port_id = node.port_id, None
                self.fleet.close_port(port_id, now=self.now)
                self.after(0.0, partial(self._lose, node, event.reason))

    def _write(self, node: Node) -> None:
        while (output := node.dialogue.poll_output()) is not None:
            if node.port_id is not None:
                self.fleet.handle_bytes(node.port_id, output, self.now)


def outcomes(node: Node) -> dict[TransmitOutcome, int]:
    return {
        outcome: sum(each.outcome is outcome for each in node.reports)
        for outcome in TransmitOutcome
    }
