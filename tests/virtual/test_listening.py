"""Listen windows on the channel: an emergency reaches a node that never stops, or leaves it."""

import random
from collections.abc import Callable
from functools import partial

import msgspec
import pytest

from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import AlohaSpec, CarrierSenseSpec
from zacoustic.core.schedule.access.spec import AccessSpec
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

TALK, EMERGENCY, STOP, COMMAND, PHOTO = 1, 2, 3, 4, 5
FRAME_S = profile_named(DEFAULT_PROFILE).airtime_s(64)


class Sea:
    """Node 1 has a thousand messages to send, or a photo; node 2 is so many metres away."""

    def __init__(
        self,
        distance_m: float,
        seed: int,
        access: AccessSpec | None = None,
        *,
        loss: float = 0.0,
        photo: bool = False,
    ) -> None:
        scenario = scenario_from_mapping(
            {
                "nodes": [
                    {"address": 1, "position": [0, 0, 10]},
                    {"address": 2, "position": [distance_m, 0, 10]},
                ],
                "seed": seed,
                "channel": "none",
                "loss": {"frame": loss},
            },
            source="test",
        )
        reliable = Qos(reliability=Reliability.RELIABLE, priority=Priority.REAL_TIME)
        command = msgspec.structs.replace(reliable, priority=Priority.INTERACTIVE_HIGH)
        table = StreamTable(
            [
                TopicSpec(stream_id=TALK, name="talk", qos=Qos(depth=1000)),
                TopicSpec(
                    stream_id=EMERGENCY,
                    name="{node}/emergency",
                    qos=Qos(priority=Priority.REAL_TIME, depth=4),
                ),
                TopicSpec(
                    stream_id=STOP, name="stop", qos=reliable, publishers=(2,), subscribers=(1,)
                ),
                TopicSpec(
                    stream_id=COMMAND, name="do", qos=command, publishers=(2,), subscribers=(1,)
                ),
                TopicSpec(
                    stream_id=PHOTO,
                    name="photo",
                    qos=msgspec.structs.replace(reliable, priority=Priority.BACKGROUND),
                    publishers=(1,),
                    subscribers=(2,),
                ),
            ],
            nodes={1: "a", 2: "b"},
        )
        self.sent: list[tuple[float, TraceRecord]] = []
        self.medium = VirtualNetwork(
            scenario,
            table,
            modem=Modem(senses_carrier=isinstance(access, CarrierSenseSpec)),
            rules=TransmitRules(access=access),
            trace=self._trace,
        )
        for at_s, node in ((0, 1), (10, 2), (20, 1), (30, 2)):  # they know each other
            self.medium.at(at_s, partial(self.medium.publish, node, TALK, b""))
        self.medium.at(60, self._send_photo if photo else self._talk)
        self.medium.run(until_s=60)

    def _talk(self) -> None:
        rng = random.Random(self.medium.scenario.seed)
        for _ in range(1000):
            self.medium.publish(1, TALK, rng.randbytes(rng.randint(8, 40)))

    def _send_photo(self) -> None:
        self.medium.publish(1, PHOTO, random.Random(1).randbytes(20_000))

    def _trace(self, record: TraceRecord) -> None:
        if record.what == "transmit":
            self.sent.append((record.at / NS_PER_S, record))


@pytest.mark.parametrize(
    ("access", "distance_m"),
    [
        (AlohaSpec(), 1500.0),
        (CarrierSenseSpec(), 100.0),
        *(
            pytest.param(access, distance_m, marks=pytest.mark.soak)
            for access, distance_m in (
                (AlohaSpec(), 100.0),
                (AlohaSpec(), 1000.0),
                (CarrierSenseSpec(), 1000.0),
                (CarrierSenseSpec(), 1500.0),
            )
        ),
    ],
)
def test_emergency_reaches_a_node_that_talks(
    access: AccessSpec, distance_m: float, count: Callable[[int], int]
) -> None:
    for seed in range(count(1000)):
        sea = Sea(distance_m, seed, access)
        at_s = 75 + random.Random(seed).uniform(0, 60)
        sea.medium.at(at_s, partial(sea.medium.publish, 2, EMERGENCY, bytes(8)))
        sea.medium.run(until_s=at_s + 10)
        heard = [event.received_at / NS_PER_S for event in sea.medium.samples(1, EMERGENCY)]
        assert heard, seed
        # The next window, the way, a short frame.
        assert heard[0] - at_s <= 4.6 + distance_m / 1500 + 0.4, seed


