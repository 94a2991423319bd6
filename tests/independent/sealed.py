"""Section 15: sealed frames. Written from docs/wire.md alone."""

import hashlib
import hmac
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from tests.independent.errors import ReadError

LAST_LIFE = 0xF7FF
NO_TABLE = bytes(4)
_LONG, _GENERATION, _STRONG = 0x80, 0x40, 0x20
_DERIVATION = 2
_STRONG_PORT = 128


@dataclass(frozen=True)
class FleetKey:
    """The key of a fleet."""

    network: str
    generation: int
    secret: bytes

    @classmethod
    def of_plain(cls, plain: Mapping[str, Any]) -> "FleetKey":
        """Read a key as the vectors spell it."""
        return cls(plain["network"], plain["generation"], bytes.fromhex(plain["secret"]))

    def of(self, source: int) -> bytes:
        """Return the key of a source."""
        name = self.network.encode()
        info = (
            b"zacoustic frame\0"
            + bytes((len(name),))
            + name
            + bytes((_DERIVATION,))
            + self.generation.to_bytes(4, "big")
            + bytes((source,))
        )
        return hmac.digest(self.secret, info + b"\x01", hashlib.sha256)[:16]


@dataclass(frozen=True)
class Head:
    """The head of a sealed frame. A short one has no life, and six bits of the counter."""

    generation: int
    strong: bool
    life: int | None
    counter: int

    @property
    def tag_size(self) -> int:
        return 8 if self.strong else 4

    def write(self) -> bytes:
        if self.life is None:
            return bytes((_GENERATION * self.generation | self.counter & 63,))
        number = self.life << 21 | self.counter
        flags = _LONG | _GENERATION * self.generation | _STRONG * self.strong
        return bytes((flags | number >> 32,)) + (number & 0xFFFFFFFF).to_bytes(4, "big")


@dataclass(frozen=True)
class Way:
    """Between whom a frame goes, by which port: the number of the link, or 96 and the route."""

    source: int
    destination: int
    port: int


def read_head(frame: bytes) -> tuple[Head, int]:
    """Return the head of a sealed frame, and its length."""
    if not frame:
        raise ReadError("no head")
    first = frame[0]
    generation = first >> 6 & 1
    if not first & _LONG:
        return Head(generation, False, None, first & 63), 1
    if len(frame) < 5:
        raise ReadError("no long head")
    number = (first & 31) << 32 | int.from_bytes(frame[1:5], "big")
    life = number >> 21
    if life > LAST_LIFE:
        raise ReadError("no such life")
    return Head(generation, bool(first & _STRONG), life, number & (1 << 21) - 1), 5


def open_frame(
    frame: bytes,
    way: Way,
    key: FleetKey,
    *,
    life: int,
    counter: int,
    digest: bytes,
    encrypted: bool = True,
) -> bytes:
    """Return the records of a sealed frame, if its tag is right for this life and counter."""
    head, size = read_head(frame)
    if head.generation != key.generation & 1:
        raise ReadError("another generation")
    body = frame[size:]
    if len(body) < head.tag_size:
        raise ReadError("no tag")
    cipher = AESCCM(key.of(way.source), tag_length=head.tag_size)
    known = frame[:size] + bytes((way.source, way.destination)) + digest
    nonce = _nonce(way, life, counter, strong=head.strong)
    try:
        if encrypted:
            return cipher.decrypt(nonce, body, known)
        records = body[: -head.tag_size]
        associated = bytes((len(known),)) + known + records
        cipher.decrypt(nonce, body[-head.tag_size :], associated)
    except InvalidTag as error:
        raise ReadError("the tag is wrong") from error
    return records


