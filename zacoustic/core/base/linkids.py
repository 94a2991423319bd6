"""The ids that the links of one engine assign, as the application sees them."""

from typing import Final, TypeVar

import msgspec

from zacoustic.core.base.linktypes import ONE_LINK

_IDS: Final = ("delivery_id", "call_id", "object_id")
"""Fields of events that hold a command's return value."""
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

    def outer(self, inner: int) -> int:
        """Return the id for the application; 0 identifies nothing and stays 0."""
        return inner | self._index << _ID_BITS if inner else 0

    def inner(self, outer: int) -> int | None:
        """Return the id on this link; None: another link has assigned it."""
        return outer & _ID_MASK if outer >> _ID_BITS == self._index else None

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
