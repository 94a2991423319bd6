"""What the seal of a node does to the frames of one link: how long they get, and how they close.

Before a frame is filled it is settled how it will be closed: by what goes in it first. A payload of
a *strong* kind (an order, a call, a goal) wants the long tag, one that is REAL_TIME or repeated the
long head; a strong frame may carry anything, any other one nothing strong. The digest that its tag
covers is that of this node's table, or none where no table is needed to read it: it has a HELLO, or
nothing but controls and remote commands.

On a link without a seal nothing of this happens (`Unsealed`).
"""

from collections.abc import Callable, Sequence
from typing import Final

import msgspec

from zacoustic.core.base.qos import Priority
from zacoustic.core.base.stats import Cause
from zacoustic.core.peers.sealing import Seal
from zacoustic.core.schedule.queue import Waiting
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
"""What can be strong."""


class SealRules(msgspec.Struct, frozen=True, kw_only=True):
    """What the config says of sealing."""

    strong: frozenset[str] = frozenset(KINDS)
    """Which of `KINDS` get the long tag."""
    pad_bytes: tuple[int, ...] = ()
    """Lengths that frames are filled up to, ascending, bytes; empty: to none."""
    unsealed: frozenset[int] = frozenset()
    """Topics, by stream id, whose samples are also taken from frames without a seal."""

    def check_room(self, room_bytes: int) -> None:
        """Check that sealed frames fit a link, and the lengths that they are filled up to.

        Args:
            room_bytes: The longest sealed frame that it can take.

        Raises:
            ConfigError: They do not.
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
    """How a frame is going to be closed."""

    overhead_bytes: int = 0
    """So much of the room that the link has for records."""
    strong: bool = False
    """With the long tag."""
    long: bool = False
    """With the long head."""


_OPEN: Final = Closing()


class Unsealed:
    """The frames of a link are not sealed."""

    overhead_bytes: int = 0
    """Most that sealing takes of a frame."""
    fragment_overhead_bytes: int = 0
    """What it takes of a frame that is filled by a fragment."""

    def check_room(self, room_bytes: int) -> None:
        """Check that a link has room for such frames; see `SealRules.check_room`."""

    def settle(
        self,
        destination: int,
        first: Waiting | None,
        priority: Priority | None,
        now: int,
        *,
        introduces: bool = False,
    ) -> Closing:
        """Settle how the next frame is going to be closed.

        Args:
            destination: Address, or `BROADCAST`.
            first: The payload that it goes for; None: it has none.
            priority: Of that.
            now: The instant.
            introduces: It says which table this node has, to whoever may not be in step.
        """
        return _OPEN

    def admits(self, item: Waiting, closing: Closing) -> bool:
        """Tell whether a payload may be in a frame that is closed so."""
        return True

    def refuses(self, stream: Stream, *, strong: bool) -> bool:
        """Tell whether a record may not be taken from a frame with a tag of that length."""
        return False

    def is_known(self, destination: int, now: int) -> bool:
        """Tell whether a fragment may go: whoever is to hear it can be in step."""
        return True

    def close(
        self,
        content: bytes,
        destination: int,
        closing: Closing,
        now: int,
        *,
        items: Sequence[Waiting] = (),
        needs_no_table: bool = False,
    ) -> bytes:
        """Close a frame.

        Args:
            content: What it says.
            destination: Address, or `BROADCAST`.
            closing: As it was settled.
            now: The instant.
            items: The payloads in it.
            needs_no_table: It has a HELLO, or no record of any stream.
        """
        return content


class LinkSeal(Unsealed):
    """The frames of a link are sealed.

    Args:
        seal: Of the node.
        rules: What the config says.
        table: Tells what is strong.
        port: Number of the link, 0…127.
        digest: Tells the digest of the present table.
    """

    overhead_bytes = LONG_HEAD_BYTES + STRONG_TAG_BYTES
    fragment_overhead_bytes = SHORT_HEAD_BYTES + TAG_BYTES

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
        first: Waiting | None,
        priority: Priority | None,
        now: int,
        *,
        introduces: bool = False,
    ) -> Closing:
        """Settle how the next frame is going to be closed; see `Unsealed.settle`."""
        if first is not None and self._is_strong(first):
            return Closing(LONG_HEAD_BYTES + STRONG_TAG_BYTES, strong=True, long=True)
        is_pressing = introduces or priority is Priority.REAL_TIME
        is_pressing |= first is not None and first.cause is Cause.REPEAT
        if is_pressing or self._seal.needs_long(destination, now, port=self._port):
            return Closing(LONG_HEAD_BYTES + TAG_BYTES, long=True)
        return Closing(SHORT_HEAD_BYTES + TAG_BYTES)

    def admits(self, item: Waiting, closing: Closing) -> bool:
        """Tell whether a payload may be in a frame that is closed so."""
        return closing.strong or not self._is_strong(item)

    def refuses(self, stream: Stream, *, strong: bool) -> bool:
        """Tell whether a record may not be taken from a frame with a tag of that length."""
        return not strong and self._kind(stream) in self._rules.strong

    def is_known(self, destination: int, now: int) -> bool:
        """Tell whether a fragment may go: whoever is to hear it can be in step."""
        return not self._seal.needs_long(destination, now, port=self._port)

    def close(
        self,
        content: bytes,
        destination: int,
        closing: Closing,
        now: int,
        *,
        items: Sequence[Waiting] = (),
        needs_no_table: bool = False,
    ) -> bytes:
        """Seal a frame; see `Unsealed.close`."""
        is_free = needs_no_table or (bool(items) and all(map(self._is_built_in, items)))
        size_bytes = len(content) + closing.overhead_bytes
        wanted_bytes = next((each for each in self._rules.pad_bytes if each >= size_bytes), 0)
        # In front: what stands last in a frame may reach to its end.
        return self._seal.seal(
            PADDING * max(0, wanted_bytes - size_bytes) + content,
            destination,
            NO_TABLE if is_free else self._digest(),
            now,
            port=self._port,
            strong=closing.strong,
            long=closing.long,
        )

    # Below the methods above

    def _is_built_in(self, item: Waiting) -> bool:
        stream = self._table.get(item.stream_id)  # a control that waits has none
        return stream is not None and stream.is_built_in

    def _is_strong(self, item: Waiting) -> bool:
        stream = self._table.get(item.stream_id)
        # An answer about nothing that is in the table is of no kind.
        return stream is not None and self._kind(stream) in self._rules.strong

    @staticmethod
    def _kind(stream: Stream) -> str:
        if isinstance(stream.spec, ActionSpec):
            return "actions"
        if isinstance(stream.spec, ServiceSpec):
            return "commands" if stream.is_built_in else "services"
        return "topics"
