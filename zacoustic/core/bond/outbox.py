"""The frames of a bond that wait for one of its links, as a source of the composer there."""

from collections.abc import Callable
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import TransmitOutcome, TransmitReport
from zacoustic.core.base.parts import FIRST_BUT_URGENT, Offer, Part
from zacoustic.core.base.qos import PATIENCE_NS, Priority
from zacoustic.core.base.stats import NO_STREAM, Cause, Entries, LinkStats
from zacoustic.core.schedule.sources import Forwarded

MOST_WAITING: Final = 6
"""More frames do not wait for a link: the oldest gives way, and its streams repeat what it had."""
_PATIENCE_NS: Final = PATIENCE_NS[Priority.INTERACTIVE_HIGH]

Ended = Callable[[TransmitReport, int], None]
"""Takes the end of a transmission, and the instant, ns."""
Make = Callable[[int, int], bytes | None]
"""``(room, now)``: makes the content of a frame of at most so many bytes; None: it does not fit, or
nothing is left to say."""


class BondFrame(msgspec.Struct, eq=False):
    """A frame that waits."""

    destination: int
    """Address, or `BROADCAST`."""
    make: Make
    """Makes its content when it goes."""
    queued_at: int
    """When it began to wait, ns."""
    is_urgent: bool = False
    """Whether it goes before all others."""
    ended: Ended | None = None
    """Told when its transmission has ended, or will not begin."""
    entries: Entries | None = None
    """What the frame of the bond is to enter into the ledger; None: it is none of a stream."""
    is_granted: bool = False
    """Whether it may go although the node is silent."""


class Outbox:
    """The frames of a bond for one of its links.

    Args:
        stats: The counters of the link.
    """

    goes_on = False
    """No frame announces another one."""

    def __init__(self, stats: LinkStats) -> None:
        self._stats = stats
        self._waiting: list[BondFrame] = []

    def put(self, frame: BondFrame, now: int) -> None:
        """Let a frame wait for the link; the oldest may give way to it."""
        if len(self._waiting) >= MOST_WAITING:
            oldest = next((each for each in self._waiting if not each.is_urgent), self._waiting[0])
            self._waiting.remove(oldest)
            _drop(oldest, now)
        self._waiting.append(frame)

    def clear(self, now: int) -> None:
        """Drop what waits: the link is down."""
        waiting, self._waiting = self._waiting, []
        for each in waiting:
            _drop(each, now)

    @property
    def waiting(self) -> int:
        """How many frames wait."""
        return len(self._waiting)

    # A source of the composer

    @property
    def is_urgent(self) -> bool:
        """Whether a frame waits that medium access is to treat as urgent."""
        return any(each.is_urgent for each in self._waiting)

    @property
    def has_granted(self) -> bool:
        """Whether a frame waits that may go although the node is silent."""
        return any(each.is_granted for each in self._waiting)

    def take_granted(self, room_bytes: int, now: int) -> tuple[int, Forwarded] | None:
        """Take the frame that may go in silence, and its destination; None: it does not fit."""
        frame = next(each for each in self._waiting if each.is_granted)
        taken = self._take(frame, room_bytes, now)
        return None if taken is None else (frame.destination, taken)

    def due_at(self, now: int) -> int | None:
        """Return the instant at which a frame is due, ns; None: none."""
        return now if self._waiting else None

    def offer(self, now: int) -> Offer | None:
        """Return what would go now; None: nothing."""
        if not self._waiting:
            return None
        frame = self._first()
        return Offer(
            destination=frame.destination,
            rank=FIRST_BUT_URGENT if frame.is_urgent else frame.queued_at + _PATIENCE_NS,
            is_forwarded=True,
            ignores_hold=frame.is_urgent,
        )

    def take(self, room_bytes: int, now: int) -> Forwarded | None:
        """Take the content of the frame that goes now, of at most `room_bytes`."""
        if not self._waiting:
            return None
        return self._take(self._first(), room_bytes, now)

    # Below the methods above

    def _take(self, frame: BondFrame, room_bytes: int, now: int) -> Forwarded | None:
        self._waiting.remove(frame)
        content = frame.make(room_bytes, now)
        if content is None or len(content) > room_bytes:
            _drop(frame, now)
            return None
        claimed_bytes = 0 if frame.entries is None else frame.entries.claim(self._stats)
        self._stats.attribute(NO_STREAM, Cause.RELAY, len(content) - claimed_bytes)
        part = Part() if frame.ended is None else Part(reported=frame.ended)
        return Forwarded(content=content, part=part, is_urgent=frame.is_urgent)

    def _first(self) -> BondFrame:
        return next((each for each in self._waiting if each.is_urgent), self._waiting[0])


def _drop(frame: BondFrame, now: int) -> None:
    if frame.ended is None:
        return
    report = TransmitReport(
        transmission_id=0,
        outcome=TransmitOutcome.ABORTED,
        started_at=now,
        finished_at=now,
        detail="another frame of the bond took its place",
    )
    frame.ended(report, now)
