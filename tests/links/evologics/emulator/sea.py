"""Emulated modems with a host at each port, stepped through virtual time."""

from collections.abc import Callable
from typing import Any

from zacoustic.channel.scenario import Scenario
from zacoustic.core.clock import ns_to_seconds, seconds_to_ns
from zacoustic_evologics import AtDecoder, Framing, Interpreter
from zacoustic_evologics.at.messages import Message, Unrecognised
from zacoustic_evologics.emulator import (
    EmulatedFleet,
    ModemOutput,
    PortBytes,
    PortClosed,
    scenario_of,
)


class Host:
    """What is at the other end of a port: it says bytes, and reads what comes."""

    def __init__(self, sea: "Sea", port_id: int, framing: Framing) -> None:
        self.port_id = port_id
        self.decoder = AtDecoder(framing)
        self.heard: list[tuple[float, Message]] = []
        self.raw = bytearray()
        self.is_closed = False
        self._sea = sea

    @property
    def messages(self) -> list[Message]:
        return [message for _, message in self.heard]

    def lines(self) -> list[str]:
        """What was said since the last call, line by line."""
        text, self.raw = self.raw.decode("latin-1"), bytearray()
        return text.removesuffix("\r\n").split("\r\n") if text else []

    def say(self, content: bytes) -> list[str]:
        """Say something; what is answered at once is returned, nothing that came before."""
        self.raw.clear()
        self._sea.fleet.handle_bytes(self.port_id, content, self._sea.fleet.now)
        self._sea.collect()
        return self.lines()

    def take(self, content: bytes, now: int) -> None:
        self.raw += content
        self.heard += [(ns_to_seconds(now), each) for each in self.decoder.feed(content)]

    def first(self, kind: type[Any]) -> Any:
        return next(message for _, message in self.heard if isinstance(message, kind))

    def all_of(self, kind: type[Any]) -> list[Any]:
        return [message for _, message in self.heard if isinstance(message, kind)]

    def at(self, kind: type[Any], number: int = 0) -> float:
        """When the message of that kind came, s."""
        return [at for at, message in self.heard if isinstance(message, kind)][number]


class Sea:
    """A fleet and the hosts of its modems."""

    def __init__(
        self, scenario: Scenario | int = 2, *, spacing_m: float = 1500.0, **options: Any
    ) -> None:
        if isinstance(scenario, int):
            scenario = scenario_of(scenario, spacing_m=spacing_m)
        self.fleet = EmulatedFleet(scenario, **options)
        self.hosts: dict[int, Host] = {}
        self.outputs: list[tuple[int, ModemOutput]] = []
        self._hearers: list[Callable[[], None]] = []

    def hear(self, hearer: Callable[[], None]) -> None:
        """Call somebody whenever something was said."""
        self._hearers.append(hearer)

    def host(self, address: int, *, is_serial: bool = False) -> Host:
        fleet = self.fleet
        port_id = fleet.open_port(address, now=fleet.now, is_serial=is_serial)
        is_net = fleet.interpreter is Interpreter.NET
        host = Host(self, port_id, Framing.LINES if is_net else Framing.PACKETS)
        self.hosts[port_id] = host
        self.collect()
        return host

    def collect(self) -> None:
        while (output := self.fleet.poll_output()) is not None:
            self.outputs.append((self.fleet.now, output))
            if isinstance(output, PortBytes):
                self.hosts[output.port_id].take(output.content, self.fleet.now)
            elif isinstance(output, PortClosed):
                self.hosts[output.port_id].is_closed = True
        for hearer in self._hearers:
            hearer()

    def run(self, until_s: float | None = None) -> None:
        """Let happen what is due up to an instant; without one, all that is due."""
        until = None if until_s is None else seconds_to_ns(until_s)
        while (due_at := self.fleet.poll_timeout()) is not None:
            if until is not None and due_at > until:
                break
            self.fleet.handle_timeout(due_at)
            self.collect()
        if until is not None:
            self.fleet.handle_timeout(until)
            self.collect()

    def wait(self, seconds: float) -> None:
        self.run(ns_to_seconds(self.fleet.now) + seconds)

    def unrecognised(self) -> list[Message]:
        return [
            message
            for host in self.hosts.values()
            for message in host.messages
            if isinstance(message, Unrecognised)
        ]
