"""Annexes B and C against the project's encoder: drawn types, missions, models and damage.

The readers are written from docs/wire.md alone; the blocks here are made by the engine.
"""

import math
import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import cbor2
import msgspec
import pytest

from tests.independent import blocks, table, texts
from tests.independent.errors import ReadError
from zacoustic.core.values.dense import DenseCodec, DenseSample, Model, Snapshot, Speaker, fit
from zacoustic.core.values.dense.model.prior import Companion, First, Learnt
from zacoustic.core.values.dense.stream.packedbytes import PackedBytesCodec
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.types import FieldSpec, TypeSpec

DIGEST = bytes.fromhex("01020304")
ROOM = 4096
LEARNS = 40
"""Blocks of a mission."""
_WORDS = ("INF leg 3 started", "WRN leak in hull 2", "", "Öl €", '{"depth":12.5,"id":4}')


@dataclass
class _Field:
    """A field, and how its values go on."""

    spec: FieldSpec
    after: Callable[[Any], Any]


def _number(rng: random.Random, name: str, **more: Any) -> _Field:
    step = rng.choice((1e-6, 0.01, 0.125, 0.5, 1.0))
    low = rng.choice((0, -40, 17)) * step
    size = rng.choice((3, 4, 40, 720, 8000, 40_000, 5_000_000, 1 << 42))
    high = low + size * step
    spec = FieldSpec(name=name, type="float64", range=(low, high), step=step, **more)
    pace = rng.choice((0, 1, 3, 50, 100_000, 2_000_000)) * step
    still = rng.random()

    def after(value: float | None) -> float:
        if spec.nan and rng.random() < 0.2:
            return rng.choice((math.nan, math.nan, math.inf, -math.inf))
        if value is None or not low <= value < high or rng.random() < 0.03:
            return rng.uniform(low, high)
        if rng.random() < still:
            return value
        moved = value + pace * rng.uniform(-1, 1.5)
        if spec.escapes and rng.random() < 0.2:
            return high + rng.uniform(1, 9)
        return low + (moved - low) % (high - low)

    return _Field(spec, after)


def _other(rng: random.Random, name: str) -> _Field:
    kind = rng.choice(
        ("bool", "enum", "uint64", "int8", "float32", "string", "bytes", "list", "free")
    )
    if kind == "enum":
        names = tuple("abcde"[: rng.randint(1, 5)])
        return _Field(FieldSpec(name=name, type="enum", values=names), lambda _: rng.choice(names))
    if kind == "list":
        spec = FieldSpec(name=name, type="int8", max_length=5)
        return _Field(spec, lambda _: [rng.randint(-9, 9) for _ in range(rng.randint(0, 5))])
    if kind == "free":
        spec = FieldSpec(name=name, type="float64", step=0.5)
        return _Field(spec, lambda old: (old or 0.0) + rng.choice((0, 0.5, -1e6)))
    if kind == "string":
        words = rng.choices(_WORDS, k=3)
        return _Field(
            FieldSpec(name=name, type="string"),
            lambda _: rng.choice(words) + rng.choice(("", str(rng.randint(0, 999)))),
        )
    if kind == "bytes":
        most, least = rng.choice(((None, None), (9, None), (9, 9), (None, 2)))
        spec = FieldSpec(name=name, type="bytes", max_length=most, min_length=least)
        sizes = [size for size in (0, 2, 9, 9 if most else 40) if size >= (least or 0)]
        return _Field(spec, lambda _: rng.randbytes(rng.choice(sizes)))
    draws: dict[str, Callable[[Any], Any]] = {
        "bool": lambda _: rng.random() < 0.1,
        "uint64": lambda old: ((old or 9) + rng.choice((1, 7, 1 << 25, 1 << 45))) % (1 << 64),
        "int8": lambda old: max(-128, min(127, (old or 0) + rng.randint(-2, 2))),
        "float32": lambda old: old if old and rng.random() < 0.5 else 2.0 ** rng.randint(-9, 9),
    }  # fmt: skip
    return _Field(FieldSpec(name=name, type=kind), draws[kind])


