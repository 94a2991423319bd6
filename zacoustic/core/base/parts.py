"""The parts of a frame: each says whom to tell what becomes of the transmission that it is in."""

from collections.abc import Callable

import msgspec

from zacoustic.core.base.linktypes import TransmitReport


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
