"""The seal of one node: its own counters, and a replay window for each way that ends here.

An outgoing frame has a *long head* if the receiver might not understand a short one: it is the
first of a life or key to its destination; it is strong; its composer asks for it (a repetition, or
`real_time` data); or the last long head to that destination is too many frames or too long ago
(`LongHeads`). So nobody has to ask for anything: after any outage a receiver is in step again
within 16 frames or five minutes.

Fragments of objects fill their frames, so each long head between them costs a frame of its own.
Where the only receiver has answered those before, it is in step, and few are enough: a window
follows short heads over more lost frames than that. Where it was asked in vain, they are frequent,
and the receiver of such a frame of its own, which is empty, answers with a long head: perhaps its
answers were heard and not understood.

An incoming frame is opened, or refused with a word for the statistics. **A refused frame never
causes a transmission**: otherwise a stranger could drain a battery.

The node finds the table of the sender by trial: the digest of its own table, the one that the
source has announced, and `NO_TABLE`.

A frame from this node's own address is an echo if this node has used its life and counter. A frame
ahead of them was sealed by another computer with the same key and address. Two computers would
share nonces, so the one that notices stops sealing.
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

_RARE_NS: Final = seconds_to_ns(5.0)
"""Ways whose frames are at least this far apart have exact marks."""
_MARK_PREFIX: Final = "seal/"
_MARK = msgspec.msgpack.Decoder(Mark)


class LongHeads(msgspec.Struct, frozen=True):
    """How far apart the long heads to a destination may be."""

    every: int
    """One of so many frames has one."""
    every_ns: int
    """The age at which the next frame has one, ns."""


USUAL: Final = LongHeads(16, seconds_to_ns(300.0))
ANSWERED: Final = LongHeads(96, seconds_to_ns(300.0))
"""Among fragments whose only receiver has answered those before."""
IN_VAIN: Final = LongHeads(16, seconds_to_ns(20.0))
"""Among fragments whose only receiver has not answered."""


class SealRefusal(Enum):
    """Why a frame was not opened: a word for the statistics."""

    UNSEALED = "unsealed"
    """It is no sealed frame."""
    FORGED = "forged"
    """No key of the fleet made its tag; or its receiver is out of step."""
    OUT_OF_STEP = "out_of_step"
    """A short head of a node that has not sent a long one yet."""
    REPLAYED = "replayed"
    """It was opened before, or is too far behind."""
    FORMER_LIFE = "former_life"
    """Authentic, but of a life of its source that is over."""
    CLONE = "clone"
    """Authentic and of this node's address, but another computer sent it."""
    FORBIDDEN = "forbidden"
    """Authentic, but its source may not send such a record or command."""
    COSTLY = "costly"
    """Authentic, but its source makes this node transmit more than its reply budget."""


class Inside(msgspec.Struct, frozen=True, kw_only=True):
    """The contents of a sealed frame."""

    records: bytes
    digest: bytes
    """Digest of the sender's table; `NO_TABLE`: the records need no table."""
    life: int
    """Life of the sender."""
    strong: bool


class _Sending:
    """Counters of one way from this node."""

    __slots__ = ("counter", "generation", "is_above_mark", "long_at", "since_long")

    def __init__(self) -> None:
        self.counter = 0
        self.generation = 0
        """Generation of the last long head."""
        self.since_long = 0
        self.long_at: int | None = None
        self.is_above_mark = False
        """Whether the next frame is above any mark of its receiver."""


