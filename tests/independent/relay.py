"""Sections 16 and 17: frames of routes, floods and bonds. Written from docs/wire.md alone."""

from dataclasses import dataclass

from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError

RELAY = 0xBF
ANSWER = 0xFF
_LEN = 0xB2
_MOST_ANSWERS, _MOST_PROBES = 16, 32
_BACK, _MORE, _URGENT, _ROUTE = 0x80, 0x40, 0x20, 0x1F


@dataclass(frozen=True)
class Relayed:
    """A frame of a route on one hop. `back`: towards the first node of the path."""

    route: int
    number: int
    age: int
    frame: bytes
    back: bool = False
    more: bool = False
    urgent: bool = False

    def write(self) -> bytes:
        flags = _BACK * self.back | _MORE * self.more | _URGENT * self.urgent
        return bytes((RELAY, flags | self.route, self.number, self.age)) + self.frame


@dataclass(frozen=True)
class HopMark:
    """One frame that a node has: its route, its direction and its number."""

    route: int
    number: int
    back: bool = False


@dataclass(frozen=True)
class HopAcknowledgement:
    """What a node has and will not transmit again."""

    marks: tuple[HopMark, ...]
    more: bool = False

    def write(self) -> bytes:
        marks = (bytes((_BACK * one.back | one.route, one.number)) for one in self.marks)
        return bytes((RELAY, _MORE * self.more)) + b"".join(marks)


@dataclass(frozen=True)
class Flooded:
    """A frame that every node passes on. `left`: how many further nodes may."""

    origin: int
    destination: int
    number: int
    left: int
    age: int
    frame: bytes

    def write(self) -> bytes:
        head = (RELAY, _BACK | self.left << 5, self.origin, self.destination)
        return bytes((*head, self.number, self.age)) + self.frame


@dataclass(frozen=True)
class Probe:
    """A frame that whoever hears it counts."""

    run: int
    number: int

    def write(self) -> bytes:
        return bytes((RELAY, _URGENT, self.run, self.number))


@dataclass(frozen=True)
class Bonded:
    """A frame of a bond by one of its links; without a frame inside a question."""

    bond: int
    number: int
    frame: bytes = b""
    answered: bool = False
    age: int | None = None

    def write(self) -> bytes:
        age = b"" if self.age is None else bytes((self.age,))
        return bytes((RELAY, _MORE * self.answered | self.bond, self.number)) + age + self.frame


@dataclass(frozen=True)
class Answer:
    """Which frames have come, by which links of the list: the body of an extension."""

    arrived: tuple[tuple[int, int], ...]

    def write(self) -> bytes:
        body = bytes(each for pair in self.arrived for each in pair)
        return bytes((_LEN, len(body) + 1, ANSWER)) + body


def read_bonded(records: bytes) -> Bonded:
    """Read a whole frame of a bond."""
    cursor = Cursor(records)
    relay, first, number = cursor.take(3)
    answered = bool(first & _MORE)
    age = cursor.number(1) if cursor.left else None
    frame = cursor.rest()
    if relay != RELAY or first & ~(_MORE | _ROUTE) or not first & _ROUTE:
        raise ReadError("no frame of a bond")
    if not frame and (age is not None or not answered):
        raise ReadError("neither frame nor question")
    return Bonded(first & _ROUTE, number, frame, answered, age)


def read_answer(body: bytes) -> Answer:
    """Read the body of the extension with the code `ANSWER`, in a frame of a bond."""
    if len(body) % 2 or not 1 <= len(body) // 2 <= _MOST_ANSWERS:
        raise ReadError("no answer")
    return Answer(tuple(zip(body[::2], body[1::2], strict=True)))


def read(records: bytes) -> Relayed | HopAcknowledgement | Flooded | Probe:
    """Read a whole frame of a route or flood, or a probe."""
    cursor = Cursor(records)
    if cursor.number(1) != RELAY:
        raise ReadError("no RELAY")
    first = cursor.number(1)
    route = first & _ROUTE
    more = bool(first & _MORE)
    if route:
        number, age = cursor.take(2)
        back, urgent = bool(first & _BACK), bool(first & _URGENT)
        if not cursor.left:
            raise ReadError("no frame inside")
        return Relayed(route, number, age, cursor.rest(), back, more, urgent)
    if first & _BACK:
        origin, destination, number, age = cursor.take(4)
        if origin in (0, 255) or destination in (0, origin) or not cursor.left:
            raise ReadError("of nobody, for nobody, or empty")
        return Flooded(origin, destination, number, first >> 5 & 3, age, cursor.rest())
    if first == _URGENT:
        run, number = cursor.take(2)
        cursor.end()
        if number >= _MOST_PROBES:
            raise ReadError("more probes than a run has")
        return Probe(run, number)
    if first & ~_MORE or not cursor.left:
        raise ReadError("no hop acknowledgement")
    marks: list[HopMark] = []
    while cursor.left:
        head, number = cursor.take(2)
        if head & ~(_BACK | _ROUTE) or not head & _ROUTE:
            raise ReadError("no route")
        marks.append(HopMark(head & _ROUTE, number, bool(head & _BACK)))
    return HopAcknowledgement(tuple(marks), more)
