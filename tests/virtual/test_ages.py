"""Ages against the true time of the simulation: all sizes, distances, losses, restarts and waits.

A sample's value has a ticket, by which the test knows when it was made. Whatever the node at the
other end is told of its age, the truth is within the error that it is told with it; and where the
way is known, within a tenth of a second or 5 %.
"""

import random
from collections.abc import Callable
from functools import partial
from typing import Any, Final

import msgspec
import pytest

from tests.virtual.fleet import line
from tests.virtual.lineoffive import route
from zacoustic.core.base.qos import Qos, Reliability, Stamp
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.linktypes import LinkMetrics, ReceivedFrame
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.relay.flood import Flood
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.testing.virtual import VirtualNetwork

SMALL, DENSE, KEPT, LARGE, BACK = 1, 2, 3, 4, 5
NODES: Final = {1: "shore", 2: "auv1", 3: "buoy"}
NAV: Final = TypeSpec(
    name="Nav",
    fields=(
        FieldSpec(name="ticket", type="uint16"),
        FieldSpec(name="depth", type="float64", range=(0, 100), step=0.5),
    ),
)
ROUNDING_S: Final = 0.005


def fleet() -> StreamTable:
    aged = Qos(stamp=Stamp.AGE, depth=50)
    reliable = Qos(stamp=Stamp.AGE, depth=50, reliability=Reliability.RELIABLE)
    there: dict[str, Any] = {"publishers": (2,), "subscribers": (1,)}
    return StreamTable(
        [
            TopicSpec(stream_id=SMALL, name="small", qos=aged, **there),
            TopicSpec(
                stream_id=DENSE, name="nav", type_name="Nav", codec="dense", qos=aged, **there
            ),
            TopicSpec(stream_id=KEPT, name="kept", qos=reliable, journal=True, **there),
            TopicSpec(stream_id=LARGE, name="photo", qos=reliable, journal=True, **there),
            TopicSpec(stream_id=BACK, name="back", qos=reliable, publishers=(1,), subscribers=(2,)),
        ],
        types=TypeTable([NAV]),
        nodes=NODES,
    )


class Run:
    """Two nodes; the second one publishes, and the first one compares.

    Args:
        metres: How far apart they are.
        loss: Share of the frames that are lost.
        seed: Of everything.
        measures: Whether modems measure how long each frame was on its way.
        faults: Of the scenario.
        positions: Of more nodes than two, m to the east.
        links: Of the scenario.
        more: Arguments of `VirtualNetwork`.
    """

    def __init__(
        self,
        metres: float,
        loss: float,
        *,
        seed: int,
        measures: bool = True,
        faults: dict[str, Any] | None = None,
        positions: tuple[float, ...] = (),
        links: list[dict[str, Any]] | None = None,
        **more: Any,
    ) -> None:
        self.rng = random.Random(seed)
        self.made_ns: list[int] = []
        self.seen: list[tuple[SampleReceived, float]] = []
        """The samples, and their true ages as they arrived, s."""
        scenario = line(
            *(positions or (0, metres)),
            seed=seed,
            channel="none",
            loss={"frame": loss},
            faults=faults or {},
            links=links or [],
        )
        self.network = VirtualNetwork(
            scenario,
            fleet(),
            deliver=self._take,
            digest=False,
            build=partial(_measuring, metres / 1500.0 if measures else None),
            **more,
        )

    def publish(self, stream_id: int, ago_s: float = 0.0) -> None:
        """Publish a sample that was made some time ago."""
        if not self.network.is_running(2):
            return
        ticket = len(self.made_ns)
        self.made_ns.append(self.network.now - seconds_to_ns(ago_s))
        value: Any = ticket.to_bytes(2, "big")
        if stream_id == DENSE:
            value = {"ticket": ticket, "depth": 10.0}
        elif stream_id == LARGE:
            value += self.rng.randbytes(self.rng.randrange(100, 1500))
        self.network.apply(
            2,
            lambda engine, now: engine.publish(
                stream_id, value, now, queued_at=now - seconds_to_ns(ago_s)
            ),
        )

    def _take(self, address: int, event: object) -> None:
        if address != 1 or not isinstance(event, SampleReceived):
            return
        value = event.value
        ticket = value["ticket"] if isinstance(value, dict) else int.from_bytes(value[:2], "big")
        since_ns = self.network.local_ns(1) - event.received_at
        true_s = (self.network.now - since_ns - self.made_ns[ticket]) / NS_PER_S
        self.seen.append((event, true_s))

    def wrong(self, roundings: int = 1) -> list[str]:
        """Return what is further off than a tenth of a second and 5 % for each rounded age."""
        return [
            f"stream {event.stream_id}: {event.age_s} ± {event.age_error_s}, true {true_s:.3f}"
            for event, true_s in self.seen
            if event.age_s is None
            or abs(event.age_s - true_s) > max(0.1, 0.05 * roundings * true_s) + ROUNDING_S
        ]

    def understated(self) -> list[str]:
        """Return what is further off than its error says."""
        return [
            f"stream {event.stream_id}: {event.age_s} ± {event.age_error_s}, true {true_s:.3f}"
            for event, true_s in self.seen
            if event.age_s is not None
            and event.age_error_s is not None
            and abs(event.age_s - true_s) > event.age_error_s + ROUNDING_S
        ]


