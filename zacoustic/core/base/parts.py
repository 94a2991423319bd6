"""The parts of a frame: what is offered for it, and who is told what becomes of it."""

from collections.abc import Callable
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import TransmitReport
from zacoustic.core.base.stats import Cause

FIRST_BUT_URGENT: Final = -(1 << 61)
"""Rank of what goes before everything but REAL_TIME payloads."""
BESIDE_PAYLOAD: Final = 1 << 62
"""Rank of what goes just before the best payload, unless that is a REAL_TIME one."""


class Offer(msgspec.Struct, frozen=True, kw_only=True):
    """What a source would put into a frame now."""

    destination: int
    """Address, or `BROADCAST`."""
    rank: int = BESIDE_PAYLOAD
    """Of several offers the smallest is taken: for payloads the instant of queueing and patience,
    ns."""
    must_go: Cause | None = None
    """The frame goes even where nothing has to be said in it, on this account."""
    owed_first: bool = False
    """What is owed to the hearers goes before payloads."""
    rides: bool = False
    """It goes to everybody where the best payload does."""
    is_answer: bool = False
    """Somebody listens for it, for as long as a short frame takes: no payload beside it."""
    is_fragment: bool = False
    """It shows no end, and needs the frame for itself."""
    ignores_hold: bool = False
    """It may go while an answer about an object is awaited."""
    lane: tuple[int, ...] = ()
    """Payloads beside it are of lanes whose key begins so."""


def _begin(now: int) -> None:
    """Nobody asks when a transmission begins."""


def _end(report: TransmitReport, now: int) -> None:
    """Nobody asks how a transmission has ended."""


class Part(msgspec.Struct, frozen=True, kw_only=True):
    """A record, or whatever else a frame does, whose owner is told of each transmission of it."""

    transmitted: Callable[[int], None] = _begin
    """Takes the instant at which a transmission begins, ns."""
    reported: Callable[[TransmitReport, int], None] = _end
    """Takes how that has ended, and the instant, ns; called exactly once for each."""
