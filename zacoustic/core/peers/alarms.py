"""What a sealed node tells the application of frames that it has refused.

A frame that does not open is counted, and mostly no more: it came twice, or its receiver is out of
step for some frames. The application is told, once in a while, of what somebody has to look into: a
node of which no frame opens has another key, or somebody speaks in its name; one that does not seal
them has none; one that is authentic and speaks as in a former life has old records; and there may
be another computer with the key and address of this node. A node of the fleet that says what it
may not say (it is no publisher, no server, or nobody executes its commands) is named, too, with the
stream.
"""

from collections.abc import Callable
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.peers.sealing import LONG_EVERY, Refusal

FORGERIES: Final = 1 << 20
"""So many refusals of one source, and the odds that one was not refused are one in 4096."""
_TELL_EVERY_NS: Final = seconds_to_ns(600.0)
_IN_A_ROW: Final = 2 * LONG_EVERY
"""So many frames that do not open are no loss of step: one of them had a long head."""


class SealAlarm(msgspec.Struct, frozen=True, kw_only=True):
    """Frames were refused that say they are of a node, or something that was in one of its."""

    address: int
    """The node."""
    refusal: Refusal
    """Why."""
    frames: int
    """How many for that reason since the start; where a stream is named, records of that."""
    is_too_many: bool
    """More than `FORGERIES`: the key is to be rotated."""
    stream_id: int | None = None
    """What the node may not say; None: whole frames were refused."""


class SealAlarms:
    """Counts refusals, and tells of them.

    Args:
        emit: Takes a `SealAlarm`.
    """

    def __init__(self, emit: Callable[[Any], None]) -> None:
        self._emit = emit
        # By node, reason and stream: only nodes with the key make entries with a stream.
        self._frames: dict[tuple[int, Refusal, int | None], int] = {}
        self._told_at: dict[tuple[int, Refusal, int | None], int] = {}
        self._in_a_row: dict[int, int] = {}

    def opened(self, address: int) -> None:
        """A frame of a node was opened."""
        self._in_a_row.pop(address, None)

    def refused(self, refusal: Refusal, address: int, now: int) -> None:
        """Count a frame, and tell of it if nothing of the kind was told lately.

        Args:
            refusal: Why it was refused.
            address: Of whom it says that it is, 1…254.
            now: The instant.
        """
        frames = self._count(address, refusal, None)
        if refusal in (Refusal.REPLAYED, Refusal.OUT_OF_STEP):
            return
        in_a_row = self._in_a_row[address] = self._in_a_row.get(address, 0) + 1
        if refusal is Refusal.FORGED and in_a_row < _IN_A_ROW and frames < FORGERIES:
            return
        self._tell(address, refusal, None, now)

    def forbidden(self, address: int, stream_id: int, now: int) -> None:
        """Count what a node of the fleet has said and may not, and tell of it likewise.

        Args:
            address: The node.
            stream_id: Of what it was.
            now: The instant.
        """
        self._count(address, Refusal.FORBIDDEN, stream_id)
        self._tell(address, Refusal.FORBIDDEN, stream_id, now)

    def _count(self, address: int, refusal: Refusal, stream_id: int | None) -> int:
        key = (address, refusal, stream_id)
        self._frames[key] = self._frames.get(key, 0) + 1
        return self._frames[key]

    def _tell(self, address: int, refusal: Refusal, stream_id: int | None, now: int) -> None:
        key = (address, refusal, stream_id)
        frames, told_at = self._frames[key], self._told_at.get(key)
        if told_at is None or now - told_at >= _TELL_EVERY_NS or frames == FORGERIES:
            self._told_at[key] = now
            self._emit(
                SealAlarm(
                    address=address,
                    refusal=refusal,
                    frames=frames,
                    is_too_many=stream_id is None and frames >= FORGERIES,
                    stream_id=stream_id,
                )
            )
