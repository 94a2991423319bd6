"""The contract for a transport of somebody else: a mechanism between two nodes beside the wire's.

It is made by `Engine(transports=[...])`, once for each link, with the `Context` of the link, and
from then on lives like the others: it says something in *extensions* (docs/wire.md, section 3),
registers what it takes, has timers, a place in the journal, random numbers and events of its own,
and follows the signals of `Peers`. It adds no thread, no clock and no file: an engine is a function
of its inputs.

A node that does not have it skips what it says. A recording has no commands to it: a run with such
commands cannot be replayed.

============================  ======================================================================
`Context.reception`           ``on_extension(code, take)``: ``take(heard, body)`` returns why
                              something is dropped, one word, or None, and raises for no bytes;
                              `Heard.refusal` tells what is agreed with the sender
`Context.timers`              ``at((Due.TRANSPORT, name, ...), instant, callback)``
`Context.peers`               ``restarted``, ``asked``, ``forgotten`` … ``.connect(told)``
`Context.journal`             ``write(f"{name}/…", entry, then)``; `Context.stored` has it back
`Context.generators`          ``of(name)``
`Context.emit`                takes a `TransportEvent`
============================  ======================================================================
"""

from collections.abc import Callable
from typing import ClassVar

import msgspec

from zacoustic.core.base.linktypes import BROADCAST, LinkCapabilities, TransmitReport
from zacoustic.core.base.parts import Offer, Part
from zacoustic.core.base.timers import Due
from zacoustic.core.peers.reception import Heard
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.sources import Said
from zacoustic.core.wire.controls import FIRST_EXTENSION, LAST_EXTENSION, Extension

__all__ = [
    "BROADCAST",
    "FIRST_EXTENSION",
    "LAST_EXTENSION",
    "Context",
    "Due",
    "Extension",
    "Heard",
    "LinkCapabilities",
    "MakeTransport",
    "Offer",
    "Part",
    "Said",
    "TransmitReport",
    "Transport",
    "TransportEvent",
]


class TransportEvent(msgspec.Struct, frozen=True, kw_only=True):
    """What a transport of somebody else tells; its own events derive from this one."""


class Transport:
    """A mechanism between two nodes; override what it needs.

    Its constructor takes the `Context` alone and registers what it takes.

    Args:
        context: What the components of its engine share.
    """

    name: ClassVar[str] = ""
    """Names it in `Engine.transports`; not empty."""

    def __init__(self, context: Context) -> None:
        self.context = context

    def use_link(self, capabilities: LinkCapabilities, now: int) -> None:
        """Take what the link can do; called before it is up, and when that changes."""

    def link_up(self, now: int) -> None:
        """The link is up."""

    def due_at(self, now: int) -> int | None:
        """Return the instant from which a frame is to go for it, ns; None: it has nothing."""
        return None

    def offer(self, now: int) -> Offer | None:
        """Return where a frame is to go now; None: nothing is due.

        With ``owed_first=True`` it goes before what else waits, otherwise where payloads leave
        room. The frame is made only if `say` then says something.
        """
        return None

    def say(self, destination: int, room_bytes: int, now: int) -> Said | None:
        """Return what it says in a frame that goes now, whoever it was made for; None: nothing.

        Args:
            destination: Address, or `BROADCAST`.
            room_bytes: How long the body may be, 0…254.
            now: The instant.
        """
        return None


MakeTransport = Callable[[Context], Transport]
"""Makes a transport; a subclass of `Transport` itself is one."""
