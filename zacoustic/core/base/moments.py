"""Instants that outlast a restart: when a sample was made, although the engine's clock begins anew.

An instant of the monotonic clock means something only in its own run of that clock, which lasts
from one boot of the computer to the next. A `Moment` in the journal has the instant, the run, and
UTC if that was known then. A later start finds it again by the run, if that goes on, or else by
UTC, once that is known. If neither tells, it is unknown, and nothing is made up.
"""

import zlib
from collections.abc import Mapping

import msgspec

from zacoustic.core.base.journal import BOOT_KEY


class Moment(msgspec.Struct, frozen=True, array_like=True):
    """An instant in the journal."""

    run: int
    """Check sum of the name of the run of the monotonic clock; 0: it has none."""
    at: int
    """The instant in that run, ns."""
    utc_ns: int | None
    """The same in UTC, ns since 1970; None: that was not known."""


class Remembered:
    """An instant from before a restart, which UTC may tell later on.

    Args:
        moments: Know run and UTC.
        moment: The instant.
    """

    __slots__ = ("_at", "_moment", "_moments")

    def __init__(self, moments: "Moments", moment: Moment) -> None:
        self._moments = moments
        self._moment = moment
        self._at: int | None = None

    def at(self, now: int) -> int | None:
        """Return the instant, ns, perhaps negative; None: nothing tells it yet."""
        if self._at is None:
            self._at = self._moments.find(self._moment, now)
        return self._at

    @property
    def moment(self) -> Moment:
        """The instant as it was journalled."""
        return self._moment


Made = int | Remembered | None
"""When something was made: an instant, ns; None: unknown."""


def instant_of(made: Made, now: int) -> int | None:
    """Return when something was made, ns; None: unknown."""
    return made.at(now) if isinstance(made, Remembered) else made


class Moments:
    """Run and UTC of one engine.

    Args:
        stored: The content of the journal.
    """

    def __init__(self, stored: Mapping[str, bytes]) -> None:
        self._run = zlib.crc32(stored[BOOT_KEY]) if BOOT_KEY in stored else 0
        self._offset_ns: int | None = None

    def tell(self, offset_ns: int) -> None:
        """Take that UTC is the engine's time and `offset_ns`."""
        self._offset_ns = offset_ns

    def keep(self, made: Made) -> Moment | None:
        """Return an instant for the journal; None: it is unknown."""
        if isinstance(made, Remembered):
            return made.moment
        if made is None:
            return None
        return Moment(self._run, made, None if self._offset_ns is None else made + self._offset_ns)

    def restored(self, moment: Moment | None) -> Made:
        """Return an instant from the journal."""
        return None if moment is None else Remembered(self, moment)

    def find(self, moment: Moment, now: int) -> int | None:
        """Return an instant by the engine's time, ns; None: unknown, or it would be in future."""
        at: int | None = None
        if moment.run and moment.run == self._run:
            at = moment.at
        elif moment.utc_ns is not None and self._offset_ns is not None:
            at = moment.utc_ns - self._offset_ns
        return None if at is None or at > now else at