def _measuring(way_s: float | None, **settings: Any) -> Engine:
    """Make an engine whose modem measures how long each frame was on its way; None: it does not."""
    engine = Engine(**settings)
    take = engine.handle_frame

    def handle_frame(frame: ReceivedFrame, now: int, link: str | None = None) -> None:
        metrics = LinkMetrics(propagation_s=way_s)
        take(
            ReceivedFrame(
                frame_bytes=frame.frame_bytes,
                received_at=frame.received_at,
                source=frame.source,
                destination=frame.destination,
                metrics=metrics,
            ),
            now,
            link,
        )

    engine.handle_frame = handle_frame  # type: ignore[method-assign]
    return engine


@pytest.mark.parametrize("loss", [0.0, 0.3])
@pytest.mark.parametrize("metres", [500.0, 2000.0])
def test_ages_are_right_whatever_waits_and_is_lost(
    metres: float, loss: float, count: Callable[[int], int]
) -> None:
    arrived: dict[int, int] = {}
    for seed in range(count(40)):
        run = Run(metres, loss, seed=seed)
        at_s = 5.0
        while at_s < 1800.0:
            stream_id = run.rng.choice((SMALL, SMALL, DENSE, DENSE, KEPT, LARGE))
            ago_s = run.rng.choice(
                (0.0, 0.0, run.rng.uniform(0, 20), 10 ** run.rng.uniform(0, 4.4))
            )
            run.network.at(at_s, partial(run.publish, stream_id, ago_s))
            at_s += run.rng.expovariate(1 / 25)
        run.network.run(until_s=3600.0)
        assert run.wrong() == [], f"seed {seed}"
        assert run.understated() == [], f"seed {seed}"
        for event, _ in run.seen:
            arrived[event.stream_id] = arrived.get(event.stream_id, 0) + 1
    assert set(arrived) == {SMALL, DENSE, KEPT, LARGE}, "the test has tested something"


@pytest.mark.parametrize("reboots", [False, True])
@pytest.mark.parametrize("metres", [500.0, 2000.0])
def test_ages_are_right_after_hours_without_a_channel_and_restarts(
    metres: float, reboots: bool, count: Callable[[int], int]
) -> None:
    hours_s = 6 * 3600.0
    for seed in range(count(40)):
        run = Run(metres, 0.2, seed=seed)
        rng, network = run.rng, run.network
        network.at(60.0, partial(network.set_link, 2, up=False))
        for _ in range(12):
            at_s, ago_s = rng.uniform(100.0, hours_s), rng.choice((0.0, rng.uniform(0, 3000)))
            network.at(at_s, partial(run.publish, rng.choice((KEPT, KEPT, LARGE)), ago_s))
        for _ in range(3):
            down_s = rng.uniform(100.0, hours_s + 900.0)
            node = rng.choice((1, 2, 2))
            network.at(down_s, partial(network.crash, node, reboots=reboots))
            network.at(down_s + rng.uniform(1.0, 600.0), partial(network.start, node))
        network.at(hours_s, partial(network.set_link, 2, up=True))
        network.run(until_s=hours_s + 3 * 3600.0)
        assert len(run.seen) >= 9, f"seed {seed}: little came"
        assert run.wrong() == [], f"seed {seed}"
        assert run.understated() == [], f"seed {seed}"


