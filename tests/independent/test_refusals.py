"""Random bytes, and vectors with random damage: nothing is raised but ReadError."""

import json
import random
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.independent import (
    agreement,
    cborpos,
    dense,
    encodings,
    envelope,
    fleet,
    frame,
    goals,
    objects,
    packed,
    record,
    relay,
    reliable,
    sealed,
    table,
)
from tests.independent.cursor import Cursor
from tests.independent.errors import ReadError
from tests.independent.record import Way

GOLDEN = Path(__file__).parent.parent / "golden"
CASES = 1500
WAYS = [Way(fleet.TABLE, 1, 2), Way(fleet.TABLE, 2, 1), Way(fleet.DENSE, 2, envelope.BROADCAST)]
KEY = sealed.FleetKey("harbour", 3, bytes(range(32)))
ODD = (
    table.Field("b", "bool", optional=True),
    table.Field("i", "int16", range=(-1000, 1000), step=10, escapes=True),
    table.Field("f", "float32", range=(0, 100), step=0.5, escapes=True),
    table.Field("d", "float64", range=(0, 1), wraps=True),
    table.Field("s", "string", max_length=5),
    table.Field("t", "string"),
    table.Field("o", "bytes"),
    table.Field("e", "enum", values=("a", "b", "c")),
    table.Field("n", "int64", step=5),
    table.Field("l", "float32", max_length=3),
)
TYPES: table.Types = {"Odd": (*ODD, table.Field("m", "Part", length=2)), "Part": ODD[:4]}


def _vectors() -> list[bytes]:
    native = json.loads((GOLDEN / "wire_native.json").read_text(encoding="utf-8"))
    closed = json.loads((GOLDEN / "wire_sealed.json").read_text(encoding="utf-8"))
    texts = [one["hex"] for one in native] + [one["frame"] for one in closed]
    return [bytes.fromhex(text) for text in texts]


