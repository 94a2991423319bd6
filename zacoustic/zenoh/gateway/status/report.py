"""The health report: documents of all sections by the end of their keys."""

from collections.abc import Sequence
from typing import Protocol

from zacoustic.zenoh.gateway.status.dates import Dates


class Section(Protocol):
    """A component with documents."""

    def documents(self) -> dict[str, object]:
        """Return its current documents, by the end of their keys."""
        ...


class Report:
    """The health report of one gateway.

    Args:
        sections: The components with documents.
        dates: Their dates.
    """

    def __init__(self, sections: Sequence[Section], dates: Dates) -> None:
        self._sections = tuple(sections)
        self._dates = dates

    def documents(self) -> dict[str, object]:
        """Return all current documents, by the end of their keys."""
        self._dates.look()
        return {
            name: self._dates.told(document)
            for section in self._sections
            for name, document in section.documents().items()
        }
