"""What the two engines ask their shells to do."""

from typing import Any

import msgspec

from zacoustic.mavlink.commands import Answer
from zacoustic.mavlink.dialect import Message


class Send(msgspec.Struct, frozen=True):
    """Send a MAVLink message."""

    message: Message
    """The message."""
    system: int
    """System id of the sender."""
    component: int
    """Component id of the sender."""


class Publish(msgspec.Struct, frozen=True):
    """Publish a sample."""

    topic: str
    """Last part of the topic's name."""
    value: dict[str, Any]
    """The value."""


class Call(msgspec.Struct, frozen=True):
    """Call a service; its end goes to `StationSide.handle_answer`."""

    number: int
    """Names the call."""
    service: str
    """Last part of the service's name."""
    value: dict[str, Any]
    """The request."""


class Reply(msgspec.Struct, frozen=True):
    """Answer a call."""

    number: int
    """As in `AutopilotSide.handle_request`."""
    answer: Answer
    """The answer."""


class Notice(msgspec.Struct, frozen=True):
    """Something that people should know."""

    event: str
    """The word for machines."""
    text: str
    """One line for people."""
    is_trouble: bool = False
    """Whether somebody should look at it."""


Output = Send | Publish | Call | Reply | Notice
