"""`Driver`: puts a medium's arrivals on an agenda, from an emission to its receptions.

Drivers of modems derive from it: `modems`, for modems that take one frame and report it, and links
whose modems do more. The driver carries the transmitted object beside the sound, since the medium
sees no bytes.
"""

from abc import ABC, abstractmethod
from typing import Generic, Protocol, TypeVar

from zacoustic.channel.agenda import Agenda
from zacoustic.channel.arrival import Arrival, Emission, Reception

SentT = TypeVar("SentT")
"""What drivers of one kind transmit."""


class Channel(Protocol):
    """Who hears what and when, and with which outcome; `Medium` is one."""

    @property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of all nodes."""
        ...

    def transmit(self, source: int, frame_bytes: int, now: int) -> Emission:
        """Let a node transmit; `now` never decreases."""
        ...

    def finish(self, arrival: Arrival) -> Reception:
        """Return the outcome of an arrival; called once, when it ends, in order of time."""
        ...


class Driver(ABC, Generic[SentT]):
    """Begins and ends arrivals.

    Args:
        channel: Source of the emissions.
        agenda: Pending actions.
    """

    def __init__(self, channel: Channel, agenda: Agenda) -> None:
        self.channel = channel
        self.agenda = agenda

    def spread(self, emission: Emission, sent: SentT) -> None:
        """Schedule the arrivals of an emission; `sent` comes back with each of them."""
        push = self.agenda.push
        for arrival in emission.arrivals:
            is_noticed = self.notices(arrival)
            if is_noticed:
                push(arrival.starts_at, self.begin, arrival, sent)
            push(arrival.ends_at, self._finish, arrival, sent, is_noticed)

    def notices(self, arrival: Arrival) -> bool:
        """Tell whether a modem notices the beginning of a sound; if so, `begin` is called."""
        return False

    def begin(self, arrival: Arrival, sent: SentT) -> None:
        """Handle the beginning of an arrival."""

    @abstractmethod
    def end(self, reception: Reception, sent: SentT, is_noticed: bool) -> None:
        """Handle the end of an arrival; `begin` was called before if it was noticed."""

    def _finish(self, arrival: Arrival, sent: SentT, is_noticed: bool) -> None:
        self.end(self.channel.finish(arrival), sent, is_noticed)
