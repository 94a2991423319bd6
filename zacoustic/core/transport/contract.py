"""The contract for a third-party transport: a mechanism between two nodes beside the wire's own.

`Engine(transports=[...])` makes one for each link, with the `Context` of the link. The transport
sends *extensions* (docs/wire.md, section 3) and registers those that it takes. It has timers,
journal entries, random numbers and events of its own, and follows the signals of `Peers`. It adds
no thread, no clock and no file: an engine is a function of its inputs.

A node without the transport skips its extensions. A recording does not contain the commands to a
transport, so a run with such commands cannot be replayed.

============================  ======================================================================
`Context.reception`           ``on_extension(code, take)``: ``take(heard, body)`` returns why
                              the body is dropped, one word, or None, and never raises;
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
    """An event from a third-party transport; its own events derive from this class."""


class Transport:
    """A mechanism between two nodes; override the methods that it needs.

    Its constructor takes only the `Context` and registers the extensions that it takes.

    Args:
        context: What the components of its engine share.
    """

    name: ClassVar[str] = ""
    """Its name in `Engine.transports`; not empty."""

    def __init__(self, context: Context) -> None:
        self.context = context

    def use_link(self, capabilities: LinkCapabilities, now: int) -> None:
        """Take the link's capabilities; called before the link is up, and when they change."""

    def link_up(self, now: int) -> None:
        """Begin or resume work: the link is up."""

    def due_at(self, now: int) -> int | None:
        """Return the instant at which it needs a frame, ns; None: it has nothing to send."""
        return None

    def offer(self, now: int) -> Offer | None:
        """Return which frame it needs now; None: nothing is due.

        With ``owed_first=True`` the frame goes before everything else that waits, otherwise where
        payloads leave room. The engine makes the frame only if `say` then returns something.
        """
        return None

    def say(self, destination: int, room_bytes: int, now: int) -> Said | None:
        """Return what to add to the frame that goes now, whatever its purpose; None: nothing.

        Args:
            destination: Address, or `BROADCAST`.
            room_bytes: Largest length of the body, 0…254.
            now: The instant.
        """
        return None


MakeTransport = Callable[[Context], Transport]
"""Makes a transport; a subclass of `Transport` is one."""
