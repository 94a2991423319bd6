"""Reliable topics in any weather: nothing lost, doubled, reordered or altered, whoever dies.

Each seed is a scenario of two to four nodes that speak at random or in a rhythm: loss to 60 %, in
bursts or not, other in each direction; repetitions, damage where the modem does not check,
blackouts to half an hour, full disks, and up to ten crashes of each node. Then two hours of calm,
in which all has to come to its end: a thousand samples of up to four nodes that do not sense each
other's carrier are an hour of ALOHA.
"""

import random
from collections import Counter
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final

import pytest

from zacoustic.channel.profiles import DEFAULT_PROFILE, profile_named
from zacoustic.channel.scenario import Scenario, scenario_from_mapping
from zacoustic.core.base.qos import Priority, Qos, Reliability, Stamp
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome, DeliveryStored, Event
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.testing.scenarios import (
    INVARIANTS,
    Arrived,
    Checker,
    Lane,
    Publication,
    RandomScenario,
    run_scenario,
)
from zacoustic.testing.scenarios.randomscenario import cast_of, opaque
from zacoustic.testing.virtual import Modem

if TYPE_CHECKING:
    from zacoustic.testing.scenarios import Run

SCENARIOS: Final = 2000
BLOCKS: Final = range(10)
_CALM_S: Final = 7200.0
_BLACKOUT_S: Final = 1800.0
_HEAD_BYTES: Final = 3 + 6 + 1 + 1 + 1 + 1
"""TAG, SYNC, stream id, a wildcard, number, age."""


class OneOutcome(Checker):
    """A sample ends once; it is stored at most once, and not after its end.

    A crash may come before the journal knows that an end was told: then it is told again.
    """

    def __init__(self) -> None:
        super().__init__()
        self._published: dict[tuple[int, int], Publication] = {}
        self._ended: dict[int, tuple[DeliveryOutcome, int]] = {}
        self._crashes = Counter[int]()
        self._stored: set[int] = set()

    def published(self, publication: Publication) -> None:
        """Remember it by its delivery id: later lives go on counting from what was kept."""
        self._published[publication.node, publication.result] = publication

    def crashed(self, node: int, at: int) -> None:
        """Another life begins."""
        self._crashes[node] += 1

    def happened(self, node: int, event: Event, at: int) -> None:
        """Look for a second end, and for an end of nothing."""
        if not isinstance(event, DeliveryEnded | DeliveryStored):
            return
        publication = self._published.get((node, event.delivery_id))
        if publication is None:
            self.violations.append(f"{at / NS_PER_S:.3f} s: {event} is about nothing")
            return
        number, told = publication.number, f"{at / NS_PER_S:.3f} s: {event} is about {publication}"
        if isinstance(event, DeliveryStored):
            if number in self._stored or number in self._ended:
                self.violations.append(f"stored too late or twice: {told}")
            self._stored.add(number)
            return
        life, former = self._crashes[node], self._ended.get(number)
        if former is not None and (former[0] is not event.outcome or former[1] == life):
            self.violations.append(f"ended twice: {told}")
        self._ended[number] = event.outcome, life


class LastArrives(Checker):
    """The last sample of a key that may live for ever arrives, whatever the depth."""

    def begins(self, scenario_run: "Run") -> None:
        """Remember who is there."""
        self._scenario_run = scenario_run
        self._lanes: dict[tuple[int, ...], list[Publication]] = {}
        self._gone: set[int] = set()
        self._got: set[tuple[int, int]] = set()

    def published(self, publication: Publication) -> None:
        """It is the last one now."""
        lane = (publication.node, publication.stream.stream_id, *publication.instance)
        self._lanes.setdefault(lane, []).append(publication)

    def received(self, arrived: Arrived) -> None:
        """It has come."""
        self._got.add((arrived.node, arrived.publication.number))

    def crashed(self, node: int, at: int) -> None:
        """What was not written down is gone."""
        journal = self._scenario_run.network.journal(node)
        for lane, publications in self._lanes.items():
            if lane[0] == node:
                self._gone |= {
                    each.number
                    for each in publications
                    if not (each.stream.spec.journal and journal.is_journalled(each.written))
                }

    def ends(self, scenario_run: "Run") -> None:
        """Look for the last one of each key."""
        for lane, publications in self._lanes.items():
            stream = publications[-1].stream
            if stream.qos.lifespan_s is not None:
                continue
            there = [each for each in publications if each.number not in self._gone]
            if not there or (not stream.spec.journal and there[-1] is not publications[-1]):
                continue
            for node in scenario_run.casts:
                lacks = (node, there[-1].number) not in self._got
                if node != lane[0] and stream.may_subscribe(node) and lacks:
                    self.violations.append(f"node {node} never got the last: {there[-1]}")


