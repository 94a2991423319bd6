"""The seal of a frame: a head in front, a tag behind, and what both are computed over.

A stranger in range hears every frame and can transmit any other. Where a fleet has a key, its
frames are encrypted and carry a tag that only its members can make (AES-128-CCM, RFC 3610); the tag
takes the place of the CRC. What a cipher needs is a *nonce*, a number that no two frames under one
key share, and what is expensive here is to tell it. So it is counted, and mostly not sent::

    short   0 g c5…c0                          counter, its lowest six bits
    long    1 g s l15…l11  l10…l3  l2…l0 c20…c16  c15…c8  c7…c0

    g       the generation of the key, its lowest bit
    s       the frame is strong: its tag has 8 bytes in place of 4
    l, c    life of the sender (16 bits) and counter (21 bits)

A *life* is a start of the sender, and of lives that end early there are enough: only the life has
to survive a power cut. Counters begin at 0 in each life, one for each destination, each port and
each strength, so a receiver sees no gaps for frames that were not for it. Lives above `LAST_LIFE`
are not used: no sealed frame begins with `NEVER_FIRST`.

The nonce is ``source 1 | destination 1 | port 1, strong in its highest bit | life 2 | counter 3``
and five zero bytes. Associated data, which the tag covers but nobody encrypts, are
``head | source | destination | digest``: the digest of the sender's table, or zeros in a frame that
is to be read without one. So a frame that opens under a digest says which table its sender has, and
no byte of it goes over the channel.
"""

from typing import Final, Protocol

import msgspec

LAST_LIFE: Final = 0xF7FF
LAST_PORT: Final = 127
LAST_COUNTER: Final = (1 << 21) - 1
NEVER_FIRST: Final = 0xBF
SHORT_HEAD_BYTES: Final = 1
LONG_HEAD_BYTES: Final = 5
TAG_BYTES: Final = 4
STRONG_TAG_BYTES: Final = 8
DIGEST_BYTES: Final = 4
LEAST_ROOM_BYTES: Final = LONG_HEAD_BYTES + STRONG_TAG_BYTES + 4
"""A link that cannot take sealed frames of so many bytes carries neither HELLO nor command."""
NO_TABLE: Final = bytes(DIGEST_BYTES)
"""Stands for the digest in a frame that needs no table."""

_LONG: Final = 0x80
_GENERATION: Final = 0x40
_STRONG: Final = 0x20
_LOW_BITS: Final = 6
LOW_COUNTERS: Final = 1 << _LOW_BITS
"""A short head tells a counter modulo this."""
_COUNTER_BITS: Final = 21
_NONCE_BYTES: Final = 13
_STRONG_PORT: Final = 0x80


class ShortHead(msgspec.Struct, frozen=True):
    """The head of a frame whose receivers know the life and follow the counter."""

    generation: int
    """Of the key, modulo 2."""
    low: int
    """Counter modulo 64."""

    def encode(self) -> bytes:
        """Return the byte."""
        return bytes(((self.generation & 1) << 6 | self.low,))


class LongHead(msgspec.Struct, frozen=True):
    """The head that brings a receiver into step."""

    generation: int
    """Of the key, modulo 2."""
    life: int
    """0…`LAST_LIFE`."""
    counter: int
    """0…`LAST_COUNTER`."""
    strong: bool = False
    """The tag has eight bytes."""

    def encode(self) -> bytes:
        """Return the five bytes.

        Raises:
            ValueError: Life or counter is out of range.
        """
        if not 0 <= self.life <= LAST_LIFE or not 0 <= self.counter <= LAST_COUNTER:
            raise ValueError(f"life {self.life}, counter {self.counter}: out of range")
        number = self.life << _COUNTER_BITS | self.counter
        flags = _LONG | (self.generation & 1) << 6 | (_STRONG if self.strong else 0)
        return bytes((flags | number >> 32,)) + (number & 0xFFFF_FFFF).to_bytes(4, "big")


