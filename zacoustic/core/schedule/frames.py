"""Frames: whatever a node transmits on one link, on any wire.

The gate asks when something is due and how much it presses (`zacoustic.core.schedule.gate`), and
the transmitter takes the frame that the gate lets through. The two wires compose in their own ways:
`zacoustic.core.schedule.composer` and `zacoustic.core.profiles.rmw_desert.packets`. A wire without
a mechanism leaves its methods as they are here: nothing of that kind is ever due.
"""

from abc import ABC, abstractmethod

import msgspec

from zacoustic.core.base.parts import Part
from zacoustic.core.base.waits import Why
from zacoustic.core.peers.bootepoch import BootEpoch
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.queue import LaneKey, QueuedRecord, TransmitQueue
from zacoustic.core.schedule.sources import ForwardingSource


class Composed(msgspec.Struct, frozen=True, kw_only=True):
    """A frame that is ready for the link."""

    destination: int
    """Address, or `BROADCAST`."""
    frame_bytes: bytes
    """With envelope."""
    records: tuple[QueuedRecord, ...] = ()
    """Its records in their order, without a fragment."""
    object_stream: int | None = None
    """The stream of the fragment in it, or None."""
    acknowledge: bool = False
    """Whether to ask the modem for an acknowledgement."""
    parts: tuple[Part, ...] = ()
    """Receive the begin and the end of its transmission."""
    rides_back: bool = False
    """Whether it goes with the device's acknowledgement of bulk frames."""
    is_urgent: bool = False
    """Whether it is a frame of a route or bond that goes before all others."""
    is_heartbeat: bool = False
    """Whether it has nothing but the sign that this node is there."""
    caused_by: int | None = None
    """Address of the node because of which it goes; None: it goes for this node's own sake."""

    @property
    def streams(self) -> tuple[int, ...]:
        """The streams of its records, in their order."""
        if self.object_stream is not None:
            return (self.object_stream,)
        return tuple(record.stream_id for record in self.records)

    @property
    def expires_at(self) -> int | None:
        """Instant after which the first of its records is worthless, ns; None: none ever is."""
        instants = (record.expires_at for record in self.records)
        return min((at for at in instants if at is not None), default=None)

    @property
    def stream_bytes(self) -> dict[int, int]:
        """Bytes of each stream's records in it."""
        if self.object_stream is not None:
            return {self.object_stream: len(self.frame_bytes)}
        sizes: dict[int, int] = {}
        for record in self.records:
            sizes[record.stream_id] = sizes.get(record.stream_id, 0) + record.size_bytes
        return sizes


class Frames(ABC):
    """The frames of one node on one link.

    Args:
        queue: The waiting records.
        epoch: The boot epoch of the node.
        forwarding: Has the frames of other links that go over this one; None: there are none.
    """

    def __init__(
        self, queue: TransmitQueue, epoch: BootEpoch, forwarding: ForwardingSource | None = None
    ) -> None:
        self.queue = queue
        """The waiting records."""
        self.epoch = epoch
        """The boot epoch; before it is journalled the node transmits no record."""
        self.forwarding = forwarding
        """The frames of other links that go over this one; None: there are none."""

    # What waits

    @abstractmethod
    def due_at(self, now: int) -> int | None:
        """Return the instant from which a frame should go, ns; None: nothing to send."""

    def is_urgent(self, now: int) -> bool:
        """Return whether something waits that goes before everything else."""
        forwarding = self.forwarding
        return (forwarding is not None and forwarding.is_urgent) or self.queue.is_urgent(now)

    def held(self, now: int) -> tuple[int, Why] | None:
        """Return until when waiting records are held although nothing is in their way, ns, and why.

        None: none waits.
        """
        return self.queue.held(now)

    def bulk_due_at(self, now: int) -> int | None:
        """Return the instant from which a frame of the bulk service should go, ns, or None."""
        return None

    def rides_back(self, address: int, now: int) -> bool:
        """Return whether all that is urgent may go with what the device says to a node."""
        return False

    def owes_acknowledgement(self, now: int) -> bool:
        """Return whether an acknowledgement waits."""
        return False

    # What goes

    @abstractmethod
    def compose(self, port: LinkPort, now: int) -> Composed | None:
        """Make the frame that is worth most now; return None when there is nothing to send."""

    def compose_only(self, port: LinkPort, lane: LaneKey, now: int) -> Composed | None:
        """Make a frame of one lane's payloads, with what their hearer needs, or return None."""
        return None

    def compose_granted(self, port: LinkPort, now: int) -> Composed | None:
        """Make the frame of another link that may go in silence, or return None."""
        return None

    def speak(self, port: LinkPort, now: int) -> Composed | None:
        """Make a frame with only the controls of medium access, or return None."""
        return None

    def compose_bulk(self, port: LinkPort, now: int) -> Composed | None:
        """Make the frame of the bulk service that is worth most now, or return None."""
        return None

    def ride_back(self, address: int, port: LinkPort, now: int) -> Composed | None:
        """Make a frame that goes with a node's acknowledgement of bulk frames, or return None."""
        return None

    def forward(self, source: ForwardingSource) -> None:
        """Begin to transmit the frames of other links that go over this one."""
        self.forwarding = source

    def hold(self, stream_id: int, until: int) -> None:
        """Hold everything of a stream until an instant, ns: its airtime is used up."""
        self.queue.hold(stream_id, until)
