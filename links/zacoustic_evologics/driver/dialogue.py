"""The dialogue with one modem, without a port and without a clock.

Contract with the shell that has both (`link`): after any input or command, call `poll_output` until
None and write the bytes, call `poll_event` until None, and arm one timer with `poll_timeout`; `now`
never decreases. Bytes from the modem never raise. States are in `states`; their actions are in
`startup` (PROBING to CONFIGURING) and `sending` (SENDING); both use one `channel`. Besides there
are *inquiries*: single queries that belong to no state, such as `AT?T` after an exchange. Their
answers may come in any state, and a frame waits for at most one of them.

A doubtful modem (it sends what only a restarted one sends, or does not answer when it must) is not
repaired step by step: the dialogue reopens the connection, and the start-up finds the cause. There
is only one way to become READY.
"""

from collections.abc import Callable
from typing import Final

from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.linktypes import (
    LinkCapabilities,
    Service,
    Transmission,
    TransmitOutcome,
)
from zacoustic.errors import LocalError
from zacoustic_evologics.at.decoder import AtDecoder
from zacoustic_evologics.at.framing import Framing
from zacoustic_evologics.at.messages import Message, Noise, RawData, Reply, Unrecognised
from zacoustic_evologics.at.notifications import Notification, PhyOff, PhyOn, SourceLevel
from zacoustic_evologics.at.replies import CommandReply, ModeReply
from zacoustic_evologics.config import IN_AIR_SOURCE_LEVEL, EvologicsConfig
from zacoustic_evologics.driver.channel import FENCE_TICKET, Answer, CommandChannel
from zacoustic_evologics.driver.events import (
    ConnectionUseless,
    Event,
    OpeningHopeless,
)
from zacoustic_evologics.driver.sending.bursts import Bursts
from zacoustic_evologics.driver.sending.sending import Sending
from zacoustic_evologics.driver.sending.service import Service as Carried
from zacoustic_evologics.driver.sending.service import choose_carriage
from zacoustic_evologics.driver.sending.states import HAS_FRAME, Phase
from zacoustic_evologics.driver.session.inquiries import Inquiries
from zacoustic_evologics.driver.session.outbox import Outbox
from zacoustic_evologics.driver.session.reception import Received, Reception
from zacoustic_evologics.driver.session.session import ModemSession
from zacoustic_evologics.driver.startup.probe import Probe
from zacoustic_evologics.driver.startup.run import StartupRun
from zacoustic_evologics.driver.startup.startup import SILENT, StartupError, start_up
from zacoustic_evologics.driver.states import CONNECTED, TRANSITIONS, UP, Input, State

SETTLING_S: Final = 0.5
"""Bytes this soon after connecting are dropped, s; the vendor's own middleware does the same."""
HELD_LIMIT_S: Final = 1.0
"""Silence after which the rest of a record will not come any more, s."""
HOPELESS_PAUSE_S: Final = 10.0
"""Pause before an unsuitable modem is tried again, s: somebody must change it."""


