"""A dialogue and a scripted modem on one bench, in hand-stepped time.

The modem is as simple as can be: it obeys settings, takes frames and says what a real one says,
each thing after a fixed time. What it does otherwise is a script: `answers["*SENDIM"] = ["BUSY"]`
gives that text to the next such command, None loses the answer (the command is obeyed all the same)
and `IGNORED` loses the command.
"""

import heapq
import itertools
from collections.abc import Callable, Iterable
from functools import partial
from typing import Final

from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkState,
    Measurement,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)
from zacoustic_evologics.airtime import BIT_RATE_BPS, PREAMBLE_S
from zacoustic_evologics.at.answers import reply_text
from zacoustic_evologics.at.command_decoder import CommandDecoder
from zacoustic_evologics.at.commands import (
    Act,
    Action,
    Command,
    InvalidCommand,
    Query,
    SendBurst,
    SendIm,
    SendIms,
    SendPbm,
    Set,
    SetOption,
)
from zacoustic_evologics.at.encoder import Speakable, command_name, encode_message
from zacoustic_evologics.at.framing import Framing, Interpreter
from zacoustic_evologics.at.messages import RawData, Reply
from zacoustic_evologics.at.notifications import (
    CanceledIm,
    Delivered,
    DeliveredIm,
    ImFlag,
    RecvEnd,
    SendEnd,
    SendStart,
)
from zacoustic_evologics.at.replies import NetStatus
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.driver.dialogue import AtDialogue
from zacoustic_evologics.driver.events import (
    CarrierChanged,
    ConnectionUseless,
    FrameHeard,
    LinkChanged,
    Measured,
    OpeningHopeless,
    TransmissionEnded,
)
from zacoustic_evologics.driver.states import State

IGNORED: Final = "ignored"
ANSWER_S: Final = 0.004
PROPAGATION_S: Final = 0.1


