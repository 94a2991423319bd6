"""Dates of a gateway's documents: by the wall clock, also when that is set.

People set clocks, and network time sets them by years after a start. An earlier date would then be
hours old at once, or new for hours. So dates come from a clock that only goes on, from the wall
clock's value at the start; later changes of the wall clock are added when a document is made. So
the difference between two dates is always the time that has passed.
"""

from collections.abc import Callable
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S, Clock

_SET_NS: Final = NS_PER_S // 20
"""Reading two clocks one after the other differs by less."""
_SUFFIX: Final = "unix_s"


class Dates:
    """The clocks of one gateway.

    Args:
        clock: Where instants come from.
        utc_ns: Tells UTC, ns since 1970.
    """

    def __init__(self, clock: Clock, utc_ns: Callable[[], int]) -> None:
        self._clock = clock
        self._utc_ns = utc_ns
        self._began_ns = utc_ns() - clock()
        self._set_by_ns = 0
        self.times_set = 0
        """How often the wall clock was seen to have been set."""

    def unix_s(self) -> float:
        """Return the instant for a fact that is kept, s since 1970."""
        return (self._clock() + self._began_ns) / NS_PER_S

    def now_unix_s(self) -> float:
        """Return the instant as documents have it, s since 1970."""
        return self.unix_s() + self._set_by_ns / NS_PER_S

    def look(self) -> None:
        """See whether the wall clock has been set."""
        set_by_ns = self._utc_ns() - self._clock() - self._began_ns
        if abs(set_by_ns - self._set_by_ns) > _SET_NS:
            self._set_by_ns = set_by_ns
            self.times_set += 1

    def told(self, document: object) -> object:
        """Return a document with its dates by the wall clock as it is now."""
        if not self._set_by_ns:
            return document
        return self._moved(msgspec.to_builtins(document))

    def _moved(self, part: Any) -> Any:  # noqa: ANN401 (of a document)
        if isinstance(part, dict):
            return {
                name: round(each + self._set_by_ns / NS_PER_S, 3)
                if isinstance(each, float) and str(name).endswith(_SUFFIX)
                else self._moved(each)
                for name, each in part.items()
            }
        return [self._moved(each) for each in part] if isinstance(part, list) else part
