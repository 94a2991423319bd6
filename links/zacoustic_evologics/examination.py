"""The queries of `zacoustic config doctor` to a modem: it changes no setting and transmits nothing.

They are those of the start-up (`driver.startup`), without its changes and without the filler, which
in data mode would be data for the channel. If a port does not answer, other baud rates are tried.
Findings name the effect of each answer at sea.
"""

import asyncio
import time
from collections.abc import Generator, Iterator, Mapping
from typing import Any, Final

from zacoustic.bytestream import ByteStream, holders
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.link import Finding
from zacoustic_evologics.at.commands import Act, Action, Command, Query
from zacoustic_evologics.at.decoder import AtDecoder
from zacoustic_evologics.at.firmware import FIRMWARES
from zacoustic_evologics.at.messages import Message, Reply
from zacoustic_evologics.at.replies import (
    CommandReply,
    Number,
    TextReply,
    state_words,
)
from zacoustic_evologics.at.settings import SOURCE_LEVELS_DB
from zacoustic_evologics.config import IN_AIR_SOURCE_LEVEL, EvologicsConfig
from zacoustic_evologics.driver.channel import CommandChannel
from zacoustic_evologics.driver.session.session import ModemSession
from zacoustic_evologics.driver.startup.probe import Probe
from zacoustic_evologics.driver.startup.run import StartupRun
from zacoustic_evologics.driver.startup.startup import (
    DEAF_WORDS,
    SILENT,
    Reached,
    Stages,
    StartupError,
    Step,
    confirm,
)
from zacoustic_evologics.driver.states import Input

BAUDRATES: Final = (19_200, 115_200, 9_600, 38_400, 57_600, 4_800, 2_400)
"""Baud rates to try on a serial port, the usual one first."""
NORMAL_GAIN: Final = 0

_BURST_WORDS: Final = ("ESTABLISH", "ONLINE", "BACKOFF", "DISCONNECT")
_BITS_PER_BYTE: Final = 10


class Examination:
    """One connection to a modem, for queries.

    Args:
        address: `tcp:HOST:PORT` or `serial:PORT`.
        baudrate: Baud rate of a serial port.
        reply_s: Time limit of an answer, s.
    """

    def __init__(self, address: str, baudrate: int, reply_s: float) -> None:
        self._is_serial = address.startswith("serial:")
        self._stream = ByteStream(address, baudrate=baudrate)
        self._reply_ns = seconds_to_ns(reply_s)
        self._byte_ns = _BITS_PER_BYTE * NS_PER_S // baudrate if self._is_serial else 0
        self._decoder = AtDecoder()
        self._heard: asyncio.Queue[Message | None] = asyncio.Queue()
        self.channel = CommandChannel(reply_ns=self._reply_ns, byte_ns=self._byte_ns)
        """Takes the commands."""
        self.reason = ""
        """Why there is no connection."""
        self.bytes_heard = 0
        """Number of bytes received, understood or not."""

    async def run(self, session: ModemSession, stages: Stages, patience_s: float) -> bool:
        """Connect, look for a modem, and run stages to their end; False: nothing answers."""
        self._stream.open(self)
        try:
            async with asyncio.timeout(patience_s):
                await self._heard.get()
        except TimeoutError:
            self.reason = self.reason or "no connection"
        if self.reason:
            return False
        probe = Probe(
            is_serial=self._is_serial, may_fill=False, reply_ns=self._reply_ns,
            byte_ns=self._byte_ns,
        )  # fmt: skip
        run = StartupRun(self.channel, session, probe, stages)
        run.start(time.monotonic_ns())
        try:
            while not await self._go_on(run):
                self._decoder.framing = self.channel.framing
        except StartupError:
            return False
        return True

    async def close(self) -> None:
        """Release the port."""
        await self._stream.close()

    async def _go_on(self, run: StartupRun) -> list[Input]:
        """Wait for a message, or the end of a time; return the stages that are completed."""
        while (output := self.channel.poll_output()) is not None:
            self._stream.write(output)
        message = await self._next(run.due_at if run.is_probing else self.channel.due_at)
        now = time.monotonic_ns()
        if run.is_probing:
            return run.handle_timeout(now) if message is None else run.handle_message(message, now)
        if isinstance(message, Reply):
            answer = self.channel.handle_reply(message, now)
        else:
            answer = self.channel.handle_timeout(now)
        if answer is None or answer.late:
            return []
        if answer.ticket == run.ticket:
            return run.handle_answer(answer, now)
        if answer.reply is None:  # not even the channel's own query is answered
            raise StartupError(SILENT)
        return []

    async def _next(self, due_at: int | None) -> Message | None:
        """Return the modem's next message; None: the time or the connection has ended."""
        left_s = max(0.0, ((due_at or 0) - time.monotonic_ns()) / NS_PER_S)
        try:
            async with asyncio.timeout(left_s):
                return await self._heard.get()
        except TimeoutError:
            return None

    # Called by the stream

    def stream_opened(self) -> None:
        """Note a connection."""
        self.reason = ""
        self._heard.put_nowait(None)

    def bytes_received(self, data: bytes, received_at: int) -> None:
        """Take bytes of the modem."""
        self.bytes_heard += len(data)
        for message in self._decoder.feed(data):
            self._heard.put_nowait(message)

    def stream_lost(self, reason: str) -> None:
        """Note that the connection was lost, or could not be made."""
        if not self.reason:
            self.reason = reason
            self._heard.put_nowait(None)


