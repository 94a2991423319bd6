"""The ids that the links of one engine give away, as the application sees them."""

from typing import Final, TypeVar

import msgspec

from zacoustic.core.base.linktypes import ONE_LINK

_IDS: Final = ("delivery_id", "call_id", "object_id")
"""Fields of events with what a command has returned."""
_ID_BITS: Final = 60
"""Of an id, what the link has given; above that stands which link it is."""
_ID_MASK: Final = (1 << _ID_BITS) - 1
EventT = TypeVar("EventT", bound=msgspec.Struct)


class LinkIds:
    """The ids of one link: no two links give the same to the application.

    Args:
        link: Name of the link.
        index: Which link it is, from 0.
    """

    def __init__(self, link: str, index: int) -> None:
        self._link = link
        self._index = index

    def outer(self, inner: int) -> int:
        """Return the id for the application; 0 names nothing, and stays 0."""
        return inner | self._index << _ID_BITS if inner else 0

    def inner(self, outer: int) -> int | None:
        """Return the id of the link; None: another link has given it away."""
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
