"""The modem's services: which one carries a frame, and what the end of each proves.

=============  ===========================  ======================================================
service        for                          how it ends
=============  ===========================  ======================================================
instant        up to 64 bytes; broadcast    `SENDEND`: on the air. Nothing else is known
… with ack     up to 64 bytes, one receiver `DELIVEREDIM`: the other modem has it. `FAILEDIM`: no
                                            acknowledgement came back
synchronous    as instant, if configured    as instant; the receiver learns the instant of start
piggyback      up to 64 bytes, one receiver `CANCELEDPBM` after `ATZ3`: it has not left. `OK` alone:
                                            it had left. Whether it was heard is unknown
burst          above 64 bytes, or if        `DELIVERED` and `FAILED`, with the number that
               configured; one receiver     `AT?PC` gave for it: no doubt which frame is meant
=============  ===========================  ======================================================

An instant message takes 0.2…0.9 s, the connection of a burst alone about as long; so up to 64 bytes
an instant message is sooner done.

A piggyback message waits in the modem until the modem sends something to the receiver by itself,
which may never happen. So it is sooner only if that is about to happen: the modem has received a
message that asks for an acknowledgement, and the frame goes to its sender. The modem would refuse
an instant message until the acknowledgement has gone and a pause is over, 0.3 s; a piggyback
message goes with it. If it comes too late for that, the driver takes it back and sends it as an
instant message. One that `rides_back` it gives again instead, as long as trains of burst data come
from that modem: an instant message would be lost under a train, and the next one is acknowledged as
well. The driver does this only with modems that have reported their acknowledgements: no capture
shows whether all do.
"""

import enum
from typing import Final

import msgspec

from zacoustic.core.linktypes import BROADCAST, Transmission, TransmitOutcome
from zacoustic_evologics.at import notifications as said
from zacoustic_evologics.at import refusals
from zacoustic_evologics.at.commands import (
    Act,
    Action,
    Command,
    PayloadCommand,
    Query,
    SendBurst,
    SendIm,
    SendIms,
    SendPbm,
)
from zacoustic_evologics.at.fields import IM_LIMIT_BYTES
from zacoustic_evologics.at.replies import RefusalKind, Refused
from zacoustic_evologics.driver.session.session import ModemSession

DROP_MESSAGES: Final = Act(Action.RESET, 3)
"""`ATZ3`: forget instant and piggyback messages."""


class Service(enum.Enum):
    """A service; the value is its name in SENDSTART and SENDEND."""

    IM = "im"
    """Instant message."""
    IMS = "ims"
    """Synchronous instant message."""
    PIGGYBACK = "pbm"
    """Piggyback message; its sound has the name of what it goes with."""
    BURST = "burst"
    """Burst data; no source has SENDSTART's word for it."""


class Remedy(enum.Enum):
    """The reaction to a refusal of a frame."""

    WAIT = "wait"
    """Try again when the modem has time."""
    CLEAR = "clear"
    """Empty its buffer first."""
    LISTEN = "listen"
    """Make it listen first."""
    NONE = "none"
    """None: it would refuse again."""
    ASK = "ask"
    """Unknown or damaged words: ask the modem whether it has the frame."""


class Carriage(msgspec.Struct, frozen=True, kw_only=True):
    """How one frame is carried."""

    service: Service
    """The service."""
    acknowledged: bool
    """The other modem acknowledges."""
    payload: bytes
    """The frame."""
    destination: int
    """Address, or BROADCAST."""
    rides_back: bool = False
    """It may wait for the acknowledgement of the next train of bursts of its destination."""
    alternative: "Carriage | None" = None
    """What carries it if this does not."""

    def command(self) -> PayloadCommand:
        """Return the command that gives the frame to the modem."""
        to, payload = self.destination, self.payload
        if self.service is Service.BURST:
            return SendBurst(payload=payload, destination=to)
        if self.service is Service.IMS:
            return SendIms(payload=payload, destination=to)
        if self.service is Service.PIGGYBACK:
            return SendPbm(payload=payload, destination=to)
        flag = said.ImFlag.ACK if self.acknowledged else said.ImFlag.NOACK
        return SendIm(payload=payload, destination=to, flag=flag)

    def state_query(self) -> Query | Act:
        """Return the query whether the modem still has the frame.

        For a piggyback message only dropping it tells: the modem reports if it drops one.
        """
        if self.service is Service.PIGGYBACK:
            return self.drop_command()
        return Query("PC" if self.service is Service.BURST else "DI")

    def drop_command(self) -> Act:
        """Return the command that makes the modem forget the frame."""
        return Act(Action.RESET, 1) if self.service is Service.BURST else DROP_MESSAGES

    def begins(self, record: said.SendStart) -> bool:
        """Tell whether this is the beginning of the frame's sound."""
        return self.is_sound(record.kind, record.destination)

    def is_sound(self, kind: str, destination: int) -> bool:
        """Tell whether a sound can be the frame's; a piggyback message goes with any to there."""
        is_named = self.service is Service.PIGGYBACK or kind == self.service.value
        return is_named and destination == self.destination

    def verdict(self, record: said.Notification, counter: int | None) -> TransmitOutcome | None:
        """Return what a notification proves about the frame, if it is about it.

        Args:
            record: A message of the modem.
            counter: Answer of `AT?PC` before a burst.
        """
        if getattr(record, "destination", None) != self.destination:
            return None
        match self.service, record:
            case Service.BURST, said.Delivered() if record.counter == counter:
                return TransmitOutcome.DELIVERED
            case Service.BURST, said.Failed() if record.counter == counter:
                return TransmitOutcome.NOT_DELIVERED
            case Service.IM, said.DeliveredIm() if self.acknowledged:
                return TransmitOutcome.DELIVERED
            case Service.IM, said.FailedIm() if self.acknowledged:
                return TransmitOutcome.NOT_DELIVERED
            case (Service.IM, said.CanceledIm()) | (Service.IMS, said.CanceledIms()):
                return TransmitOutcome.ABORTED
            case Service.IMS, said.ExpiredIms():
                return TransmitOutcome.REJECTED
            case Service.PIGGYBACK, said.SendEnd():
                return TransmitOutcome.SENT
            case Service.PIGGYBACK, said.CanceledPbm():
                return TransmitOutcome.REJECTED
            case _, said.SendEnd() if not self.acknowledged and record.kind == self.service.value:
                return TransmitOutcome.SENT
            case _:
                return None


