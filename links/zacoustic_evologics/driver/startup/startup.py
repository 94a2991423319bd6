"""From a connection to a ready modem: queries and settings, in order.

These are generators, since a start-up is a list of queries with a few branches. Each yields a
`Command` and gets its answer (None: none came in time), or yields a `Pause`, or a `Reached` at the
end of a stage. The dialogue runs them. A query is sent twice before the modem counts as gone; every
command here is harmless when repeated.

The start-up changes only configured settings and those that the driver cannot work without: it
turns off the modem's own repetitions of instant messages (`AT!RI0`, by the setting `retries`),
turns on the notifications of this port (`AT@ZX1`, `AT@ZU1`), and makes the modem listen. It stores
nothing and restores nothing.
"""

from collections.abc import Generator
from typing import Final, TypeAlias

import msgspec

from zacoustic.errors import LinkError
from zacoustic_evologics.at import commands as asked
from zacoustic_evologics.at import refusals, replies
from zacoustic_evologics.at.answers import reply_text
from zacoustic_evologics.at.encoder import command_name
from zacoustic_evologics.at.framing import SERIAL_LINE_END, TCP_LINE_END, Framing, Interpreter
from zacoustic_evologics.at.settings import SETTINGS
from zacoustic_evologics.config import IN_AIR_SOURCE_LEVEL
from zacoustic_evologics.driver.channel import FENCE, CommandChannel
from zacoustic_evologics.driver.sending.service import DROP_MESSAGES
from zacoustic_evologics.driver.session.session import ModemSession
from zacoustic_evologics.driver.states import Input

DATA_MODE_PAUSE_S: Final = 0.2
"""Pause after `ATO`, which has no answer, s; the vendor's middleware does not wait at all."""
FLIGHT_POLL_S: Final = 0.5
"""Pause between two queries whether an earlier message is still under way, s."""
FLIGHT_POLLS: Final = 5
"""Number of these queries; then the message is dropped."""
NUMBER_READINGS: Final = 5
"""Most queries of one number."""

DEAF_WORDS: Final = ("NOISE", "DEAF", "PHY")
"""Words of `AT?S` for states in which a modem hears nobody."""


class Pause(msgspec.Struct, frozen=True):
    """A pause."""

    duration_s: float
    """Duration, s."""


class Reached(msgspec.Struct, frozen=True):
    """The end of a stage."""

    stage: Input
    """The stage."""


Step: TypeAlias = asked.Command | Pause | Reached
"""The next step of a start-up."""
Stages: TypeAlias = Generator[Step, replies.CommandReply | None, None]
"""A start-up, or a part of one."""
Question: TypeAlias = Generator[Step, replies.CommandReply | None, replies.CommandReply]
"""A part of a start-up that returns a reply."""


SILENT: Final = "the modem does not answer"
"""The fault of a modem that answers in no way; at a serial port perhaps the baud rate."""


class StartupError(LinkError):
    """The modem does not answer, or cannot serve this node; never leaves the dialogue.

    Args:
        message: The fault.
        hint: Its cure.
        is_hopeless: Only people can cure it.
    """

    def __init__(self, message: str, *, hint: str = "", is_hopeless: bool = False) -> None:
        super().__init__(message, hint=hint)
        self.message = message
        self.is_hopeless = is_hopeless


def start_up(channel: CommandChannel, session: ModemSession) -> Stages:
    """Make a modem that has answered ready for frames.

    Raises:
        StartupError: It does not answer, or cannot serve this node.
    """
    yield from confirm(channel)
    yield Reached(Input.FOUND)
    yield from _leave(channel, session)
    yield Reached(Input.LEFT)
    yield from _read(session)
    yield Reached(Input.READ)
    yield from _configure(session)
    yield Reached(Input.CONFIGURED)


def _ask(command: asked.Command) -> Question:
    """Send a query, and repeat it once if there is no answer."""
    for _ in range(2):
        reply = yield command
        if reply is not None:
            return reply
    raise StartupError(f"the modem does not answer AT{command_name(command)}")


