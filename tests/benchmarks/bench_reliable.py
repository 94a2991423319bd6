"""Reliable topics: what they cost, how late samples are, and how soon an emergency is through.

Virtual time, S2C profile (64 bytes in 0.951 s), losses each way that the sender does not know.
Bytes and airtime are those of both ends, in units of one transmission of each sample without loss
and without acknowledgement. Run: ``python tests/benchmarks/bench_reliable.py [SEEDS] [--sealed]``;
ends with 1 when a figure is worse than was promised.

With a key (`--sealed`, which leaves records readable so that the urgent one is found), bytes and
airtime have no limit. The last two columns are the mean bytes of a seal, and what they are where
nothing is repeated.
"""

import argparse
import random
import statistics
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.virtual.sealed import SealedFleet, seal_bytes
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import NS_PER_S, ns_to_seconds
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome, Event, SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.seal.spec import Mode
from zacoustic.testing.virtual import Modem, VirtualNetwork

SEEDS: Final = 20
MESSAGES: Final = 300
_PERIOD_S: Final = 10.0
_PAYLOAD_BYTES: Final = 12
_RECORD_BYTES: Final = 2 + _PAYLOAD_BYTES
_DISTANCE_M: Final = 1500.0
_ORDERS: Final = 1
_BULK: Final = 2
_OBJECT: Final = 3
_OBJECT_BYTES: Final = 10_240
_WARM_UP_S: Final = 60.0

WORST_BYTES: Final = 1.75
WORST_AIRTIME: Final = 2.3
WORST_P95_S: Final = 8.0
WORST_UNLOADED_S: Final = 0.050
"""Over airtime and one-way delay."""
LEAST_URGENT: Final = 0.97
URGENT_WITHIN_S: Final = 3.0
URGENT_WAIT_S: Final = 0.1
"""Beyond the frame that is on the air."""
URGENT_WINDOW_S: Final = 4.5
"""Until the next listen window of somebody else's object."""


class Cost(msgspec.Struct, frozen=True):
    """What one run gave."""

    transmitted_bytes: float
    airtime: float
    latencies_s: tuple[float, ...]
    beyond_s: float
    """Longest latency beyond airtime and one-way delay."""
    delivered: int
    frames: int
    """Of both nodes."""
    sealed_bytes: int
    """Bytes of seals."""
    expected_seals: float
    """Bytes that seals would take if no frame were repeated."""


class Sea:
    """Two nodes, 1500 m apart.

    Args:
        seed: Of the losses.
        loss: Share of the frames that is lost, each way.
        priority: Of the orders.
        senses_carrier: The modems do; otherwise access is ALOHA.
        sealed: The nodes have a key.
    """

    def __init__(
        self,
        seed: int,
        loss: float,
        priority: Priority = Priority.DATA,
        *,
        senses_carrier: bool = True,
        sealed: bool = False,
    ) -> None:
        reliable = Qos(reliability=Reliability.RELIABLE, depth=40, priority=priority)
        orders = TopicSpec(stream_id=_ORDERS, name="o", publishers=(1,), subscribers=(2,))
        bulk = TopicSpec(stream_id=_BULK, name="b", qos=Qos(depth=2000), subscribers=(2,))
        photo = TopicSpec(
            stream_id=_OBJECT,
            name="p/{node}",
            qos=Qos(reliability=Reliability.RELIABLE, priority=Priority.BACKGROUND),
        )
        table = StreamTable(
            [msgspec.structs.replace(orders, qos=reliable), bulk, photo],
            nodes={1: "a", 2: "b"},
        )
        nodes = [
            {"address": 1, "position": [0, 0, 10]},
            {"address": 2, "position": [_DISTANCE_M, 0, 10]},
        ]
        medium = scenario_from_mapping(
            {"seed": seed, "channel": "none", "nodes": nodes}, source="bench"
        )
        self.loss = 0.0
        self._rng = random.Random(seed)
        self.published_at: dict[bytes, int] = {}
        self.arrived_at: dict[bytes, int] = {}
        self.delivered = 0
        self.fleet = SealedFleet(mode=Mode.AUTHENTICATE) if sealed else None
        self.network = VirtualNetwork(
            medium,
            table,
            modem=Modem(senses_carrier=senses_carrier),
            deliver=self._take,
            disturb=self._disturb,
            digest=False,
            build=self.fleet or Engine,
        )
        for at_s in (1, 20, 40):  # until both know each other, and the count
            self.network.at(at_s, partial(self.publish, _ORDERS, b"%d" % at_s))
        self.network.at(_WARM_UP_S - 1, lambda: setattr(self, "loss", loss))

    def publish(self, stream_id: int, payload: bytes) -> None:
        """Publish a sample from node 1."""
        self.published_at[payload] = self.network.now
        self.network.publish(1, stream_id, payload)

    def airtime_s(self, record_bytes: int) -> float:
        """Airtime of a frame with that much in it."""
        return ns_to_seconds(self.network.capabilities(1).airtime_ns(record_bytes))

    def latency_s(self, payload: bytes) -> float:
        """Time from `publish` to the event at the other node; infinity if there was none."""
        arrived_at = self.arrived_at.get(payload)
        if arrived_at is None:
            return float("inf")
        return ns_to_seconds(arrived_at - self.published_at[payload])

    def _take(self, address: int, event: Event) -> None:
        if isinstance(event, SampleReceived):
            self.arrived_at.setdefault(event.value, self.network.now)
        elif isinstance(event, DeliveryEnded) and event.outcome is DeliveryOutcome.DELIVERED:
            self.delivered += 1

    def _disturb(self, source: int, node: int, now: int) -> Sequence[float]:
        return () if self._rng.random() < self.loss else (0.0,)


