"""The engine and the reader of the page take the same of any damaged frame, and refuse the same."""

import random
from collections import Counter
from collections.abc import Callable
from typing import Any

import msgspec

from tests.golden.refusals import Receiver
from tests.independent import calls, fleet, frame, record
from tests.independent.fleet import TABLES
from zacoustic.core.engine.events import (
    Event,
    GoalReceived,
    RequestReceived,
    SampleReceived,
)
from zacoustic.testing.virtual import Modem

PARTS = ("b3", "b404", "b80001000000", "b9", "b20314c0ff", "0b6f6b", "80", "00", "ff", "c0", "b2")
"""What is put into frames: prefixes, a record, and bytes on which an end depends."""
EPOCH = 1
"""That of each node of the vectors."""
_AGREEMENT = {0xB0, 0xB1}
_RELAY = 0xBF
_CALL = 20


def _frames() -> list[dict[str, Any]]:
    """Return the refused frames between two nodes that know each other."""
    vectors = [*fleet.load("refusals.json"), *fleet.load("ends.json")]
    return [
        each
        for each in vectors
        if "key" not in each
        and "link" not in each
        and each["table"] in ("base", "reliable", "action")
        and each["receiver"] == 3 - each["source"]
    ]


def _damaged(data: bytes, others: list[bytes], chance: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(chance.randint(1, 3)):
        place = chance.randrange(len(out) + 1)
        match chance.randrange(5):
            case 0 if place < len(out):
                out[place] = chance.randrange(256)
            case 1:
                out[place:place] = chance.randbytes(chance.randint(1, 3))
            case 2:
                del out[place : place + chance.randint(1, 3)]
            case 3:
                out += chance.choice(others)
            case _:
                out[place:place] = bytes.fromhex(chance.choice(PARTS))
    return bytes(out[:64])


def _text(value: object) -> str:
    return value.hex() if isinstance(value, bytes) else msgspec.json.encode(value).decode()


def _of_engine(event: Event, reliable: set[int]) -> tuple[object, ...] | None:
    match event:
        case SampleReceived() if event.stream_id not in reliable:
            return "sample", event.stream_id, _text(event.value), event.deleted
        case RequestReceived():
            return "request", event.call.stream_id, event.call.number, _text(event.value)
        case GoalReceived():
            return "goal", event.goal.stream_id, event.goal.number, event.goal.epoch
        case _:
            return None


def _of_page(item: object, reliable: set[int]) -> tuple[object, ...] | None:
    match item:
        case record.Sample() if item.stream not in reliable:
            return "sample", item.stream, _text(item.payload), item.deletes
        case record.Call(stream=stream, head=calls.Head(calls.REQUEST, number, False)):
            return ("request", stream, number, _text(item.payload)) if stream == _CALL else None
        case record.Goal() if item.head.operation == "GOAL":
            epoch = EPOCH if item.head.epoch is None else item.head.epoch
            return "goal", item.stream, item.head.number, epoch
        case _:
            return None


def test_both_take_the_same(count: Callable[[int], int]) -> None:
    chance = random.Random(1)
    vectors = _frames()
    pool = [bytes.fromhex(each["hex"]) for each in vectors]
    taken: Counter[str] = Counter()
    for _ in range(count(20_000)):
        one = chance.choice(vectors)
        data = _damaged(bytes.fromhex(one["hex"]), pool, chance)
        # One empty sample was the last frame of both before: it would be its echo.
        if data in (b"", b"\x0b") or data[0] == _RELAY or _AGREEMENT & {*data}:
            continue
        table = TABLES[one["table"]]
        reliable = {each.id for each in table.streams.values() if getattr(each, "reliable", False)}
        engine = Receiver(one["table"], one["receiver"], Modem())
        engine.take(data.hex(), one["source"], one["destination"])
        got = Counter(_of_engine(event, reliable) for event in engine.events)
        way = record.Way(table, one["source"], one["destination"], routes=False)
        items = frame.read(data, way).items
        wanted = Counter(_of_page(item, reliable) for item in items)
        for each in [each for each in wanted if each and each[0] in ("request", "goal")]:
            wanted[each] = 1  # at most once
        del got[None], wanted[None]
        assert got == wanted, f"{one['table']} {one['source']} {one['destination']} {data.hex()}"
        taken["read"] += bool(got)
        taken["refused"] += any(isinstance(item, frame.Unread) for item in items)
    assert min(taken.values()) > count(20_000) // 10