class AtDialogue:
    """The dialogue with one modem.

    Args:
        config: Settings of the driver.
        node_address: Acoustic address of this node, 1…254.
        is_serial: The port is a serial port.
    """

    def __init__(self, config: EvologicsConfig, *, node_address: int, is_serial: bool) -> None:
        self.state = State.CLOSED
        self._reply_ns = seconds_to_ns(config.reply_s)
        self._byte_ns = 10 * NS_PER_S // config.baudrate if is_serial else 0
        self._is_serial = is_serial
        self._silent_hint = (
            f"at {config.baudrate} baud; zacoustic config doctor tries others: baudrate=… in the "
            "locator"
        )
        self._session = ModemSession(config, node_address)
        self._channel = CommandChannel(reply_ns=self._reply_ns, byte_ns=self._byte_ns)
        self._reception = Reception(self._session)
        self._decoder = AtDecoder()
        self._startup: StartupRun | None = None
        self._sending: Sending | None = None
        self._outbox = Outbox(self._session)
        self._bursts = Bursts(self._channel, self._session)
        self._inquiries = Inquiries(self._channel, self._session, self._outbox.put)
        self._due_at: int | None = None
        self._waiting: Sending | None = None
        """An urgent frame that waits for the end of another one, or one that it has overtaken."""

    @property
    def detail(self) -> str:
        """The modem, or what the link waits for; one line."""
        return self._outbox.detail

    @property
    def capabilities(self) -> LinkCapabilities:
        """Capabilities of the link; complete once it has been UP."""
        return self._session.capabilities()

    def diagnostics(self) -> dict[str, int | float | str]:
        """Counters and readings."""
        return {
            "state": self.state.value,
            "detail": self.detail,
            "stray_replies": self._channel.stray_replies,
            "missed_replies": self._channel.missed_replies,
            **self._session.diagnostics(),
        }

    # Inputs

    def handle_opened(self, now: int) -> None:
        """Note that a connection was made."""
        if self.state in CONNECTED:
            self._fall(Input.GONE, "connected anew", now)
        self._step(Input.OPENED)
        self._channel.reset()
        self._decoder = AtDecoder()
        self._due_at = now + seconds_to_ns(SETTLING_S)
        self._outbox.down("looking for the modem")

    def handle_lost(self, reason: str, now: int) -> None:
        """Note that the connection was lost, or could not be made."""
        self._fall(Input.GONE, reason, now)

    def handle_bytes(self, received: bytes, now: int) -> None:
        """Take bytes of the modem."""
        if self.state is State.SETTLING:
            self._session.count("settling_bytes", len(received))
            return
        self._session.hear(now)
        if self.state in CONNECTED:
            self._take(self._decoder.feed(received), now)

    def handle_timeout(self, now: int) -> None:
        """Handle the instant that `poll_timeout` has returned."""
        if self._is_held_too_long(now):
            self._take(self._decoder.flush(), now)
        if self._due_at is not None and now >= self._due_at:
            self._due_at = None
            self._end_pause(now)
        if answer := self._channel.handle_timeout(now):
            self._handle_answer(answer, now)
        if self._startup is not None:
            self._run(self._startup.handle_timeout, now)
        if self._sending is not None:
            self._sending.handle_timeout(now)
            self._collect(now)
        self._bursts.handle_timeout(now)
        self._collect_bursts(now)
        self._outbox.put(self._reception.handle_timeout(now))
        self._decoder.framing = self._channel.framing

    # Commands

    def transmit(self, transmission: Transmission, now: int) -> None:
        """Send a frame; one `TransmissionEnded` follows."""
        if transmission.service is Service.BULK and self.state in UP:
            refusal = self._bursts.refuse(transmission)
            if refusal:
                self._outbox.refuse(transmission, TransmitOutcome.REJECTED, refusal, now)
            else:
                self._bursts.transmit(transmission, now)
        elif self.state is State.SENDING and not self._overtakes(transmission):
            self._outbox.refuse(
                transmission, TransmitOutcome.REJECTED, "another frame is outstanding", now
            )
        elif self.state not in UP:
            self._outbox.refuse(
                transmission, TransmitOutcome.ABORTED, f"link down: {self.detail}", now
            )
        elif isinstance(carriage := choose_carriage(transmission, self._session, now), str):
            self._outbox.refuse(transmission, TransmitOutcome.REJECTED, carriage, now)
        else:
            sending = Sending(transmission, carriage, self._channel, self._session, now)
            if transmission.is_urgent:
                self._bursts.make_way(now)
            elif carriage.service is not Carried.PIGGYBACK:
                self._bursts.hold()
            if self._sending is not None and self._sending.phase is not Phase.PAUSING:
                self._waiting = sending
                return
            self._waiting, self._sending = self._sending, sending
            if self.state is State.READY:
                self._step(Input.TRANSMIT)
            self._start(now)

    def close(self, now: int) -> None:
        """End the dialogue; an outstanding frame is reported."""
        for sending in (self._sending, self._waiting):
            if sending is not None:
                sending.handle_lost("link closed", now)
                self._report(sending)
        self._bursts.handle_lost("link closed", now)
        self._collect_bursts(now)
        self._step(Input.CLOSED)
        self._clear(now)
        self._outbox.has_been_up = False

    # Outputs

    def poll_output(self) -> bytes | None:
        """Return the bytes to write to the modem next."""
        return self._channel.poll_output()

    def poll_event(self) -> Event | None:
        """Return the next event."""
        return self._outbox.poll()

    def poll_timeout(self) -> int | None:
        """Return when to call `handle_timeout`, ns; None: not before another input."""
        instants = [self._due_at, self._channel.due_at, self._reception.due_at, self._flush_at()]
        instants.append(self._bursts.due_at)
        instants += [each.due_at for each in (self._startup, self._sending) if each is not None]
        return min((instant for instant in instants if instant is not None), default=None)

    # Messages of the modem

    def _take(self, messages: list[Message], now: int) -> None:
        for message in messages:
            if self.state not in CONNECTED:
                return
            self._handle_message(message, now)
        self._decoder.framing = self._channel.framing

    def _handle_message(self, message: Message, now: int) -> None:
        startup = self._startup
        if startup is not None and startup.is_probing:
            self._run(lambda at: startup.handle_message(message, at), now)
            return
        match message:
            case Reply():
                if message.command is not None and self._channel.framing is Framing.LINES:
                    self._give_up("the modem has changed to data mode", now)
                elif answer := self._channel.handle_reply(message, now):
                    self._handle_answer(answer, now)
            case RawData():
                self._session.count("raw_bytes", len(message.content))
                if self.state is State.READY:
                    self._inquiries.check(now)
            case Unrecognised() | Noise():
                self._session.count("unrecognised")
            case _:
                self._handle_notification(message, now)

    def _handle_answer(self, answer: Answer, now: int) -> None:
        startup, sending, ticket = self._startup, self._sending, answer.ticket
        if answer.late:
            self._session.count("late_replies")
        elif ticket == FENCE_TICKET:
            self._see_fence(answer.reply, now)
        elif startup is not None and ticket == startup.ticket:
            self._run(lambda at: startup.handle_answer(answer, at), now)
        elif sending is not None and ticket == sending.ticket:
            sending.handle_answer(answer, now)
            self._collect(now)
        elif ticket == self._bursts.ticket:
            self._bursts.handle_answer(answer, now)
            self._collect_bursts(now)
        elif suspicion := self._inquiries.handle_answer(answer, now):
            self._give_up(suspicion, now)

    def _handle_notification(self, record: Notification, now: int) -> None:
        sending = self._sending
        is_sending = sending is not None and sending.phase in HAS_FRAME
        if self.state not in UP:
            return
        self._outbox.put(self._reception.handle(record, is_sending=is_sending, now=now))
        if isinstance(record, Received):
            self._inquiries.note_message()
        if sending is not None:
            sending.handle_notification(record, now)
            self._collect(now)
        self._bursts.handle_notification(record, now)
        self._collect_bursts(now)
        on_deck = self._session.config.deck
        match record:
            case PhyOff():
                self._give_up("the physical layer of the modem is off", now)
            case PhyOn():
                self._inquiries.check(now)
            case SourceLevel() if on_deck and record.level != IN_AIR_SOURCE_LEVEL:
                self._inquiries.silence(now)
            case _:
                pass

    # Changes of the state

    def _step(self, event: Input) -> None:
        """Look the next state up and enter it.

        Raises:
            LocalError: The dialogue has a bug.
        """
        after = TRANSITIONS.get((self.state, event))
        if after is None:
            raise LocalError(f"dialogue: {event.value} in state {self.state.value}")
        self.state = after

    def _end_pause(self, now: int) -> None:
        if self.state is State.LOST:
            self._outbox.put([ConnectionUseless(self.detail)])
            return
        self._step(Input.SETTLED)
        probe = Probe(
            is_serial=self._is_serial,
            may_fill=self._session.may_fill,
            reply_ns=self._reply_ns,
            byte_ns=self._byte_ns,
        )
        self._startup = StartupRun(
            self._channel, self._session, probe, start_up(self._channel, self._session)
        )
        self._startup.start(now)

    def _run(self, go_on: Callable[[int], list[Input]], now: int) -> None:
        """Advance the start-up."""
        try:
            for reached in go_on(now):
                self._step(reached)
        except StartupError as error:
            hint = error.hint
            if self._is_serial and error.message == SILENT:
                hint = self._silent_hint
            self._give_up(error.message, now, hint=hint, is_hopeless=error.is_hopeless)
            return
        if self.state is State.READY:
            self._startup = None
            self._session.may_fill = True
            self._outbox.up(now)

    def _see_fence(self, reply: CommandReply | None, now: int) -> None:
        if not isinstance(reply, ModeReply):
            self._give_up("the modem does not answer", now)
        elif reply.interpreter is not self._channel.interpreter:
            self._give_up(f"the modem has changed to {reply.interpreter.value}", now)

    def _collect(self, now: int) -> None:
        """Report the frame if it has ended."""
        sending = self._sending
        if sending is None or sending.report is None:
            return
        if sending.suspicion:
            self._give_up(sending.suspicion, now)
            return
        self._report(sending)
        self._sending, self._waiting = self._waiting, None
        if self._sending is None:
            self._step(Input.ENDED)
            self._bursts.go_on(now)
        else:
            self._start(now)
        if sending.report.outcome is TransmitOutcome.DELIVERED:
            to = sending.carriage.destination
            self._inquiries.measure_delay(to, sending.report, sending.answer, now)
        self._inquiries.read_battery(now)

    def _overtakes(self, transmission: Transmission) -> bool:
        """Return whether a frame may be given although another one has not ended."""
        return self._session.has_bulk and transmission.is_urgent and self._waiting is None

    def _start(self, now: int) -> None:
        """Begin with the frame, unless it has begun, or burst data have to make way before."""
        sending = self._sending
        if sending is not None and not sending.has_begun and not self._bursts.keeps_back:
            sending.start(now)

    def _collect_bursts(self, now: int) -> None:
        """Report the burst data that have ended."""
        while (report := self._bursts.poll_report()) is not None:
            self._outbox.report(report)
        if self._bursts.must_check:
            self._bursts.must_check = False
            self._inquiries.check(now)
        self._start(now)

    def _give_up(self, reason: str, now: int, *, hint: str = "", is_hopeless: bool = False) -> None:
        """Give the connection up; reopen it at once, or later if that would not help."""
        self._session.count("restarts")
        self._fall(Input.GIVEN_UP, f"{reason} ({hint})" if hint else reason, now)
        if is_hopeless:
            self._outbox.put([OpeningHopeless(reason, hint)])
            self._due_at = now + seconds_to_ns(HOPELESS_PAUSE_S)
        else:
            self._outbox.put([ConnectionUseless(reason)])

    def _fall(self, event: Input, reason: str, now: int) -> None:
        """Leave any state for one without a modem: report DOWN first, then the frame."""
        self._step(event)
        under_way = [each for each in (self._sending, self._waiting) if each is not None]
        self._clear(now)
        self._outbox.down(reason)
        for sending in under_way:
            sending.handle_lost(reason, now)
            self._report(sending)
        self._bursts.handle_lost(reason, now)
        self._collect_bursts(now)

    def _clear(self, now: int) -> None:
        """End the work of the state, and its timers."""
        self._due_at = None
        self._startup = self._sending = self._waiting = None
        self._channel.reset()
        self._inquiries.forget()
        self._decoder = AtDecoder()
        self._outbox.put(self._reception.stop(now))

    def _report(self, sending: Sending) -> None:
        assert sending.report is not None
        self._sending = None
        self._outbox.report(sending.report)

    def _flush_at(self) -> int | None:
        """Return when incomplete bytes are given up."""
        if not self._decoder.held_bytes:
            return None
        return self._session.heard_at + seconds_to_ns(HELD_LIMIT_S)

    def _is_held_too_long(self, now: int) -> bool:
        """Tell whether bytes wait too long; a missing answer may be among them."""
        flush_at = self._flush_at()
        if flush_at is None:
            return False
        instants = [flush_at, self._channel.due_at]
        if self._startup is not None:
            instants.append(self._startup.due_at)
        return any(instant is not None and now >= instant for instant in instants)
