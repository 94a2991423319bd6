"""The incoming objects of a node, and how much memory they may take.

The number of transfers and their total bytes are bounded. To make room, the transfer that was
silent for longest is found, and of its key the one that is delivered last is given up, since it
would have to wait for all the others.
"""

from collections.abc import Iterator
from typing import Final

from zacoustic.core.base.linktypes import ReceivedFrame
from zacoustic.core.base.moments import Made
from zacoustic.core.transport.objects.limits import ObjectLimits
from zacoustic.core.transport.objects.receiving.incoming import IncomingObject
from zacoustic.core.transport.objects.receiving.replies import TransferKey
from zacoustic.core.values.age import NO_AGE

_MOST_AT_A_TIME: Final = 64


class Transfer:
    """An incoming object, and its feedback."""

    def __init__(self, incoming: IncomingObject) -> None:
        self.incoming = incoming
        self.heard_at = 0
        self.groups = 0
        self.unwritten: list[tuple[int, bytes]] = []
        self.received: ReceivedFrame | None = None
        self.age = NO_AGE
        """Its age as its first fragment had arrived."""
        self.aged_at: Made = None
        """When that was."""
        self.is_ending = False
        """Whether it is complete and its delivery is being journalled."""


class Transfers:
    """The incoming objects of one node.

    Args:
        limits: How much memory they may take.
    """

    def __init__(self, limits: ObjectLimits) -> None:
        self._limits = limits
        self._transfers: dict[TransferKey, Transfer] = {}

    def __len__(self) -> int:
        return len(self._transfers)

    def __contains__(self, key: TransferKey) -> bool:
        return key in self._transfers

    def __iter__(self) -> Iterator[tuple[TransferKey, Transfer]]:
        return iter(self._transfers.items())

    @property
    def memory_bytes(self) -> int:
        """The most bytes that they take in memory."""
        return sum(each.incoming.memory_bytes for each in self._transfers.values())

    def get(self, key: TransferKey) -> Transfer | None:
        """Return the transfer with a source's number, or None."""
        return self._transfers.get(key)

    def open(self, key: TransferKey, fragment_bytes: int) -> Transfer:
        """Begin an object."""
        incoming = IncomingObject(key[1], fragment_bytes, self._limits.largest_bytes)
        transfer = self._transfers[key] = Transfer(incoming)
        return transfer

    def remove(self, key: TransferKey) -> Transfer:
        """Remove an object."""
        return self._transfers.pop(key)

    def make_room(self, newest: TransferKey) -> Iterator[TransferKey]:
        """Yield the transfers to give up, one by one; remove each before the next.

        Args:
            newest: The transfer just heard, given up only if no other one can be.
        """
        while self._is_full and newest in self._transfers:
            idle = [
                (transfer.heard_at, key)
                for key, transfer in self._transfers.items()
                if not transfer.is_ending and key != newest
            ]
            yield self._last_of_key(min(idle)[1]) if idle else newest

    @property
    def _is_full(self) -> bool:
        if len(self._transfers) > _MOST_AT_A_TIME:
            return True
        return self.memory_bytes > self._limits.incoming_bytes

    def _last_of_key(self, key: TransferKey) -> TransferKey:
        manifest = self._transfers[key].incoming.manifest
        if manifest is None:
            return key
        sample_key = (key[0], manifest.stream_id, manifest.instance, manifest.lineage)
        of_key = [
            (each.number, other)
            for other, transfer in self._transfers.items()
            if (each := transfer.incoming.manifest) is not None
            and (other[0], each.stream_id, each.instance, each.lineage) == sample_key
            and not transfer.is_ending
        ]
        return max(of_key)[1]
