"""What a sealed node reports to the application about frames that it refused.

A frame that does not open is counted, and usually no more: it came twice, or its receiver is out of
step for some frames. A rate-limited event reports what somebody has to look into:

- no frame of a node opens: it has another key, or somebody uses its address;
- a node does not seal its frames: it has no key;
- an authentic node transmits with an earlier life: it has old records;
- another computer may have this node's key and address;
- an authentic node transmits what it may not (it is no publisher, no server, or nobody executes its
  commands): the event then names the stream;
- an authentic node makes this node transmit more than its reply budget.
"""

from collections.abc import Callable
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.peers.sealing import USUAL, SealRefusal

FORGERIES: Final = 1 << 20
"""After this many refusals of one source, a forgery was accepted with odds of 1 in 4096."""
_TELL_EVERY_NS: Final = seconds_to_ns(600.0)
_IN_A_ROW: Final = 2 * USUAL.every
"""This many frames that do not open are hardly a loss of step: one of them had a long head.

Only a node that lost a hundred fragments of an object without any other frame loses step longer.
"""


class SealAlarm(msgspec.Struct, frozen=True, kw_only=True):
    """This node refused frames that claim to be of a node, or contents of its frames."""

    address: int
    """The node."""
    refusal: SealRefusal
    """Why."""
    frames: int
    """Refused frames for that reason since the start; records, if a stream is named."""
    is_too_many: bool
    """More than `FORGERIES`: the key has to be rotated."""
    stream_id: int | None = None
    """The stream that the node may not use in that way; None: whole frames were refused."""


class SealAlarms:
    """Counts refusals and reports them.

    Args:
        emit: Takes a `SealAlarm`.
    """

    def __init__(self, emit: Callable[[Any], None]) -> None:
        self._emit = emit
        # By node, reason and stream: only nodes with the key make entries with a stream.
        self._frames: dict[tuple[int, SealRefusal, int | None], int] = {}
        self._told_at: dict[tuple[int, SealRefusal, int | None], int] = {}
        self._in_a_row: dict[int, int] = {}

    def opened(self, address: int) -> None:
        """Note that a frame of a node was opened."""
        self._in_a_row.pop(address, None)

    def refused(self, refusal: SealRefusal, address: int, now: int) -> None:
        """Count a refused frame; report it unless the same was reported recently.

        Args:
            refusal: Why it was refused.
            address: The source that it claims, 1…254.
            now: The instant.
        """
        frames = self._count(address, refusal, None)
        if refusal in (SealRefusal.REPLAYED, SealRefusal.OUT_OF_STEP):
            return
        in_a_row = self._in_a_row[address] = self._in_a_row.get(address, 0) + 1
        if refusal is SealRefusal.FORGED and in_a_row < _IN_A_ROW and frames < FORGERIES:
            return
        self._tell(address, refusal, None, now)

    def forbidden(self, address: int, stream_id: int, now: int) -> None:
        """Count a record that a node of the fleet may not send, and report it likewise.

        Args:
            address: The node.
            stream_id: The stream of the record.
            now: The instant.
        """
        self._count(address, SealRefusal.FORBIDDEN, stream_id)
        self._tell(address, SealRefusal.FORBIDDEN, stream_id, now)

    def costly(self, address: int, now: int) -> None:
        """Count something of a node beyond its reply budget, and report it likewise.

        Args:
            address: The node.
            now: The instant.
        """
        self._count(address, SealRefusal.COSTLY, None)
        self._tell(address, SealRefusal.COSTLY, None, now)

    def _count(self, address: int, refusal: SealRefusal, stream_id: int | None) -> int:
        key = (address, refusal, stream_id)
        self._frames[key] = self._frames.get(key, 0) + 1
        return self._frames[key]

    def _tell(self, address: int, refusal: SealRefusal, stream_id: int | None, now: int) -> None:
        key = (address, refusal, stream_id)
        frames, told_at = self._frames[key], self._told_at.get(key)
        if told_at is None or now - told_at >= _TELL_EVERY_NS or frames == FORGERIES:
            self._told_at[key] = now
            self._emit(
                SealAlarm(
                    address=address,
                    refusal=refusal,
                    frames=frames,
                    is_too_many=stream_id is None
                    and refusal is not SealRefusal.COSTLY
                    and frames >= FORGERIES,
                    stream_id=stream_id,
                )
            )
