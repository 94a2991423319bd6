"""The deduplication table of commands: each is executed once, and none after a later one.

A node counts the commands of one boot epoch (*serial*). For each commanding node and each object of
a command, the table keeps the epoch and the serial of the last executed command, and the epochs
before. A command is new if its serial is later in the same epoch, or if its epoch is not among
those before: a node never returns to an earlier epoch, so a command from one is late.
"""

import enum
from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.streams.commands import SERIALS

_JOURNAL: Final = "order"
_FORMER_LIVES: Final = 8


class Freshness(enum.Enum):
    """How a command compares with those before."""

    NEW = "new"
    """New: execute it."""
    SAME = "same"
    """It has been executed."""
    OVERTAKEN = "overtaken"
    """A later one has been executed."""


class _Last(msgspec.Struct, frozen=True, array_like=True):
    """The last command of a node about one object."""

    epoch: int
    serial: int
    former: tuple[int, ...]


class DeduplicationTable:
    """The commands that this node has executed.

    Args:
        stored: The content of the journal.
        journal: Holds the table.
    """

    def __init__(self, stored: Mapping[str, bytes], journal: JournalPort) -> None:
        self._journal = journal
        self._last: dict[tuple[int, int], _Last] = {}
        for name, value in stored.items():
            head, _, place = name.partition("/")
            if head == _JOURNAL:
                client, subject = map(int, place.split("/"))
                self._last[client, subject] = msgspec.msgpack.decode(value, type=_Last)

    def freshness(self, client: int, subject: int, epoch: int, serial: int) -> Freshness:
        """Return whether a command is new.

        Args:
            client: The commanding node.
            subject: The object of the command.
            epoch: Boot epoch of that node.
            serial: The command's serial.
        """
        last = self._last.get((client, subject))
        if last is None or (epoch != last.epoch and epoch not in last.former):
            return Freshness.NEW
        if epoch != last.epoch:
            return Freshness.OVERTAKEN
        ahead = (serial - last.serial) % SERIALS
        if ahead == 0:
            return Freshness.SAME
        return Freshness.NEW if ahead < SERIALS // 2 else Freshness.OVERTAKEN

    def peer_forgotten(self, client: int, now: int) -> None:
        """Forget a node and its commands."""
        for place in [place for place in self._last if place[0] == client]:
            del self._last[place]
            self._journal.write(_name(*place), None)

    def enter(
        self, client: int, subject: int, epoch: int, serial: int, then: Callable[[int], None]
    ) -> None:
        """Add an executed command; call `then` once it is journalled."""
        last = self._last.get((client, subject))
        former: tuple[int, ...] = ()
        if last is not None:
            former = last.former
            if last.epoch != epoch:
                former = (last.epoch, *former)[:_FORMER_LIVES]
        entered = self._last[client, subject] = _Last(epoch, serial, former)
        self._journal.write(_name(client, subject), msgspec.msgpack.encode(entered), then)


def _name(client: int, subject: int) -> str:
    return f"{_JOURNAL}/{client}/{subject}"
