"""Dense frames: what goes in comes out, within half a step, whatever the types."""

import math
import random
from collections.abc import Callable
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.core.dense.schemas import is_close, schemas
from tests.telemetry.exchange import dense_samples
from tests.telemetry.mission import Mission
from tests.telemetry.streams import by_id
from zacoustic.core.linktypes import LinkCapabilities, ReceivedFrame
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.dense import DenseCodec, DenseSample, Listener, Model, Speaker
from zacoustic.core.values.payload import PackedCodec, PayloadError
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.core.wire.envelope import Envelope, Opened
from zacoustic.errors import ConfigError, PayloadInvalidError

NAV: dict[str, Any] = {
    "lat": 43.1654321,
    "lon": 15.1234567,
    "heading": 359.97,
    "speed": 1.234,
    "depth": 1500.0,
    "altitude": None,
    "mode": "survey",
    "leak": False,
}
ROOM = 4096


def taken(codec: DenseCodec, samples: list[DenseSample], room: int = ROOM) -> bytes:
    """Encode all of the samples."""
    encoded = codec.encode(samples, room)
    assert encoded is not None
    assert encoded.taken == len(samples)
    return encoded.frame


def test_a_sample_comes_back_within_half_a_step(nav_type: TypeSpec) -> None:
    codec = DenseCodec({7: nav_type})
    ((stream_id, value),) = codec.decode(taken(codec, [DenseSample(7, NAV)])).samples
    assert stream_id == 7
    assert value["lat"] == pytest.approx(NAV["lat"], abs=0.5e-6)
    assert value["heading"] == 0.0  # rounded up, and around
    assert value["speed"] == pytest.approx(1.23)
    assert value["depth"] == 1000.0  # clamped, and counted
    assert value["altitude"] is None
    assert (value["mode"], value["leak"]) == ("survey", False)
    assert codec.streams[7].outside.clamped == {"depth": 1}


def test_samples_of_several_streams_share_a_frame(nav_type: TypeSpec, log_type: TypeSpec) -> None:
    codec = DenseCodec({7: nav_type, 3: log_type})
    lines = ["INF mission: leg 3 of 12 started", "überraschend € 😀", ""]
    samples = [DenseSample(7, NAV | {"speed": n / 10}, n) for n in range(5)]
    samples[2:2] = [DenseSample(3, {"text": line}, n) for n, line in enumerate(lines)]
    decoded = codec.decode(taken(codec, samples)).samples
    assert [value["text"] for stream_id, value in decoded if stream_id == 3] == lines
    speeds = [value["speed"] for stream_id, value in decoded if stream_id == 7]
    assert speeds == pytest.approx([0.0, 0.1, 0.2, 0.3, 0.4])


@given(schemas(), st.booleans())
def test_any_type_comes_back_within_half_a_step(
    case: tuple[TypeSpec, list[dict[str, Any]]], refers: bool
) -> None:
    type_spec, values = case
    codec = DenseCodec({1: type_spec, 2: type_spec})
    speaker, listener = Speaker(codec), Listener(codec)
    for place, value in enumerate(values):
        samples = [DenseSample(1, value, place), DenseSample(2, values[0], 3 * place)]
        encoded = speaker.encode(samples, ROOM, {1} if refers else ())
        assert encoded is not None
        speaker.sent(encoded)
        decoded = listener.decode(encoded.frame)
        assert decoded.snapshot.digest == encoded.snapshot.digest
        assert listener.mark is not None
        speaker.acknowledged(1, listener.mark)
        for (_, found), sample in zip(decoded.samples, samples, strict=True):
            expected = type_spec.validate(sample.value)
            for field in type_spec.fields:
                assert is_close(field, found[field.name], expected[field.name])


@pytest.mark.parametrize("name", ["lon", "speed"])
def test_a_heading_or_speed_of_many_values_is_no_position_too(name: str) -> None:
    many: dict[str, Any] = {"type": "float64", "range": (-2.0, 3.0), "step": 1e-6}
    fields: list[dict[str, Any]] = [{"name": name, **many, "wraps": name == "lon"}]
    fields += [{"name": "x", **many}, {"name": "y", **many}]
    if name == "speed":
        fields.append({"name": "heading", "type": "float64", "range": (0, 360), "step": 1.0,
                       "wraps": True})  # fmt: skip
    codec = DenseCodec({1: TypeSpec(name="T", fields=tuple(FieldSpec(**f) for f in fields))})
    speaker, listener, rng = Speaker(codec), Listener(codec), random.Random(2)
    for tick in range(40):
        value = {each["name"]: rng.choice((0.0, 1.0, 1.5, rng.uniform(0, 2))) for each in fields}
        encoded = speaker.encode([DenseSample(1, value, tick)], ROOM, {1})
        assert encoded is not None
        speaker.sent(encoded)
        decoded = listener.decode(encoded.frame)
        speaker.acknowledged(1, decoded.snapshot.mark)
        for each in fields:
            assert decoded.samples[0][1][each["name"]] == pytest.approx(
                value[each["name"]], abs=0.5 * each["step"] * 1.001
            )


