"""Commands whose sender has not shown that it has heard this node: they hold for ten minutes.

Anybody can say a command under the address of another node. Who gives one says with it which boot
epoch of this node it has heard (`heard`): that is no frame of a former life, and of nobody who only
guesses. A command without it is executed all the same, since whoever needs silence may just have
been started; but what it has changed is undone after a while, and no command counts as overtaken by
it for longer. Its sender gives it again with the epoch that it hears in the answer.
"""

from collections.abc import Callable
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.streams.commands import SERIALS
from zacoustic.core.transport.commands.deduplication import Freshness
from zacoustic.core.wire.calls import CallKey

UNPROVED_S: Final = 600.0
"""How long such a command holds, s."""


class _Tried(msgspec.Struct, frozen=True):
    """The last such command about one object."""

    client: int
    epoch: int
    serial: int
    undo: Callable[[int], None]
    """Restores what was before the first of them; takes the instant."""


class Unproved:
    """What such commands have changed.

    Args:
        timers: End it.
    """

    def __init__(self, timers: Timers) -> None:
        self._timers = timers
        self._tried: dict[int, _Tried] = {}

    def freshness(self, call: CallKey, subject: int, serial: int) -> Freshness:
        """Tell whether such a command is new among its kind."""
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
        """Note a command that is executed, and how what was before it is restored."""
        before = self._tried.get(subject)
        undo = undo if before is None else before.undo
        self._tried[subject] = _Tried(call.client, call.epoch, serial, undo)
        until = now + round(UNPROVED_S * NS_PER_S)
        self._timers.at((Due.UNPROVED, subject), until, partial(self._end, subject))

    def settle(self, subject: int) -> None:
        """A command of somebody who is known to have given it: what was tried is over."""
        self._tried.pop(subject, None)
        self._timers.cancel((Due.UNPROVED, subject))

    # Below the methods above

    def _end(self, subject: int, now: int) -> None:
        self._tried.pop(subject).undo(now)
