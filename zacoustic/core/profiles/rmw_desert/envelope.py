"""The envelope of a message of rmw_desert: a packet, if the link is a byte stream.

This wire has no addresses and no check, so nothing is added for a link that lacks them. A link with
frames carries the message alone, and may add the packet by itself.

A packet may be longer than a frame of the link. Then it goes in pieces, like the writes of
rmw_desert, which DESERT cuts in the same way. An incomplete packet waits for its pieces until
`patience_ns` of silence; then its bytes are searched for other packets.
"""

from collections.abc import Callable
from typing import Final

from zacoustic.core.base.linktypes import BROADCAST, UNKNOWN_SOURCE, LinkCapabilities, ReceivedFrame
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.values.rmw_desert.packets import (
    PAYLOAD_LIMIT_BYTES,
    PacketDecoder,
    encode_packet,
)
from zacoustic.core.wire.envelope import Damaged, Envelope, Opened

# One packet of 512 bytes comes in nine pieces of DESERT's usual 64; each extends the wait.
_PATIENCE_FRAMES: Final = 4
NO_PACKET: Final = "no_packet"
"""Reason for dropping bytes that belong to no packet."""


class PacketEnvelope(Envelope):
    """Wraps and opens the messages of one node on one link.

    Args:
        capabilities: What the link can do.
        address: Address of this node, 1…254.
        timers: Tell when an incomplete packet is given up.
        give_up: Called then; must call `flush`.
    """

    def __init__(
        self,
        capabilities: LinkCapabilities,
        address: int,
        timers: Timers,
        give_up: Callable[[int], None],
    ) -> None:
        super().__init__(capabilities, address)
        self._timers = timers
        self._give_up = give_up
        mtu_bytes = capabilities.mtu_bytes
        self._decoder = None if capabilities.framed else PacketDecoder()
        self._patience_ns = _PATIENCE_FRAMES * capabilities.airtime_ns(mtu_bytes)
        self.piece_bytes = mtu_bytes
        """The largest piece that the link takes, bytes."""
        self.room_bytes = (
            min(PAYLOAD_LIMIT_BYTES, mtu_bytes) if capabilities.framed else PAYLOAD_LIMIT_BYTES
        )
        timers.cancel((Due.PACKET,))  # armed for the link before

    def wrap(self, records: bytes, destination: int) -> bytes:
        """Make the packet of a message; it may be longer than a frame of the link."""
        return records if self._decoder is None else encode_packet(records)

    def open(self, received: ReceivedFrame) -> list[Opened | Damaged]:
        """Return the messages that arrived: one, or any number for a byte stream."""
        if self._decoder is None:
            return [_opened(received.frame_bytes, received.source)]
        discarded_before = self._decoder.discarded_bytes
        payloads = self._decoder.feed(received.frame_bytes)
        if self._decoder.is_waiting:
            give_up_at = received.received_at + self._patience_ns
            self._timers.at((Due.PACKET,), give_up_at, self._give_up)
        else:
            self._timers.cancel((Due.PACKET,))
        return self._found(payloads, discarded_before, received.source)

    def flush(self) -> list[Opened | Damaged]:
        """Give up the incomplete packet, and return the messages among its bytes."""
        if self._decoder is None:
            return []
        discarded_before = self._decoder.discarded_bytes
        return self._found(self._decoder.flush(), discarded_before, UNKNOWN_SOURCE)

    def forget(self) -> None:
        """Forget an incomplete packet, which a new connection will never complete."""
        self._timers.cancel((Due.PACKET,))
        if self._decoder is not None:
            self._decoder = PacketDecoder()

    def _found(
        self, payloads: list[bytes], discarded_before: int, source: int
    ) -> list[Opened | Damaged]:
        assert self._decoder is not None
        found: list[Opened | Damaged] = [_opened(payload, source) for payload in payloads]
        discarded_bytes = self._decoder.discarded_bytes - discarded_before
        if discarded_bytes:
            found.append(Damaged(reason=NO_PACKET, size_bytes=discarded_bytes))
        return found


def _opened(payload: bytes, source: int) -> Opened:
    return Opened(source=source, destination=BROADCAST, records=payload)
