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


class Cdr(msgspec.Struct, frozen=True):
    """The content of a line of a ROS 2 bag: only the stream's type tells what it means."""

    data: bytes
    """The message."""
