"""Engines on the dialogues of a `Sea`: nodes that are whole but for the loop and the port."""

import random
from collections.abc import Callable
from typing import TypeVar

import msgspec

from tests.links.evologics.driver.sea import Node, Sea
from zacoustic.core.base.journal import LIFE_KEY
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event as EngineEvent
from zacoustic.core.linktypes import BROADCAST, LinkState, Transmission
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.dialogue import AtDialogue
from zacoustic_evologics.driver.events import (
    CarrierChanged,
    Event,
    FrameHeard,
    LinkChanged,
    Measured,
    TransmissionEnded,
)
from zacoustic_evologics.emulator import EmulatedFleet

T = TypeVar("T")

Deliver = Callable[["CrewNode", EngineEvent], None]
"""Takes what an engine tells its application."""


class Given(msgspec.Struct, frozen=True):
    """A frame that an engine gave to its dialogue."""

    at: int
    """When, ns."""
    transmission: Transmission
    """What."""


class CrewNode(Node):
    """One engine on one dialogue.

    Args:
        address: Of the node.
        dialogue: With its modem.
        engine: Not told of any link yet.
        deliver: Takes the engine's events.
        acknowledge: Share of the frames for one node that ask for an acknowledgement.
    """

    def __init__(
        self,
        address: int,
        dialogue: AtDialogue,
        engine: Engine,
        deliver: Deliver,
        *,
        acknowledge: float,
    ) -> None:
        super().__init__(address, dialogue)
        self.engine = engine
        self.is_down = False
        """Whether its computer is off; the modem is not."""
        self.journal: dict[str, bytes] = {}
        """What survives that."""
        self.given: list[Given] = []
        self._deliver = deliver
        self._acknowledge = acknowledge
        self._rng = random.Random(address)

    @property
    def is_up(self) -> bool:
        return self.engine.link_state is LinkState.UP

    @property
    def due_at(self) -> int | None:
        if self.is_down:
            return None
        instants = (self.dialogue.poll_timeout(), self.engine.poll_timeout())
        return min((at for at in instants if at is not None), default=None)

    def expire(self, now: int) -> None:
        for each in (self.dialogue, self.engine):
            due_at = each.poll_timeout()
            if due_at is not None and due_at <= now:
                each.handle_timeout(now)
        self.work(now)

    def take(self, event: Event, now: int) -> None:
        if self.is_down:
            return
        super().take(event, now)
        engine = self.engine
        match event:
            case FrameHeard():
                engine.handle_frame(event.frame, now)
            case TransmissionEnded():
                engine.handle_transmit_report(event.report, now)
            case CarrierChanged():
                engine.handle_carrier(event.busy, now)
            case Measured():
                engine.handle_measurement(event.measurement, now)
            case LinkChanged():
                engine.handle_link_state(event.state, now, event.capabilities)
            case _:
                return
        self.work(now)

    def work(self, now: int) -> None:
        """Do what the contract of the engine asks."""
        engine = self.engine
        while (write := engine.poll_journal()) is not None:
            if write.value is None:
                self.journal.pop(write.key, None)
            else:
                self.journal[write.key] = write.value
            engine.handle_journal_committed(write.write_id, now)
        while (transmission := engine.poll_transmit(now)) is not None:
            is_asked = self._rng.random() < self._acknowledge
            if is_asked and transmission.destination != BROADCAST:
                transmission = msgspec.structs.replace(transmission, acknowledge=True)
            self.given.append(Given(now, transmission))
            self.dialogue.transmit(transmission, now)
        while (event := engine.poll_event()) is not None:
            self._deliver(self, event)


class CrewedSea(Sea):
    """Modems, dialogues, engines and the time.

    Args:
        fleet: The modems.
        table: Of all engines.
        deliver: Takes the events of all engines.
        config: Of the dialogues.
        is_serial: The ports are serial ones.
        acknowledge: As of `CrewNode`.
        rules: Of all engines.
    """

    def __init__(
        self,
        fleet: EmulatedFleet,
        table: StreamTable,
        deliver: Deliver,
        *,
        config: EvologicsConfig,
        is_serial: bool = False,
        acknowledge: float = 0.0,
        rules: TransmitRules | None = None,
    ) -> None:
        self._table = table
        self._rules = rules or TransmitRules()
        self._tell = deliver
        self._acknowledge = acknowledge
        super().__init__(fleet.scenario, fleet=fleet, config=config, is_serial=is_serial)

    @property
    def crew(self) -> list[CrewNode]:
        """All nodes."""
        return [node for node in self.nodes.values() if isinstance(node, CrewNode)]

    def make_node(self, address: int, dialogue: AtDialogue) -> Node:
        engine = self._make_engine(address, 1, {})
        node = CrewNode(address, dialogue, engine, self._tell, acknowledge=self._acknowledge)
        node.work(self.now)
        return node

    def crash(self, node: CrewNode) -> None:
        """Let a node's computer fail; its modem goes on."""
        node.is_down = True

    def restart(self, node: CrewNode, epoch: int) -> None:
        """Let it start again, with its journal and the modem that it finds."""
        node.is_down = False
        stored = {**node.journal, LIFE_KEY: epoch.to_bytes(8, "big")}
        node.engine = self._make_engine(node.address, epoch, stored)
        node.work(self.now)
        self.cut(node.address)

    def _make_engine(self, address: int, epoch: int, stored: dict[str, bytes]) -> Engine:
        return Engine(
            address=address,
            table=self._table,
            epoch=epoch,
            rng=random.Random(f"{self.fleet.scenario.seed}/{address}/{epoch}"),
            stored=stored,
            rules=self._rules,
        )

    def apply(self, node: CrewNode, command: Callable[[Engine, int], T]) -> T:
        """Give a command to an engine and let it act."""
        result = command(node.engine, self.now)
        node.work(self.now)
        self._serve(node)
        self._deliver()
        return result