def _damaged(data: bytes, chance: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(chance.randint(1, 3)):
        place = chance.randrange(len(out) + 1)
        way = chance.randrange(4)
        if way == 0 and place < len(out):
            out[place] = chance.randrange(256)
        elif way == 1:
            out[place:place] = chance.randbytes(chance.randint(1, 4))
        elif way == 2:
            del out[place : place + chance.randint(1, 4)]
        else:
            out = out[:place]
    return bytes(out)


def _survives(reading: Callable[[bytes], object], data: bytes) -> bool:
    """Read the bytes, and tell whether they were read; any other error fails the test."""
    try:
        reading(data)
    except ReadError:
        return False
    return True


def _open(data: bytes) -> object:
    way = sealed.Way(1, 2, 0)
    return sealed.open_frame(data, way, KEY, life=7, counter=0, digest=sealed.NO_TABLE)


def _object(data: bytes) -> object:
    assembly = objects.Assembly(len(data) // 2)
    for index in range(2):
        part = data[index * (len(data) // 2) : (index + 1) * (len(data) // 2)]
        assembly.take(objects.Fragment(1, 0, index, part))
    return objects.payload_of(assembly.whole(2))


READINGS: dict[str, Callable[[bytes], object]] = {
    "cbor": lambda data: cborpos.read(TYPES, "Odd", Cursor(data)),
    "packed": lambda data: packed.read(TYPES, "Odd", Cursor(data)),
    "packed bytes": packed.read_bytes,
    "encoding": lambda data: encodings.read(Cursor(data)),
    "manifest": objects.read_manifest,
    "object": _object,
    "holding": lambda data: reliable.read_holding(Cursor(data)),
    "goal": lambda data: goals.read_head(Cursor(data), from_server=True),
    "relay": relay.read,
    "seal": _open,
    "dense": dense.read_head,
    "record": lambda data: record.read(Cursor(data), WAYS[0]),
    "byte stream": lambda data: envelope.unwrap(data, envelope.Capabilities()),
    "cobs": envelope.uncobs,
}


def _total(whole: frame.Frame, data: bytes) -> None:
    """Check that a reader has given an account of the frame."""
    if data.strip(b"\0"):
        assert whole.agreement or whole.items
    assert whole.padding <= len(data)


@pytest.mark.parametrize("place", range(len(WAYS)))
def test_random_frames(place: int) -> None:
    chance = random.Random(place)
    for _ in range(CASES):
        data = chance.randbytes(chance.randrange(40))
        _total(frame.read(data, WAYS[place]), data)


@pytest.mark.parametrize("place", range(len(WAYS)))
def test_damaged_vectors(place: int) -> None:
    chance = random.Random(place)
    vectors = _vectors()
    for _ in range(CASES):
        data = _damaged(chance.choice(vectors), chance)
        _total(frame.read(data, WAYS[place]), data)


@pytest.mark.parametrize("name", READINGS)
def test_random_parts(name: str) -> None:
    chance = random.Random(name)
    for _ in range(CASES // 3):
        _survives(READINGS[name], chance.randbytes(chance.randrange(60)))


def test_what_was_read_can_be_written_and_read_again() -> None:
    """What a codec takes is in its one form, so it writes the same bytes."""
    chance = random.Random(1)
    taken = 0
    for codec in (cborpos, packed):
        for _ in range(3 * CASES):
            cursor = Cursor(chance.choice((b"\xf6", b"\x01", b"")) + chance.randbytes(40))
            types: table.Types = {"T": (chance.choice(ODD),)}
            try:
                value = codec.read(types, "T", cursor)
            except ReadError:
                continue
            taken += 1
            data = cursor.data[: cursor.position]
            assert codec.write(types, "T", value) == data, (types, value)
    assert taken > CASES


class _Strict(frame.Trusting):
    """Knows that stream 10 is another one at the source."""

    def verdict(self, introduction: frame.Introduction | None, stream: int) -> agreement.Verdict:
        differs = stream == 10
        return agreement.Verdict.DIFFERS if differs else agreement.Verdict.DECODE


REFUSED = {
    "not in shortest form": ("i", "1800"),
    "an integer that is a float": ("i", "f93c00"),
    "a float that is an integer": ("d", "00"),
    "a float longer than it must be": ("d", "fa3f000000"),
    "a bool that is a number": ("b", "01"),
    "the upper end of a range that wraps": ("d", "f93c00"),
    "beyond the range": ("e", "03"),
    "too long": ("s", "66616161616161"),
    "no UTF-8": ("t", "61ff"),
    "an escape for a number within its range": ("f", "f93c00"),
    "too many items": ("l", "04f93c00f93c00f93c00f93c00"),
    "a text of unknown length": ("t", "7f"),
}


@pytest.mark.parametrize("reason", REFUSED)
def test_cbor_refuses(reason: str) -> None:
    name, data = REFUSED[reason]
    types: table.Types = {"T": tuple(one for one in ODD if one.name == name)}
    assert not _survives(lambda raw: cborpos.read(types, "T", Cursor(raw)), bytes.fromhex(data))


REFUSED_FRAMES = {
    "a reserved control": ("ab00", "no stream 0xab"),
    "RELAY behind a record": ("b20200ffbf010101", "reserved"),
    "HELLO behind a record": ("b2020b00b0020001200b2be1", "an introduction behind a record"),
    "LEN beyond the frame": ("b2050b00", "5 bytes wanted, 2 left"),
    "another version": ("b0030001200b2be10b00", "another version"),
    "an ACK of a best-effort topic": ("b90b03", "no reliable topic"),
    "a turn given back for a time": ("be0001", "the span of a turn given back is 0"),
}


@pytest.mark.parametrize("reason", REFUSED_FRAMES)
def test_frames_that_are_refused(reason: str) -> None:
    data, why = REFUSED_FRAMES[reason]
    (last,) = frame.read(bytes.fromhex(data), WAYS[1]).items[-1:]
    assert isinstance(last, frame.Unread)
    assert last.reason == why


def test_a_sealed_frame_shows_the_ends_of_equal_streams() -> None:
    """Section 15: it is as if each frame began with a TAG, but where streams are equal."""
    data = bytes.fromhex("0a1a02b4bfc0187b190a9b010b726177")
    samples = frame.read(data, WAYS[1], life=7).items
    assert samples == frame.read(data, WAYS[1]).items
    assert len(samples) == 2
    whole = frame.read(data, WAYS[1], _Strict(), life=7)
    assert whole.introduction == agreement.Tag(7)
    assert whole.items == (frame.Unread(data, "differs"),)
    delimited = b"\xb2\x0c" + data[:12] + b"\x0braw"
    whole = frame.read(delimited, WAYS[1], _Strict(), life=7)
    assert whole.items == (frame.Unread(data[:12], "differs"), record.Sample(11, (), b"raw"))


def test_an_extension_is_skipped() -> None:
    whole = frame.read(bytes.fromhex("b203c10102b201e00b00"), WAYS[1])
    assert whole.items[0] == frame.Extension(0xC1, b"\x01\x02")
    assert whole.items[1] == frame.Extension(0xE0, b"")
    assert whole.items[2] == record.Sample(11, (), b"\0")