def confirm(channel: CommandChannel) -> Stages:
    """Find out the interpreter. Late answers to the probe's queries end here."""
    reply = yield FENCE
    if reply is None:
        other = TCP_LINE_END if channel.line_end == SERIAL_LINE_END else SERIAL_LINE_END
        channel.line_end = other
        reply = yield from _ask(FENCE)
    assert isinstance(reply, replies.ModeReply)
    channel.interpreter = reply.interpreter
    if reply.interpreter is Interpreter.NET and channel.framing is Framing.PACKETS:
        raise StartupError("the modem says NET and talks as in data mode")


def _leave(channel: CommandChannel, session: ModemSession) -> Stages:
    """Leave command mode and the deaf state, and end a message under way."""
    if channel.interpreter is Interpreter.AT and channel.framing is Framing.LINES:
        channel.tell(asked.Act(asked.Action.DATA_MODE))
        channel.framing = Framing.PACKETS
        yield Pause(DATA_MODE_PAUSE_S)
        yield from _ask(FENCE)
    session.interpreter = channel.interpreter
    if session.needs_clearing and channel.framing is Framing.PACKETS:
        yield from _ask(asked.Act(asked.Action.RESET, 4))
    session.needs_clearing = False
    state = replies.state_words((yield from _ask(asked.Query("S"))))
    if any(word in state for word in DEAF_WORDS):
        yield from _ask(asked.Act(asked.Action.LISTEN))
        state = replies.state_words((yield from _ask(asked.Query("S"))))
        if any(word in state for word in DEAF_WORDS):
            raise StartupError(f"the modem does not listen: {state}")
    yield from _await_landing()
    if session.has_piggyback:
        yield from _ask(DROP_MESSAGES)
    session.has_piggyback = False


def _await_landing() -> Stages:
    """Wait until no earlier message is under way: its reports would be taken for those of ours."""
    for _ in range(FLIGHT_POLLS):
        reply = yield from _ask(asked.Query("DI"))
        if reply != replies.DeliveryReply(replies.DeliveryState.DELIVERING):
            return
        yield Pause(FLIGHT_POLL_S)
    yield from _ask(DROP_MESSAGES)


def _read(session: ModemSession) -> Stages:
    """Read the modem's values; those that a firmware lacks stay unknown."""
    firmware = yield from _ask(asked.Act(asked.Action.INFORMATION, 0))
    session.firmware = firmware.text if isinstance(firmware, replies.TextReply) else ""
    address = yield from _ask_number("AL")
    if address is None:
        raise StartupError("the modem does not tell its address")
    session.address = address
    highest = yield from _ask_number("AM")
    session.highest_address = 254 if highest is None else highest
    for name in ("L", "LC", "G", "RI"):
        session.note_setting(name, (yield from _ask_number(name)))
    session.may_repeat = False
    session.sound_speed_m_s = yield from _ask_number("CA")
    clock = yield from _ask(asked.Query("CLOCK"))  # its instant: `StartupRun.handle_answer`
    session.clock_us = clock.value if isinstance(clock, replies.Number) else None
    battery = yield from _ask(asked.Query("BV"))
    session.battery_v = battery.value if isinstance(battery, replies.Measurement) else None


def _ask_number(name: str) -> Generator[Step, replies.CommandReply | None, int | None]:
    """Query a number until two answers agree; None: it is not known.

    If a port damages bytes, one digit is no proof, and much depends on these numbers.
    """
    setting = SETTINGS.get(name)
    seen: list[int | None] = []
    for _ in range(NUMBER_READINGS):
        reply = yield from _ask(asked.Query(name))
        value = None
        if isinstance(reply, replies.Number) and (setting is None or setting.allows(reply.value)):
            value = reply.value
        elif not isinstance(reply, replies.Refused):
            continue
        if value in seen:
            return value
        seen.append(value)
    return None


