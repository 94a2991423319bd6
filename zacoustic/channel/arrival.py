"""Records of the medium for its driver: emissions, the arrivals they cause, and their outcomes.

An emission is one frame leaving a node. It arrives at every node whose modem understands it, later
by the propagation delay; each arrival has a beginning and an end. Until its end other sound may
overlap it, so only then its outcome is known: that is a reception. All instants are ns since the
start of the scenario.
"""

import enum
import random

import msgspec

from zacoustic.channel.faults.faults import corrupt


class Outcome(enum.Enum):
    """Outcome of an arrival."""

    RECEIVED = "received"
    """The receiver has the frame."""
    NOISE = "noise"
    """Lost by noise, fading or a named loss of the scenario, or too weak to be noticed."""
    COLLISION = "collision"
    """Other arrivals that overlapped it were too strong."""
    HALF_DUPLEX = "half_duplex"
    """The receiver was transmitting during a part of it."""
    DEAF = "deaf"
    """The receiver had locked on an earlier arrival."""


class Arrival(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """A frame on its way to one node, with all random draws that decide its outcome."""

    node: int
    """Address of the node that it arrives at."""
    source: int
    """Address of the node that sent it."""
    sequence: int
    """Counts the emissions of `source`, from 0."""
    frame_bytes: int
    """Length of the frame, bytes."""
    starts_at: int
    """Instant of the first sound at the node, ns."""
    ends_at: int
    """Instant of the last sound at the node, ns; the driver calls `Medium.finish` then."""
    received_level_db: float
    """Level at the node, fading included, dB re 1 µPa."""
    snr_db: float
    """Level over ambient noise in the modem's band, dB."""
    propagation_s: float
    """Propagation delay, one way, s."""
    distance_m: float
    """Slant distance that the sound covers, m."""
    range_rate_m_s: float = 0.0
    """Relative velocity, m/s, positive when the distance grows; 0 between fixed nodes."""
    effective_snr_db: float
    """SNR after the losses of the channel model and of the receiver, dB."""
    chance: float
    """Uniform draw, 0…1: noise destroys the frame if it is below the error rate."""
    dropped: bool = False
    """The scenario's `loss` drops this frame, at any level."""
    corrupt_seed: int | None = None
    """Seed for `faults.corrupt` when the frame arrives damaged without the modem noticing."""
    delay_s: float = 0.0
    """How late the modem reports the frame, s."""
    duplicates_after_s: tuple[float, ...] = ()
    """When the modem reports the frame again, s after its first report."""


class Emission(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """One frame leaving a node."""

    source: int
    """Address of the sender."""
    sequence: int
    """Counts the emissions of `source`, from 0."""
    frame_bytes: int
    """Length of the frame, bytes."""
    started_at: int
    """Instant of the first sound, ns."""
    ends_at: int
    """Instant of the last sound, ns: `started_at` and the airtime."""
    ready_at: int
    """Instant from which the modem takes the next frame, ns: `ends_at` and the gap."""
    arrivals: tuple[Arrival, ...]
    """One for each node that could receive it, in the order of the scenario."""
    unheard: tuple[int, ...] = ()
    """Nodes that only a blackout keeps from receiving it."""


class Reception(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """An arrival with its outcome."""

    arrival: Arrival
    """The arrival."""
    outcome: Outcome
    """Its outcome."""
    sinr_db: float
    """Level over ambient noise and everything that overlapped, averaged over the frame, dB."""
    corrupt_seed: int | None = None
    """If set, the frame is damaged, see `damage`."""
    delay_s: float = 0.0
    """Delay of the delivery, s; see `delays_s`."""
    duplicates_after_s: tuple[float, ...] = ()
    """Deliver the frame again after each of these times, s, counted from the first delivery."""

    @property
    def is_received(self) -> bool:
        """Whether the receiver has the frame, damaged or not."""
        return self.outcome is Outcome.RECEIVED

    @property
    def is_intact(self) -> bool:
        """Whether the receiver has the frame as it was sent."""
        return self.outcome is Outcome.RECEIVED and self.corrupt_seed is None

    @property
    def delays_s(self) -> tuple[float, ...]:
        """Return the delay of each delivery, s."""
        if not self.duplicates_after_s:  # the usual case
            return (self.delay_s,)
        return (self.delay_s, *(self.delay_s + after_s for after_s in self.duplicates_after_s))

    def damage(self, frame_bytes: bytes) -> bytes:
        """Return the bytes that the receiver gets; the same at each call."""
        if self.corrupt_seed is None:
            return frame_bytes
        return corrupt(frame_bytes, random.Random(self.corrupt_seed))