def seal(
    records: bytes,
    way: Way,
    key: FleetKey,
    head: Head,
    *,
    life: int,
    counter: int,
    digest: bytes,
    encrypted: bool = True,
) -> bytes:
    """Return a sealed frame."""
    cipher = AESCCM(key.of(way.source), tag_length=head.tag_size)
    front = head.write()
    known = front + bytes((way.source, way.destination)) + digest
    nonce = _nonce(way, life, counter, strong=head.strong)
    if encrypted:
        return front + cipher.encrypt(nonce, records, known)
    associated = bytes((len(known),)) + known + records
    return front + records + cipher.encrypt(nonce, b"", associated)


def _nonce(way: Way, life: int, counter: int, *, strong: bool) -> bytes:
    port = way.port + _STRONG_PORT * strong
    front = bytes((way.source, way.destination, port))
    return front + life.to_bytes(2, "big") + counter.to_bytes(3, "big") + bytes(5)


class Window:
    """The counters that a receiver has opened, for one source, destination, port and strength."""

    SIZE = 64
    BACK = 15

    def __init__(self) -> None:
        self.highest: int | None = None
        self._opened: set[int] = set()

    def candidates(self, low: int) -> tuple[int, int]:
        """Return the two counters that six bits may stand for."""
        start = 0 if self.highest is None else max(0, self.highest - self.BACK)
        first = start + (low - start) % 64
        return first, first + 64

    def take(self, counter: int) -> None:
        """Take a counter, or refuse one that was opened before or is too far behind."""
        if self.highest is not None and counter <= self.highest - self.SIZE:
            raise ReadError("too far behind")
        if counter in self._opened:
            raise ReadError("opened before")
        self._opened.add(counter)
        self.highest = max(counter, self.highest or 0)
        self._opened = {one for one in self._opened if one > self.highest - self.SIZE}


@dataclass(frozen=True)
class Opening:
    """A sealed frame that a receiver has opened. `digest`: what it was opened with."""

    records: bytes
    life: int
    counter: int
    strong: bool
    digest: bytes


@dataclass
class _Source:
    """What a receiver knows of a source."""

    life: int | None = None
    digest: bytes = NO_TABLE
    windows: dict[tuple[int, int, bool], Window] = field(default_factory=dict)


class Receiver:
    """Opens what is for a node and for all, each frame once, in the mode *encrypt*."""

    def __init__(self, node: int, key: FleetKey, digest: bytes) -> None:
        self._node = node
        self._key = key
        self._digest = digest
        self._sources: dict[int, _Source] = {}

    def announced(self, source: int, digest: bytes) -> None:
        """Take the digest of a HELLO of a source."""
        self._sources.setdefault(source, _Source()).digest = digest

    def open(self, frame: bytes, source: int, destination: int, port: int = 0) -> Opening:
        """Open a frame, or refuse it."""
        if destination not in (self._node, 255):
            raise ReadError("for another node")
        head, _ = read_head(frame)
        known = self._sources.setdefault(source, _Source())
        life = known.life if head.life is None else head.life
        if life is None:
            raise ReadError("no long head was heard")
        if known.life is not None and life < known.life:
            raise ReadError("a former life")
        place = (destination, port, head.strong)
        window = known.windows.get(place, Window()) if life == known.life else Window()
        counters = (head.counter,) if head.life is not None else window.candidates(head.counter)
        opening = self._try(frame, Way(source, destination, port), head, life, counters, known)
        window.take(opening.counter)
        if life != known.life:
            known.life = life
            known.windows.clear()
        known.windows[place] = window
        return opening

    def _try(
        self,
        frame: bytes,
        way: Way,
        head: Head,
        life: int,
        counters: tuple[int, ...],
        known: _Source,
    ) -> Opening:
        digests = dict.fromkeys((self._digest, known.digest, NO_TABLE))
        for counter in counters:
            for digest in digests:
                try:
                    records = open_frame(
                        frame, way, self._key, life=life, counter=counter, digest=digest
                    )
                except ReadError:
                    continue
                return Opening(records, life, counter, head.strong, digest)
        raise ReadError("no counter and no digest fits the tag")
