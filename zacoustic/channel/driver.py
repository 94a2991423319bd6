"""`Driver`: puts what a medium does on an agenda, from an emission to its receptions.

Whoever has modems on a medium derives from it: `modems` for modems that take one frame and report
it, and links whose modems do more. What they transmit travels beside the sound, since the medium
sees no bytes.
"""

from abc import ABC, abstractmethod
from typing import Generic, Protocol, TypeVar

from zacoustic.channel.agenda import Agenda
from zacoustic.channel.arrival import Arrival, Emission, Reception

SentT = TypeVar("SentT")
"""What the drivers of one kind transmit."""


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
        channel: Where the emissions come from.
        agenda: What is to come.
    """

    def __init__(self, channel: Channel, agenda: Agenda) -> None:
        self.channel = channel
        self.agenda = agenda

    def spread(self, emission: Emission, sent: SentT) -> None:
        """Let sound arrive; `sent` comes back with each end of it."""
        push = self.agenda.push
        for arrival in emission.arrivals:
            is_noticed = self.notices(arrival)
            if is_noticed:
                push(arrival.starts_at, self.begin, arrival, sent)
            push(arrival.ends_at, self._finish, arrival, sent, is_noticed)

    def notices(self, arrival: Arrival) -> bool:
        """Tell whether a modem notices that sound begins: then `begin` is called."""
        return False

    def begin(self, arrival: Arrival, sent: SentT) -> None:
        """Sound begins to arrive."""

    @abstractmethod
    def end(self, reception: Reception, sent: SentT, is_noticed: bool) -> None:
        """Sound has ended; `begin` was called before if it was noticed."""

    def _finish(self, arrival: Arrival, sent: SentT, is_noticed: bool) -> None:
        self.end(self.channel.finish(arrival), sent, is_noticed)
