"""Commands whose sender has not proved that it has heard this node: they hold for ten minutes.

Anybody can send a command under the address of another node. The sender adds the boot epoch of this
node that it has heard (`heard`): this excludes frames for an earlier boot epoch, and senders that
only guess. A command without it is executed all the same, since the node that needs silence may
just have started. But its effect is undone after a while, and it overtakes other commands no longer
than that. Its sender gives the command again with the epoch that it hears in the answer.

A command from a boot epoch that seems to be over is unproved, too. It may be a recorded one; but a
late copy can also make the present epoch of its sender count as over, and a node in silence may not
ask for a proof.
"""

from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.streams.commands import SERIALS
from zacoustic.core.transport.commands.deduplication import Freshness
from zacoustic.core.transport.exchanges.repeating import UNPROVED_S
from zacoustic.core.wire.calls import CallKey

_UNPROVED_NS: Final = seconds_to_ns(UNPROVED_S)


class _Tried(msgspec.Struct, frozen=True):
    """The last such command about one object."""

    client: int
    epoch: int
    serial: int
    undo: Callable[[int], None]
    """Restores the state before the first of them; takes the instant."""


class Unproved:
    """The effects of unproved commands.

    Args:
        timers: End them.
    """

    def __init__(self, timers: Timers) -> None:
        self._timers = timers
        self._tried: dict[int, _Tried] = {}

    def freshness(self, call: CallKey, subject: int, serial: int) -> Freshness:
        """Return whether an unproved command is new among the unproved ones."""
        tried = self._tried.get(subject)
        if tried is None or (tried.client, tried.epoch) != (call.client, call.epoch):
            return Freshness.NEW
        ahead = (serial - tried.serial) % SERIALS
        if ahead == 0:
            return Freshness.SAME
        return Freshness.NEW if ahead < SERIALS // 2 else Freshness.OVERTAKEN

    def enter(
        self, call: CallKey, subject: int, serial: int, undo: Callable[[int], None], now: int
    ) -> None:
        """Add an executed command, and what restores the state before it."""
        before = self._tried.get(subject)
        undo = undo if before is None else before.undo
        self._tried[subject] = _Tried(call.client, call.epoch, serial, undo)
        self._timers.at((Due.UNPROVED, subject), now + _UNPROVED_NS, partial(self._end, subject))

    def settle(self, subject: int) -> None:
        """End the trial of an object: a proved command has replaced it."""
        self._tried.pop(subject, None)
        self._timers.cancel((Due.UNPROVED, subject))

    # Below the methods above

    def _end(self, subject: int, now: int) -> None:
        self._tried.pop(subject).undo(now)
