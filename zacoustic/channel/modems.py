"""`Modems`: the behaviour of simple modems on a medium, whatever drives it.

A modem takes one frame at a time, transmits it as soon as it is ready, and reports its end. It
reports whether other nodes are audible. It delivers received frames: damaged, late or twice, as the
scenario asks. If a frame asks for an acknowledgement, the modem at its destination sends one,
unless it is transmitting at that moment. The acknowledgement is a frame like any other, and yields
the range.

A subclass defines how the node of a modem is informed (`carrier`, `hand_over`, `finished`).
"""

import enum
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Generic, Protocol, TypeVar

from zacoustic.channel.acknowledgement import ACKNOWLEDGEMENT_BYTES, patience_ns, turnaround_ns
from zacoustic.channel.agenda import Agenda
from zacoustic.channel.arrival import Arrival, Emission, Outcome, Reception
from zacoustic.channel.driver import Driver
from zacoustic.channel.medium import Medium
from zacoustic.channel.profiles import ModemProfile


class Ending(enum.Enum):
    """How a frame ended for its modem, in the terms of links."""

    SENT = "sent"
    """It was transmitted and asked for no acknowledgement."""
    DELIVERED = "delivered"
    """It was acknowledged."""
    NOT_DELIVERED = "not_delivered"
    """It was not acknowledged."""
    ABORTED = "aborted"
    """The modem is unplugged: it was not transmitted."""


class Frame(Protocol):
    """What a modem transmits."""

    @property
    def frame_bytes(self) -> bytes:
        """The frame."""
        ...

    @property
    def destination(self) -> int:
        """Address of a node, or broadcast."""
        ...


FrameT = TypeVar("FrameT", bound=Frame)
StationT = TypeVar("StationT", bound="Station[Any]")


class Station(Generic[FrameT]):
    """The modem of one node.

    Args:
        address: Address of the node.
        profile: Profile of the modem.
    """

    __slots__ = ("address", "carriers", "is_up", "pending", "profile", "ready_at", "silent_at")

    def __init__(self, address: int, profile: ModemProfile) -> None:
        self.address = address
        self.profile = profile
        self.is_up = True
        """It is plugged in."""
        self.pending: list[FrameT] = []
        """Frames whose end is not reported yet. If a caller empties it, they are not reported, and
        those not yet begun are never transmitted."""
        self.ready_at = 0
        """Instant from which it takes the next frame, ns."""
        self.silent_at = 0
        """End of its own last sound, ns."""
        self.carriers = 0
        """Number of other nodes that are audible now."""

    def holds(self, frame: FrameT) -> bool:
        """Tell whether the end of a frame is not reported yet."""
        return any(each is frame for each in self.pending)


class Sound(Generic[StationT, FrameT]):
    """A frame on its way, or the acknowledgement of one."""

    __slots__ = ("frame", "is_answer", "sender", "started_at")

    def __init__(
        self, sender: StationT, frame: FrameT, started_at: int, *, is_answer: bool = False
    ) -> None:
        self.sender = sender
        self.frame = frame
        self.started_at = started_at
        self.is_answer = is_answer