def _any(rng: random.Random, name: str) -> _Field:
    if rng.random() < 0.4:
        return _other(rng, name)
    outside = rng.choice(("reject", "reject", "escape"))
    found = _number(rng, name, outside=outside, nan=rng.random() < 0.2)
    if rng.random() < 0.2:
        found = _optional(rng, found)
    if rng.random() < 0.15:
        return _array(rng, found)
    return found


def _optional(rng: random.Random, one: _Field) -> _Field:
    spec = msgspec.structs.replace(one.spec, optional=True)
    return _Field(spec, lambda old: None if rng.random() < 0.3 else one.after(old))


def _array(rng: random.Random, one: _Field) -> _Field:
    length = rng.choice((1, 3, 20))
    spec = msgspec.structs.replace(one.spec, length=length, optional=False)

    def after(old: list[Any] | None) -> list[Any]:
        found = [one.after(each) for each in old or [None] * length]
        low = (spec.range or (0.0, 0.0))[0]
        return [low if each is None else each for each in found]

    return _Field(spec, after)


def _vehicle(rng: random.Random) -> list[_Field]:
    """A course: heading, speed, positions; and an attitude."""
    step = rng.choice((0.02, 0.001))
    turn = FieldSpec(name="heading", type="float64", range=(0, 360), step=0.5, wraps=True)
    place = FieldSpec(name="x", type="float64", range=(-90, 90), step=1e-5)
    part = FieldSpec(name="qx", type="float64", range=(-1, 1), step=step)
    speed = FieldSpec(name=rng.choice(("Speed", "pace")), type="float64", range=(-1, 4), step=0.1)
    old = [0.0, 0.0]

    def position(axis: int) -> Callable[[Any], float]:
        def after(_: Any) -> float:
            old[axis] += rng.uniform(-1e-4, 2e-4)
            return old[axis]

        return after

    attitude = {"tilt": 0.0}

    def component(name: str) -> Callable[[Any], float]:
        def after(_: Any) -> float:
            if name == "qx":
                attitude["tilt"] = rng.uniform(-0.2, 0.2)
            tilt = attitude["tilt"]
            return {"qx": tilt, "qy": 0.0, "qz": 0.0, "qw": math.sqrt(1 - tilt * tilt)}[name]

        return after

    spin = rng.choice((1.0, 40.0))
    fields = [
        _Field(turn, lambda old: ((old or 0) + rng.uniform(-1, spin)) % 359.5),
        _Field(speed, lambda _: rng.uniform(-1, 2)),
        *(
            _Field(msgspec.structs.replace(place, name=name), position(n))
            for n, name in enumerate(("lat", "lon"))
        ),
        *(
            _Field(msgspec.structs.replace(part, name=name), component(name))
            for name in ("qx", "qy", "qz", "qw")
        ),
    ]
    return fields[: rng.choice((4, 8))]


@dataclass
class _Topic:
    """A topic, and the samples of a mission."""

    spec: TypeSpec
    fields: list[_Field]
    inner: list[_Field] = field(default_factory=list)
    last: dict[str, Any] = field(default_factory=dict)

    def sample(self) -> dict[str, Any]:
        for each in self.fields:
            name = each.spec.name
            self.last[name] = each.after(self.last.get(name))
        found = dict(self.last)
        if self.inner:
            found["inner"] = self._inner()
            length = self.spec.fields[-1].length
            if length is not None:
                found["inner"] = [self._inner() for _ in range(length)]
        return found

    def _inner(self) -> dict[str, Any]:
        return {each.spec.name: each.after(None) for each in self.inner}


def _topic(rng: random.Random, name: str) -> _Topic:
    fields = [_any(rng, f"f{n}") for n in range(rng.randint(1, 5))]
    if rng.random() < 0.4:
        fields = [*_vehicle(rng), *fields[:2]]
    inner = [_any(rng, f"i{n}") for n in range(2)] if rng.random() < 0.3 else []
    nested = (TypeSpec(name=f"{name}In", fields=tuple(each.spec for each in inner)),)
    specs = [each.spec for each in fields]
    if inner:
        length = rng.choice((None, 2, 9))
        specs.append(FieldSpec(name="inner", type=nested[0].name, length=length))
    spec = TypeSpec(name=name, fields=tuple(specs), nested=nested if inner else ())
    return _Topic(spec, fields, inner)