@given(schemas(), st.data())
def test_whoever_changes_a_schema_has_another_digest(
    case: tuple[TypeSpec, list[dict[str, Any]]], data: st.DataObject
) -> None:
    type_spec, _ = case
    fields = list(type_spec.fields)
    place = data.draw(st.integers(0, len(fields) - 1))
    field = fields[place]
    changes: list[dict[str, Any]] = [{"optional": not field.optional}]
    if field.range is not None:
        low, high = field.range
        changes.append({"range": (low, high + 16 * (field.step or 1)), "wraps": False})
    if field.values:
        changes.append({"values": (*field.values, "more")})
    if field.max_length is not None:
        changes.append({"max_length": field.max_length + 1})
    change = data.draw(st.sampled_from(changes))
    other = [*fields[:place], msgspec.structs.replace(field, **change), *fields[place + 1 :]]
    tables = []
    for each in (fields, other, [*fields, FieldSpec(name="last", type="bool")]):
        types = TypeTable([TypeSpec(name="Any", fields=tuple(each))])
        spec = TopicSpec(stream_id=7, name="any", type_name="Any", codec="dense")
        tables.append(StreamTable([spec], types=types))
    assert len({table.digest for table in tables}) == 3
    assert len({table.by_id(7).digest for table in tables}) == 3


@given(schemas())
def test_a_single_sample_costs_two_bytes_more_than_packed_at_most(
    case: tuple[TypeSpec, list[dict[str, Any]]],
) -> None:
    type_spec, values = case
    codec, packed = DenseCodec(dict.fromkeys(range(8), type_spec)), PackedCodec(type_spec)
    for value in values:
        frame = taken(codec, [DenseSample(3, value)], 1 << 16)
        assert len(frame) <= len(packed.encode(value)) + 2


def test_as_many_samples_as_fit_are_taken_and_one_more_would_not_fit(nav_type: TypeSpec) -> None:
    codec, rng = DenseCodec({7: nav_type}), random.Random(4)
    samples = [
        DenseSample(7, NAV | {"speed": rng.uniform(-1, 4), "heading": rng.uniform(0, 359)}, n)
        for n in range(300)
    ]
    for room in (8, 20, 64, 200, 512):
        encoded = codec.encode(samples, room)
        if encoded is None:
            assert len(taken(codec, samples[:1])) > room
            continue
        assert len(encoded.frame) <= room
        assert len(taken(codec, samples[: encoded.taken + 1])) > room
    assert codec.encode([], 64) is None


def test_more_samples_than_a_frame_can_have_are_left_for_the_next(nav_type: TypeSpec) -> None:
    codec = DenseCodec({7: nav_type})
    encoded = codec.encode([DenseSample(7, NAV, n) for n in range(400)], 1 << 16)
    assert encoded is not None
    assert encoded.taken == 255
    assert len(codec.decode(encoded.frame).samples) == 255


def test_what_is_not_of_the_type_is_refused_before_anything_is_written(nav_type: TypeSpec) -> None:
    codec = DenseCodec({7: nav_type})
    with pytest.raises(PayloadInvalidError):
        codec.encode([DenseSample(7, NAV | {"lat": 60.0})], ROOM)
    with pytest.raises(ConfigError):
        DenseCodec({})


def test_a_vehicle_that_stands_still_costs_about_two_bytes(nav_type: TypeSpec) -> None:
    codec = DenseCodec({7: nav_type, 8: nav_type, 9: nav_type})
    speaker, listener, sizes = Speaker(codec), Listener(codec), []
    for tick in range(60):
        encoded = speaker.encode([DenseSample(8, NAV, tick)], ROOM, {1})
        assert encoded is not None
        speaker.sent(encoded)
        sizes.append(len(encoded.frame))
        listener.decode(encoded.frame)
        assert listener.mark is not None
        speaker.acknowledged(1, listener.mark)
    assert sum(sizes[20:]) / len(sizes[20:]) <= 2.2


def test_what_is_learnt_makes_frames_smaller() -> None:
    mission = Mission(5, 1200)
    codec = DenseCodec(by_id(mission.types))
    speaker, listener, sizes = Speaker(codec), Listener(codec), []
    for sample in dense_samples(mission.samples, ("nav",)):
        encoded = speaker.encode([sample], ROOM, {1})
        assert encoded is not None
        speaker.sent(encoded)
        sizes.append(len(encoded.frame))
        listener.decode(encoded.frame)
        assert listener.mark is not None
        speaker.acknowledged(1, listener.mark)
    late = sizes[-120:]
    assert sum(late) / len(late) < 8  # packed: 14 and a byte of id


