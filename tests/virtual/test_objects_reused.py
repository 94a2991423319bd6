"""Large samples whose transfer numbers are used again, and crashes of either end among them."""

import random
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import pytest

from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Forward, Priority, Qos, Reliability
from zacoustic.core.base.sizes import SIZES, Sizes
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome, ObjectProgress
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing import SMALL_SIZES
from zacoustic.testing.virtual import VirtualNetwork

AUV, SHORE = 1, 2
PHOTO, VIEW = 1, 2
HOUR_S = 3600.0


class Photos:
    """A vehicle that publishes photos for the shore; both keep their journals.

    Args:
        sizes: Sizes of the engines' number windows.
        make: Makes the engines.
    """

    def __init__(self, sizes: Sizes = SIZES, *, make: Callable[..., Engine] = Engine) -> None:
        self.loses = 0
        """How many of the next frames to the shore are lost."""
        qos = Qos(reliability=Reliability.RELIABLE, priority=Priority.BACKGROUND, depth=100)
        ends: dict[str, Any] = {"publishers": (AUV,), "subscribers": (SHORE,)}
        on_demand = msgspec.structs.replace(qos, forward=Forward.ON_DEMAND)
        specs = [
            TopicSpec(stream_id=PHOTO, name="photo", qos=qos, journal=True, **ends),
            TopicSpec(stream_id=VIEW, name="view", qos=on_demand, **ends),
        ]
        nodes = [{"address": each, "position": [500 * each, 0, 10]} for each in (AUV, SHORE)]
        self.frames: Counter[int] = Counter()
        self.network = VirtualNetwork(
            scenario_from_mapping({"seed": 1, "channel": "none", "nodes": nodes}, source="photos"),
            StreamTable(specs, nodes={AUV: "auv", SHORE: "shore"}),
            trace=lambda each: self.frames.update([each.node] if each.what == "transmit" else []),
            digest=False,
            disturb=self._disturb,
            build=partial(make, sizes=sizes),
        )
        self._rng = random.Random(3)
        self.given: list[bytes] = []

    def _disturb(self, source: int, node: int, now: int) -> tuple[float, ...]:
        if source != AUV or not self.loses:
            return (0.0,)
        self.loses -= 1
        return ()

    def publish(self, size_bytes: int) -> None:
        self.given.append(self._rng.randbytes(size_bytes))
        self.network.publish(AUV, PHOTO, self.given[-1])

    def run(self, for_s: float) -> None:
        self.network.run(until_s=self.network.now / NS_PER_S + for_s)

    def restart(self, node: int) -> None:
        self.network.crash(node)
        self.run(5.0)
        self.network.start(node)

    @property
    def ends(self) -> list[DeliveryEnded]:
        return [each for _, each in self.network.events if isinstance(each, DeliveryEnded)]

    @property
    def got(self) -> list[bytes]:
        return [each.value for each in self.network.samples(SHORE, PHOTO)]


@pytest.mark.parametrize(("before", "restarts"), [(64, False), (24, True)])
def test_receiver_that_crashes_in_a_reused_number_gets_the_photo(
    before: int, restarts: bool
) -> None:
    """The photo's number was used before: by the 64th before it, or by one before a restart."""
    photos = Photos()
    for _ in range(before):
        photos.publish(150)
        photos.run(40.0)
    if restarts:
        photos.restart(AUV)
        photos.run(60.0)
    photos.publish(3000)
    photos.run(25.0)
    photos.restart(SHORE)
    photos.run(HOUR_S)
    assert photos.got == photos.given
    frames = photos.frames.copy()
    photos.run(6 * HOUR_S)
    assert photos.frames == frames
    photos.publish(200)
    photos.run(HOUR_S)
    assert photos.got == photos.given


@pytest.mark.parametrize("size_bytes", [20, 300])
def test_photos_that_wait_outlive_each_restart_of_their_publisher(size_bytes: int) -> None:
    photos = Photos()
    photos.run(5.0)
    photos.network.crash(SHORE)
    for _ in range(8):
        photos.publish(size_bytes)
        photos.run(30.0)
        photos.restart(AUV)
        photos.run(2.0)
    photos.network.start(SHORE)
    photos.run(2 * HOUR_S)
    assert photos.got == photos.given
    assert [each.outcome for each in photos.ends] == 8 * [DeliveryOutcome.DELIVERED]


@pytest.mark.parametrize("lost", range(1, 6))
def test_photo_with_the_number_of_a_refused_one_arrives(lost: int) -> None:
    """The first fragments of the new photo are lost, and those show that it is another one."""
    photos = Photos(SMALL_SIZES)
    photos.publish(900)
    photos.run(6.0)
    (under_way,) = {
        each.transfer for at, each in photos.network.events
        if at == SHORE and isinstance(each, ObjectProgress)
    }  # fmt: skip
    photos.network.apply(SHORE, lambda engine, now: engine.refuse_object(AUV, under_way, now))
    photos.run(60.0)
    assert [each.outcome for each in photos.ends] == [DeliveryOutcome.REFUSED]
    for _ in range(SMALL_SIZES.transfers - 1):
        photos.publish(150)
        photos.run(60.0)
    photos.loses = lost
    photos.publish(900)
    photos.run(HOUR_S)
    assert photos.got == photos.given[1:]
    assert {each.outcome for each in photos.ends[1:]} == {DeliveryOutcome.DELIVERED}


def test_photo_with_the_number_of_one_that_nobody_wanted_arrives() -> None:
    """The shore has unsubscribed while a picture of a view came, and is silent about it."""
    photos = Photos(SMALL_SIZES)
    network = photos.network
    network.apply(SHORE, lambda engine, now: engine.subscriptions.want(VIEW, now))
    photos.run(30.0)
    network.publish(AUV, VIEW, bytes(900))
    photos.run(5.0)
    network.apply(SHORE, lambda engine, now: engine.subscriptions.want(VIEW, now, sources=()))
    photos.run(60.0)
    for _ in range(SMALL_SIZES.transfers - 1):
        photos.publish(150)
        photos.run(60.0)
    photos.loses = 12
    photos.publish(900)
    photos.run(HOUR_S)
    assert photos.got == photos.given