def choose_carriage(transmission: Transmission, session: ModemSession, now: int) -> Carriage | str:
    """Return how a frame is carried, or why it cannot be."""
    size, to, wanted = len(transmission.frame_bytes), transmission.destination, session.config
    if not 1 <= size <= wanted.mtu:
        return f"frame of {size} bytes; allowed: 1..{wanted.mtu}"
    if to != BROADCAST and not 1 <= to <= session.highest_address:
        return (
            f"destination {to}; allowed: 1..{session.highest_address} "
            f"(highest address of the network) and {BROADCAST}"
        )
    if to == session.address:
        return f"destination {to} is this node"
    if size > IM_LIMIT_BYTES or (wanted.service == "burst" and to != BROADCAST):
        if to == BROADCAST:
            return (
                f"broadcast of {size} bytes; allowed: 1..{IM_LIMIT_BYTES}, bursts have one receiver"
            )
        service = Service.BURST
    else:
        service = Service.IMS if wanted.service == "ims" else Service.IM
    asked = transmission.acknowledge and to != BROADCAST and session.acknowledges
    chosen = Carriage(
        service=service,
        acknowledged=asked or service is Service.BURST,
        payload=transmission.frame_bytes,
        destination=to,
        rides_back=transmission.rides_back,
    )
    return _with_piggyback(chosen, session, now)


def _with_piggyback(chosen: Carriage, session: ModemSession, now: int) -> Carriage:
    """Return a frame's piggyback message if that is sooner or configured; otherwise `chosen`."""
    if chosen.destination == BROADCAST or chosen.service is not Service.IM:
        return chosen
    piggyback = msgspec.structs.replace(chosen, service=Service.PIGGYBACK)
    if session.config.service == "pbm":
        return piggyback
    is_sooner = chosen.rides_back or session.is_about_to_answer(chosen.destination, now)
    may_choose = session.config.service == "auto" and session.tells_answers
    if chosen.acknowledged or not (is_sooner and may_choose):
        return chosen
    return msgspec.structs.replace(piggyback, alternative=chosen)


def remedy_for(refusal: Refused) -> Remedy:
    """Return the reaction to a refusal, by the words that drivers have met."""
    if refusal.kind is RefusalKind.BUSY:
        return Remedy.WAIT
    return Remedy.CLEAR if refusals.is_not_empty(refusal) else _REMEDIES.get(refusal, Remedy.ASK)


def remedy_command(remedy: Remedy) -> Command:
    """Return the command of a remedy."""
    return Act(Action.RESET, 4) if remedy is Remedy.CLEAR else Act(Action.LISTEN)


_REMEDIES: Final = {
    refusals.BUFFER_FULL: Remedy.WAIT,
    refusals.CONNECTION_CLOSED: Remedy.WAIT,
    refusals.NOT_ACCEPTED: Remedy.WAIT,
    refusals.OUT_OF_CONTEXT: Remedy.LISTEN,
    refusals.PHY_OFF: Remedy.LISTEN,
    refusals.NO_CONTROL: Remedy.NONE,
    refusals.NOT_ALLOWED: Remedy.NONE,
    refusals.OUT_OF_RANGE: Remedy.NONE,
    refusals.PROTOCOL_ID: Remedy.NONE,
    refusals.UNKNOWN_COMMAND: Remedy.NONE,
    refusals.WRONG_DESTINATION: Remedy.NONE,
    refusals.WRONG_FORMAT: Remedy.NONE,
}