class Modems(Driver[Sound[StationT, FrameT]], Generic[StationT, FrameT]):
    """The modems of a medium.

    Args:
        medium: Carries the sound.
        agenda: Pending actions.
    """

    def __init__(self, medium: Medium, agenda: Agenda) -> None:
        super().__init__(medium, agenda)
        self.medium = medium
        self.stations: dict[int, StationT] = {}
        """Modems by address; nodes of the scenario without one hear nothing."""
        self.losses: dict[str, int] = {}
        """Number of lost frames by outcome."""
        self.farthest_s = medium.scenario.farthest_s
        """Longest propagation delay, one way, s."""
        self.senses_carrier = True
        """Modems notice the beginning of a sound."""

    def send(self, address: int, frame: FrameT) -> None:
        """Transmit a frame of a node; `finished` follows."""
        station = self.stations[address]
        station.pending.append(frame)
        self._start(station, frame)

    # Defined by a subclass

    @abstractmethod
    def asks(self, frame: FrameT) -> bool:
        """Tell whether a frame asks for an acknowledgement."""

    @abstractmethod
    def finished(
        self,
        station: StationT,
        frame: FrameT,
        ending: Ending,
        started_at: int,
        answer: Arrival | None,
    ) -> None:
        """Report the end of a frame to its node, with the acknowledgement if there is one."""

    def carrier(self, station: StationT, is_heard: bool) -> None:
        """Report to a node that others are audible, or that all are silent; or `settle` does it."""

    @abstractmethod
    def hand_over(self, station: StationT, reception: Reception, frame: FrameT) -> None:
        """Deliver a received frame to a node."""

    @abstractmethod
    def settle(self, station: StationT) -> None:
        """Let a node act on reports: the end of a carrier comes before the frame."""

    def delays_s(self, reception: Reception) -> Sequence[float]:
        """Return the delay of each delivery of a frame, s."""
        return reception.delays_s if reception.is_received else ()

    def emitted(self, station: StationT, emission: Emission) -> None:
        """Note an emission."""

    # Common to all modems

    def _start(self, station: StationT, frame: FrameT) -> None:
        now = self.agenda.now
        if not station.holds(frame):
            return
        if not station.is_up:
            self.agenda.push(now, self._conclude, station, frame, Ending.ABORTED, now)
            return
        if station.ready_at > now:
            self.agenda.push(station.ready_at, self._start, station, frame)
            return
        sound = Sound(station, frame, now)
        ends_at = self._emit(station, len(frame.frame_bytes), sound).ends_at
        if self.asks(frame):
            until = ends_at + patience_ns(station.profile, self.farthest_s)
            self.agenda.push(until, self._conclude, station, frame, Ending.NOT_DELIVERED, now)
        else:
            self.agenda.push(ends_at, self._conclude, station, frame, Ending.SENT, now)

    def _emit(self, station: StationT, size_bytes: int, sound: Sound[StationT, FrameT]) -> Emission:
        emission = self.medium.transmit(station.address, size_bytes, self.agenda.now)
        station.silent_at = station.ready_at = emission.ends_at
        if emission.unheard:
            self.lose("blackout", len(emission.unheard))
        self.emitted(station, emission)
        self.spread(emission, sound)
        return emission

    def _conclude(
        self,
        station: StationT,
        frame: FrameT,
        ending: Ending,
        started_at: int,
        answer: Arrival | None = None,
    ) -> None:
        for place, each in enumerate(station.pending):
            if each is frame:
                del station.pending[place]
                self.finished(station, frame, ending, started_at, answer)
                return

    def lose(self, outcome: str, number: int = 1) -> None:
        """Count lost frames."""
        self.losses[outcome] = self.losses.get(outcome, 0) + number

    def notices(self, arrival: Arrival) -> bool:
        """Tell whether a modem notices the beginning of a sound."""
        station = self.stations.get(arrival.node)
        if station is None or not self.senses_carrier:
            return False
        return station.profile.notices(arrival.snr_db)

    def begin(self, arrival: Arrival, sent: Sound[StationT, FrameT]) -> None:
        """Handle the beginning of a sound at a node."""
        station = self.stations[arrival.node]
        station.carriers += 1
        if station.carriers == 1:
            self.carrier(station, True)
            self.settle(station)

    def end(self, reception: Reception, sent: Sound[StationT, FrameT], is_noticed: bool) -> None:
        """Handle the end of a sound at a node: deliver a frame, or take an acknowledgement."""
        if reception.outcome is not Outcome.RECEIVED:
            self.lose(reception.outcome.value)
        station = self.stations.get(reception.arrival.node)
        if station is None:
            self.delays_s(reception)  # a subclass that disturbs frames sees those for nobody, too
            return
        if is_noticed:
            station.carriers -= 1
            if not station.carriers:
                self.carrier(station, False)
        if sent.is_answer:
            self._take_answer(station, reception, sent)
        else:
            self._take(station, reception, sent)
        # No node acts between the two inputs, so none transmits before it gets the frame.
        self.settle(station)

    def _take(
        self, station: StationT, reception: Reception, sound: Sound[StationT, FrameT]
    ) -> None:
        delays_s, frame, now = self.delays_s(reception), sound.frame, self.agenda.now
        is_asked = frame.destination == station.address and self.asks(frame)
        if delays_s and is_asked and reception.is_intact:
            at = now + turnaround_ns(station.profile)
            self.agenda.push(at, self._acknowledge, station, sound)
        for after_s in delays_s:
            if after_s:
                at = now + round(after_s * 1e9)
                self.agenda.push(at, self._hand_over_late, station, reception, frame)
            else:
                self.hand_over(station, reception, frame)

    def _hand_over_late(self, station: StationT, reception: Reception, frame: FrameT) -> None:
        self.hand_over(station, reception, frame)
        self.settle(station)

    def _acknowledge(self, station: StationT, asked: Sound[StationT, FrameT]) -> None:
        if station.is_up and station.silent_at <= self.agenda.now:
            answer = Sound(asked.sender, asked.frame, asked.started_at, is_answer=True)
            self._emit(station, ACKNOWLEDGEMENT_BYTES, answer)

    def _take_answer(
        self, station: StationT, reception: Reception, answer: Sound[StationT, FrameT]
    ) -> None:
        if station is not answer.sender or not station.holds(answer.frame):
            return
        if reception.is_intact and self.delays_s(reception):
            self._conclude(
                station, answer.frame, Ending.DELIVERED, answer.started_at, reception.arrival
            )