def test_damaged_frames_are_refused_or_within_bounds(
    log_type: TypeSpec, count: Callable[[int], int]
) -> None:
    fields = (
        FieldSpec(name="speed", type="float32", range=(-1, 4), step=0.01),
        FieldSpec(name="altitude", type="float32", range=(0, 200), step=0.1, optional=True),
    )
    codec = DenseCodec({3: log_type, 7: TypeSpec(name="Small", fields=fields)})
    speaker, listener, rng = Speaker(codec), Listener(codec), random.Random(9)
    frames = []
    for tick in range(12):
        value = {"speed": rng.uniform(0, 1), "altitude": rng.choice((None, 7.0))}
        encoded = speaker.encode([DenseSample(7, value, tick)], ROOM, {1})
        assert encoded is not None
        speaker.sent(encoded)
        frames.append(encoded.frame)
        held = listener.decode(encoded.frame).snapshot
        speaker.acknowledged(1, held.mark)
    snapshots = [listener.decode(frame).snapshot for frame in frames[-4:]]
    held_by_name = {each.name: each for each in snapshots if each.name is not None}
    refused, total = 0, count(10_000_000)
    for place in range(total):
        if place % 2:
            frame = rng.randbytes(rng.choice((1, 2, 3, 4, 5)) if place % 64 > 1 else 64)
        else:
            damaged = bytearray(rng.choice(frames))
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
            frame = bytes(damaged)
        try:
            decoded = codec.decode(frame, held_by_name)
        except PayloadError:
            refused += 1
            continue
        for stream_id, value in decoded.samples:
            codec.streams[stream_id].type_spec.validate(value)
    assert refused > total // 3


def test_damaged_frames_of_a_whole_vehicle_are_refused_or_within_bounds(
    count: Callable[[int], int],
) -> None:
    mission = Mission(3)
    types = by_id(mission.types)
    codec = DenseCodec(types)
    speaker, listener, rng = Speaker(codec), Listener(codec), random.Random(10)
    frames, samples = [], dense_samples(mission.samples, mission.types)[:400]
    for place in range(0, len(samples), 10):
        encoded = speaker.encode(samples[place : place + 10], ROOM, {1})
        assert encoded is not None
        speaker.sent(encoded)
        frames.append(encoded.frame)
        speaker.acknowledged(1, listener.decode(encoded.frame).snapshot.mark)
    snapshots = [listener.decode(frame).snapshot for frame in frames[-8:]]
    held_by_name = {each.name: each for each in snapshots if each.name is not None}
    refused, total = 0, count(200_000)
    for place in range(total):
        damaged = bytearray(frames[-1 - place % 8])
        if place % 4 == 0:
            damaged = bytearray(rng.randbytes(rng.randrange(1, 65)))
        elif place % 4 == 1:
            del damaged[rng.randrange(1, len(damaged)) :]
        else:
            damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
        try:
            decoded = codec.decode(bytes(damaged), held_by_name)
        except PayloadError:
            refused += 1
            continue
        assert len(decoded.samples) <= 255 * len(types)
        for stream_id, value in decoded.samples:
            types[stream_id].validate(value)
    assert refused > total // 3


def test_behind_the_check_of_a_link_nothing_damaged_is_read(count: Callable[[int], int]) -> None:
    link = LinkCapabilities(mtu_bytes=64, bit_rate_bps=1000, checked=False)
    sender, receiver, rng = Envelope(link, 1), Envelope(link, 2), random.Random(12)
    whole = sender.wrap(rng.randbytes(40), 2)
    for _ in range(count(1_000_000)):
        damaged = bytearray(whole)
        for _ in range(rng.randint(1, 12)):
            damaged[rng.randrange(len(damaged))] ^= rng.randrange(1, 256)
        if damaged == whole:
            continue
        frame = ReceivedFrame(source=1, destination=2, frame_bytes=bytes(damaged), received_at=0)
        assert not any(isinstance(each, Opened) for each in receiver.open(frame))


def test_numbers_that_are_none_are_refused(nav_type: TypeSpec) -> None:
    codec = DenseCodec({7: nav_type})
    with pytest.raises(PayloadInvalidError):
        codec.encode([DenseSample(7, NAV | {"speed": math.nan})], ROOM)


def test_a_model_survives_being_written_as_json() -> None:
    model = Model(single=77)
    again = msgspec.json.decode(msgspec.json.encode(model), type=Model)
    assert again.digest == model.digest
