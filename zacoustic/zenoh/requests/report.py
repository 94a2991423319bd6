"""The health report of a gateway: ``@acoustic/3/link``, or ``@acoustic/3/**`` for all of it.

This row has no parameters and no engine call. A gateway puts the documents on a change as well
(`zacoustic.zenoh.gateway.status.health`), and answers any key expression with those that it covers,
each under its own key, as JSON.
"""

import re
from typing import Final

from zacoustic.zenoh.requests.request import ANY_NODE, PREFIX

ALL: Final = "**"
"""All documents."""
_KEY: Final = re.compile(rf"{PREFIX}/([0-9]{{1,3}})/(.+)")


class Report:
    """The row of the report."""

    def key(self, node: int | None, document: str = ALL) -> str:
        """Return the key of a document, or the expression of a query.

        Args:
            node: Address of the gateway; None: all local ones.
            document: End of the key.
        """
        return f"{PREFIX}/{ANY_NODE if node is None else node}/{document}"

    def place(self, key: str) -> tuple[int, str] | None:
        """Return the gateway and the document of a key; None: it is another key."""
        found = _KEY.fullmatch(key)
        return None if found is None else (int(found[1]), found[2])


REPORT: Final = Report()
"""Asks gateways for documents about themselves."""
