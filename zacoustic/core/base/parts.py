"""The parts of a frame: the offers for it, and the callbacks about its transmission."""

from collections.abc import Callable
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import TransmitReport
from zacoustic.core.base.stats import Cause

FIRST_BUT_URGENT: Final = -(1 << 61)
"""Rank of what goes before everything except REAL_TIME payloads."""
BESIDE_PAYLOAD: Final = 1 << 62
"""Rank of what goes just before the best payload, unless that is a REAL_TIME one."""


class Offer(msgspec.Struct, frozen=True, kw_only=True):
    """What a source would put into a frame now."""

    destination: int
    """Address, or `BROADCAST`."""
    rank: int = BESIDE_PAYLOAD
    """Of several offers the smallest rank wins; for payloads queueing instant plus patience, ns."""
    must_go: Cause | None = None
    """The cause for which the frame goes even if it would be empty; None: there is none."""
    owed_first: bool = False
    """Whether what is owed to the hearers goes before payloads."""
    rides: bool = False
    """Whether it becomes a broadcast if the best payload is one."""
    is_answer: bool = False
    """Whether a node listens for it for as long as a short frame takes: no payload beside it."""
    is_fragment: bool = False
    """Whether it shows no end and needs the frame for itself."""
    is_answered: bool | None = None
    """Of a fragment: whether its only receiver has answered the last request; None: unknown."""
    is_forwarded: bool = False
    """Whether it is a whole frame of a route over relays, of a bond, or flooded."""
    sealed_bytes: int = 0
    """Content of such a frame that its hop seals, bytes; 0: it goes as it is."""
    ignores_hold: bool = False
    """Whether it may go while an answer about an object is awaited."""
    is_reply: bool = False
    """Whether it goes because of its destination, which pays for it (`ReplyBudget`)."""
    takes_all: bool = False
    """Whether a frame to one node may carry what is for all: there is no other one."""
    lane: tuple[int, ...] = ()
    """First parts of the lane keys of payloads beside it."""


def _begin(now: int) -> None:
    """Ignore the begin of a transmission."""


def _end(report: TransmitReport, now: int) -> None:
    """Ignore the end of a transmission."""


class Part(msgspec.Struct, frozen=True, kw_only=True):
    """A record, or another effect of a frame, that follows each of its transmissions."""

    transmitted: Callable[[int], None] = _begin
    """Called with the instant at which a transmission begins, ns."""
    reported: Callable[[TransmitReport, int], None] = _end
    """Called with the report of a transmission and the instant, ns; exactly once for each."""
