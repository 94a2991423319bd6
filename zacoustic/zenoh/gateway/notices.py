"""Notices of a running gateway: what it says to its user, as lines of text or as JSON."""

from collections.abc import Callable
from typing import Any

import msgspec


class Notice(msgspec.Struct, frozen=True, kw_only=True):
    """One fact worth a line; made by `notice`."""

    event: str
    """Its kind: the word in JSON."""
    says: tuple[str, ...]
    """Its lines of text: a word of nine letters at most in front, then what it says."""
    facts: dict[str, Any]
    """Its members in JSON."""
    is_trouble: bool = False
    """Whether somebody should look at it."""

    def lines(self) -> list[str]:
        """Return it as lines of text."""
        return list(self.says)

    def record(self) -> dict[str, Any]:
        """Return it as JSON holds it."""
        return {"event": self.event, **self.facts}


def notice(
    event: str, *says: str, head: str = "", is_trouble: bool = False, **facts: object
) -> Notice:
    """Make a notice.

    Args:
        event: Its kind.
        says: Its lines of text, without the word in front.
        head: That word; empty: its kind.
        is_trouble: Whether somebody should look at it.
        facts: Its members in JSON.
    """
    lines = tuple(f"{head or event:<10}{line}".rstrip() for line in says)
    return Notice(event=event, says=lines, is_trouble=is_trouble, facts=facts)


Notify = Callable[[Notice], None]
"""Takes notices, on the loop."""