async def examine(
    address: str, config: EvologicsConfig, node_address: int, patience_s: float
) -> list[Finding]:
    """Examine the modem at a port.

    Args:
        address: `tcp:HOST:PORT` or `serial:PORT`.
        config: Settings of the driver.
        node_address: Acoustic address of the node.
        patience_s: Time limit of a connection, s.
    """
    if address.startswith("serial:") and (others := holders(address)):
        return [_unreachable(address, f"in use by another program: {', '.join(others)}")]
    examination = Examination(address, config.baudrate, config.reply_s)
    session = ModemSession(config, node_address)
    found: list[Finding] = []
    stages = _judge(examination.channel, config, node_address, found)
    try:
        if await examination.run(session, stages, patience_s):
            return found
    finally:
        await examination.close()
    if examination.reason:
        return [_unreachable(address, examination.reason)]
    if address.startswith("serial:"):
        for baudrate in BAUDRATES:
            if baudrate != config.baudrate and await _answers(address, baudrate, session):
                return [_wrong_baudrate(address, config.baudrate, baudrate)]
    return [_silent(address, config.baudrate, examination.bytes_heard)]


def assess(health: Mapping[str, Any], config: EvologicsConfig) -> list[Finding]:
    """Find faults in the modem's values in a running gateway's health report.

    Args:
        health: Documents of the gateway, by name.
        config: Settings of the driver.
    """
    readings = health.get("link", {}).get("diagnostics", {})
    if not isinstance(readings, Mapping) or readings.get("state") != "ready":
        return []
    found = list(_of_firmware(TextReply(str(readings.get("firmware", "")))))
    level = readings.get("source_level")
    if isinstance(level, int):
        found += _of_level(Number(level), config)
    gain = readings.get("gain")
    if isinstance(gain, int):
        found += _of_gain(Number(gain), config)
    return found


async def _answers(address: str, baudrate: int, session: ModemSession) -> bool:
    examination = Examination(address, baudrate, min(session.config.reply_s, 0.5))
    try:
        return await examination.run(session, _find(examination.channel), 2.0)
    finally:
        await examination.close()


def _find(channel: CommandChannel) -> Stages:
    """Only see that it is a modem."""
    yield from confirm(channel)
    yield Reached(Input.FOUND)


def _judge(
    channel: CommandChannel, config: EvologicsConfig, node_address: int, found: list[Finding]
) -> Stages:
    """Query the modem, and judge its answers."""
    yield from confirm(channel)
    found += _of_firmware((yield from _ask(Act(Action.INFORMATION, 0))))
    found += _of_state((yield from _ask(Query("S"))))
    found += _of_address((yield from _ask(Query("AL"))), config, node_address)
    highest = yield from _ask(Query("AM"))
    is_left = isinstance(highest, Number) and config.highest_address is None
    if isinstance(highest, Number) and is_left and node_address > highest.value:
        found.append(_too_small(highest.value, node_address))
    found += _of_level((yield from _ask(Query("L"))), config)
    found += _of_gain((yield from _ask(Query("G"))), config)
    yield Reached(Input.READ)


def _ask(command: Command) -> Generator[Step, CommandReply | None, CommandReply | None]:
    """Send a query, twice if there is no answer; None: there was none."""
    reply = yield command
    return (yield command) if reply is None else reply