def periodic(seed: int, loss: float, *, sealed: bool) -> Cost:
    """Measure messages that come one by one."""
    sea = Sea(seed, loss, sealed=sealed)
    payloads = [number.to_bytes(_PAYLOAD_BYTES, "big") for number in range(MESSAGES)]
    for number, payload in enumerate(payloads):
        at_s = _WARM_UP_S + number * _PERIOD_S
        sea.network.at(at_s, partial(sea.publish, _ORDERS, payload))
    sea.network.run(until_s=_WARM_UP_S - 1)
    before = _spent(sea)
    sea.network.run(until_s=_WARM_UP_S + MESSAGES * _PERIOD_S + 600)
    spent_bytes, spent_s = (after - then for after, then in zip(_spent(sea), before, strict=True))
    latencies_s = tuple(sea.latency_s(payload) for payload in payloads)
    frames, seals = seal_bytes(sea.network)
    airtime_s, delay_s = sea.airtime_s(_RECORD_BYTES), _DISTANCE_M / 1500
    return Cost(
        spent_bytes / MESSAGES / _RECORD_BYTES,
        spent_s / MESSAGES / airtime_s,
        latencies_s,
        max(latencies_s) - airtime_s - delay_s,
        sea.delivered - 3,
        frames,
        seals,
        sea.fleet.expected_bytes * frames if sea.fleet is not None else 0.0,
    )


def _spent(sea: Sea) -> tuple[float, float]:
    stats = list(sea.network.stats())
    return (
        float(sum(each.bytes_transmitted for each in stats)),
        sum(each.airtime_ns for each in stats) / NS_PER_S,
    )


def emergency(
    seed: int,
    loss: float,
    *,
    queued: int = 0,
    object_from: int | None = None,
    sealed: bool,
) -> tuple[float, float]:
    """Measure one urgent sample of node 1 with ALOHA.

    Args:
        seed: Of losses and instants.
        loss: Share of the frames that is lost.
        queued: Messages that wait before it.
        object_from: Node that is sending an object.
        sealed: The nodes have a key.

    Returns:
        When it was on the air, and when it arrived, s.
    """
    sea = Sea(seed, loss, Priority.REAL_TIME, senses_carrier=False, sealed=sealed)
    begin_s = _WARM_UP_S + random.Random(seed).uniform(10, 60)
    started: list[int] = []

    def crowd() -> None:
        for number in range(queued):
            sea.publish(_BULK, b"%050d" % number)
        if object_from is not None:
            sea.network.publish(object_from, _OBJECT, bytes(_OBJECT_BYTES))

    def alarm() -> None:
        sea.publish(_ORDERS, b"surface now!")
        sea.network.apply(1, lambda engine, now: None)

    sea.network.at(_WARM_UP_S - 1, crowd)
    sea.network.at(begin_s, alarm)
    engine = sea.network.engine(1)
    poll = engine.poll_transmit

    def watch(now: int) -> object:
        transmission = poll(now)
        if transmission is not None and b"surface now!" in transmission.frame_bytes:
            started.append(sea.network.now)
        return transmission

    engine.poll_transmit = watch  # type: ignore[method-assign, assignment]
    sea.network.run(until_s=begin_s + 60)
    alarm_at = sea.published_at[b"surface now!"]
    return ns_to_seconds(started[0] - alarm_at), sea.latency_s(b"surface now!")


