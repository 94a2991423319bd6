"""How the frames of one link are sealed: their overhead, and how each is closed.

How a frame is closed is settled before it is filled, by its first payload. A payload of a *strong*
kind (a command, a call, a goal) needs the long tag; one that is REAL_TIME or repeated needs the
long head. A strong frame may carry anything, any other frame nothing strong. The tag covers the
digest of this node's table, or none if no table is needed to read the frame: it has a HELLO, or
only controls and remote commands.

On a link without a seal none of this happens (`Unsealed`).
"""

from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.qos import Priority
from zacoustic.core.base.stats import Cause
from zacoustic.core.peers.sealing import ANSWERED, IN_VAIN, USUAL, LongHeads, Seal
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.schedule.replybudget import REPLY_SHARE
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.wire.frame import PADDING
from zacoustic.core.wire.seal import (
    LEAST_ROOM_BYTES,
    LONG_HEAD_BYTES,
    NO_TABLE,
    SHORT_HEAD_BYTES,
    STRONG_TAG_BYTES,
    TAG_BYTES,
)
from zacoustic.errors import ConfigError

KINDS: Final = ("commands", "services", "actions")
"""The kinds that can be strong."""


class SealRules(msgspec.Struct, frozen=True, kw_only=True):
    """The sealing settings of the config."""

    strong: frozenset[str] = frozenset(KINDS)
    """Those of `KINDS` that get the long tag."""
    pad_bytes: tuple[int, ...] = ()
    """Lengths to which frames are padded, ascending, bytes; empty: no padding."""
    unsealed: frozenset[int] = frozenset()
    """Topics, by stream id, whose samples are also accepted from unsealed frames."""
    reply_share: float = REPLY_SHARE
    """Share of the time that each other node can make this one transmit, above 0, at most 1."""

    def check_room(self, room_bytes: int) -> None:
        """Check that sealed frames, and the lengths to which they are padded, fit a link.

        Args:
            room_bytes: The longest sealed frame of the link, bytes.

        Raises:
            ConfigError: They do not fit.
        """
        if room_bytes < LEAST_ROOM_BYTES:
            raise ConfigError(
                f"security: this link has room for sealed frames of {room_bytes} bytes; allowed: "
                f"at least {LEAST_ROOM_BYTES}",
                hint="raise the mtu of the link, or use another one",
            )
        longest_bytes = max(self.pad_bytes, default=0)
        if longest_bytes > room_bytes:
            raise ConfigError(
                f"security.pad: {longest_bytes}; this link has room for sealed frames of "
                f"{room_bytes} bytes; allowed: lengths up to that",
                hint=f"make the longest one {room_bytes}",
            )


class Closing(msgspec.Struct, frozen=True):
    """How a frame will be closed."""

    overhead_bytes: int = 0
    """Bytes that this takes from the link's room for records."""
    strong: bool = False
    """Whether it gets the long tag."""
    long: bool = False
    """Whether it gets the long head."""
    long_heads: LongHeads = USUAL
    """How far apart long heads may be."""


_OPEN: Final = Closing()


class Unsealed:
    """The frames of a link without a seal."""

    overhead_bytes: int = 0
    """The most bytes that sealing takes from a frame."""
    fragment_overhead_bytes: int = 0
    """The bytes that it takes from a frame filled by a fragment."""
    hop_overhead_bytes: int = 0
    """The bytes that it takes from a full frame of a route, or a full flooded one, on its hop."""

    def check_room(self, room_bytes: int) -> None:
        """Check that a link has room for such frames; see `SealRules.check_room`."""

    def settle(
        self,
        destination: int,
        first: QueuedRecord | None,
        priority: Priority | None,
        now: int,
        *,
        introduces: bool = False,
        answered: bool | None = None,
    ) -> Closing:
        """Decide how the next frame will be closed.

        Args:
            destination: Address, or `BROADCAST`.
            first: Its first payload; None: none.
            priority: The priority of that payload.
            now: The instant.
            introduces: It introduces this node's table to nodes that may not be in step.
            answered: Its only hearer has answered the fragments before, or was asked in vain.
        """
        return _OPEN

    def admits(self, item: QueuedRecord, closing: Closing) -> bool:
        """Return whether a payload may be in a frame with this closing."""
        return True

    def refuses(self, stream: Stream, *, strong: bool) -> bool:
        """Return whether a record is refused from a frame with a tag of this length."""
        return False

    def is_known(self, destination: int, now: int, *, answered: bool | None = None) -> bool:
        """Return whether a fragment may go: each of its hearers can be in step.

        Args:
            destination: Address, or `BROADCAST`.
            now: The instant.
            answered: Its only hearer has answered the fragments before, or was asked in vain.
        """
        return True

    def close(
        self,
        content: bytes,
        destination: int,
        closing: Closing,
        now: int,
        *,
        items: Sequence[QueuedRecord] = (),
        needs_no_table: bool = False,
        padded_to: int | None = None,
    ) -> bytes:
        """Close a frame.

        Args:
            content: Its content.
            destination: Address, or `BROADCAST`.
            closing: How it is closed.
            now: The instant.
            items: Its payloads.
            needs_no_table: It has a HELLO, or no record of any stream.
            padded_to: Padding makes it at most so long, bytes; None: no such limit.
        """
        return content

    def introduces_hop(self, content_bytes: int, room_bytes: int, now: int) -> bool:
        """Return whether a frame with the long head goes before one of a route, or a flooded one.

        Args:
            content_bytes: Its content.
            room_bytes: What a frame of the link has room for.
            now: The instant.
        """
        return False

    def close_hop(self, content: bytes, room_bytes: int, now: int, *, is_pressing: bool) -> bytes:
        """Close a frame of a route, or a flooded one, for its next hop.

        Args:
            content: Its content.
            room_bytes: What a frame of the link has room for.
            now: The instant.
            is_pressing: It is urgent, or was sent before.
        """
        return content


