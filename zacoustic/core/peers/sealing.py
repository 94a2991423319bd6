"""The seal of one node: its own counters, and a replay window for each way that ends here.

Outgoing, a frame has a *long head* where a short one might not be understood: it is the first of a
life or key to its destination, it is strong, whoever composes it asks for one (a repetition, or
what is `real_time`), it is one of `LONG_EVERY`, or the last long head to that destination is older
than `LONG_EVERY_S`. So nothing has to be asked for: after any outage a receiver is in step again
within 16 frames or five minutes.

Incoming, a frame is opened, or refused with a word for the statistics. **Nothing is ever
transmitted because of a frame that was refused**: else a stranger could drain a battery.

The table of its sender is found out by trying: the digest of this node's own table, the one that
was announced by this source, and `NO_TABLE`.

A frame of this node's own address is an echo where it is of a life and a counter that were used
here. One that is ahead of them was sealed by another computer with the same key and address: two of
them would share nonces, so the one that notices seals nothing from then on.
"""

from collections.abc import Callable, Mapping
from enum import Enum
from functools import partial
from typing import Final

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.peers.replay import AHEAD, Mark, Window, life_of
from zacoustic.core.wire.seal import (
    LAST_COUNTER,
    LAST_LIFE,
    NO_TABLE,
    Cipher,
    LongHead,
    SealedFrame,
    ShortHead,
    Way,
    associated_data,
    is_strong,
    nonce,
    parse_sealed,
)

LONG_EVERY: Final = 16
LONG_EVERY_S: Final = 300.0
_LONG_EVERY_NS: Final = seconds_to_ns(LONG_EVERY_S)
_RARE_NS: Final = seconds_to_ns(5.0)
"""Frames that come no closer have marks that are exact."""
_MARK_PREFIX: Final = "seal/"
_MARK = msgspec.msgpack.Decoder(Mark)


class Refusal(Enum):
    """Why a frame was not opened: a word for the statistics."""

    UNSEALED = "unsealed"
    """It is no sealed frame."""
    FORGED = "forged"
    """No key of the fleet made its tag; or its receiver is out of step."""
    OUT_OF_STEP = "out_of_step"
    """A short head of a node of which no long one has come."""
    REPLAYED = "replayed"
    """It was opened before, or is too far behind."""
    FORMER_LIFE = "former_life"
    """Authentic, and of a life of its source that is over."""
    CLONE = "clone"
    """Authentic, and of this node's address, but it has not sent it."""
    FORBIDDEN = "forbidden"
    """Authentic, but a record in it, or its command, is not for its source to give."""


class Inside(msgspec.Struct, frozen=True, kw_only=True):
    """What was in a sealed frame."""

    records: bytes
    digest: bytes
    """Of the sender's table; `NO_TABLE`: to be read without one."""
    life: int
    """Of the sender."""
    strong: bool


class _Sending:
    """Counters of one way from this node."""

    __slots__ = ("counter", "generation", "long_at", "since_long")

    def __init__(self) -> None:
        self.counter = 0
        self.generation = 0
        """Of the last long head."""
        self.since_long = 0
        self.long_at: int | None = None


