"""Messages that need no connection: instant, synchronous and piggyback ones.

There is one slot for instant messages, whose state `AT?DI` reports, one for a synchronous message
that waits for its instant, and for each address one for a piggyback message.
"""

from collections.abc import Callable
from typing import Final

from zacoustic.channel.agenda import Entry
from zacoustic.core.linktypes import BROADCAST
from zacoustic_evologics.airtime import PREPARATION_NS, im_airtime_ns
from zacoustic_evologics.at import notifications as said
from zacoustic_evologics.at import refusals
from zacoustic_evologics.at.commands import PayloadCommand, SendIm, SendIms, SendPbm
from zacoustic_evologics.at.fields import CLOCK_SPAN_US
from zacoustic_evologics.at.replies import Accepted, DeliveryState, Refused
from zacoustic_evologics.at.table import COMMANDS
from zacoustic_evologics.emulator.exchanges.exchange import Ending, Exchange, ExchangeState
from zacoustic_evologics.emulator.hardware.chassis import Chassis, Origin
from zacoustic_evologics.emulator.hardware.signals import Hearing, Piggyback, Signal, SignalKind
from zacoustic_evologics.emulator.hardware.transducer import Transducer

FOR_EVER: Final = 255
"""Retry count without a limit."""


class InstantMessages:
    """The slots of one modem.

    Args:
        chassis: Chassis of the modem.
        transducer: Transducer of the modem.
    """

    def __init__(self, chassis: Chassis, transducer: Transducer) -> None:
        self.state = DeliveryState.EMPTY
        self._chassis = chassis
        self._transducer = transducer
        self._exchange: Exchange | None = None
        self._owner: int | None = None
        self.has_bursts: Callable[[], bool] = lambda: False
        """Returns whether burst data are under way; set by the modem."""
        self._scheduled: tuple[Signal, int, Entry] | None = None
        self._piggybacks: dict[int, tuple[int, Piggyback]] = {}

    def send_im(self, origin: Origin, command: SendIm, now: int) -> Accepted | Refused:
        """`AT*SENDIM`."""
        refused = check_message(self._chassis, self._transducer, command)
        if refused is None:
            refused = self._make_room(command.flag, now)
        if refused is not None:
            return refused
        retries = self._chassis.store["RI"]
        is_acknowledged = command.flag is said.ImFlag.ACK
        self.state = DeliveryState.DELIVERING
        self._owner = origin.port_id
        self._exchange = Exchange(
            self._chassis,
            self._transducer,
            self._signal(SignalKind.IM, command, origin),
            answer=SignalKind.ACK if is_acknowledged else None,
            attempts=None if is_acknowledged and retries == FOR_EVER else 1 + retries,
            force=command.flag is said.ImFlag.FORCE,
            ended=self._end,
        )
        self.look(now)
        return Accepted()

    def send_ims(self, origin: Origin, command: SendIms, now: int) -> Accepted | Refused:
        """`AT*SENDIMS`; without an instant it is sent at once, as an instant message."""
        refused = check_message(self._chassis, self._transducer, command)
        transducer = self._transducer
        if refused is None and command.start_us is None:
            refused = self._make_room(said.ImFlag.NOACK, now)
            if transducer.is_transmitting(now):
                refused = refused or refusals.BACKOFF
        if refused is not None:
            return refused
        self._drop_scheduled()
        signal = self._signal(SignalKind.IMS, command, origin)
        if command.start_us is None:
            starts_at = max(now, transducer.ready_at)
        else:
            wait_us = (command.start_us - self._chassis.clock_us(now)) % CLOCK_SPAN_US
            if wait_us >= CLOCK_SPAN_US // 2:
                self.state = DeliveryState.EXPIRED
                self._chassis.say(said.ExpiredIms(command.destination), origin.port_id)
                return Accepted()
            # The clock ticks with the microseconds of `now`.
            starts_at = (now // 1000 + wait_us) * 1000
        self._schedule(signal, origin.port_id, max(now, starts_at), now)
        return Accepted()

    def send_pbm(self, origin: Origin, command: SendPbm, now: int) -> Accepted | Refused:
        """`AT*SENDPBM`."""
        refused = check_message(self._chassis, self._transducer, command)
        if refused is not None:
            return refused
        self._cancel_piggyback(command.destination)
        pid = origin.pid if command.pid is None else command.pid
        self._piggybacks[command.destination] = origin.port_id, Piggyback(command.payload, pid)
        return Accepted()

    def take_piggyback(self, destination: int) -> Piggyback | None:
        """Return the piggyback message for an address, which now goes with a signal."""
        kept = self._piggybacks.pop(destination, None)
        return kept[1] if kept else None

    def handle_sent(self, signal: Signal, now: int) -> None:
        """Note that a signal has left."""
        if self._exchange is not None:
            self._exchange.handle_sent(signal, now)

    def handle_answer(self, hearing: Hearing, now: int) -> bool:
        """Take an acknowledgement; return whether it was for the message in the slot."""
        return self._exchange is not None and self._exchange.handle_answer(hearing, now)

    def look(self, now: int) -> None:
        """Advance if an awaited event has happened."""
        if self._exchange is not None and not self._waits_for_bursts():
            self._exchange.look(now)

    def _waits_for_bursts(self) -> bool:
        """Return whether the message that has not begun waits until burst data are through."""
        exchange = self._exchange
        has_begun = exchange is not None and exchange.state is not ExchangeState.WAITING
        is_queued = self._chassis.behaviour.im_in_train == "queued"
        return is_queued and self.has_bursts() and not has_begun

    def drop(self) -> None:
        """`ATZ3`: drop messages under way or waiting, and report them."""
        self._cancel_im()
        self._drop_scheduled()
        for destination in tuple(self._piggybacks):
            self._cancel_piggyback(destination)
        self.state = DeliveryState.EMPTY

    def restart(self) -> None:
        """Discard all state."""
        self.state = DeliveryState.EMPTY
        self._exchange = None
        self._scheduled = None
        self._piggybacks.clear()

    def _make_room(self, flag: said.ImFlag, now: int) -> Refused | None:
        behaviour = self._chassis.behaviour
        if self._exchange is not None and behaviour.second_im == "busy":
            return refusals.DELIVERING
        if flag is not said.ImFlag.FORCE:
            if behaviour.im_in_train == "refused" and self.has_bursts():
                return refusals.BACKOFF
            transducer = self._transducer
            is_occupied = transducer.is_receiving or transducer.owed > 0
            if is_occupied and behaviour.while_receiving == "busy":
                return refusals.BACKOFF
            if now < self._transducer.backoff_until:
                return refusals.BACKOFF
        self._cancel_im()
        return None

    def _end(self, ending: Ending, now: int) -> None:
        assert self._exchange is not None
        destination = self._exchange.signal.destination
        self._exchange = None
        report: said.Notification | None = None
        self.state = DeliveryState.EMPTY
        if ending is Ending.ANSWERED:
            report = said.DeliveredIm(destination)
        elif ending is Ending.UNANSWERED:
            report = said.FailedIm(destination)
            self.state = DeliveryState.FAILED
        if report is not None:
            self._chassis.say(report, self._owner)

    def _cancel_im(self) -> None:
        exchange, self._exchange = self._exchange, None
        if exchange is not None:
            # A message being transmitted that asks for nothing counts as sent.
            is_sent = exchange.state is ExchangeState.SENDING and not exchange.is_acknowledged
            exchange.cancel()
            if not is_sent:
                self._chassis.say(said.CanceledIm(exchange.signal.destination), self._owner)

    def _cancel_piggyback(self, destination: int) -> None:
        kept = self._piggybacks.pop(destination, None)
        if kept is not None:
            self._chassis.say(said.CanceledPbm(destination), kept[0])

    def _drop_scheduled(self) -> None:
        scheduled, self._scheduled = self._scheduled, None
        if scheduled is not None:
            signal, port_id, entry = scheduled
            self._chassis.agenda.cancel(entry)
            self._chassis.say(said.CanceledIms(signal.destination), port_id)

    def _schedule(self, signal: Signal, port_id: int, starts_at: int, now: int) -> None:
        agenda = self._chassis.agenda
        announce_at = max(now, starts_at - PREPARATION_NS)

        def announce() -> None:
            self._transducer.announce(signal, announce_at, starts_at)
            self._scheduled = signal, port_id, agenda.push(starts_at, start)

        def start() -> None:
            self._scheduled = None
            if self._transducer.is_transmitting(starts_at) or not self._transducer.is_on:
                self._chassis.say(said.CanceledIms(signal.destination), port_id)
            else:
                self._transducer.transmit(signal, starts_at, is_announced=True)

        self._scheduled = signal, port_id, agenda.push(announce_at, announce)
        self.state = DeliveryState.EMPTY

    def _signal(self, kind: SignalKind, command: SendIm | SendIms, origin: Origin) -> Signal:
        piggyback = None
        if command.destination != BROADCAST and kind is SignalKind.IM:
            piggyback = self.take_piggyback(command.destination)
        piggyback_bytes = len(piggyback.payload) if piggyback else 0
        return Signal(
            kind=kind,
            source=self._chassis.address,
            destination=command.destination,
            duration_ns=im_airtime_ns(len(command.payload) + piggyback_bytes),
            number=self._chassis.next_number(),
            payload=command.payload,
            flag=command.flag if isinstance(command, SendIm) else said.ImFlag.NOACK,
            pid=origin.pid if command.pid is None else command.pid,
            piggyback=piggyback,
            level=self._chassis.store["L"],
        )


def check_message(
    chassis: Chassis, transducer: Transducer, command: PayloadCommand
) -> Refused | None:
    """Return why a message cannot be sent at all, or None."""
    row = COMMANDS[type(command)]
    if not transducer.is_on:
        return refusals.PHY_OFF
    if not row.allows(command, "payload"):
        return refusals.WRONG_FORMAT
    to = command.destination
    is_one = 1 <= to <= chassis.store["AM"] and to != chassis.address
    if not is_one and not (to == BROADCAST and row.allows(command, "destination")):
        return refusals.WRONG_DESTINATION
    return refusals.WRONG_FORMAT if row.refusal(command) else None