def _model(rng: random.Random, topics: dict[int, _Topic]) -> Model | None:
    """A model of some samples, or none. Its numbers are shaken: what is unusual occurs, too."""
    if rng.random() < 0.4:
        return None
    recording = [
        (float(tick), stream_id, topic.sample())
        for tick in range(rng.choice((30, 110)))
        for stream_id, topic in topics.items()
    ]
    model = fit([({n: topic.spec for n, topic in topics.items()}, recording)])
    streams = {}
    for key, prior in model.streams.items():
        learnt = {
            place: _shaken(rng, each) if rng.random() < 0.5 else each
            for place, each in prior.learnt.items()
            if rng.random() < 0.7
        }
        firsts = tuple(
            _accompanied(rng, each, [n for n in topics if str(n) != key]) for each in prior.firsts
        )
        streams[key] = msgspec.structs.replace(prior, learnt=learnt, firsts=firsts)
    return msgspec.structs.replace(model, streams=streams)


def _accompanied(rng: random.Random, first: First, others: list[int]) -> First:
    if not others or rng.random() < 0.7:
        return first
    companion = Companion(
        stream_id=rng.choice(others),
        column=rng.randrange(3),
        slope=rng.randint(-(1 << 17), 1 << 17),
        offset=rng.randint(-(1 << 12), 1 << 12),
        scale=rng.randint(1, 1 << 24),
    )
    return msgspec.structs.replace(first, companion=companion)


def _shaken(rng: random.Random, learnt: Learnt) -> Learnt:
    return msgspec.structs.replace(
        learnt,
        weights=tuple(
            tuple(each + rng.randint(-3000, 3000) for each in row) for row in learnt.weights
        ),
        widths=tuple(rng.randint(0, 8191) for _ in learnt.widths),
        nearer=tuple(rng.randint(0, 65536) for _ in learnt.nearer),
        holds=tuple(rng.randint(1, 60000) for _ in learnt.holds),
    )


def _types(topics: dict[int, _Topic]) -> table.Types:
    found: dict[str, tuple[table.Field, ...]] = {}
    for topic in topics.values():
        for spec in (topic.spec, *topic.spec.nested):
            stated = [msgspec.to_builtins(each) for each in spec.fields]
            found[spec.name] = tuple(map(table.field_of, stated))
    return found


class _Ends:
    """The engine and the reader, for the blocks of one source."""

    def __init__(self, rng: random.Random) -> None:
        self.topics = {n: _topic(rng, f"T{n}") for n in rng.sample(range(1, 99), rng.randint(1, 3))}
        model = _model(rng, self.topics)
        specs = {n: topic.spec for n, topic in self.topics.items()}
        self.codec = DenseCodec(specs, model=model, digest=DIGEST)
        text = "{}" if model is None else msgspec.json.encode(model, order="sorted").decode()
        names = {n: spec.name for n, spec in specs.items()}
        self.reader = blocks.Reader(_types(self.topics), names, DIGEST, text)
        self._held: dict[int, Snapshot] = {}

    def read(self, data: bytes) -> int | None:
        """Read a block with both; return its mark if it is held."""
        decoded = self.codec.decode(data, self._held)
        samples, block = self.reader.read(data)
        assert repr(samples) == repr(list(decoded.samples))
        snapshot = decoded.snapshot
        assert (block.digest, block.name) == (snapshot.digest, snapshot.name)
        if snapshot.name is None:
            return None
        held = self._held.get(snapshot.name)
        if held is None or not snapshot.is_outdated_by(held):
            self._held[snapshot.name] = snapshot
        assert self.reader.is_held(block) == (self._held[snapshot.name] is snapshot)
        return block.mark if self.reader.is_held(block) else None

    def read_damaged(self, data: bytes) -> bool:
        """Read a damaged block with both, without holding it; tell whether there is one."""
        try:
            decoded = self.codec.decode(data, self._held)
        except PayloadError:
            with pytest.raises(ReadError):
                self.reader.look_at(data)
            return False
        samples, block = self.reader.look_at(data)
        assert repr(samples) == repr(list(decoded.samples))
        assert block.digest == decoded.snapshot.digest
        return True