@pytest.mark.parametrize(
    ("stream_id", "loss", "least"),
    [
        (STOP, 0.4, 0.85),
        pytest.param(COMMAND, 0.2, 0.93, marks=pytest.mark.soak),
        (COMMAND, 0.4, 0.75),
    ],
)
def test_what_presses_is_understood_in_the_next_pause_though_frames_are_lost(
    stream_id: int, loss: float, least: float, count: Callable[[int], int]
) -> None:
    """Of single frames 60 % arrive at 40 % loss, and the next pause is four seconds later."""
    seeds, in_time = range(count(2000)), 0
    for seed in seeds:
        sea = Sea(1500.0, seed, CarrierSenseSpec(), loss=loss, photo=True)
        at_s = 75 + random.Random(seed).uniform(0, 60)
        for early_s in (62, 68):  # the count is known
            sea.medium.at(early_s, partial(sea.medium.publish, 2, stream_id, b"before"))
        sea.medium.at(at_s, partial(sea.medium.publish, 2, stream_id, b"now"))
        sea.medium.run(until_s=at_s + 60)
        heard = [each for each in sea.medium.samples(1, stream_id) if each.value == b"now"]
        assert len(heard) == 1, seed
        # The next window, the way, four short frames.
        in_time += heard[0].received_at / NS_PER_S - at_s <= 4.6 + 1.0 + 4 * 0.35
    assert in_time >= least * len(seeds)


@pytest.mark.parametrize("priority", [Priority.REAL_TIME, Priority.INTERACTIVE_HIGH])
@pytest.mark.parametrize("addressed", [True, False])
def test_what_two_press_at_once_is_understood_of_both(
    addressed: bool, priority: Priority, count: Callable[[int], int]
) -> None:
    """Both aim at the pauses of node 1, which talks, or sends a photo that node 3 overhears."""
    for seed in range(count(400)):
        medium, at_s = _two_beside_one(seed, priority, addressed=addressed)
        medium.run(until_s=at_s + 100)
        heard = {each.source for each in medium.samples(1, STOP) if each.value == b"now"}
        assert heard == {2, 3}, seed


def _two_beside_one(
    seed: int, priority: Priority, *, addressed: bool
) -> tuple[VirtualNetwork, float]:
    """A network in which nodes 2 and 3 say something to 1 within half a second, and when."""
    rng = random.Random(seed)
    places = [0.0, -rng.uniform(300, 1500), rng.uniform(300, 1500)]
    nodes = [{"address": n, "position": [x, 0, 10]} for n, x in enumerate(places, 1)]
    qos = Qos(reliability=Reliability.RELIABLE, priority=priority)
    photo = msgspec.structs.replace(qos, priority=Priority.BACKGROUND)
    table = StreamTable(
        [
            TopicSpec(stream_id=TALK, name="talk", qos=Qos(depth=1000)),
            TopicSpec(
                stream_id=STOP, name="{node}/stop", qos=qos, publishers=(2, 3), subscribers=(1,)
            ),
            TopicSpec(stream_id=PHOTO, name="photo", qos=photo, publishers=(1,), subscribers=(2,)),
        ],
        nodes={1: "a", 2: "b", 3: "c"},
    )
    medium = VirtualNetwork(
        scenario_from_mapping({"nodes": nodes, "seed": seed, "channel": "none"}, source="test"),
        table,
        modem=Modem(addressed=addressed),
        rules=TransmitRules(access=CarrierSenseSpec()),
    )
    for at_s, node in ((0, 1), (10, 2), (20, 3)):  # they know each other
        medium.at(at_s, partial(medium.publish, node, TALK, b""))
    for _ in range(1000 if addressed else 0):
        medium.at(60, partial(medium.publish, 1, TALK, rng.randbytes(rng.randint(8, 40))))
    if not addressed:
        medium.at(60, partial(medium.publish, 1, PHOTO, random.Random(1).randbytes(20_000)))
    now_s = 75 + rng.uniform(0, 60)
    for node in (2, 3):
        medium.at(now_s + rng.uniform(0, 0.5), partial(medium.publish, node, STOP, b"now"))
    return medium, now_s


@pytest.mark.parametrize("access", [AlohaSpec(), CarrierSenseSpec()])
def test_own_emergency_is_on_the_air_after_one_frame(
    access: AccessSpec, count: Callable[[int], int]
) -> None:
    for seed in range(count(2000)):
        sea = Sea(1500.0, seed, access)
        at_s = 65 + random.Random(seed).uniform(0, 60)
        sea.medium.at(at_s, partial(sea.medium.publish, 1, EMERGENCY, bytes(12)))
        sea.medium.run(until_s=at_s + 5)
        on_air = min(at for at, each in sea.sent if EMERGENCY in each.streams)
        assert on_air - at_s <= FRAME_S + 0.1, seed


def test_no_node_transmits_for_more_than_four_seconds(count: Callable[[int], int]) -> None:
    profile = profile_named(DEFAULT_PROFILE)
    for seed in range(count(300)):
        sea = Sea(1000.0, seed)
        sea.medium.run(until_s=400)
        own = [(at, at + profile.airtime_s(each.size_bytes)) for at, each in sea.sent
               if each.node == 1]  # fmt: skip
        begun, last = own[0]
        for started, ended in own[1:]:
            begun = started if started - last >= 0.45 else begun
            last = ended
            assert ended - begun <= 4.0 + 1e-6, (seed, started)
        assert sum(ended - started for started, ended in own) > 0.6 * (own[-1][1] - 60.0)
