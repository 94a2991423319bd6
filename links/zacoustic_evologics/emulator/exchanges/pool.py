"""The transmit buffer of the burst service: queued data with receiver and counter."""

from collections import deque
from collections.abc import Callable
from typing import Final

import msgspec

from zacoustic_evologics.airtime import burst_airtime_ns
from zacoustic_evologics.emulator.hardware.signals import BurstPacket

PACKETS_LIMIT: Final = 1024
"""Most packets in the buffer, whatever their size."""

_COUNTER_SPAN: Final = 1 << 16


class Queued(msgspec.Struct, frozen=True):
    """A packet in the buffer."""

    packet: BurstPacket
    """The packet."""
    destination: int
    """Its receiver."""
    counter: int
    """Counter of its report; 0: raw data, which has no report."""
    port_id: int
    """The port that it came from."""


class TransmitPool:
    """The buffer of one modem.

    Args:
        limit_bytes: Returns its size.
    """

    def __init__(self, limit_bytes: Callable[[], int]) -> None:
        self.counter = 1
        self.queued_bytes = 0
        self._limit_bytes = limit_bytes
        self._queue: deque[Queued] = deque()

    def __len__(self) -> int:
        return len(self._queue)

    @property
    def free_bytes(self) -> int:
        """Free bytes."""
        return max(0, self._limit_bytes() - self.queued_bytes)

    @property
    def next_destination(self) -> int | None:
        """Destination of the first packet; None: the buffer is empty."""
        return self._queue[0].destination if self._queue else None

    def put(self, packet: BurstPacket, destination: int, port_id: int) -> bool:
        """Queue a packet if there is room; return whether there was."""
        if len(packet.payload) > self.free_bytes or len(self._queue) >= PACKETS_LIMIT:
            return False
        counter = 0
        if not packet.is_raw:
            counter, self.counter = self.counter, self.counter % _COUNTER_SPAN + 1
        self._queue.append(Queued(packet, destination, counter, port_id))
        self.queued_bytes += len(packet.payload)
        return True

    def train(self, packets_limit: int, bit_rate_bps: int, limit_ns: int) -> tuple[Queued, ...]:
        """Return the packets at the front that form one train.

        Args:
            packets_limit: Most packets of a train.
            bit_rate_bps: Its bit rate.
            limit_ns: Its longest duration, ns, if it has more than one packet.
        """
        train: list[Queued] = []
        total_bytes = 0
        for item in self._queue:
            total_bytes += len(item.packet.payload)
            is_long = burst_airtime_ns(total_bytes, bit_rate_bps) > limit_ns
            is_full = len(train) >= packets_limit
            if train and (item.destination != train[0].destination or is_long or is_full):
                break
            train.append(item)
        return tuple(train)

    def take(self, count: int) -> None:
        """Remove packets from the front."""
        for _ in range(count):
            self.queued_bytes -= len(self._queue.popleft().packet.payload)

    def take_all(self, destination: int | None = None) -> list[Queued]:
        """Remove all packets, or all for one address, and return them."""
        taken = [item for item in self._queue if destination in (None, item.destination)]
        kept = [] if destination is None else self._queue
        self._queue = deque(item for item in kept if item.destination != destination)
        self.queued_bytes = sum(len(item.packet.payload) for item in self._queue)
        return taken
