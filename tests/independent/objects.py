"""Section 9: FRAGMENT, FEEDBACK, manifests, erasure code. Written from docs/wire.md alone."""

import hashlib
from dataclasses import dataclass, field

from tests.independent import encodings
from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

FRAGMENT, FEEDBACK = 0xBA, 0xBB
NO_FRAGMENT = 0xFFFF
BLOCK = 255
MOST_SOURCES = 32000
_MOST_LENGTH_BYTES = 4
_POLYNOMIAL = 0x11D
LACKS, COMPLETE, REFUSED, HEADLESS = range(4)
REASONS = {1: "cancelled", 2: "too large", 3: "not subscribed", 4: "former"}


@dataclass(frozen=True)
class Fragment:
    """A fragment of an object, its withdrawal, or its turn."""

    number: int
    hint: int
    index: int
    data: bytes

    @property
    def withdraws(self) -> bool:
        return self.index == NO_FRAGMENT and not self.data

    @property
    def is_turn(self) -> bool:
        return self.index == NO_FRAGMENT and bool(self.data)

    def write(self) -> bytes:
        front = bytes((FRAGMENT, self.hint << 6 | self.number))
        return front + self.index.to_bytes(2, "big") + self.data


@dataclass(frozen=True)
class Feedback:
    """A receiver's report. What it does not say is empty."""

    number: int
    kind: int
    block: int = 0
    missing: tuple[int, ...] = ()
    digest: bytes = b""
    reason: int = 0
    held: int = 0

    @property
    def waits(self) -> bool:
        """Tell whether all is there, if `block` is the one behind the last."""
        return self.kind == LACKS and self.missing == (0,)

    def write(self) -> bytes:
        front = bytes((FEEDBACK, self.kind << 6 | self.number))
        if self.kind == LACKS:
            return front + bytes((self.block, len(self.missing), *self.missing))
        if self.kind == COMPLETE:
            return front + self.digest
        if self.kind == REFUSED:
            return front + bytes((self.reason,))
        return front + self.held.to_bytes(2, "big")


def read_fragment(cursor: Cursor) -> Fragment:
    """Take the body of FRAGMENT, to the end."""
    transfer, index = cursor.number(1), cursor.number(2)
    data = cursor.rest()
    if index == NO_FRAGMENT and len(data) not in (0, 4):
        raise ReadError("neither a withdrawal nor a turn")
    if index != NO_FRAGMENT and not data:
        raise ReadError("a fragment without data")
    return Fragment(transfer & 63, transfer >> 6, index, data)


def read_feedback(cursor: Cursor) -> Feedback:
    """Take the body of FEEDBACK."""
    transfer = cursor.number(1)
    number, kind = transfer & 63, transfer >> 6
    if kind == LACKS:
        block, count = cursor.take(2)
        if not 1 <= count <= 4:
            raise ReadError("1…4 blocks lack something")
        return Feedback(number, kind, block=block, missing=tuple(cursor.take(count)))
    if kind == COMPLETE:
        return Feedback(number, kind, digest=cursor.take(4))
    if kind == REFUSED:
        return Feedback(number, kind, reason=cursor.number(1))
    return Feedback(number, kind, held=cursor.number(2))


@dataclass(frozen=True)
class Manifest:
    """What stands before the payload of an object."""

    stream: int
    lineage: int
    number: int
    instance: bytes
    encoding: str | None
    length: int
    digest: bytes
    size: int
    aged: bool = False

    @property
    def whole(self) -> int:
        """The bytes of the object."""
        return self.size + self.length


def read_manifest(data: bytes) -> Manifest:
    """Read the manifest at the beginning of an object."""
    cursor = Cursor(data)
    stream, flags = cursor.take(2)
    aged = bool(flags & 0x40)
    if aged:
        cursor.take(1)
    lineage, number = cursor.number(2), cursor.number(3)
    instance = cursor.take(flags & 0x3F)
    encoding = encodings.read(cursor) if flags & 0x80 else None
    length = _read_length(cursor)
    digest = cursor.take(8)
    return Manifest(
        stream, lineage, number, instance, encoding, length, digest, cursor.position, aged
    )


def age_of(fragment: Fragment) -> int | None:
    """Return the code of the age in the first fragment of an object."""
    data = fragment.data
    if fragment.index or len(data) < 3 or not data[1] & 0x40:
        return None
    return data[2]


def make_object(
    stream: int,
    lineage: int,
    number: int,
    instance: bytes,
    encoding: str | None,
    payload: bytes,
    *,
    aged: bool = False,
) -> bytes:
    """Return the bytes of an object, its age unknown."""
    flags = len(instance) | 0x80 * (encoding is not None) | 0x40 * aged
    front = (
        bytes((stream, flags))
        + b"\xff" * aged
        + lineage.to_bytes(2, "big")
        + number.to_bytes(3, "big")
    )
    front += instance
    if encoding is not None:
        front += encodings.write(encoding)
    front += _length(len(payload))
    return front + _digest(front, payload) + payload


def payload_of(whole: bytes) -> tuple[Manifest, bytes]:
    """Return manifest and payload of an object whose digest is right."""
    manifest = read_manifest(whole)
    if len(whole) < manifest.whole:
        raise ReadError("the object is not whole")
    payload = whole[manifest.size : manifest.whole]
    if any(whole[manifest.whole :]):
        raise ReadError("the last fragment is filled with zeros")
    if _digest(whole[: manifest.size - 8], payload) != manifest.digest:
        raise ReadError("digest of the object")
    return manifest, payload