def _configure(session: ModemSession) -> Stages:
    """Change the settings, check that the modem can serve, then set the options of this port.

    `[*]OK` may mean that the setting is not in force yet; it counts as OK.
    """
    wanted = _wanted(session)
    session.changes = []
    if wanted:
        yield from _ask(asked.SetOption("CTRL"))  # older firmware neither knows nor needs it
    for setting, before in wanted:
        yield from _change(session, setting, before)
    _check(session)
    config = session.config
    session.has_extended_notifications = session.has_usbl = False
    if config.extended_notifications:
        reply = yield from _ask(asked.SetOption("ZX", 1))
        session.has_extended_notifications = isinstance(reply, replies.Accepted)
    if config.usbl:
        reply = yield from _ask(asked.SetOption("ZU", 1))
        session.has_usbl = isinstance(reply, replies.Accepted)


def _change(session: ModemSession, setting: asked.Set, before: int | None) -> Stages:
    """Change a setting and read it back, twice at most: a restarting modem forgets the first."""
    refusal: replies.Refused | None = None
    for _ in range(2):
        reply = yield from _ask(setting)
        refusal = reply if isinstance(reply, replies.Refused) else None
        if refusal is not None:
            continue
        value = yield from _ask_number(setting.name)
        session.note_setting(setting.name, setting.value if value is None else value)
        if value in (None, setting.value):
            session.changes.append(f"{setting.name} {before} to {setting.value}")
            break
    if refusal is not None:
        _refuse(setting, refusal)


def _wanted(session: ModemSession) -> list[tuple[asked.Set, int | None]]:
    """Return the settings to change, with their present values."""
    config = session.config
    wanted: list[tuple[asked.Set, int | None]] = []

    def want(name: str, now: int | None, value: int | None) -> None:
        if value is not None and now != value:
            wanted.append((asked.Set(name, value), now))

    want("AM", session.highest_address, config.highest_address)
    if config.set_address:
        want("AL", session.address, session.node_address)
    want("L", session.source_level, IN_AIR_SOURCE_LEVEL if config.deck else config.source_level)
    if config.deck and session.source_level_control is not None:
        want("LC", session.source_level_control, 0)  # no other modem may make it louder
    want("G", session.gain, config.gain)
    if session.retries is not None:
        want("RI", session.retries, config.retries)
    return wanted


def _refuse(setting: asked.Set, reply: replies.Refused) -> None:
    """Accept the refusal of a setting if the driver can do without; otherwise raise."""
    if setting.name in ("RI", "LC"):
        # Without the first there are no acknowledgements (`ModemSession.acknowledges`); without
        # the second the level is set again when somebody changes it (`Inquiries.silence`).
        return
    words = reply_text(reply)
    is_controlled = reply == refusals.NO_CONTROL
    raise StartupError(
        f"the modem refuses AT!{setting.name}{setting.value}: {words}",
        hint="another program has the control (AT@CTRL), or this port's AT?ZS is not 0"
        if is_controlled
        else "",
        is_hopeless=True,
    )


def _check(session: ModemSession) -> None:
    """Check that the modem can serve this node."""
    here = session.node_address
    if session.address != here:
        raise StartupError(
            f"the modem has address {session.address}, this node {here}",
            hint=f"set_address=true gives it {here}",
            is_hopeless=True,
        )
    if here > session.highest_address:
        raise StartupError(
            f"highest address of the network is {session.highest_address}, this node has {here}",
            hint="highest_address=14 (or 30, 62, …) in all modems",
            is_hopeless=True,
        )
    if session.config.deck and session.source_level != IN_AIR_SOURCE_LEVEL:
        raise StartupError(
            f"on deck, and the source level is {session.source_level}, not {IN_AIR_SOURCE_LEVEL}",
            hint="take deck=true away in water only",
            is_hopeless=True,
        )
