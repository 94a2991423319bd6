"""Models: fitted to some missions, they help on others, and say nothing of another type."""

import math

import msgspec
import pytest

from tests.telemetry.exchange import dense_samples, exchange
from tests.telemetry.mission import Mission
from tests.telemetry.streams import STREAM_IDS, by_id
from zacoustic.core.values.dense import DenseCodec, DenseSample, Model, fit
from zacoustic.core.values.dense.model.prior import Companion
from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.errors import ConfigError

NAMES = ("nav", "ctd", "log")


@pytest.fixture(scope="module")
def model() -> Model:
    missions = [Mission(seed, 900) for seed in (11, 12)]
    return fit(
        (by_id(each.types, NAMES), [(t, STREAM_IDS[name], v) for t, name, v in each.samples])
        for each in missions
    )


def test_a_model_helps_where_nothing_was_learnt_yet(model: Model) -> None:
    mission = Mission(13, 900)
    types = by_id(mission.types, NAMES)
    samples = dense_samples(mission.samples, NAMES)
    groups = [samples[n : n + 8] for n in range(0, 400, 8)]
    without = exchange(DenseCodec(types), groups)
    fitted = exchange(DenseCodec(types, model=model), groups)
    assert fitted.wrong == fitted.undecodable == 0
    assert fitted.mean < 0.8 * without.mean


def test_a_model_is_the_same_after_a_file(model: Model) -> None:
    again = msgspec.json.decode(msgspec.json.encode(model), type=Model)
    assert again == model
    assert again.digest == model.digest
    assert msgspec.structs.replace(model, single=3).digest != model.digest


def test_a_model_of_another_type_is_refused_by_name(model: Model) -> None:
    types = by_id(Mission(1, 10).types)
    with pytest.raises(ConfigError, match=r"model\.streams\.10: fitted to another type"):
        DenseCodec({10: types[STREAM_IDS["pose"]]}, model=model)


def test_a_model_with_nonsense_is_refused(model: Model) -> None:
    nav = model.streams["10"]
    types = {10: Mission(1, 10).types["nav"]}
    learnt = dict(nav.learnt)
    learnt["1"] = msgspec.structs.replace(learnt["1"], log_scales=(-1,) * len(nav.sizes))
    unheld = {
        **nav.learnt,
        "1": msgspec.structs.replace(nav.learnt["1"], holds=(0,) * len(nav.sizes)),
    }
    later = Companion(stream_id=10, column=0, slope=1, offset=0, scale=9)  # positions come last
    firsts = [*nav.firsts[:2], msgspec.structs.replace(nav.firsts[2], companion=later)]
    for damage in (
        {"learnt": learnt},
        {"learnt": unheld},
        {"firsts": (*firsts, *nav.firsts[3:])},
        {"steadiness": (0,) * len(nav.sizes)},
        {"firsts": nav.firsts[:-1]},
        {"present": 1 << 20},
    ):
        broken = msgspec.structs.replace(nav, **damage)
        with pytest.raises(ConfigError):
            DenseCodec(types, model=Model(streams={"10": broken}))


def test_a_model_of_an_earlier_version_is_refused_with_what_it_lacks(model: Model) -> None:
    learnt = msgspec.to_builtins(model)
    for place in learnt["streams"]["10"]["learnt"].values():
        for now, before in (("log_scales", "scales"), ("nearer", "hold_misses")):
            place[before] = place.pop(now)
    with pytest.raises(msgspec.ValidationError, match=r"missing required field `log_scales`"):
        msgspec.convert(learnt, Model)


def test_infinities_that_are_clamped_are_fitted_at_the_ends_of_their_range() -> None:
    level = FieldSpec(name="level", type="float32", range=(0, 10), step=0.1, outside="clamp")
    spec = TypeSpec(name="Level", fields=(level,))
    levels = [5.0, math.inf, -math.inf, 50.0] * 40
    model = fit([({7: spec}, [(number, 7, {"level": each}) for number, each in enumerate(levels)])])
    codec = DenseCodec({7: spec}, model=model)
    encoded = codec.encode([DenseSample(7, {"level": -math.inf})], 64)
    assert encoded is not None
    assert codec.decode(encoded.frame).samples == ((7, {"level": 0.0}),)
