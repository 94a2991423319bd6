"""The health report: documents by the end of their keys, from those that know."""

from collections.abc import Sequence
from typing import Protocol

from zacoustic.zenoh.gateway.status.dates import Dates


class Section(Protocol):
    """What knows some of the documents."""

    def documents(self) -> dict[str, object]:
        """Return them as they are now, by the end of their keys."""
        ...


class Report:
    """The health report of one gateway.

    Args:
        sections: What knows its documents.
        dates: Their dates.
    """

    def __init__(self, sections: Sequence[Section], dates: Dates) -> None:
        self._sections = tuple(sections)
        self._dates = dates

    def documents(self) -> dict[str, object]:
        """Return all documents as they are now, by the end of their keys."""
        self._dates.look()
        return {
            name: self._dates.told(document)
            for section in self._sections
            for name, document in section.documents().items()
        }
