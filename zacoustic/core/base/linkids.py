"""The ids that the links of one engine assign, as the application sees them.

Calls have them from the beginning: components of the node call services of a link directly. The ids
of deliveries are in the journal, where they must not depend on the order of the links in the file;
so they are mapped on their way to the application.
"""

from collections.abc import Iterator
from itertools import count
from typing import Final, TypeVar

import msgspec

from zacoustic.core.base.linktypes import ONE_LINK

_IDS: Final = ("delivery_id", "object_id")
"""Fields of events that hold the id of a delivery."""
_ID_BITS: Final = 60
"""The bits of an id that the link assigns; the bits above hold the link's index."""
_ID_MASK: Final = (1 << _ID_BITS) - 1
EventT = TypeVar("EventT", bound=msgspec.Struct)


class LinkIds:
    """The ids of one link: no two links give the application the same id.

    Args:
        link: Name of the link.
        index: Index of the link, from 0.
    """

    def __init__(self, link: str, index: int) -> None:
        self._link = link
        self._index = index

    def numbered(self) -> Iterator[int]:
        """Return ids for the application without end, each once."""
        return map(self.outer, count(1))

    def issued(self, outer: int) -> bool:
        """Return whether this link has assigned an id of the application."""
        return outer >> _ID_BITS == self._index

    def outer(self, inner: int) -> int:
        """Return the id for the application; 0 identifies nothing and stays 0."""
        return inner | self._index << _ID_BITS if inner else 0

    def inner(self, outer: int) -> int:
        """Return the id on this link of one that it has assigned."""
        return outer & _ID_MASK

    def of_event(self, event: EventT) -> EventT:
        """Return an event as the application sees it, with the name of its link if it has one."""
        if self._link == ONE_LINK and self._index == 0:
            return event
        told: dict[str, int | str] = {
            name: self.outer(getattr(event, name))
            for name in _IDS
            if getattr(event, name, None) is not None
        }
        if "link" in event.__struct_fields__:
            told["link"] = self._link
        return msgspec.structs.replace(event, **told) if told else event
