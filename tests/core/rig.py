"""Engines that are driven by hand: every frame passes through the test."""

import random
from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final, TypeVar

from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkCapabilities,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable

E = TypeVar("E", bound=Event)
NO_RULES: Final = TransmitRules()


def link(**settings: Any) -> LinkCapabilities:
    """Return a link that brings everything by itself, 64 bytes in 1 ms, but for `settings`."""
    defaults: dict[str, Any] = {"mtu_bytes": 64, "bit_rate_bps": 512_000, "propagation_s": 0.0}
    return LinkCapabilities(**(defaults | settings))


class End:
    """One engine, its link, and what came out of it."""

    def __init__(
        self,
        address: int,
        table: StreamTable,
        *,
        epoch: int = 1,
        capabilities: LinkCapabilities | None = None,
        commits: bool = True,
        journal: Mapping[str, bytes] = MappingProxyType({}),
        rules: TransmitRules = NO_RULES,
        now: int = 0,
        is_up: bool = True,
    ) -> None:
        self.address = address
        self.journal = dict(journal)
        """What has been committed, in this life and before."""
        self.engine = Engine(
            address=address,
            table=table,
            epoch=epoch,
            rng=random.Random(f"{address}/{epoch}"),
            stored=dict(journal),
            rules=rules,
        )
        self.capabilities = capabilities or link()
        self.events: list[Event] = []
        self.commits = commits
        self.now = now
        if is_up:
            self.engine.handle_link_state(LinkState.UP, now, self.capabilities)
        self.settle()

    def settle(self) -> None:
        """Commit what is to be written down, and take the events."""
        while self.commits and (write := self.engine.poll_journal()) is not None:
            if write.value is None:
                self.journal.pop(write.key, None)
            else:
                self.journal[write.key] = write.value
            self.engine.handle_journal_committed(write.write_id, self.now)
        while (event := self.engine.poll_event()) is not None:
            self.events.append(event)

    def poll(self, now: int) -> Transmission | None:
        """Return the next transmission, still under way."""
        self.now = now
        self.settle()
        transmission = self.engine.poll_transmit(now)
        if transmission is not None:
            assert len(transmission.frame_bytes) <= self.capabilities.mtu_bytes
        return transmission

    def report(
        self, transmission: Transmission, outcome: TransmitOutcome = TransmitOutcome.SENT
    ) -> None:
        """End a transmission."""
        self.engine.handle_transmit_report(
            TransmitReport(
                transmission_id=transmission.transmission_id,
                outcome=outcome,
                started_at=self.now,
                finished_at=self.now,
            ),
            self.now,
        )
        self.settle()

    def send(self, now: int) -> Transmission | None:
        """Return the next transmission and end it at once."""
        transmission = self.poll(now)
        if transmission is not None:
            self.report(transmission)
        return transmission

    def hear(
        self, frame_bytes: bytes, now: int, *, source: int, destination: int = BROADCAST
    ) -> None:
        """Hand a frame to the engine."""
        self.now = now
        addressed = self.capabilities.addressed
        self.engine.handle_frame(
            ReceivedFrame(
                frame_bytes=frame_bytes,
                received_at=now,
                source=source if addressed else 0,
                destination=destination if addressed else BROADCAST,
            ),
            now,
        )
        self.settle()

    def got(self, kind: type[E]) -> list[E]:
        """Return the events of one kind."""
        return [event for event in self.events if isinstance(event, kind)]


Pass = Callable[[int, int, Transmission], bool]
"""``(source, node, transmission)``: whether the frame arrives there."""


class Rig:
    """Several ends in water without delay, where the test decides what arrives."""

    def __init__(
        self,
        tables: Mapping[int, StreamTable],
        *,
        capabilities: LinkCapabilities | None = None,
        rules: Mapping[int, TransmitRules] = MappingProxyType({}),
    ) -> None:
        self.now = 0
        self.capabilities = capabilities or link()
        self.rules = rules
        self.ends = {
            address: End(
                address,
                table,
                capabilities=self.capabilities,
                rules=rules.get(address, NO_RULES),
            )
            for address, table in tables.items()
        }
        self.frames: list[tuple[int, Transmission]] = []
        """``(source, transmission)`` of everything that was sent."""

    def __getitem__(self, address: int) -> End:
        return self.ends[address]

    def restart(self, address: int, table: StreamTable, *, keeps: bool = False) -> None:
        """Begin a new life of a node, with its journal or without."""
        last = self.ends[address]
        self.ends[address] = End(
            address,
            table,
            epoch=last.engine.epoch + 1,
            capabilities=self.capabilities,
            journal=last.journal if keeps else {},
            now=self.now,
            rules=self.rules.get(address, NO_RULES),
        )

    def publish(self, address: int, stream_id: int, value: object, **settings: Any) -> None:
        """Publish without sending."""
        self.ends[address].engine.publish(stream_id, value, self.now, **settings)

    def exchange(self, passes: Pass = lambda source, node, transmission: True) -> list[bytes]:
        """Let everything cross that can cross now; returns the frames."""
        crossed: list[bytes] = []
        for _ in range(1000):
            sent = False
            for address, end in list(self.ends.items()):
                transmission = end.send(self.now)
                if transmission is None:
                    continue
                sent = True
                crossed.append(transmission.frame_bytes)
                self.frames.append((address, transmission))
                self.deliver(address, transmission, passes)
            if not sent:
                return crossed
        raise AssertionError("the engines do not come to rest")

    def deliver(
        self,
        source: int,
        transmission: Transmission,
        passes: Pass = lambda source, node, transmission: True,
    ) -> None:
        """Hand a transmission to whoever it is for."""
        for address, end in self.ends.items():
            concerns = transmission.destination in (address, BROADCAST)
            if address != source and concerns and passes(source, address, transmission):
                end.hear(
                    transmission.frame_bytes,
                    self.now,
                    source=source,
                    destination=transmission.destination,
                )

    def run(
        self, duration_s: float, passes: Pass = lambda source, node, transmission: True
    ) -> list[bytes]:
        """Let time pass, with timers and exchanges; returns the frames."""
        until = self.now + seconds_to_ns(duration_s)
        crossed = self.exchange(passes)
        for _ in range(100_000):
            due = [end.engine.poll_timeout() for end in self.ends.values()]
            next_at = min((at for at in due if at is not None), default=until)
            if next_at >= until:
                self.now = until
                return crossed
            assert next_at >= self.now
            self.now = max(self.now, next_at)
            for end in self.ends.values():
                due_at = end.engine.poll_timeout()
                if due_at is not None and due_at <= self.now:
                    end.now = self.now
                    end.engine.handle_timeout(self.now)
                    end.settle()
            crossed += self.exchange(passes)
        raise AssertionError("the timers do not come to rest")