class SealedFrame(msgspec.Struct, frozen=True):
    """A sealed frame, taken apart and not yet opened."""

    head: ShortHead | LongHead
    head_bytes: bytes
    body: bytes
    """Encrypted records, and the tag."""

    @property
    def tag_bytes(self) -> int:
        """Length of the tag."""
        return STRONG_TAG_BYTES if is_strong(self.head) else TAG_BYTES


def is_strong(head: ShortHead | LongHead) -> bool:
    """Tell whether a frame has the long tag."""
    return isinstance(head, LongHead) and head.strong


def parse_sealed(frame: bytes) -> SealedFrame | None:
    """Take a frame apart; None: it is too short, or no sealed frame."""
    if not frame or frame[0] == NEVER_FIRST:
        return None
    first = frame[0]
    generation = (first & _GENERATION) >> 6
    head: ShortHead | LongHead
    if not first & _LONG:
        head, size_bytes = ShortHead(generation, first & (LOW_COUNTERS - 1)), SHORT_HEAD_BYTES
    else:
        if len(frame) < LONG_HEAD_BYTES:
            return None
        number = (first & 0x1F) << 32 | int.from_bytes(frame[1:LONG_HEAD_BYTES], "big")
        life, counter = number >> _COUNTER_BITS, number & LAST_COUNTER
        if life > LAST_LIFE:
            return None
        head = LongHead(generation, life, counter, strong=bool(first & _STRONG))
        size_bytes = LONG_HEAD_BYTES
    sealed = SealedFrame(head, frame[:size_bytes], frame[size_bytes:])
    return sealed if len(sealed.body) >= sealed.tag_bytes else None


class Way(msgspec.Struct, frozen=True):
    """What has counters of its own: frames of one strength from a source to a destination."""

    source: int
    """1…254."""
    destination: int
    """1…254, or 255 for all."""
    port: int = 0
    """A link or a route between them, 0…127; the same number at both ends."""
    strong: bool = False


def nonce(way: Way, life: int, counter: int) -> bytes:
    """Return the nonce of a frame, 13 bytes: the same for no two frames of one source."""
    place = way.port | (_STRONG_PORT if way.strong else 0)
    named = bytes((way.source, way.destination, place))
    numbered = named + life.to_bytes(2, "big") + counter.to_bytes(3, "big")
    return numbered + bytes(_NONCE_BYTES - len(numbered))


def associated_data(head: bytes, way: Way, digest: bytes) -> bytes:
    """Return what a tag covers beside the records."""
    return head + bytes((way.source, way.destination)) + digest


class Cipher(Protocol):
    """AES-128-CCM with the keys of a fleet: the core imports no cryptography."""

    @property
    def generation(self) -> int:
        """The generation of the key that frames of this node are sealed with."""

    def seal(self, way: Way, nonce: bytes, records: bytes, associated: bytes) -> bytes:
        """Return the encrypted records and the tag.

        Args:
            way: Chooses key and length of the tag.
            nonce: 13 bytes that were never used with this key.
            records: What to encrypt.
            associated: What the tag covers, too.
        """

    def open(
        self, generation: int, way: Way, nonce: bytes, body: bytes, associated: bytes
    ) -> bytes | None:
        """Return the records; None where no known key of this generation made the tag.

        Args:
            generation: Modulo 2.
            way: Chooses the key.
            nonce: 13 bytes.
            body: Encrypted records, and the tag.
            associated: What the tag covers, too.
        """

    def wrap_key(self, source: int, node: int) -> bytes:
        """Return the secret of a source's broadcasts, wrapped for one node.

        Raises:
            LocalError: Nodes have no keys of their own, or this one does not open them.
        """

    def take_key(self, source: int, sender: int, wrapped: bytes) -> None:
        """Store the secret of a source's broadcasts that another node has wrapped for this one.

        Raises:
            LocalError: It is not from that node, not wanted, or cannot be stored.
        """
