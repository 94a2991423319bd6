"""Dates of a gateway's documents: by the wall clock, even when somebody sets it.

People set clocks, and network time moves them by years after a start. An earlier date would then
suddenly be hours old, or new for hours. So dates come from a clock that never jumps, starting at
the wall clock's first value. Later changes of the wall clock are added when a document is made, so
the difference between two dates is always the time between them.
"""

from collections.abc import Callable
from typing import Any, Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S, Clock

_SET_NS: Final = NS_PER_S // 20
"""Two clocks that are read one after the other differ by less."""
_SUFFIX: Final = "unix_s"


class Dates:
    """The clocks of one gateway.

    Args:
        clock: Source of instants.
        utc_ns: Returns UTC, ns since 1970.
    """

    def __init__(self, clock: Clock, utc_ns: Callable[[], int]) -> None:
        self._clock = clock
        self._utc_ns = utc_ns
        self._began_ns = utc_ns() - clock()
        self._set_by_ns = 0
        self.times_set = 0
        """How often somebody set the wall clock."""

    def unix_s(self) -> float:
        """Return the current instant for storage, s since 1970."""
        return (self._clock() + self._began_ns) / NS_PER_S

    def of(self, instant: int) -> float:
        """Return the date of an instant for storage, s since 1970; the same each time."""
        return round((instant + self._began_ns) / NS_PER_S, 3)

    def now_unix_s(self) -> float:
        """Return the current instant as in documents, s since 1970."""
        return self.unix_s() + self._set_by_ns / NS_PER_S

    def look(self) -> None:
        """Check whether somebody has set the wall clock."""
        set_by_ns = self._utc_ns() - self._clock() - self._began_ns
        if abs(set_by_ns - self._set_by_ns) > _SET_NS:
            self._set_by_ns = set_by_ns
            self.times_set += 1

    def told(self, document: object) -> object:
        """Return a document with its dates by the current wall clock."""
        if not self._set_by_ns:
            return document
        return self._moved("", document)

    def _moved(self, name: str, part: Any) -> Any:  # noqa: ANN401 (of a document)
        if isinstance(part, float) and name.endswith(_SUFFIX):
            return round(part + self._set_by_ns / NS_PER_S, 3)
        if isinstance(part, msgspec.Struct):
            members = {each: getattr(part, each) for each in part.__struct_fields__}
            return msgspec.structs.replace(part, **self._moved("", members))
        if isinstance(part, dict):
            return {each: self._moved(str(each), value) for each, value in part.items()}
        if isinstance(part, (list, tuple)):
            return type(part)(self._moved("", each) for each in part)
        return part
