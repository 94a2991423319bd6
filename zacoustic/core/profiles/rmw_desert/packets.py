"""Packets: one message each, in as many pieces as the link needs."""

from zacoustic.core.base.linktypes import BROADCAST, TransmitOutcome, TransmitReport
from zacoustic.core.base.parts import Part
from zacoustic.core.base.stats import NO_STREAM, Cause, LinkStats, count
from zacoustic.core.peers.bootepoch import BootEpoch
from zacoustic.core.schedule.frames import Composed, Frames
from zacoustic.core.schedule.port import LinkPort
from zacoustic.core.schedule.queue import QueuedRecord, TransmitQueue


class Packets(Frames):
    """The packets of one node on one link.

    Args:
        queue: The waiting messages.
        epoch: The boot epoch of the node.
        stats: Counts every byte.
    """

    def __init__(self, queue: TransmitQueue, epoch: BootEpoch, stats: LinkStats) -> None:
        super().__init__(queue, epoch)
        self._stats = stats
        self._pieces: list[bytes] = []
        self._piece = Part(reported=self._reported)
        self._pieces_stream = NO_STREAM

    @property
    def is_under_way(self) -> bool:
        """Whether pieces of a packet are left."""
        return bool(self._pieces)

    def clear(self) -> None:
        """Drop the rest of a packet."""
        self._pieces.clear()

    def due_at(self, now: int) -> int | None:
        """Return the instant from which a packet should go, ns; None: nothing to send."""
        return now if self._pieces else self.queue.due_at(now)

    def compose(self, port: LinkPort, now: int) -> Composed | None:
        """Make the packet that is worth most now, or return the next piece of the last one."""
        if self._pieces:
            piece = self._pieces.pop(0)
            return Composed(
                destination=BROADCAST,
                frame_bytes=piece,
                object_stream=self._pieces_stream,
                parts=(self._piece,),
            )
        for lane, _ in self.queue.candidates(now):
            if lane.due_at <= now:
                return self._packet(port, self.queue.take(lane, now))
        return None

    # Below the methods above

    def _reported(self, report: TransmitReport, now: int) -> None:
        """Drop the rest of a packet that has lost a piece."""
        if report.outcome in (TransmitOutcome.REJECTED, TransmitOutcome.ABORTED):
            self._pieces.clear()

    def _packet(self, port: LinkPort, item: QueuedRecord) -> Composed:
        message = bytes((item.code,)) + item.head + item.payload
        packet = port.envelope.wrap(message, BROADCAST)
        self._stats.attribute(NO_STREAM, Cause.ENVELOPE, len(packet) - len(message))
        self._stats.attribute(item.stream_id, Cause.HEADER, len(message) - len(item.payload))
        self._stats.attribute(item.stream_id, Cause.PAYLOAD, len(item.payload))
        count(self._stats.transmitted, item.stream_id)
        most = port.capabilities.mtu_bytes
        first, *self._pieces = [packet[at : at + most] for at in range(0, len(packet), most)]
        self._pieces_stream = item.stream_id
        return Composed(
            destination=BROADCAST, frame_bytes=first, records=(item,), parts=(self._piece,)
        )