class Seal:
    """Seals the frames of one node, and opens those for it.

    Args:
        address: This node, 1…254.
        life: Of this start; no other start has the same.
        cipher: Has the keys.
        journal: Stores the windows.
        stored: What earlier lives stored there.
        announced: Returns the digest of a node's table as announced by it; empty: none yet.
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
        self.wrap_key, self.take_key = cipher.wrap_key, cipher.take_key
        self._journal = journal
        self._sending: dict[Way, _Sending] = {}
        self._windows: dict[Way, Window] = {}
        self._given: dict[Way, Mark] = {}
        """Marks that the journal has got,"""
        self._given_at: dict[Way, int] = {}
        self._safe: dict[Way, Mark] = {}
        """and those of them that it has written."""
        self._heard_lives: dict[int, int] = {}
        """The life of each other node as it was heard last."""
        self._floors: dict[int, int] = {}
        """The newest start of each source."""
        self._recover(stored)

    # Outgoing

    @property
    def may_seal(self) -> bool:
        """A frame can be sealed: lives are not used up, and no other computer has this one's."""
        return not self.failure

    @property
    def failure(self) -> str:
        """Why nothing can be sealed, one line; empty: it can."""
        if self.is_cloned:
            return "another computer has the key and the address of this node"
        if self._life > LAST_LIFE:
            return "this node has no life in which it may seal frames"
        return ""

    @property
    def is_exhausted(self) -> bool:
        """A counter has reached its end: only another life can seal."""
        return any(each.counter > LAST_COUNTER for each in self._sending.values())

    def begin(self, life: int) -> None:
        """Begin another life; counters start anew."""
        self._life = life
        self._sending.clear()

    def reintroduce(self, address: int, *, to_all: bool = True) -> None:
        """Use a long head in the next frame to a node, which may know nothing of this one.

        Args:
            address: The node.
            to_all: In the next frame to all as well.
        """
        for way, sending in self._sending.items():
            if way.destination == address or (to_all and way.destination == BROADCAST):
                sending.long_at = None

    def life_began(self, address: int, life: int, now: int) -> None:
        """Make the next frames readable for a node in a new life: it knows marks at most.

        Args:
            address: The node.
            life: Its life.
            now: The instant.
        """
        if self._heard_lives.get(address, life) != life:
            self.pass_mark(address)
            self.pass_mark(BROADCAST)
        self._heard_lives[address] = life
        self.reintroduce(address)

    def pass_mark(self, address: int) -> None:
        """Go on above the mark of a node that may have restarted: it refuses what is below.

        Args:
            address: The node, or `BROADCAST`.
        """
        for way, sending in self._sending.items():
            if way.destination == address and not sending.is_above_mark:
                sending.counter = min(sending.counter + AHEAD, LAST_COUNTER)
                sending.is_above_mark = True
                sending.long_at = None

    def needs_long(
        self, destination: int, now: int, *, port: int = 0, long_heads: LongHeads = USUAL
    ) -> bool:
        """Return whether the next frame needs a long head, whatever its contents.

        Args:
            destination: 1…254, or 255.
            now: The instant.
            port: The link or route.
            long_heads: How far apart they may be.
        """
        return self._needs_long(Way(self._address, destination, port), now, long_heads)

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
        long_heads: LongHeads = USUAL,
    ) -> bytes:
        """Make a sealed frame; it uses up its counter, even if the frame is never transmitted.

        Args:
            records: What to seal.
            destination: 1…254, or 255.
            digest: Of this node's table, or `NO_TABLE`.
            now: The instant.
            port: The link or route.
            strong: With the long tag.
            long: With the long head.
            long_heads: How far apart long heads may be.

        Raises:
            OverflowError: The seal `is_exhausted`.
        """
        way = Way(self._address, destination, port, strong)
        is_long = strong or long or self._needs_long(way, now, long_heads)
        sending = self._sending.setdefault(way, _Sending())
        counter = sending.counter
        if counter > LAST_COUNTER:
            raise OverflowError(f"{counter} frames were sealed for {destination} in one life")
        sending.counter += 1
        sending.is_above_mark = False
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
    ) -> SealRefusal | None:
        """Open a frame for this node.

        Args:
            frame: What arrived.
            way: Source, destination and port, from the link or the envelope; a wrong way opens
                nothing. The frame itself tells whether it is strong.
            own_digest: Of this node's table.
            now: The instant.
            then: Takes the records and the instant once no later life of this node can open them
                again: during this call, or when the journal has written.

        Returns:
            Why it was not opened; None: it was.
        """
        sealed = parse_sealed(frame)
        if sealed is None:
            return SealRefusal.UNSEALED
        way = msgspec.structs.replace(way, strong=is_strong(sealed.head))
        window = self._windows.get(way) or Window()
        floor = self._floors.get(way.source, -1)
        refusal = SealRefusal.OUT_OF_STEP
        generation = self._cipher.generation
        generation -= (generation ^ sealed.head.generation) & 1  # this one, or the previous one
        for start, counter in window.candidates(sealed.head, generation, floor):
            number = nonce(way, life_of(start), counter)
            opened = self._try(sealed, way, number, life_of(start), own_digest)
            if opened is None:
                refusal = SealRefusal.FORGED
                continue
            if start < floor:
                return SealRefusal.FORMER_LIFE
            if not window.is_new(start, counter):
                return SealRefusal.REPLAYED
            window.note(start, counter)
            self._windows[way] = window
            self._floors[way.source] = start
            self._keep(way, window, partial(then, opened), now)
            return None
        return refusal

    def overhear_own(self, frame: bytes, way: Way, own_digest: bytes) -> SealRefusal | None:
        """Examine a frame of this node's own address: an echo, a forgery, or a clone's frame.

        Args:
            frame: What arrived.
            way: Its source, destination and port.
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
        return SealRefusal.CLONE

    # Below the methods above

    def _needs_long(self, way: Way, now: int, long_heads: LongHeads) -> bool:
        sending = self._sending.get(way)
        if sending is None or sending.long_at is None or sending.since_long >= long_heads.every - 1:
            return True
        is_other_key = sending.generation != self._cipher.generation
        return is_other_key or now - sending.long_at >= long_heads.every_ns

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
        """Write the mark of a window as its kind needs, and call `then` when that is safe."""
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
            # A mark that covers it is being written: write the same again behind it.
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