def _digest(front: bytes, payload: bytes) -> bytes:
    return hashlib.sha256(front + payload).digest()[:8]


def _length(value: int) -> bytes:
    out = bytearray()
    while value > 127:
        out.append(0x80 | value & 127)
        value >>= 7
    out.append(value)
    return bytes(out)


def _read_length(cursor: Cursor) -> int:
    value = 0
    for place in range(_MOST_LENGTH_BYTES):
        byte = cursor.take(1)[0]
        value |= (byte & 127) << (7 * place)
        if not byte & 0x80:
            return value
    raise ReadError("a length has at most four bytes")


@dataclass(frozen=True)
class Layout:
    """How the source fragments of an object form blocks."""

    sources: int

    def __post_init__(self) -> None:
        if not 1 <= self.sources <= MOST_SOURCES:
            raise ReadError("1…32000 source fragments")

    @property
    def blocks(self) -> int:
        return -(-self.sources // BLOCK)

    def block_size(self, block: int) -> int:
        return self.sources // self.blocks + (block < self.sources % self.blocks)

    def first(self, block: int) -> int:
        """Return the index of the block's first source fragment."""
        return self.sources // self.blocks * block + min(block, self.sources % self.blocks)

    def place(self, index: int) -> tuple[int, int | None, int]:
        """Return the block of a fragment, its place in it or None, and its seed."""
        if index < self.sources:
            for block in range(self.blocks):
                place = index - self.first(block)
                if place < self.block_size(block):
                    return block, place, 0
        seed, block = divmod(index - self.sources, self.blocks)
        return block, None, seed

    def repair_index(self, block: int, seed: int) -> int:
        return self.sources + seed * self.blocks + block


def _tables() -> tuple[list[int], list[int]]:
    powers, logs = [0] * 512, [0] * 256
    value = 1
    for exponent in range(255):
        powers[exponent] = powers[exponent + 255] = value
        logs[value] = exponent
        value <<= 1
        if value & 0x100:
            value ^= _POLYNOMIAL
    return powers, logs


_POWERS, _LOGS = _tables()


def times(left: int, right: int) -> int:
    """Multiply in GF(256)."""
    return _POWERS[_LOGS[left] + _LOGS[right]] if left and right else 0


def _scaled(data: bytes, factor: int) -> bytes:
    return data.translate(bytes(times(byte, factor) for byte in range(256)))


def _added(left: bytes, right: bytes) -> bytes:
    total = int.from_bytes(left, "big") ^ int.from_bytes(right, "big")
    return total.to_bytes(len(left), "big")


def coefficients(block: int, seed: int, count: int) -> bytes:
    """Return the coefficients of a repair fragment."""
    return hashlib.shake_128(bytes((block,)) + seed.to_bytes(2, "big")).digest(count)


def repair(block: int, seed: int, sources: list[bytes]) -> bytes:
    """Return a repair fragment of a block of source fragments."""
    total = bytes(len(sources[0]))
    for data, factor in zip(sources, coefficients(block, seed, len(sources)), strict=True):
        total = _added(total, _scaled(data, factor))
    return total


def cut(whole: bytes, size: int) -> list[bytes]:
    """Cut an object into source fragments, the last one filled up with zeros."""
    return [whole[start : start + size].ljust(size, b"\0") for start in range(0, len(whole), size)]


@dataclass
class Assembly:
    """The fragments of one object that have come."""

    size: int
    _held: dict[int, bytes] = field(default_factory=dict)

    def take(self, fragment: Fragment) -> None:
        if fragment.index == NO_FRAGMENT or len(fragment.data) != self.size:
            raise ReadError("no fragment of this object")
        data = fragment.data
        if age_of(fragment) is not None:  # it counts as unknown
            data = data[:2] + b"\xff" + data[3:]
        self._held[fragment.index] = data

    def whole(self, sources: int) -> bytes:
        """Return the object, or refuse if fragments are missing."""
        layout = Layout(sources)
        return b"".join(b"".join(self._block(layout, block)) for block in range(layout.blocks))

    def _block(self, layout: Layout, block: int) -> list[bytes]:
        size = layout.block_size(block)
        rows: list[tuple[bytearray, bytes]] = []
        for index, data in sorted(self._held.items()):
            where, place, seed = layout.place(index)
            if where != block:
                continue
            if place is None:
                row = bytearray(coefficients(block, seed, size))
            else:
                row = bytearray(size)
                row[place] = 1
            rows.append((row, data))
        return _solve(rows, size)


def _solve(rows: list[tuple[bytearray, bytes]], size: int) -> list[bytes]:
    """Solve the equations of a block."""
    solved: list[tuple[bytearray, bytes]] = []
    for column in range(size):
        pivot = next((row for row in rows if row[0][column]), None)
        if pivot is None:
            raise ReadError("too few fragments")
        rows.remove(pivot)
        inverse = _POWERS[255 - _LOGS[pivot[0][column]]]
        unit = (bytearray(_scaled(bytes(pivot[0]), inverse)), _scaled(pivot[1], inverse))
        rows = [_without(row, unit, column) for row in rows]
        solved = [_without(row, unit, column) for row in solved]
        solved.append(unit)
    return [data for _, data in solved]


def _without(
    row: tuple[bytearray, bytes], unit: tuple[bytearray, bytes], column: int
) -> tuple[bytearray, bytes]:
    factor = row[0][column]
    if not factor:
        return row
    left = bytearray(_added(bytes(row[0]), _scaled(bytes(unit[0]), factor)))
    return left, _added(row[1], _scaled(unit[1], factor))