class Seal:
    """Seals the frames of one node, and opens those that are for it.

    Args:
        address: This node, 1…254.
        life: Of this start; no start before or after has the same.
        cipher: Has the keys.
        journal: Keeps the windows.
        stored: What former lives have kept there.
        announced: Tells the digest of a node's table, as it has announced it; empty: it has not.
    """

    def __init__(
        self,
        address: int,
        life: int,
        cipher: Cipher,
        journal: JournalPort,
        stored: Mapping[str, bytes],
        announced: Callable[[int], bytes],
    ) -> None:
        self._address = address
        self._life = life
        self._announced = announced
        self.is_cloned = False
        """Another computer has this node's key and address."""
        self._cipher = cipher
        self._journal = journal
        self._sending: dict[Way, _Sending] = {}
        self._windows: dict[Way, Window] = {}
        self._given: dict[Way, Mark] = {}
        """Marks that were given to the journal,"""
        self._given_at: dict[Way, int] = {}
        self._safe: dict[Way, Mark] = {}
        """and those of them that it has written."""
        self._floors: dict[int, int] = {}
        """The newest start of each source."""
        self._recover(stored)

    # Outgoing

    @property
    def may_seal(self) -> bool:
        """A frame can be sealed: this life is none beyond the last, and nobody else has it."""
        return not self.failure

    @property
    def failure(self) -> str:
        """Why nothing can be sealed, one line; empty: it can."""
        if self.is_cloned:
            return "another computer has the key and the address of this node"
        if self._life > LAST_LIFE:
            return "there is no life of this node that a frame may be sealed in"
        return ""

    @property
    def is_exhausted(self) -> bool:
        """A counter has reached its end: only another life can seal."""
        return any(each.counter > LAST_COUNTER for each in self._sending.values())

    def begin(self, life: int) -> None:
        """Begin another life: counters begin anew."""
        self._life = life
        self._sending.clear()

    def reintroduce(self, address: int) -> None:
        """Have what goes to a node begin with a long head: it may know nothing of this one."""
        for way, sending in self._sending.items():
            if way.destination in (address, BROADCAST):
                sending.long_at = None

    def needs_long(self, destination: int, now: int, *, port: int = 0) -> bool:
        """Tell whether the next frame needs a long head, whatever is in it."""
        return self._needs_long(Way(self._address, destination, port), now)

    def seal(
        self,
        records: bytes,
        destination: int,
        digest: bytes,
        now: int,
        *,
        port: int = 0,
        strong: bool = False,
        long: bool = False,
    ) -> bytes:
        """Make a sealed frame; its counter is used up, whatever becomes of it.

        Args:
            records: What to seal.
            destination: 1…254, or 255.
            digest: Of this node's table, or `NO_TABLE`.
            now: The instant.
            port: The link or route.
            strong: With the long tag.
            long: With the long head.

        Raises:
            OverflowError: The seal `is_exhausted`.
        """
        way = Way(self._address, destination, port, strong)
        is_long = strong or long or self._needs_long(way, now)
        sending = self._sending.setdefault(way, _Sending())
        counter = sending.counter
        if counter > LAST_COUNTER:
            raise OverflowError(f"{counter} frames were sealed for {destination} in one life")
        sending.counter += 1
        generation = self._cipher.generation & 1
        head: ShortHead | LongHead = ShortHead(generation, counter % 64)
        sending.since_long += 1
        if is_long:
            head = LongHead(generation, self._life, counter, strong)
            sending.since_long, sending.long_at = 0, now
            sending.generation = self._cipher.generation
        head_bytes = head.encode()
        associated = associated_data(head_bytes, way, digest)
        number = nonce(way, self._life, counter)
        return head_bytes + self._cipher.seal(way, number, records, associated)

    # Incoming

    def open(
        self,
        frame: bytes,
        way: Way,
        own_digest: bytes,
        now: int,
        then: Callable[[Inside, int], None],
    ) -> Refusal | None:
        """Open a frame that is for this node.

        Args:
            frame: What arrived.
            way: Whence and whither, as the link or the envelope says, and by which port; a wrong
                one opens nothing. The frame itself says whether it is strong.
            own_digest: Of this node's table.
            now: The instant.
            then: Takes the records, and the instant, when nothing can make a later life of this
                node open them again: in this call, or when the journal has written.

        Returns:
            Why it was not opened; None: it was.
        """
        sealed = parse_sealed(frame)
        if sealed is None:
            return Refusal.UNSEALED
        way = msgspec.structs.replace(way, strong=is_strong(sealed.head))
        window = self._windows.get(way) or Window()
        floor = self._floors.get(way.source, -1)
        refusal = Refusal.OUT_OF_STEP
        generation = self._cipher.generation
        generation -= (generation ^ sealed.head.generation) & 1  # this one, or that before
        for start, counter in window.candidates(sealed.head, generation, floor):
            number = nonce(way, life_of(start), counter)
            opened = self._try(sealed, way, number, life_of(start), own_digest)
            if opened is None:
                refusal = Refusal.FORGED
                continue
            if start < floor:
                return Refusal.FORMER_LIFE
            if not window.is_new(start, counter):
                return Refusal.REPLAYED
            window.note(start, counter)
            self._windows[way] = window
            self._floors[way.source] = start
            self._keep(way, window, partial(then, opened), now)
            return None
        return refusal

    def overhear_own(self, frame: bytes, way: Way, own_digest: bytes) -> Refusal | None:
        """Look at a frame of this node's own address: an echo, a forgery, or that of a clone.

        Args:
            frame: What arrived.
            way: Whence and whither.
            own_digest: Of this node's table.
        """
        sealed = parse_sealed(frame)
        if sealed is None or not isinstance(sealed.head, LongHead):
            return None
        head, way = sealed.head, msgspec.structs.replace(way, strong=sealed.head.strong)
        sending = self._sending.get(way)
        sent = (self._life, sending.counter if sending else 0)
        if (head.life, head.counter) < sent or self.is_cloned:
            return None
        number = nonce(way, head.life, head.counter)
        if self._try(sealed, way, number, head.life, own_digest) is None:
            return None
        self.is_cloned = True
        return Refusal.CLONE

    # Below the methods above

    def _needs_long(self, way: Way, now: int) -> bool:
        sending = self._sending.get(way)
        if sending is None or sending.long_at is None or sending.since_long >= LONG_EVERY - 1:
            return True
        is_other_key = sending.generation != self._cipher.generation
        return is_other_key or now - sending.long_at >= _LONG_EVERY_NS

    def _try(
        self, sealed: SealedFrame, way: Way, number: bytes, life: int, own_digest: bytes
    ) -> Inside | None:
        announced = self._announced(way.source) or own_digest
        for digest in dict.fromkeys((own_digest, announced, NO_TABLE)):
            associated = associated_data(sealed.head_bytes, way, digest)
            generation = sealed.head.generation
            records = self._cipher.open(generation, way, number, sealed.body, associated)
            if records is not None:
                return Inside(records=records, digest=digest, life=life, strong=way.strong)
        return None

    def _keep(self, way: Way, window: Window, then: Callable[[int], None], now: int) -> None:
        """Have a window written as it has to be, and go on when that is safe."""
        if way.strong:
            self._write(way, window.mark, then)
            return
        given, safe = self._given.get(way), self._safe.get(way)
        given_at = self._given_at.get(way)
        if given_at is None or now - given_at >= _RARE_NS:
            self._given_at[way] = now
            self._write(way, window.mark, then)
            return
        if given is None or not given.covers(window, AHEAD // 2):
            self._given_at[way] = now
            ahead = min(window.highest + AHEAD, LAST_COUNTER)
            waits = None if safe is not None and safe.covers(window) else then
            self._write(way, Mark(window.start, ahead), waits)
            if waits is not None:
                return
        elif safe is None or not safe.covers(window):
            # A mark that covers it is on its way to the disk: behind that, the same once more.
            self._write(way, given, then)
            return
        then(now)

    def _write(self, way: Way, mark: Mark, then: Callable[[int], None] | None) -> None:
        self._given[way] = mark

        def written(now: int) -> None:
            self._safe[way] = mark
            if then is not None:
                then(now)

        self._journal.write(_key(way), msgspec.msgpack.encode(mark), written)

    def _recover(self, stored: Mapping[str, bytes]) -> None:
        for key, value in stored.items():
            if key.startswith(_MARK_PREFIX):
                way, mark = _way(key), _MARK.decode(value)
                self._windows[way] = Window(mark)
                self._given[way] = self._safe[way] = mark
                self._floors[way.source] = max(mark.start, self._floors.get(way.source, -1))


def _key(way: Way) -> str:
    strength = "strong" if way.strong else "plain"
    return f"{_MARK_PREFIX}{way.source}/{way.destination}/{way.port}/{strength}"


def _way(key: str) -> Way:
    source, destination, port, strength = key.removeprefix(_MARK_PREFIX).split("/")
    return Way(int(source), int(destination), int(port), strength == "strong")