def test_an_age_that_no_clock_tells_any_more_is_unknown() -> None:
    run = Run(500.0, 0.0, seed=1, faults={"clocks": [{"node": 2}]})
    run.network.at(5.0, partial(run.publish, KEPT))
    run.network.at(20.0, partial(run.network.set_link, 2, up=False))
    run.network.at(30.0, partial(run.publish, KEPT))
    run.network.at(40.0, partial(run.network.crash, 2, reboots=True))
    run.network.at(4000.0, partial(run.network.start, 2))
    run.network.at(4000.0, partial(run.network.set_link, 2, up=True))
    run.network.run(until_s=6000.0)
    first, second = (event for event, _ in run.seen)
    assert first.age_s is not None
    assert (second.age_s, second.age_error_s) == (None, None), "its host has no clock to trust"


@pytest.mark.parametrize("metres", [500.0, 2000.0])
def test_half_of_the_round_trip_is_the_way_where_modems_measure_none(
    metres: float, count: Callable[[int], int]
) -> None:
    for seed in range(count(40)):
        run = Run(metres, 0.1, seed=seed, measures=False)
        for number in range(12):
            run.network.at(10.0 + 150.0 * number, partial(run.network.publish, 1, BACK, b"do"))
        at_s = 5.0
        while at_s < 1800.0:
            run.network.at(at_s, partial(run.publish, run.rng.choice((SMALL, DENSE, KEPT, LARGE))))
            at_s += run.rng.expovariate(1 / 40)
        run.network.run(until_s=3600.0)
        assert run.understated() == [], f"seed {seed}"
        known = [event for event, _ in run.seen if event.received_at > seconds_to_ns(400)]
        run.seen = [each for each in run.seen if each[0] in known]
        assert run.wrong() == [], f"seed {seed}"


def over_hops(seed: int, loss: float, *, floods: bool) -> Run:
    """Return three nodes in a line, of which the last publishes to the first over the second."""
    streams = (SMALL, DENSE, KEPT, LARGE)
    name = "flood" if floods else "far"
    rules = TransmitRules(links_of_streams=dict.fromkeys(streams, name))
    if floods:
        rules = msgspec.structs.replace(rules, flood=Flood(hops=2, link="link"))
    else:
        rules = msgspec.structs.replace(rules, routes=(route(1, 3, 2),))
    plain = msgspec.structs.replace(rules, links_of_streams={})
    return Run(
        1500.0,
        loss,
        seed=seed,
        positions=(0.0, 3000.0, 1500.0),
        rules={1: rules, 2: rules, 3: rules if floods else plain},
        links=[{"from": a, "to": b, "loss": {"frame": 1.0}} for a, b in ((1, 2), (2, 1))],
    )


@pytest.mark.parametrize("floods", [False, True])
@pytest.mark.parametrize("loss", [0.0, 0.2])
def test_each_hop_adds_its_part(loss: float, floods: bool, count: Callable[[int], int]) -> None:
    arrived = 0
    for seed in range(count(40)):
        run = over_hops(seed, loss, floods=floods)
        at_s = 60.0
        while at_s < 3600.0:
            stream_id = run.rng.choice((SMALL, SMALL, DENSE, KEPT, KEPT, LARGE))
            ago_s = run.rng.choice((0.0, 10 ** run.rng.uniform(0, 3)))
            run.network.at(at_s, partial(run.publish, stream_id, ago_s))
            at_s += run.rng.expovariate(1 / 120)
        run.network.run(until_s=7200.0)
        assert run.wrong(roundings=2) == [], f"seed {seed}"
        assert run.understated() == [], f"seed {seed}"
        arrived += len(run.seen)
    assert arrived, "the test has tested something"