class LinkSeal(Unsealed):
    """The frames of a sealed link.

    Args:
        seal: The node's seal.
        rules: The sealing settings of the config.
        table: Tells which payloads are strong.
        port: Number of the link, 0…127.
        digest: Returns the digest of the present table.
    """

    overhead_bytes = LONG_HEAD_BYTES + STRONG_TAG_BYTES
    fragment_overhead_bytes = SHORT_HEAD_BYTES + TAG_BYTES
    hop_overhead_bytes = SHORT_HEAD_BYTES + TAG_BYTES

    def __init__(
        self,
        seal: Seal,
        rules: SealRules,
        table: StreamTable,
        port: int,
        digest: Callable[[], bytes],
    ) -> None:
        self._seal = seal
        self._rules = rules
        self._table = table
        self._port = port
        self._digest = digest

    def check_room(self, room_bytes: int) -> None:
        """Check that a link has room for sealed frames; see `SealRules.check_room`."""
        self._rules.check_room(room_bytes)

    def settle(
        self,
        destination: int,
        first: QueuedRecord | None,
        priority: Priority | None,
        now: int,
        *,
        introduces: bool = False,
        answered: bool | None = None,
    ) -> Closing:
        """Decide how the next frame will be closed; see `Unsealed.settle`."""
        if first is not None and self._is_strong(first):
            return Closing(LONG_HEAD_BYTES + STRONG_TAG_BYTES, strong=True, long=True)
        is_pressing = introduces or priority is Priority.REAL_TIME
        is_pressing |= first is not None and first.cause is Cause.REPEAT
        if is_pressing or not self.is_known(destination, now, answered=answered):
            return Closing(LONG_HEAD_BYTES + TAG_BYTES, long=True)
        return Closing(SHORT_HEAD_BYTES + TAG_BYTES, long_heads=_long_heads(answered))

    def admits(self, item: QueuedRecord, closing: Closing) -> bool:
        """Return whether a payload may be in a frame with this closing."""
        return closing.strong or not self._is_strong(item)

    def refuses(self, stream: Stream, *, strong: bool) -> bool:
        """Return whether a record is refused from a frame with a tag of this length."""
        return not strong and self._kind(stream) in self._rules.strong

    def is_known(self, destination: int, now: int, *, answered: bool | None = None) -> bool:
        """Return whether a fragment may go; see `Unsealed.is_known`."""
        heads = _long_heads(answered)
        return not self._seal.needs_long(destination, now, port=self._port, long_heads=heads)

    def close(
        self,
        content: bytes,
        destination: int,
        closing: Closing,
        now: int,
        *,
        items: Sequence[QueuedRecord] = (),
        needs_no_table: bool = False,
        padded_to: int | None = None,
    ) -> bytes:
        """Seal a frame; see `Unsealed.close`."""
        is_free = needs_no_table or (bool(items) and all(map(self._is_built_in, items)))
        size_bytes = len(content) + closing.overhead_bytes
        wanted_bytes = next((each for each in self._rules.pad_bytes if each >= size_bytes), 0)
        if padded_to is not None:
            wanted_bytes = min(wanted_bytes, padded_to)
        # Padding goes first: the last record of a frame may extend to its end.
        return self._seal.seal(
            PADDING * max(0, wanted_bytes - size_bytes) + content,
            destination,
            NO_TABLE if is_free else self._digest(),
            now,
            port=self._port,
            strong=closing.strong,
            long=closing.long,
            long_heads=closing.long_heads,
        )

    def introduces_hop(self, content_bytes: int, room_bytes: int, now: int) -> bool:
        """Return whether a frame with the long head goes first; see `Unsealed.introduces_hop`."""
        has_room = content_bytes + LONG_HEAD_BYTES + TAG_BYTES <= room_bytes
        return not has_room and not self.is_known(BROADCAST, now)

    def close_hop(self, content: bytes, room_bytes: int, now: int, *, is_pressing: bool) -> bytes:
        """Seal a frame for its next hop; see `Unsealed.close_hop`.

        It goes to all, and is read whatever table its sender has.
        """
        has_room = len(content) + LONG_HEAD_BYTES + TAG_BYTES <= room_bytes
        is_long = is_pressing and has_room
        return self._seal.seal(content, BROADCAST, NO_TABLE, now, port=self._port, long=is_long)

    # Below the methods above

    def _is_built_in(self, item: QueuedRecord) -> bool:
        stream = self._table.get(item.stream_id)  # a waiting control has none
        return stream is not None and stream.is_built_in

    def _is_strong(self, item: QueuedRecord) -> bool:
        stream = self._table.get(item.stream_id)
        # An answer about something outside the table is of no kind.
        return stream is not None and self._kind(stream) in self._rules.strong

    @staticmethod
    def _kind(stream: Stream) -> str:
        if isinstance(stream.spec, ActionSpec):
            return "actions"
        if isinstance(stream.spec, ServiceSpec):
            return "commands" if stream.is_built_in else "services"
        return "topics"


def _long_heads(answered: bool | None) -> LongHeads:
    if answered is None:
        return USUAL
    return ANSWERED if answered else IN_VAIN
