"""Reception: dispatches the items of a frame to the components that registered for them.

A frame is read in two passes. The first takes the statements about the sender, at any position: who
it is, and whether both ends know each other's tables. They decide which of the rest may be decoded.
The second pass takes controls and records in order and applies that verdict.

From a frame for another node only the items that concern everybody are read.
"""

from collections.abc import Callable
from typing import Any, Protocol

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.linktypes import BROADCAST, ReceivedFrame
from zacoustic.core.base.signals import Signal
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.streams.table import Stream
from zacoustic.core.values.age import Age, decode_age
from zacoustic.core.wire.access import AccessControl
from zacoustic.core.wire.controls import FIRST_EXTENSION, LAST_EXTENSION, Extension, Item
from zacoustic.core.wire.frame import Record
from zacoustic.core.wire.objects import ListenHint


class HearingPort(Protocol):
    """The port that received a frame."""

    def handle_control(
        self, source: int, control: AccessControl, frame: ReceivedFrame, now: int
    ) -> None:
        """Take a control of medium access."""

    def handle_call(self, source: int, call: ListenHint, frame: ReceivedFrame, now: int) -> None:
        """Learn from a fragment when its sender listens."""

    def travel(
        self, source: int, frame: ReceivedFrame, content_bytes: int, now: int
    ) -> tuple[int, int | None]:
        """Return how long a frame was on its way, and the largest error of that, ns."""


class Heard:
    """A frame that is being read, with the statements about its sender.

    Args:
        source: Address of its sender.
        frame: The frame, including its destination.
        port: The port that received it.
        handshake: Knows the agreement with its sender.
        now: The instant.
        content_bytes: Size of its records, bytes.
    """

    __slots__ = (
        "_handshake", "content_bytes", "epoch", "frame", "is_foreign", "is_strong", "now", "port",
        "source", "streams", "tagged",
    )  # fmt: skip

    def __init__(
        self,
        source: int,
        frame: ReceivedFrame,
        port: HearingPort,
        handshake: Handshake,
        now: int,
        content_bytes: int = 0,
    ) -> None:
        self._handshake = handshake
        self.content_bytes = content_bytes
        self.source = source
        self.frame = frame
        self.port = port
        self.now = now
        self.epoch: int | None = None
        """Boot epoch in its HELLO or TAG; None: it has neither."""
        self.tagged: int | None = None
        """Boot epoch in its TAG; None: it has none."""
        self.is_strong = False
        """It has the long tag of the seal."""
        self.is_foreign = False
        """It has a HELLO of another wire version."""
        self.streams: list[int] = []
        """Streams of its items; 0 for an item without a stream."""

    @property
    def is_unicast(self) -> bool:
        """It is for this node alone."""
        return self.frame.destination != BROADCAST

    def age(self, code: int) -> Age:
        """Return the age, as the frame arrived here, of a sample with this code in it.

        The code tells it as the frame began at its source.
        """
        travel_ns, error_ns = self.port.travel(
            self.source, self.frame, self.content_bytes, self.now
        )
        error_s = None if error_ns is None else ns_to_seconds(error_ns)
        return decode_age(code).later(ns_to_seconds(travel_ns), error_s)

    def refusal(self, stream_id: int) -> str | None:
        """Return why a record of a stream may not be decoded, one word, or None."""
        return self._handshake.verdict(self.source, self.epoch, stream_id, self.now)

    def dense_refusal(self) -> str | None:
        """Return why a dense block may not be decoded, one word, or None."""
        return self._handshake.verdict_dense(self.source, self.epoch, self.now)

    def misses_reference(self) -> None:
        """Report to its sender that this node lacks the reference that the frame assumes."""
        self._handshake.misses_reference(self.source, self.now)


Take = Callable[[Heard, Any], str | None]
"""Takes an item of a frame; returns why it drops it, one word, or None."""
TakeRecord = Callable[[Heard, Stream, Record], str | None]
"""The same for a record of a stream that both ends define in the same way."""
TakeExtension = Callable[[Heard, bytes], str | None]
"""The same for the body of an extension."""


class Reception:
    """The components that take items, by kind."""

    def __init__(self) -> None:
        self._of_sender: dict[type[Item], Take] = {}
        self._takers: dict[type[Item], tuple[Take, ...]] = {}
        self._overhearers: dict[type[Item], Take] = {}
        self._records: dict[type, TakeRecord] = {}
        self._acks: dict[type, TakeRecord] = {}
        self._extensions: dict[int, TakeExtension] = {}
        self.read = Signal[int, int]()
        """``(address, now)``: a frame of a node has been read."""
        self.came_again = Signal[int]()
        """``(address)``: a node repeats an earlier record: it did not get the answer."""
        self.on(Extension, self._extension)

    # Registration

    def of_sender(self, kind: type[Item], take: Take) -> None:
        """Register for a control that describes its sender; taken in the first pass."""
        self._of_sender[kind] = take

    def on(self, kind: type[Item], take: Take) -> None:
        """Register for a control of the second pass, after earlier registrations."""
        self._takers[kind] = (*self._takers.get(kind, ()), take)

    def overhear(self, kind: type[Item], take: Take) -> None:
        """Register for a control in frames for other nodes."""
        self._overhearers[kind] = take

    def on_records(self, spec: type, take: TakeRecord, take_ack: TakeRecord | None = None) -> None:
        """Register for the records of one kind of stream.

        Args:
            spec: Class of the streams' specs.
            take: Takes a record that may be decoded.
            take_ack: Takes an acknowledgement; it needs no verdict, because its sender has read
                records of this node.
        """
        self._records[spec] = take
        if take_ack is not None:
            self._acks[spec] = take_ack

    def on_extension(self, code: int, take: TakeExtension) -> None:
        """Register for an extension.

        Raises:
            ValueError: It is no code of an extension, or it is already taken.
        """
        if not FIRST_EXTENSION <= code <= LAST_EXTENSION or code in self._extensions:
            raise ValueError(
                f"extension code is {code:02X}; allowed: one of "
                f"{FIRST_EXTENSION:02X}..{LAST_EXTENSION:02X} that no other transport has"
            )
        self._extensions[code] = take

    # Dispatch

    def first(self, heard: Heard, item: Item) -> str | None:
        """Dispatch a statement about the sender; returns why it is dropped, or None."""
        take = self._of_sender.get(type(item))
        return None if take is None else take(heard, item)

    def second(self, heard: Heard, item: Item) -> str | None:
        """Dispatch any other control; returns why it is dropped, or None."""
        reason = None
        for take in self._takers.get(type(item), ()):
            reason = take(heard, item)
        return reason

    def overheard(self, heard: Heard, item: Item) -> None:
        """Dispatch a control of a frame for another node."""
        take = self._overhearers.get(type(item))
        if take is not None:
            take(heard, item)

    def record(self, heard: Heard, stream: Stream, record: Record) -> str | None:
        """Dispatch a record that may be decoded; returns why it is dropped, or None."""
        return self._records[type(stream.spec)](heard, stream, record)

    def ack(self, heard: Heard, stream: Stream, record: Record) -> str | None:
        """Dispatch an acknowledgement; returns why it is dropped, or None."""
        take = self._acks.get(type(stream.spec))
        return "unknown_stream" if take is None else take(heard, stream, record)

    # Below the methods above

    def _extension(self, heard: Heard, said: Extension) -> str | None:
        take = self._extensions.get(said.code)
        return "reserved" if take is None else take(heard, said.body)