def _mission(seed: int) -> int:
    """Send the blocks of a mission with losses; return how many damaged ones were read."""
    rng = random.Random(seed)
    ends, damaged = _Ends(rng), 0
    speaker, ticks = Speaker(ends.codec), dict.fromkeys(ends.topics, 0)
    mark: int | None = None
    for _ in range(LEARNS):
        samples = []
        for stream_id, topic in ends.topics.items():
            for _ in range(rng.choice((0, 1, 1, 1, 2, 14 if rng.random() < 0.1 else 1))):
                ticks[stream_id] += rng.choice((1, 1, 1, 2, 9, 30))
                samples.append(DenseSample(stream_id, topic.sample(), ticks[stream_id]))
        is_heard = rng.random() < 0.7
        encoded = speaker.encode(samples, ROOM, {1} if is_heard else ())
        if encoded is None:
            continue
        speaker.sent(encoded)
        if rng.random() < 0.2:
            continue
        mark = ends.read(encoded.frame) or mark
        if mark is not None and rng.random() < 0.6:
            speaker.acknowledged(1, mark)
        damaged += ends.read_damaged(_damaged(rng, encoded.frame))
    return damaged


def _damaged(rng: random.Random, data: bytes) -> bytes:
    whole = bytearray(data)
    kind = rng.randrange(4)
    if kind == 0:
        whole[rng.randrange(len(whole))] ^= 1 << rng.randrange(8)
    elif kind == 1:
        del whole[rng.randint(1, len(whole)) :]
    elif kind == 2:
        whole += rng.randbytes(rng.randint(1, 9))
    else:
        whole = bytearray(rng.randbytes(rng.randint(1, 20)))
    whole[0] |= 0xC0
    return bytes(whole)


def test_the_reader_reads_the_blocks_of_the_engine(sized: Callable[..., int]) -> None:
    for seed in range(sized(5_000, share=6)):
        _mission(seed)


def test_the_engine_reads_the_blocks_of_the_least_sender(sized: Callable[..., int]) -> None:
    for seed in range(sized(10_000, share=20)):
        ends = _Ends(random.Random(seed))
        for stream_id, topic in ends.topics.items():
            value = ends.codec.streams[stream_id].layout.split(
                ends.codec.streams[stream_id].outside.bound(topic.spec.validate(topic.sample()))
            )
            joined = ends.codec.streams[stream_id].layout.join(*value)
            ends.read(ends.reader.write_alone(stream_id, joined))


def _text(rng: random.Random) -> bytes:
    kind = rng.randrange(5)
    if kind == 0:
        return rng.randbytes(rng.randint(0, 30))
    if kind == 1:
        return b"\xfa\xfb" + rng.randbytes(rng.randint(0, 12)) + b"\xfb"
    if kind == 2:
        return bytes(rng.choices(b"\x00\x01\x00 10", k=rng.randint(0, 30)))
    if kind == 3:
        number = 10 ** rng.uniform(-9, 20)
        value = {"depth": round(number, 3), "id": rng.randint(0, 99), "on": True}
        return msgspec.json.encode(value) if rng.random() < 0.5 else cbor2.dumps(value)
    shown = f"{rng.uniform(-99, 999):.{rng.randint(0, 6)}f}"
    return f"{rng.choice(_WORDS)} {shown} {rng.choice(_WORDS)}".encode()


def test_the_reader_reads_and_writes_the_texts_of_the_engine(sized: Callable[..., int]) -> None:
    codec, rng, coded = PackedBytesCodec(), random.Random(1), 0
    for _ in range(sized(100_000, share=60)):
        text = _text(rng)
        payload = codec.encode(text)
        if payload[:1] >= b"\xc0":
            coded += 1
            assert texts.read_block(payload) == text
            assert texts.write_block(text) == payload
            other = _damaged(rng, payload)
            try:
                expected = codec.decode(other)
            except PayloadError:
                with pytest.raises(ReadError):
                    texts.read_block(other)
            else:
                assert texts.read_block(other) == expected
        else:  # a block may stand for it as well
            assert codec.decode(texts.write_block(text)) == text
    assert coded