class ScriptedModem:
    """What the dialogue talks to; `say` is where its bytes go."""

    def __init__(
        self,
        interpreter: Interpreter = Interpreter.NET,
        framing: Framing = Framing.LINES,
        *,
        line_end: bytes | None = None,
    ) -> None:
        self.decoder = CommandDecoder(interpreter, framing)
        self.line_end = line_end
        self.settings = {"AL": 1, "AM": 14, "L": 3, "LC": 0, "G": 0, "RI": 1, "CA": 1500, "T": 1000,
                         "PC": 5, "ZX": 0, "ZU": 0, "ZF": 0, "RT": 1500}  # fmt: skip
        self.state = "INITIATION LISTEN"
        self.delivery = "EMPTY"
        self.heard: list[Command | InvalidCommand | RawData] = []
        self.answers: dict[str, list[str | None]] = {}
        self.tells_end = True
        self.delivers = True
        self.schedule: Callable[[float, Callable[[], None]], None] = lambda after_s, act: act()
        self.write: Callable[[bytes], None] = lambda raw: None
        self.instant: Callable[[], int] = lambda: 0

    @property
    def clock_us(self) -> int:
        """Its clock, which turns over soon after the start."""
        return (self.instant() // 1000 + 2**32 - 8_000_000) % 2**32

    @property
    def sent(self) -> list[SendIm | SendIms | SendBurst]:
        """The frames that it was given, accepted or not."""
        return [each for each in self.heard if isinstance(each, SendIm | SendIms | SendBurst)]

    def names(self) -> list[str]:
        """Names of the commands that it heard."""
        return [
            each.name if isinstance(each, InvalidCommand) else command_name(each)
            for each in self.heard
            if not isinstance(each, RawData)
        ]

    def feed(self, raw: bytes) -> None:
        if self.line_end is not None:
            foreign = b"\n" if self.line_end == b"\r" else b"\r"
            raw = raw.replace(foreign, b"?")
        for command in self.decoder.feed(raw):
            self.heard.append(command)
            if not isinstance(command, RawData):
                self._answer(command)

    def say(self, message: Speakable) -> None:
        self.write(encode_message(message, self.decoder.framing))

    def restart(self) -> None:
        """Lose all that is volatile, as with the power."""
        self.decoder = CommandDecoder(self.decoder.interpreter, self.decoder.framing)
        self.settings |= {"ZX": 0, "ZU": 0, "RI": 1}
        self.delivery = "EMPTY"

    def _answer(self, command: Command | InvalidCommand) -> None:
        name = command.name if isinstance(command, InvalidCommand) else command_name(command)
        script = self.answers.get(name)
        scripted = script.pop(0) if script else ""
        if scripted == IGNORED:
            return
        refused = scripted is not None and scripted.startswith(("ERROR", "BUSY"))
        text = scripted if refused else self._execute(command)
        if scripted:
            text = scripted
        if text is None or scripted is None:
            return
        packets = self.decoder.framing is Framing.PACKETS
        reply = Reply(text, name if packets else None)
        self.schedule(ANSWER_S, lambda: self._say_reply(reply, text))

    def _say_reply(self, reply: Reply, text: str) -> None:
        end = b"\r\n" if text.endswith("\n") and reply.command is None else b""
        raw = text.encode() + end if end else encode_message(reply, self.decoder.framing)
        self.write(raw)

    def _execute(self, command: Command | InvalidCommand) -> str | None:
        match command:
            case InvalidCommand():
                return reply_text(command.mistake.value)
            case Query("MODE"):
                return self.decoder.interpreter.value
            case Query("S"):
                if self.decoder.interpreter is Interpreter.AT:
                    return f"{self.state} 16384"
                return reply_text(
                    NetStatus(local_address=1, remote_address=0, state=self.state, pool="0 16384",
                              promiscuous=False)
                )  # fmt: skip
            case Query("DI"):
                return self.delivery
            case Query("BV"):
                return "24.1000"
            case Query("CLOCK"):
                return str(self.clock_us)
            case Query(name):
                value = self.settings.get(name)
                return "ERROR UNKNOWN COMMAND" if value is None else str(value)
            case Set() | SetOption():
                if command.value is not None:
                    self.settings[command.name] = command.value
                return "OK"
            case Act(Action.INFORMATION):
                return "1.9"
            case Act(Action.DATA_MODE):
                return None
            case Act(Action.LISTEN):
                self.state = "INITIATION LISTEN"
                return self.state
            case Act(Action.RESET, value):
                if self.delivery == "DELIVERING" and value == 3:
                    self.delivery = "EMPTY"
                return "OK"
            case SendIm() | SendIms():
                self._fly(command)
                return "OK"
            case SendBurst():
                self._fly_burst(command)
                return "OK"
            case SendPbm():
                return "OK"
            case _:
                return "OK"

    def _fly(self, command: SendIm | SendIms) -> None:
        kind = "im" if isinstance(command, SendIm) else "ims"
        airtime_s = PREAMBLE_S + 8 * len(command.payload) / BIT_RATE_BPS
        duration_us = round(airtime_s * 1e6)
        to, delivered = command.destination, self.delivers
        acknowledged = isinstance(command, SendIm) and command.flag is ImFlag.ACK
        self.delivery = "DELIVERING"
        start = SendStart(destination=to, kind=kind, duration_us=duration_us, delay_us=0)
        starts_us = (self.clock_us + round(2e6 * ANSWER_S)) % 2**32
        end = SendEnd(destination=to, kind=kind, clock_us=starts_us, duration_us=duration_us)
        self.schedule(2 * ANSWER_S, lambda: self._notify(start, self.settings["ZX"]))
        self.schedule(2 * ANSWER_S + airtime_s, lambda: self._end(end, acknowledged))
        if acknowledged:
            after_s = airtime_s + 2 * PROPAGATION_S + 0.25
            heard = RecvEnd(clock_us=0, duration_us=139_376, rssi_db=-36, integrity=77)
            if delivered:
                self.schedule(after_s, lambda: self._notify(heard, self.settings["ZX"]))
            self.schedule(after_s, lambda: self._deliver(to, delivered))

    def _end(self, end: SendEnd, acknowledged: bool) -> None:
        if not acknowledged:
            self.delivery = "EMPTY"
        self._notify(end, self.settings["ZX"])

    def _deliver(self, to: int, delivered: bool) -> None:
        if self.delivery == "EMPTY":
            self._notify(CanceledIm(to), 1)
            return
        self.delivery = "DELIVERED" if delivered else "FAILED"
        if delivered:
            self._notify(DeliveredIm(to), 1)
        else:
            self._notify_failed(to)

    def _notify_failed(self, to: int) -> None:
        if self.tells_end:
            self.write_line(f"FAILEDIM,{to}")

    def _notify(self, record: Speakable, wanted: int) -> None:
        if wanted and self.tells_end:
            self.say(record)

    def write_line(self, line: str) -> None:
        body = line.encode()
        if self.decoder.framing is Framing.PACKETS:
            body = b"+++AT:%d:%s" % (len(body), body)
        self.write(body + b"\r\n")

    def _fly_burst(self, command: SendBurst) -> None:
        counter = self.settings["PC"]
        self.settings["PC"] += 1
        to, delivered = command.destination, self.delivers

        def end() -> None:
            if delivered:
                self._notify(Delivered(counter=counter, destination=to), 1)
            elif self.tells_end:
                self.write_line(f"FAILED,{counter},{to}")

        self.schedule(2.0, end)


class Bench:
    """The two, and the time."""

    def __init__(
        self,
        modem: ScriptedModem | None = None,
        config: EvologicsConfig | None = None,
        *,
        node_address: int = 1,
        is_serial: bool = False,
        split: Callable[[bytes], Iterable[bytes]] | None = None,
    ) -> None:
        self.now = 5 * NS_PER_S
        self.modem = modem or ScriptedModem()
        self.config = config or EvologicsConfig()
        self.dialogue = AtDialogue(self.config, node_address=node_address, is_serial=is_serial)
        self.frames: list[ReceivedFrame] = []
        self.reports: list[TransmitReport] = []
        self.changes: list[tuple[LinkState, str]] = []
        self.carrier: list[bool] = []
        self.measurements: list[Measurement] = []
        self.hopeless: list[OpeningHopeless] = []
        self.resets: list[str] = []
        self.order: list[str] = []
        self.is_connected = False
        self.reconnects = True
        """What a byte stream does: makes a connection that is of no use anew."""
        self.on_report: Callable[[TransmitReport], None] = lambda report: None
        self.written: list[bytes] = []
        self._split = split or (lambda raw: (raw,))
        self._heap: list[tuple[int, int, Callable[[], None]]] = []
        self._count = itertools.count()
        self._generation = 0
        self._next_id = 1
        self.modem.schedule = self.after
        self.modem.write = self.to_dialogue
        self.modem.instant = lambda: self.now

    # Time

    def after(self, delay_s: float, act: Callable[[], None]) -> None:
        entry = (self.now + seconds_to_ns(delay_s), next(self._count), act)
        heapq.heappush(self._heap, entry)

    def step(self) -> bool:
        """Let the next thing happen; False when nothing is to happen."""
        due_at = self.dialogue.poll_timeout()
        if self._heap and (due_at is None or self._heap[0][0] <= due_at):
            at, _, act = heapq.heappop(self._heap)
            self.now = max(self.now, at)
            act()
        elif due_at is not None:
            assert due_at >= self.now or due_at >= self.now - NS_PER_S, "a timer lies far behind"
            self.now = max(self.now, due_at)
            self.dialogue.handle_timeout(self.now)
            self.serve()
        else:
            return False
        return True

    def run(self, duration_s: float) -> None:
        """Let this time pass."""
        end = self.now + seconds_to_ns(duration_s)
        while True:
            due_at = self.dialogue.poll_timeout()
            instants = [self._heap[0][0]] if self._heap else []
            instants += [] if due_at is None else [due_at]
            if not instants or min(instants) > end:
                break
            self.step()
        self.now = end

    def until(self, condition: Callable[[], object], limit_s: float = 120.0) -> None:
        """Let time pass until something holds."""
        end = self.now + seconds_to_ns(limit_s)
        while not condition():
            assert self.now <= end, f"not within {limit_s} s; {self.changes} {self.reports}"
            assert self.step(), f"nothing is to happen any more; {self.changes} {self.reports}"

    # The connection

    def connect(self) -> None:
        self._generation += 1
        self.is_connected = True
        self.dialogue.handle_opened(self.now)
        self.serve()

    def cut(self, reason: str = "cut") -> None:
        self.is_connected = False
        self._generation += 1
        self.dialogue.handle_lost(reason, self.now)
        self.serve()

    def to_dialogue(self, raw: bytes) -> None:
        """Bytes of the modem arrive."""
        if not self.is_connected:
            return
        generation = self._generation
        for piece in self._split(raw):
            if generation != self._generation:
                return
            self.dialogue.handle_bytes(piece, self.now)
            self.serve()

    def serve(self) -> None:
        """Do what the contract asks of a shell."""
        while (output := self.dialogue.poll_output()) is not None:
            self.written.append(output)
            if self.is_connected:
                self._to_modem(output)
        while (event := self.dialogue.poll_event()) is not None:
            self.order.append(type(event).__name__)
            match event:
                case FrameHeard():
                    self.frames.append(event.frame)
                case TransmissionEnded():
                    self.reports.append(event.report)
                    self.on_report(event.report)
                case LinkChanged():
                    self.changes.append((event.state, event.detail))
                case CarrierChanged():
                    self.carrier.append(event.busy)
                case Measured():
                    self.measurements.append(event.measurement)
                case OpeningHopeless():
                    self.hopeless.append(event)
                case ConnectionUseless():
                    self.resets.append(event.reason)
                    if self.is_connected:
                        self.is_connected = False
                        self._generation += 1
                        self.after(0.0, partial(self._lose, event.reason))

    def _to_modem(self, output: bytes) -> None:
        generation = self._generation

        def arrive() -> None:
            if generation == self._generation:
                self.modem.feed(output)

        self.after(0.001, arrive)

    def _lose(self, reason: str) -> None:
        self.dialogue.handle_lost(f"address: {reason}", self.now)
        self.serve()
        if self.reconnects:
            self.after(0.2, self.connect)

    def replace(self, modem: ScriptedModem) -> None:
        """Another modem is there now."""
        modem.schedule, modem.write, modem.instant = self.after, self.to_dialogue, lambda: self.now
        self.modem = modem

    # What is done with it

    def make_ready(self) -> None:
        self.connect()
        self.until(lambda: self.dialogue.state is State.READY)
        self.run(0.5)

    def transmit(
        self, content: bytes = b"hello", to: int = BROADCAST, *, acknowledge: bool = False
    ) -> int:
        transmission = Transmission(
            transmission_id=self._next_id,
            frame_bytes=content,
            destination=to,
            acknowledge=acknowledge,
        )
        self._next_id += 1
        self.dialogue.transmit(transmission, self.now)
        self.serve()
        return transmission.transmission_id

    def send(
        self, content: bytes = b"hello", to: int = BROADCAST, *, acknowledge: bool = False
    ) -> TransmitReport:
        """Transmit, and wait for the report."""
        transmission_id = self.transmit(content, to, acknowledge=acknowledge)
        self.until(lambda: self.reports_of(transmission_id))
        reports = self.reports_of(transmission_id)
        assert len(reports) == 1
        return reports[0]

    def reports_of(self, transmission_id: int) -> list[TransmitReport]:
        return [each for each in self.reports if each.transmission_id == transmission_id]
