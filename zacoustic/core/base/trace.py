"""The structured trace: a record of each action of an engine, at the injected instant.

A trace contains no wall clock and no object identity, so two runs with the same inputs write the
same trace, byte for byte, and a trace from the sea can be compared with a replay of it.
"""

from collections.abc import Callable

import msgspec

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import ONE_LINK, Service


class TraceRecord(msgspec.Struct, frozen=True, omit_defaults=True):
    """One action of an engine."""

    at: int
    """Instant, ns."""
    node: int
    """Address of the engine."""
    what: str
    """``transmit``, ``report``, ``receive``, ``drop``, ``link``, ``journal``, ``peer``, ``differ``,
    ``measure``."""
    peer: int = 0
    """The other node, if there is one."""
    size_bytes: int = 0
    """Size of the frame, bytes."""
    streams: tuple[int, ...] = ()
    """The streams of its records."""
    detail: str = ""
    """Outcome or reason, one word."""
    frame: str = ""
    """The frame in hexadecimal, so that a trace can be replayed."""
    link: str = ONE_LINK
    """Name of the link."""
    service: Service = Service.PLAIN
    """The service that carries the frame."""

    def render(self) -> str:
        """Return the record as one line for people."""
        peer = f" peer {self.peer}" if self.peer else ""
        size = f" {self.size_bytes} B" if self.size_bytes else ""
        streams = f" streams {','.join(map(str, self.streams))}" if self.streams else ""
        detail = f" {self.detail}" if self.detail else ""
        link = f" {self.link}" if self.link != ONE_LINK else ""
        head = f"{self.at / NS_PER_S:12.3f}  node {self.node:3d}  {self.what}{link}"
        return f"{head}{peer}{size}{streams}{detail}"


TraceSink = Callable[[TraceRecord], None]
"""Takes each record; must not raise."""


class Tracer:
    """Writes the trace of one engine, if it has a sink.

    Args:
        node: Address of the engine.
        sink: Takes the records, or None.
    """

    def __init__(self, node: int, sink: TraceSink | None) -> None:
        self._node = node
        self._sink = sink

    def note(
        self,
        now: int,
        what: str,
        *,
        peer: int = 0,
        frame: bytes = b"",
        streams: tuple[int, ...] = (),
        detail: str = "",
        link: str = ONE_LINK,
        service: Service = Service.PLAIN,
    ) -> None:
        """Write a record; `TraceRecord` lists the words."""
        if self._sink is not None:
            self._sink(
                TraceRecord(
                    at=now,
                    node=self._node,
                    what=what,
                    peer=peer,
                    size_bytes=len(frame),
                    streams=streams,
                    detail=detail,
                    frame=frame.hex(),
                    link=link,
                    service=service,
                )
            )
