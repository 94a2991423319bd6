"""References: whatever is lost, doubled and late, what is read is right, and all of it is read."""

import gc
import random
from collections.abc import Callable

import pytest

from tests.telemetry.exchange import dense_samples, exchange
from tests.telemetry.mission import Mission
from tests.telemetry.streams import by_id
from zacoustic.core.values.dense import (
    DenseCodec,
    DenseSample,
    Encoded,
    Listener,
    Snapshot,
    Speaker,
)
from zacoustic.core.values.dense.model.snapshot import NAMES
from zacoustic.core.values.dense.stream.references import KEPT
from zacoustic.core.values.payload import PayloadError
from zacoustic.core.values.types import TypeSpec

ROOM = 512
HERE, THERE = 1, 2


def say(speaker: Speaker, value: dict[str, object], tick: int, *listeners: int) -> Encoded:
    """Send a sample of stream 7."""
    encoded = speaker.encode([DenseSample(7, value, tick)], ROOM, listeners)
    assert encoded is not None
    speaker.sent(encoded)
    return encoded


def answer(speaker: Speaker, listener: Listener, address: int = HERE) -> bool:
    """Acknowledge the newest frame."""
    assert listener.mark is not None
    return speaker.acknowledged(address, listener.mark)


def snapshots() -> int:
    """How many there are in this process."""
    gc.collect()
    return sum(isinstance(each, Snapshot) for each in gc.get_objects())


@pytest.fixture
def values() -> list[dict[str, object]]:
    rng = random.Random(3)
    return [
        {"lat": 43.1, "lon": 15.1, "heading": rng.uniform(0, 360), "speed": rng.uniform(0, 2),
         "depth": 10.0, "altitude": None, "mode": "idle", "leak": False}
        for _ in range(80)
    ]  # fmt: skip


@pytest.mark.parametrize("loss", [0.0, 0.1, 0.3])
@pytest.mark.parametrize("ack_every", [1, 5])
def test_nothing_is_wrong_or_unreadable(
    loss: float, ack_every: int, count: Callable[[int], int]
) -> None:
    for seed in range(count(100)):
        mission = Mission(seed, 600)
        codec = DenseCodec(by_id(mission.types))
        samples = dense_samples(mission.samples, ("nav", "status", "ctd", "cmd", "log"))
        alone = [[each] for each in samples[:150]]
        groups = [samples[n : n + 9] for n in range(150, 450, 9)]
        counters = exchange(
            codec, alone + groups, ack_every=ack_every, loss=loss, disorder=0.1, seed=seed
        )
        assert (counters.undecodable, counters.wrong) == (0, 0), f"seed {seed}"
        assert counters.received > 0


def test_nothing_is_referred_to_that_was_not_acknowledged(
    nav_type: TypeSpec, values: list[dict[str, object]]
) -> None:
    codec = DenseCodec({7: nav_type})
    speaker, listener = Speaker(codec), Listener(codec)
    for tick in range(5):
        encoded = say(speaker, values[tick], tick, HERE)
        assert encoded.reference is None
        listener.decode(encoded.frame)
    assert answer(speaker, listener)
    assert say(speaker, values[5], 5, HERE).reference is encoded.snapshot
    assert say(speaker, values[6], 6, HERE, THERE).reference is None  # not all hold it
    assert say(speaker, values[7], 7).reference is None  # anybody may listen


def test_on_broadcast_the_newest_is_meant_that_every_listener_holds(
    nav_type: TypeSpec, values: list[dict[str, object]]
) -> None:
    codec = DenseCodec({7: nav_type})
    speaker, here, there = Speaker(codec), Listener(codec), Listener(codec)
    first = say(speaker, values[0], 0, HERE, THERE)
    for listener, address in ((here, HERE), (there, THERE)):
        listener.decode(first.frame)
        answer(speaker, listener, address)
    second = say(speaker, values[1], 1, HERE, THERE)
    assert second.reference is first.snapshot
    here.decode(second.frame)  # lost there
    answer(speaker, here, HERE)
    third = say(speaker, values[2], 2, HERE, THERE)
    assert third.reference is first.snapshot
    for listener in (here, there):
        listener.decode(third.frame)
    # Who acknowledges a frame holds what it refers to, though it never said so.
    assert say(speaker, values[3], 3, HERE).reference is second.snapshot


def test_who_has_restarted_is_not_referred_to(
    nav_type: TypeSpec, values: list[dict[str, object]]
) -> None:
    codec = DenseCodec({7: nav_type})
    speaker, listener = Speaker(codec), Listener(codec)
    listener.decode(say(speaker, values[0], 0, HERE).frame)
    answer(speaker, listener)
    listener.forget()
    with pytest.raises(PayloadError):
        listener.decode(say(speaker, values[1], 1, HERE).frame)
    speaker.forget(HERE)
    assert say(speaker, values[2], 2, HERE).reference is None


def test_an_acknowledgement_of_what_is_not_known_changes_nothing(nav_type: TypeSpec) -> None:
    speaker = Speaker(DenseCodec({7: nav_type}))
    assert not any(speaker.acknowledged(HERE, mark) for mark in range(256))


def test_a_reference_to_something_else_is_an_error_and_not_plausible_garbage(
    nav_type: TypeSpec, values: list[dict[str, object]]
) -> None:
    codec = DenseCodec({7: nav_type})
    accepted = total = 0
    for seed in range(8):
        speaker, other, held = Speaker(codec), Speaker(codec), {}
        for tick in range(2):
            snapshot = say(other, values[(tick * 7 + seed) % 80], tick, HERE).snapshot
            held[snapshot.name or 0] = snapshot
            other.acknowledged(HERE, snapshot.mark)
        for tick in range(60):
            encoded = say(speaker, values[tick], tick, HERE)
            speaker.acknowledged(HERE, encoded.snapshot.mark)
            if encoded.reference is None:
                continue
            total += 1
            try:
                codec.decode(encoded.frame, held)
            except PayloadError:
                continue
            accepted += 1
    assert total > 400
    assert accepted / total < 0.08  # two frames of 44 names, and then the check


def test_memory_is_bounded(nav_type: TypeSpec, values: list[dict[str, object]]) -> None:
    codec = DenseCodec({7: nav_type})
    speaker, listener = Speaker(codec), Listener(codec)
    others = snapshots()
    for tick in range(400):
        encoded = say(speaker, values[tick % 80], tick, HERE)
        listener.decode(encoded.frame)
        if tick % 3 == 0:
            answer(speaker, listener)
    # What a source sent, what that refers to, and of each name what a receiver holds.
    assert snapshots() - others <= 2 * KEPT + NAMES + 2
    assert answer(speaker, listener)
    assert say(speaker, values[0], 400, HERE).reference is encoded.snapshot