def draw_reliable_scenario(seed: int) -> RandomScenario:
    """Draw a scenario that has reliable topics only."""
    rng = random.Random(f"reliable {seed}")
    count = rng.choice((2, 2, 2, 3, 4))
    busy_s = rng.choice((300.0, 900.0, 2700.0))
    room_bytes = rng.choice((16, 32, 64, 512))
    addressed, checked, framed = rng.choice(
        ((True, True, True),) * 3 + ((True, False, True), (False, False, True), (False,) * 3)
    )
    overhead = 2 * (not addressed) + 4 * (not checked) + 3 * (not framed)
    mtu_bytes = min(max(64, room_bytes), room_bytes + overhead)
    modem = Modem(
        addressed=addressed,
        checked=checked,
        framed=framed,
        senses_carrier=rng.random() < 0.5,
        mtu_bytes=mtu_bytes,
    )
    names = {address: f"n{address}" for address in range(1, count + 1)}
    cast = cast_of(_lanes(rng, count, mtu_bytes - overhead), names)
    return RandomScenario(
        seed=seed,
        scenario=_scenario(rng, seed, count, busy_s, modem),
        casts=dict.fromkeys(names, cast),
        modem=modem,
        busy_s=busy_s,
        calm_s=_CALM_S,
        pause_s=rng.choice((20.0, 60.0, 120.0)) * count,
        beat_s=rng.choice((None, None, 7.0, 15.0, 40.0)),
    )


def _lanes(rng: random.Random, count: int, room_bytes: int) -> dict[int, Lane]:
    largest = min(50, room_bytes - _HEAD_BYTES)
    lanes = {}
    for stream_id in range(1, rng.choice((1, 2, 3)) + 1):
        parts = rng.random() < 0.3
        everybody = count > 2 and rng.random() < 0.5
        qos = Qos(
            reliability=Reliability.RELIABLE,
            priority=rng.choice((Priority.DATA, Priority.INTERACTIVE_HIGH, Priority.REAL_TIME)),
            depth=rng.choice((1, 4, 40, 1000)),
            lifespan_s=rng.choice((None, None, 60.0)),
            stamp=rng.choice((Stamp.NONE, Stamp.AGE)),
        )
        spec = TopicSpec(
            stream_id=stream_id,
            name=f"s{stream_id}/{{node}}" + ("/{part}" if parts else ""),
            wildcards=(Wildcard(name="part", values=("a", "b", "c")),) if parts else (),
            subscribers=None if everybody else (rng.randint(1, count),),
            publishers=None if rng.random() < 0.5 else (rng.randint(1, count),),
            qos=qos,
            journal=rng.random() < 0.7,
        )
        lanes[stream_id] = Lane(spec, opaque(rng.randint(3, max(3, largest))))
    return lanes


def _scenario(rng: random.Random, seed: int, count: int, busy_s: float, modem: Modem) -> Scenario:
    addresses = range(1, count + 1)
    medium: dict[str, Any] = {
        "seed": seed,
        "channel": "none",
        "profile": "ideal" if (modem.mtu_bytes or 0) > 64 else DEFAULT_PROFILE,
        "nodes": [
            {"address": each, "position": [rng.uniform(-800, 800), rng.uniform(-800, 800), 10]}
            for each in addresses
        ],
        "links": [
            {"from": source, "to": target, "loss": _loss(rng, busy_s)}
            for source in addresses
            for target in addresses
            if source != target
        ],
    }
    bare = scenario_from_mapping(medium, source=f"reliable {seed}")
    link = modem.capabilities(profile_named(bare.profile), bare.farthest_s)
    settling_s = 4 * (link.airtime_ns(link.mtu_bytes) / NS_PER_S + link.propagation_s)
    medium["faults"] = {
        "corrupt": 0.0 if modem.checked else rng.choice((0.0, 0.05, 0.3)),
        "duplicate": rng.choice((0.0, 0.1, 0.4)),
        "duplicate_after_s": [0.0, 0.9 * settling_s],
        "jitter_s": rng.choice((0.0, 0.0, 0.05, 0.1 * settling_s)),
        "blackouts": [
            {**_span(rng, busy_s, rng.choice((30.0, 300.0, _BLACKOUT_S))), "node": node}
            for node in addresses
            if rng.random() < 0.3
        ],
        "crashes": _crashes(rng, addresses, busy_s),
        "journal": {
            "commit_s": rng.choice((0.0, 0.005, 0.05, 1.0)),
            "fails": [
                {**_span(rng, busy_s, 200.0), "node": node}
                for node in addresses
                if rng.random() < 0.1
            ],
        },
        "until_s": busy_s,
    }
    return scenario_from_mapping(medium, source=f"reliable {seed}")


