"""Small and large samples of one stream: in one order, each once, whatever goes wrong."""

import random
from collections.abc import Callable

import msgspec
import pytest

from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.testing.scenarios import RandomScenario, draw_scenario, run_scenario
from zacoustic.testing.scenarios.randomscenario import Lane, Shape, cast_of

MIXED = 33


def mixed(small_bytes: int, large_bytes: int) -> Shape:
    """Opaque payloads, every third of which fits no frame; they follow from their ticket."""

    def write(ticket: int) -> bytes:
        rng = random.Random(ticket)
        most_bytes = large_bytes if ticket % 3 == 0 else small_bytes
        return ticket.to_bytes(3, "big") + rng.randbytes(rng.randint(0, most_bytes - 3))

    return Shape(None, write, lambda value: int.from_bytes(value[:3], "big"))


def draw_mixed_scenario(seed: int) -> RandomScenario:
    """Return the water and the faults of a random scenario, and a stream of both sizes in it."""
    drawn = draw_scenario(seed)
    rng = random.Random(f"mixed {seed}")
    qos = Qos(
        reliability=Reliability.RELIABLE,
        depth=rng.choice((1, 10, 1000)),
        lifespan_s=rng.choice((None, None, None, 120.0)),
    )
    spec = TopicSpec(stream_id=MIXED, name="{node}/mixed", qos=qos, journal=rng.random() < 0.7)
    lanes: dict[int, Lane] = {MIXED: Lane(spec, mixed(rng.choice((8, 14)), 150))}
    if rng.random() < 0.5:
        lanes |= {each: lane for each, lane in drawn.casts[1].lanes.items() if each < 30}
    names = {address: f"n{address}" for address in drawn.casts}
    cast = cast_of(lanes, names)
    casts = dict.fromkeys(names, cast)
    # Most of the time is for what is large, and it is for all the others.
    return msgspec.structs.replace(drawn, casts=casts, pause_s=len(names) * drawn.pause_s)


@pytest.mark.parametrize("seed", [pytest.param(36, marks=pytest.mark.soak), 237])
def test_dense_texts_that_go_as_records_fit_the_frame(seed: int) -> None:
    assert run_scenario(draw_mixed_scenario(seed)).violations == ()


def test_a_sample_that_becomes_an_object_after_a_restart_keeps_its_lineage() -> None:
    assert run_scenario(draw_mixed_scenario(25)).violations == ()


@pytest.mark.parametrize("number", range(4))
def test_order_is_kept_in_any_scenario(count: Callable[[int], int], number: int) -> None:
    for seed in range(number, count(400), 4):
        violations = run_scenario(draw_mixed_scenario(seed)).violations
        assert not violations, f"seed {seed}: {len(violations)} complaints, {violations[0]}"
