"""Killed between the journal and the application: nothing is lost there, and nothing told twice.

A crash may find a commit on the disk that nobody was told of. A journalled sample whose position
was written so is handed on by the next life, and says that it may come again; the end of a delivery
is told by one life only; and no delivery id is given away twice.
"""

import random
from collections.abc import Callable
from typing import Final

import pytest

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.engine.events import (
    DeliveryEnded,
    DeliveryOutcome,
    DeliveryStored,
    SampleReceived,
)
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import VirtualNetwork

LOG, PHOTO = 10, 11
TABLE: Final = StreamTable(
    [
        TopicSpec(
            stream_id=LOG,
            name="log",
            publishers=(1,),
            subscribers=(2,),
            journal=True,
            qos=Qos(reliability=Reliability.RELIABLE, depth=5, lifespan_s=600.0),
        ),
        TopicSpec(
            stream_id=PHOTO,
            name="photo",
            publishers=(1,),
            subscribers=(2,),
            journal=True,
            max_bytes=1000,
            qos=Qos(reliability=Reliability.RELIABLE, depth=10),
        ),
    ],
    nodes={1: "shore", 2: "auv1"},
)


@pytest.mark.parametrize("untold", [0.0, 0.5, 1.0])
def test_killed_at_any_instant_of_a_hand_over(count: Callable[[int], int], untold: float) -> None:
    assert sum(_hand_over(seed, untold) for seed in range(12, 12 + count(1500)))


@pytest.mark.parametrize(("seed", "untold"), [(1192, 0.0), (1157, 0.5)])
def test_receivers_do_not_pass_over_a_sample_whose_end_is_not_journalled(
    seed: int, untold: float
) -> None:
    # The publisher superseded it, said so by its floor, was killed before the commit, sent it
    # again, and took the receiver's ACK of the floor for its delivery.
    _hand_over(seed, untold)


def _hand_over(seed: int, untold: float) -> int:
    """Kill both ends again and again; return how many samples were marked as coming again."""
    marked = 0
    rng = random.Random(seed)
    journal = {"commit_s": rng.choice((0.02, 0.5)), "untold": untold}
    medium = VirtualNetwork(
        line(0, 300, seed=seed, channel="none", loss={"frame": 0.2}, faults={"journal": journal}),
        TABLE,
    )
    published: dict[int, bytes] = {}
    for number in range(12):
        value = f"sample {number}".encode()
        delivery_id = medium.publish(1, LOG, value)
        assert delivery_id not in published, f"seed {seed}: an id comes again"
        published[delivery_id] = value
        medium.run(until_s=medium.now / 1e9 + rng.choice((0.01, 0.3, 2, 20)) * rng.random())
        if rng.random() < 0.6:
            medium.restart(rng.choice((1, 2)))
    medium.run(until_s=medium.now / 1e9 + 3600)
    stored: set[int] = set()
    ended: dict[int, DeliveryOutcome] = {}
    first: set[bytes] = set()
    for node, event in medium.events:
        match event:
            case SampleReceived():
                assert event.again or event.value not in first, f"seed {seed}: twice"
                marked += event.again
                first.add(event.value)
            case DeliveryStored():
                stored.add(event.delivery_id)
            case DeliveryEnded():
                assert node == 1
                outcome = ended.setdefault(event.delivery_id, event.outcome)
                assert outcome is event.outcome, f"seed {seed}: two ends"
                if event.outcome is DeliveryOutcome.DELIVERED:
                    value = published[event.delivery_id]
                    assert value in first, f"seed {seed}: {value!r} was lost"
    assert medium.engine(1).delivering(LOG) == 0
    assert stored <= ended.keys(), f"seed {seed}: an end was never told"
    return marked


@pytest.mark.parametrize("untold", [0.0, 0.5, 1.0])
def test_killed_at_any_instant_of_the_hand_over_of_a_large_sample(
    count: Callable[[int], int], untold: float
) -> None:
    marked = 0
    for seed in range(5, 5 + count(600)):
        rng = random.Random(seed)
        journal = {"commit_s": rng.choice((0.02, 0.5, 3.0)), "untold": untold}
        medium = VirtualNetwork(
            line(
                0, 300, seed=seed, channel="none", loss={"frame": 0.1}, faults={"journal": journal}
            ),
            TABLE,
        )
        handed_on: list[bytes] = []
        wanted: list[bytes] = []
        for number in range(6):
            value = f"photo {number} ".encode().ljust(rng.randint(80, 600), b".")
            medium.publish(1, PHOTO, value)
            wanted.append(value)
            begun_at = medium.now
            medium.run(until_s=begun_at / 1e9 + 4 + rng.random())
            while rng.random() < 0.9 and medium.now < begun_at + 60e9:
                medium.run(until_s=medium.now / 1e9 + rng.choice((0.3, 1, 3)) * rng.random())
                if medium.engine(2).stats.received.get(PHOTO, 0) or rng.random() < 0.5:
                    medium.restart(2)
        medium.run(until_s=medium.now / 1e9 + 3600)
        for node, event in medium.events:
            match event:
                case SampleReceived():
                    assert event.again or event.value not in handed_on, f"seed {seed}: twice"
                    marked += event.again
                    handed_on.append(event.value)
                case DeliveryEnded():
                    assert node == 1
                    assert event.outcome is DeliveryOutcome.DELIVERED, f"seed {seed}: {event}"
        lost = set(wanted) - set(handed_on)
        assert not lost, f"seed {seed}: {len(lost)} photos were lost"
        assert medium.engine(1).delivering(PHOTO) == 0
        kept = [key for key in medium.journal(2).entries if key.startswith("object/in/")]
        assert not kept
    assert marked