def _loss(rng: random.Random, busy_s: float) -> dict[str, Any]:
    share = rng.uniform(0, rng.choice((0.0, 0.3, 0.6)))
    loss: dict[str, Any] = {"frame": share, "until_s": busy_s}
    if rng.random() < 0.5:
        loss["burst_frames"] = max(1.0, share / (1 - share)) * rng.uniform(1, 10)
    return loss


def _crashes(rng: random.Random, addresses: range, busy_s: float) -> list[dict[str, Any]]:
    most = rng.choice((0, 2, 10, 10))
    return [
        {
            "node": address,
            "at_s": sorted(rng.uniform(0, busy_s) for _ in range(rng.randint(most // 2, most))),
            "restart_after_s": rng.choice((0, 1, 20, 200)),
            "reboots": rng.random() < 0.5,
        }
        for address in addresses
        if most
    ]


def _span(rng: random.Random, busy_s: float, longest_s: float) -> dict[str, float]:
    begin_s = rng.uniform(0, busy_s - 1)
    return {"from_s": begin_s, "to_s": min(busy_s, begin_s + rng.uniform(1, longest_s))}


@pytest.mark.parametrize("number", BLOCKS)
def test_nothing_is_lost_doubled_reordered_or_altered(
    count: Callable[[int], int], number: int
) -> None:
    for seed in range(number, count(SCENARIOS), len(BLOCKS)):
        told = run_scenario(draw_reliable_scenario(seed), (*INVARIANTS, OneOutcome, LastArrives))
        violations = told.violations
        assert not violations, f"seed {seed}: {len(violations)} complaints, {violations[0]}"


def test_scenarios_are_as_bad_as_they_promise() -> None:
    scenarios = [draw_reliable_scenario(seed) for seed in range(300)]
    faults = [drawn.scenario.faults for drawn in scenarios]
    assert max(len(spec.at_s) for each in faults for spec in each.crashes) == 10
    assert max(each.to_s - each.from_s for one in faults for each in one.blackouts) > 1500
    assert max(each.corrupt for each in faults) > 0.2
    losses = [link.loss for drawn in scenarios for link in drawn.scenario.links if link.loss]
    assert max(loss.frame for loss in losses) > 0.55
    assert {len(drawn.casts) for drawn in scenarios} == {2, 3, 4}
    specs = [lane.spec for drawn in scenarios for lane in drawn.casts[1].lanes.values()]
    assert {spec.qos.depth for spec in specs} == {1, 4, 40, 1000}


@pytest.mark.parametrize("seed", [169, 841])
def test_answers_of_several_receivers_do_not_meet_for_ever(seed: int) -> None:
    # Their patience ended at the same instant, or they waited for the same pause.
    assert not run_scenario(draw_reliable_scenario(seed), (*INVARIANTS, LastArrives)).violations


@pytest.mark.parametrize("seed", [331, pytest.param(462, marks=pytest.mark.soak)])
def test_four_nodes_with_backlogs_leave_each_other_room_for_answers(seed: int) -> None:
    # Repetitions went on while the answers of other receivers were awaited. Long rows of
    # emergencies went without a pause. So two nodes transmitted for ever, and heard nothing.
    assert not run_scenario(draw_reliable_scenario(seed), (*INVARIANTS, LastArrives)).violations
