"""One sample of a recording, as written."""

from typing import Any

import msgspec


class Line(msgspec.Struct, frozen=True):
    """A sample as written."""

    place: str
    """File and number of the line, for messages."""
    at_s: float
    """Time, s."""
    name: str
    """The stream, by name or id."""
    content: Any
    """The value."""