def _of_firmware(reply: CommandReply | None) -> Iterator[Finding]:
    text = reply.text.strip() if isinstance(reply, TextReply) else ""
    if not text.startswith(FIRMWARES):
        yield Finding(
            what=f"firmware of the modem is unknown: it answers {text or 'nothing'!r} to ATI0",
            why="its messages may have another form than the driver knows, and be dropped",
            cure=f"try it on the bench, or load one of {', '.join(FIRMWARES)}",
        )


def _of_state(reply: CommandReply | None) -> Iterator[Finding]:
    state = state_words(reply)
    if any(word in state for word in DEAF_WORDS):
        yield Finding(
            what=f"the modem does not listen: AT?S says {state}",
            why="it hears nobody, and acknowledges nothing",
            cure="ATA makes it listen; the gateway says that when it starts; see who stops it",
        )
    elif any(word in state for word in _BURST_WORDS):
        yield Finding(
            what=f"the modem is in burst mode: AT?S says {state}",
            why="it sets up or holds a burst connection, again and again if nobody answers: that "
            "fills the channel, and frames of the gateway have to wait",
            cure="ATZ1 drops the burst data; see which other program has sent them",
        )


def _of_address(
    reply: CommandReply | None, config: EvologicsConfig, node_address: int
) -> Iterator[Finding]:
    if not isinstance(reply, Number):
        yield Finding(
            what="the modem does not tell its address (AT?AL)",
            why="nobody can tell who speaks",
            cure="switch the modem off and on",
        )
    elif reply.value != node_address and not config.set_address:
        yield Finding(
            what=f"the modem has address {reply.value}, this node {node_address}",
            why="two modems of one address answer for each other, and take each other's frames; "
            "the gateway does not start so",
            cure=f"address: {reply.value} in the file, or set_address=true in the locator, which "
            f"gives the modem {node_address}",
        )


def _too_small(highest: int, node_address: int) -> Finding:
    return Finding(
        what=f"highest address of the network is {highest}, this node has {node_address}",
        why="the modem takes no address above; the gateway does not start so",
        cure="highest_address=14 (or 30, 62, …) in the locator of all modems",
    )


def _of_level(reply: CommandReply | None, config: EvologicsConfig) -> Iterator[Finding]:
    if config.deck or not isinstance(reply, Number):
        return
    level = reply.value if config.source_level is None else config.source_level
    if level == IN_AIR_SOURCE_LEVEL:
        yield Finding(
            what=f"source level is {level}, {SOURCE_LEVELS_DB[level]:g} dB: that of a bench in air",
            why="in water nobody farther than some hundred metres hears it",
            cure="source_level=0 in the locator, or AT!L0 in the modem; deck=true where it is in "
            "air",
        )


def _of_gain(reply: CommandReply | None, config: EvologicsConfig) -> Iterator[Finding]:
    if config.deck or not isinstance(reply, Number):
        return
    gain = reply.value if config.gain is None else config.gain
    if gain != NORMAL_GAIN:
        yield Finding(
            what=f"gain of the receiver is {gain}, low, as for a tank",
            why="in water it hears only who is near",
            cure="gain=0 in the locator, or AT!G0 in the modem; deck=true where it is in air",
        )


def _wrong_baudrate(address: str, given: int, found: int) -> Finding:
    return Finding(
        what=f"{address}: no modem at {given} baud, one answers at {found}",
        why="what passes is nonsense at both ends, and looks like a dead modem",
        cure=f"baudrate={found} in the locator",
    )


def _silent(address: str, baudrate: int, bytes_heard: int) -> Finding:
    heard = f"; {bytes_heard} bytes came that mean nothing" if bytes_heard else ""
    where = f" at {baudrate} baud or any usual rate" if address.startswith("serial:") else ""
    return Finding(
        what=f"{address}: no modem answers{where}{heard}",
        why="without it this node is deaf and mute",
        cure="see that it has power, that transmit and receive are not crossed, and that no other "
        "program talks to this port",
    )


def _unreachable(address: str, reason: str) -> Finding:
    reason = reason.removeprefix(f"{address}: ")
    cure = "see that it is switched on, and that address and cable are right"
    if "in use" in reason:
        cure = "stop the other program; if it is the gateway, name its router by --connect"
    elif "Permission" in reason:
        cure = "add the user of the gateway to the group of the port (often dialout), and log in "
        cure += "again; or write a udev rule"
    return Finding(
        what=f"{address}: {reason}",
        why="the gateway cannot open the modem either",
        cure=cure,
    )