def main() -> int:
    """Print the tables; returns 1 when something is worse than it was."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("seeds", type=int, nargs="?", default=SEEDS)
    parser.add_argument("--sealed", action="store_true", help="the nodes have a key")
    arguments = parser.parse_args()
    seeds, sealed = arguments.seeds, arguments.sealed
    kept = True
    print(f"{MESSAGES} messages of {_PAYLOAD_BYTES} bytes, one per {_PERIOD_S:g} s, 1 s one way")
    print("loss  bytes  airtime  p50 s  p95 s  p99 s  delivered" + "   seal  expected" * sealed)
    for loss in (0.0, 0.1, 0.3, 0.5):
        costs = [periodic(seed, loss, sealed=sealed) for seed in range(seeds)]
        spent = statistics.fmean(cost.transmitted_bytes for cost in costs)
        airtime = statistics.fmean(cost.airtime for cost in costs)
        latencies_s = sorted(each for cost in costs for each in cost.latencies_s)
        p50, p95, p99 = (latencies_s[int(len(latencies_s) * share)] for share in (0.5, 0.95, 0.99))
        delivered = sum(cost.delivered for cost in costs)
        kept = kept and delivered == seeds * MESSAGES
        print(
            f"{loss:4.0%}  {spent:5.2f}  {airtime:7.2f}  {p50:5.2f}  {p95:5.2f}  {p99:5.2f}  "
            f"{delivered / seeds / MESSAGES:9.2%}" + (_seals(costs) if sealed else "")
        )
        if loss == 0.3:
            is_cheap = spent <= WORST_BYTES and airtime <= WORST_AIRTIME
            kept = kept and (is_cheap or sealed)
            kept = kept and p95 <= WORST_P95_S
        if loss == 0 and not sealed:
            beyond_s = max(cost.beyond_s for cost in costs)
            kept = kept and beyond_s <= WORST_UNLOADED_S
            print(f"      at most {beyond_s * 1000:.1f} ms beyond airtime and one-way delay")
    print()
    print("an urgent sample over 1500 m      on the air after s  arrived within 3 s")
    frame_s = Sea(0, 0).airtime_s(64)
    for name, run, most_s, least in (
        (
            "quiet channel, 40 % loss",
            partial(emergency, sealed=sealed, loss=0.4),
            0.0,
            LEAST_URGENT,
        ),
        ("behind 1000 messages", partial(emergency, sealed=sealed, loss=0, queued=1000), None, 0.0),
        (
            "during an outgoing object",
            partial(emergency, sealed=sealed, loss=0, object_from=1),
            None,
            0.0,
        ),
        (
            "during an incoming one",
            partial(emergency, sealed=sealed, loss=0, object_from=2),
            URGENT_WINDOW_S,
            0.0,
        ),
    ):
        runs = [run(seed) for seed in range((50 if least else 10) * seeds)]
        waited_s = max(run[0] for run in runs)
        share = statistics.fmean(run[1] <= URGENT_WITHIN_S for run in runs)
        print(f"{name:32}  {waited_s:18.2f}  {share:18.1%}")
        kept = kept and waited_s <= (frame_s + URGENT_WAIT_S if most_s is None else most_s)
        kept = kept and share >= least
    return 0 if kept else 1


def _seals(costs: Sequence[Cost]) -> str:
    frames = sum(cost.frames for cost in costs)
    seal = sum(cost.sealed_bytes for cost in costs) / frames
    return f"  {seal:5.2f}  {sum(cost.expected_seals for cost in costs) / frames:8.2f}"


if __name__ == "__main__":
    sys.exit(main())
