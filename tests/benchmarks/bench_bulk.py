"""What large samples get out of burst data, beside a raw client that fills the modem's own buffer.

Two emulated S2C modems at the loudest source level, in virtual time. How a modem treats burst data
is a guess (`zacoustic_evologics.emulator.burst_guess`), so every row is over several guesses; both
clients get the same modems and the same loss, in one run. The raw client knows nothing but the AT
commands: it gives 1024 bytes after 1024 bytes, waits when the buffer is full, gives again what
FAILED names, and is ready when all of it has arrived. The engine is ready when the other engine has
handed the sample to its application: agreement between the nodes, the digest, answers and pauses
are in its time.

- *goodput*: the share of the raw client's bit rate, mean and least.
- *reports*: both nodes publish a report of 20 bytes every `--period` seconds meanwhile: how many
  arrive, and their delay, beside the same without any large sample; *beyond* is the delay without
  the time that the frames take which were under way when it was published.
- *real_time*: either node publishes a real_time sample now and then meanwhile: their delay.
- *alarms*: a third node, as far from both, has reliable real_time samples for one of them.
- *progress*: a photo of 13 kB, and what the console of `make auv` shows of it from the third second
  on: its bar beside the share of the time that has passed, and the foretold end, in parts of the
  whole time. Nothing is known before the first train has come, and no end before the second has.

Must hold: in the mean 0.85 of the raw client, 0.7 in each guess; at the 95th percentile reports 6 s
beyond what was under way, real_time samples 6 s, alarms 10 s; of 1000 alarms 999 in 30 s, and in
60 s if more than 20 % of the frames are lost; at most 5 % of the reports lost.

    python tests/benchmarks/bench_bulk.py [--guesses N] [--kib N …] [--json] [--strict]
"""

import argparse
import json
import random
import statistics
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Final

import msgspec

# Run as a file, the project's root is not on the path.
sys.path.insert(0, str(Path(__file__).parents[2]))

from examples.auv.linkwatch import LinkWatch
from tests.links.evologics.driver.crew import CrewedSea, CrewNode
from tests.links.evologics.emulator.sea import Host
from tests.links.evologics.emulator.sea import Sea as HostSea
from zacoustic.channel.faults.loss import LossSpec
from zacoustic.channel.scenario import NodeSpec, Scenario
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.clock import ns_to_seconds, seconds_to_ns
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.linktypes import Service
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic_evologics.at.notifications import Delivered, Failed, Recv
from zacoustic_evologics.config import EvologicsConfig
from zacoustic_evologics.emulator import BurstGuess, EmulatedFleet, burst_guess, scenario_of

PHOTO, REPORT, URGENT, ALARM = 10, 11, 12, 13
MEAN_LIMIT: Final = 0.85
LEAST_LIMIT: Final = 0.7
DELAY_LIMIT_S: Final = 6.0
ALARM_LIMIT_S: Final = 10.0
LOST_LIMIT: Final = 0.05
PROGRESS_LIMIT: Final = 0.2
_PACKET_BYTES: Final = 1024
_LIMIT_S: Final = 20_000.0
_CHANNELS: Final = 12
"""With losses each guess has so many channels: one lost train more or less is luck."""
_SHOWN_FROM_S: Final = 3.0
_SHOWN_EACH_S: Final = 0.5


class Goodput(msgspec.Struct, frozen=True, kw_only=True):
    """One row: the two clients over all guesses."""

    kib: int
    distance_m: float
    loss: float
    raw_bit_per_s: list[float]
    engine_bit_per_s: list[float]

    @property
    def shares(self) -> list[float]:
        """The engine's part of the raw client's bit rate, by guess."""
        pairs = zip(self.engine_bit_per_s, self.raw_bit_per_s, strict=True)
        return [engine / raw for engine, raw in pairs]


class Progress(msgspec.Struct, frozen=True, kw_only=True):
    """What is shown of a photo, over all guesses: errors in parts of its whole time."""

    distance_m: float
    loss: float
    took_s: list[float]
    bar: list[float]
    foretold: list[float]

    @staticmethod
    def honest(errors: Sequence[float]) -> float:
        """Return which share of the instants is right within `PROGRESS_LIMIT`."""
        return sum(abs(each) <= PROGRESS_LIMIT for each in errors) / max(1, len(errors))


class Small(msgspec.Struct, frozen=True, kw_only=True):
    """Small samples while a large one is under way, or without one."""

    what: str
    published: int
    delays_s: list[float]
    beyond_s: list[float] = []
    limit_s: float = DELAY_LIMIT_S
    last_limit_s: float | None = None
    """That of 999 of 1000; None: there is none."""

    @property
    def judged_s(self) -> float:
        """The delay at the 95th percentile that is judged, s."""
        return self.percentile_s(0.95, beyond=bool(self.beyond_s))

    @property
    def holds(self) -> bool:
        """Whether its limits hold."""
        is_late = self.last_limit_s is not None and self.percentile_s(0.999) > self.last_limit_s
        lost = 1 - len(self.delays_s) / max(1, self.published)
        return self.judged_s <= self.limit_s and lost <= LOST_LIMIT and not is_late

    def percentile_s(self, share: float, *, beyond: bool = False) -> float:
        """Return a percentile of the delays, or of what is beyond the frames under way, s."""
        ordered = sorted(self.beyond_s if beyond else self.delays_s) or [float("nan")]
        return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def main() -> int:
    """Measure, print, and say whether the limits hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--guesses", type=int, default=30, help="drawn emulators")
    parser.add_argument("--kib", type=int, nargs="*", default=[32, 256], help="sizes")
    parser.add_argument("--distance", type=float, nargs="*", default=[500.0, 1500.0], help="m")
    parser.add_argument("--loss", type=float, nargs="*", default=[0.0, 0.2], help="shares")
    parser.add_argument("--period", type=float, default=30.0, help="of the reports, s")
    parser.add_argument("--json", action="store_true", help="one JSON object")
    parser.add_argument("--strict", action="store_true", help="exit with 1 when a limit is missed")
    arguments = parser.parse_args()
    rows = [
        goodput(kib, distance_m, loss, arguments.guesses)
        for kib in arguments.kib
        for distance_m in arguments.distance
        for loss in arguments.loss
    ]
    small = [
        each
        for distance_m in arguments.distance
        for each in small_samples(distance_m, arguments.guesses, arguments.period)
    ]
    small += [
        alarms(distance_m, loss, arguments.guesses, end)
        for distance_m in arguments.distance
        for loss in sorted({*arguments.loss, 0.4})
        for end in (1, 2)
    ]
    shown = [
        progress(distance_m, loss, arguments.guesses)
        for distance_m in arguments.distance
        for loss in arguments.loss
    ]
    verdicts = _judge(rows, small)
    if arguments.json:
        told = [msgspec.to_builtins(row) for row in (*rows, *small, *shown)]
        print(json.dumps({"rows": told, "holds": verdicts}))
    else:
        report(rows, small, shown, verdicts)
    return 1 if arguments.strict and not all(verdicts.values()) else 0


def _judge(rows: Sequence[Goodput], small: Sequence[Small]) -> dict[str, bool]:
    shares = [share for row in rows for share in row.shares]
    during = [each for each in small if "without" not in each.what]
    return {
        f"goodput: {MEAN_LIMIT:g} of the raw client in the mean": (
            statistics.fmean(shares) >= MEAN_LIMIT
        ),
        f"goodput: {LEAST_LIMIT:g} in each guess": min(shares) >= LEAST_LIMIT,
        "small samples: each in its time": all(each.holds for each in during),
    }


def report(
    rows: Sequence[Goodput],
    small: Sequence[Small],
    shown: Sequence[Progress],
    verdicts: dict[str, bool],
) -> None:
    """Print the tables."""
    print(f"{'':24}{'raw bit/s':>11}{'engine':>9}{'mean':>7}{'least':>7}  least guesses")
    for row in rows:
        shares = row.shares
        worst = sorted(range(len(shares)), key=shares.__getitem__)[:3]
        print(
            f"{row.kib:4d} KiB {row.distance_m:5.0f} m {row.loss:4.0%}  "
            f"{statistics.fmean(row.raw_bit_per_s):11.0f}"
            f"{statistics.fmean(row.engine_bit_per_s):9.0f}"
            f"{statistics.fmean(shares):7.2f}{min(shares):7.2f}  "
            + ", ".join(f"{guess}: {shares[guess]:.2f}" for guess in worst)
        )
    print(
        f"\n{'small samples':52}{'sent':>6}{'arrived':>9}{'p50 s':>8}{'p95 s':>8}{'99.9 %':>8}"
        f"{'beyond':>8}"
    )
    for each in small:
        arrived = len(each.delays_s) / max(1, each.published)
        print(
            f"{each.what:52}{each.published:6d}{arrived:9.0%}"
            f"{each.percentile_s(0.5):8.1f}{each.percentile_s(0.95):8.1f}"
            f"{each.percentile_s(0.999):8.1f}"
            + (f"{each.judged_s:8.1f}" if each.beyond_s else " " * 8)
            + ("" if each.holds or "without" in each.what else "  MISSED")
        )
    print(f"\nprogress of 13 kB, right within {PROGRESS_LIMIT:.0%}     took s    bar  foretold end")
    for photo in shown:
        took_s = statistics.median(photo.took_s)
        print(
            f"{photo.distance_m:5.0f} m {photo.loss:4.0%} lost{'':21}{took_s:8.1f}"
            f"{photo.honest(photo.bar):7.0%}{photo.honest(photo.foretold):14.0%}"
        )
    for limit, holds in verdicts.items():
        print(f"{limit}: {'holds' if holds else 'MISSED'}")


def goodput(kib: int, distance_m: float, loss: float, guesses: int) -> Goodput:
    """Send one object with both clients, over all guesses."""
    raw: list[float] = []
    engine: list[float] = []
    for seed in range(guesses):
        guess = burst_guess(seed)
        content = random.Random(seed).randbytes(kib << 10)
        raw_s = engine_s = 0.0
        channels = _CHANNELS if loss else 1
        for channel in range(channels):
            scenario = _scenario(distance_m, loss, seed + 1000 * channel)
            raw_s += RawClient(scenario, guess, content).run()
            engine_s += EngineClient(scenario, guess).send(content)
        raw.append(8 * len(content) * channels / raw_s)
        engine.append(8 * len(content) * channels / engine_s)
    return Goodput(
        kib=kib,
        distance_m=distance_m,
        loss=loss,
        raw_bit_per_s=raw,
        engine_bit_per_s=engine,
    )


def small_samples(distance_m: float, guesses: int, period_s: float) -> list[Small]:
    """Publish reports and real_time samples with and without a large sample under way."""
    results: list[Small] = []
    for has_object in (False, True):
        clients = []
        for seed in range(guesses):
            client = EngineClient(_scenario(distance_m, 0.0, seed), burst_guess(seed))
            client.measure(
                random.Random(seed).randbytes(128 << 10) if has_object else b"", period_s
            )
            clients.append(client)
        suffix = "during a large sample" if has_object else "without a large sample"
        for stream_id, name in ((REPORT, "reports"), (URGENT, "real_time")):
            for source, end in ((1, "its publisher"), (2, "its subscriber")):
                results.append(
                    Small(
                        what=f"{distance_m:.0f} m, {name} of {end}, {suffix}",
                        published=sum(each.published[source, stream_id] for each in clients),
                        delays_s=[
                            delay for each in clients for delay in each.delays_s[source, stream_id]
                        ],
                        beyond_s=[
                            beyond
                            for each in clients
                            for beyond in each.beyond_s[source]
                            if has_object and stream_id == REPORT
                        ],
                    )
                )
    return results


def alarms(distance_m: float, loss: float, guesses: int, end: int) -> Small:
    """Let a third node have alarms for an end of a large sample that is under way."""
    runs = [AlarmRun(distance_m, loss, seed, end) for seed in range(guesses)]
    return Small(
        what=f"{distance_m:.0f} m, {loss:.0%} lost, alarms of a third node for {end}",
        published=sum(each.published for each in runs),
        delays_s=[delay_s for each in runs for delay_s in each.delays_s],
        limit_s=ALARM_LIMIT_S,
        last_limit_s=60.0 if loss > 0.2 else 30.0,
    )


def progress(distance_m: float, loss: float, guesses: int) -> Progress:
    """Follow a photo as the console of the shore does, over all guesses."""
    runs = [PhotoRun(distance_m, loss, seed) for seed in range(guesses)]
    return Progress(
        distance_m=distance_m,
        loss=loss,
        took_s=[each.took_s for each in runs],
        bar=[error for each in runs for error in each.bar],
        foretold=[error for each in runs for error in each.foretold],
    )


def _scenario(distance_m: float, loss: float, seed: int) -> Scenario:
    scenario = scenario_of(2, spacing_m=distance_m, seed=seed + 1)
    return msgspec.structs.replace(scenario, loss=LossSpec(frame=loss))


class RawClient:
    """Gives the content to the modem as the modem takes it.

    Args:
        scenario: The channel.
        guess: How the modems treat burst data.
        content: What to send.
    """

    def __init__(self, scenario: Scenario, guess: BurstGuess, content: bytes) -> None:
        self._sea = HostSea(scenario, behaviour=guess.behaviour, settings=guess.settings)
        self._near: Host = self._sea.host(1)
        self._far: Host = self._sea.host(2)
        step = _PACKET_BYTES - 4
        self._packets = [
            number.to_bytes(4, "big") + content[at : at + step]
            for number, at in enumerate(range(0, len(content), step))
        ]
        self._waiting = list(range(len(self._packets)))[::-1]
        self._given: dict[int, int] = {}
        self._read = self._read_far = 0
        self._arrived: set[bytes] = set()
        self._retry_at = 0

    def run(self) -> float:
        """Return how long it takes, s."""
        fleet = self._sea.fleet
        self._fill()
        while len(self._arrived) < len(self._packets):
            due_at = fleet.poll_timeout()
            if self._waiting and not self._given:
                due_at = self._retry_at if due_at is None else min(due_at, self._retry_at)
            assert due_at is not None
            assert due_at < seconds_to_ns(_LIMIT_S)
            fleet.handle_timeout(max(due_at, fleet.now))
            self._sea.collect()
            self._take()
            self._fill()
        return ns_to_seconds(fleet.now)

    def _take(self) -> None:
        for _, message in self._near.heard[self._read :]:
            if isinstance(message, Delivered | Failed):
                packet = self._given.pop(message.counter, None)
                if packet is not None and isinstance(message, Failed):
                    self._waiting.append(packet)
        self._read = len(self._near.heard)
        for _, message in self._far.heard[self._read_far :]:
            if isinstance(message, Recv):
                self._arrived.add(message.payload)
        self._read_far = len(self._far.heard)

    def _fill(self) -> None:
        while self._waiting and self._sea.fleet.now >= self._retry_at:
            counter = int(self._near.say(b"AT?PC\n")[0])
            payload = self._packets[self._waiting[-1]]
            command = b"AT*SEND,%d,2,%s\n" % (len(payload), payload)
            if self._near.say(command)[0] != "OK":
                self._retry_at = self._sea.fleet.now + seconds_to_ns(0.2)
                return
            self._given[counter] = self._waiting.pop()


class Crew:
    """Engines on the driver, from the instant at which all of them are up.

    Args:
        scenario: The channel.
        guess: How the modems treat burst data.
        table: Of all engines.
    """

    def __init__(self, scenario: Scenario, guess: BurstGuess, table: StreamTable) -> None:
        fleet = EmulatedFleet(scenario, behaviour=guess.behaviour, settings=guess.settings)
        self.sea = CrewedSea(fleet, table, self._deliver, config=EvologicsConfig())
        """The engines, their modems and the time."""
        self.sea.until(lambda: all(node.is_up for node in self.sea.crew))

    def _deliver(self, node: CrewNode, event: Event) -> None:
        """Take what an engine tells its application."""

    def _publish(self, source: int, stream_id: int, value: bytes) -> None:
        node = self.sea.crew[source - 1]
        self.sea.apply(node, lambda engine, now: engine.publish(stream_id, value, now))


class EngineClient(Crew):
    """Two engines on the driver.

    Args:
        scenario: The channel.
        guess: How the modems treat burst data.
    """

    def __init__(self, scenario: Scenario, guess: BurstGuess) -> None:
        self.published: dict[tuple[int, int], int] = {}
        self.delays_s: dict[tuple[int, int], list[float]] = {}
        for source in (1, 2):
            for stream_id in (REPORT, URGENT):
                self.published[source, stream_id] = 0
                self.delays_s[source, stream_id] = []
        self.beyond_s: dict[int, list[float]] = {1: [], 2: []}
        """Of the reports of a node: the delay beyond what was under way, s."""
        self._under_way: dict[tuple[int, bytes], set[int]] = {}
        self._has_arrived = self._has_ended = False
        self._at: dict[tuple[int, int, bytes], int] = {}
        super().__init__(scenario, guess, _table())

    def send(self, content: bytes) -> float:
        """Publish an object; return how long it takes until the other end has it, s."""
        begun_at = self.sea.now
        self._publish(1, PHOTO, content)
        self.sea.until(lambda: self._has_arrived, limit_s=_LIMIT_S)
        return ns_to_seconds(self.sea.now - begun_at)

    def measure(self, content: bytes, period_s: float) -> None:
        """Publish small samples while an object is under way; empty: for as long as one takes."""
        rng = random.Random(f"small/{period_s}")
        for source in (1, 2):
            self._repeat(source, REPORT, lambda: period_s, rng.uniform(0.0, period_s))
            self._repeat(source, URGENT, lambda: rng.uniform(20.0, 60.0), rng.uniform(5.0, 30.0))
        self.sea.run(90.0)  # the engines introduce themselves
        for key in self.published:
            self.published[key] = 0
            self.delays_s[key].clear()
        for beyond_s in self.beyond_s.values():
            beyond_s.clear()
        self._at.clear()
        self._under_way.clear()
        if content:
            self.send(content)
        else:
            self.sea.run(300.0)
        self._has_ended = True
        self.sea.run(30.0)  # what was published before the end may still arrive

    def _repeat(
        self, source: int, stream_id: int, pause_s: Callable[[], float], first_s: float
    ) -> None:
        def publish() -> None:
            if self._has_ended:
                return
            self.published[source, stream_id] += 1
            number = self.published[source, stream_id].to_bytes(4, "big")
            value = number + bytes(16 if stream_id == REPORT else 4)
            self._at[source, stream_id, value] = self.sea.now
            if stream_id == REPORT:
                self._under_way[source, value] = self._bulk_under_way()
            self._publish(source, stream_id, value)
            self.sea.after(pause_s(), publish)

        self.sea.after(first_s, publish)

    def _deliver(self, node: CrewNode, event: Event) -> None:
        if not isinstance(event, SampleReceived):
            return
        if event.stream_id == PHOTO:
            self._has_arrived = True
            return
        assert isinstance(event.value, bytes)
        published_at = self._at.pop((event.source, event.stream_id, event.value), None)
        if published_at is not None:
            delay_s = ns_to_seconds(self.sea.now - published_at)
            self.delays_s[event.source, event.stream_id].append(delay_s)
            under_way = self._under_way.pop((event.source, event.value), None)
            if under_way is not None:
                beyond_ns = self.sea.now - max(published_at, self._ends_at(under_way))
                self.beyond_s[event.source].append(max(0.0, beyond_ns / 1e9))

    def _bulk_under_way(self) -> set[int]:
        """Return the ids of the bulk frames of the publisher that are not reported."""
        node = self.sea.crew[0]
        ids = {
            each.transmission.transmission_id
            for each in node.given
            if each.transmission.service is Service.BULK
        }
        return ids - {each.transmission_id for each in node.reports}

    def _ends_at(self, ids: set[int]) -> int:
        """Return when the last of these frames was reported, so far, ns."""
        reports = self.sea.crew[0].reports
        return max((each.finished_at for each in reports if each.transmission_id in ids), default=0)


class PhotoRun(EngineClient):
    """A photo, and what its receiver's console shows of it.

    Args:
        distance_m: The distance.
        loss: Share of the frames that are lost.
        seed: Everything follows from it.
    """

    def __init__(self, distance_m: float, loss: float, seed: int) -> None:
        self.bar: list[float] = []
        self.foretold: list[float] = []
        self._watch = LinkWatch()
        self._shown: list[tuple[float, float, float | None]] = []
        super().__init__(_scenario(distance_m, loss, seed), burst_guess(seed))
        for source in (1, 2):
            self.sea.after(5.0 * source, partial(self._publish, source, REPORT, bytes(20)))
        self.sea.run(60.0)  # the engines introduce themselves
        self._begun_at = self.sea.now
        self.sea.after(_SHOWN_FROM_S, self._look)
        self.took_s = self.send(random.Random(seed).randbytes(13_000))
        for at_s, share, left_s in self._shown:
            self.bar.append(share - at_s / self.took_s)
            if left_s is not None:
                self.foretold.append((at_s + left_s - self.took_s) / self.took_s)

    def _look(self) -> None:
        at_s = ns_to_seconds(self.sea.now - self._begun_at)
        arriving = self._watch.arriving(at_s)
        first = arriving[0] if arriving else None
        share, left_s = (first.share, first.left_s) if first is not None else (None, None)
        self._shown.append((at_s, share or 0.0, left_s))
        self.sea.after(_SHOWN_EACH_S, self._look)

    def _deliver(self, node: CrewNode, event: Event) -> None:
        super()._deliver(node, event)
        if isinstance(event, ObjectProgress) and event.peer == 1:
            told = msgspec.to_builtins(event) | {"source": event.peer}
            at_s = ns_to_seconds(self.sea.now - self._begun_at)
            self._watch.take("objects", {"receiving": [told]}, at_s)


class AlarmRun(Crew):
    """A large sample from node 1 to node 2, and alarms of node 3.

    Args:
        distance_m: The distance between any two of them.
        loss: Share of the frames that are lost.
        seed: Everything follows from it.
        end: The node that the alarms are for.
    """

    def __init__(self, distance_m: float, loss: float, seed: int, end: int) -> None:
        self.published = 0
        self.delays_s: list[float] = []
        self._end = end
        self._at: dict[bytes, int] = {}
        self._has_arrived = False
        self._rng = random.Random(f"alarms/{seed}")
        scenario = scenario_of(3, spacing_m=distance_m, seed=seed + 1)
        far = NodeSpec(address=3, position=(distance_m / 2, distance_m * 0.75**0.5, 10.0))
        scenario = msgspec.structs.replace(
            scenario, nodes=(*scenario.nodes[:2], far), loss=LossSpec(frame=loss)
        )
        super().__init__(scenario, burst_guess(seed), _table(end))
        for address in (1, 2, 3):
            self.sea.after(10.0 * address, partial(self._publish, address, REPORT, b"here"))
        self.sea.run(90.0)
        self.sea.after(self._rng.uniform(5.0, 30.0), self._alarm)
        self._publish(1, PHOTO, self._rng.randbytes(64 << 10))
        self.sea.until(lambda: self._has_arrived, limit_s=_LIMIT_S)
        self.sea.run(120.0)

    def _alarm(self) -> None:
        if self._has_arrived:
            return
        self.published += 1
        value = self.published.to_bytes(8, "big")
        self._at[value] = self.sea.now
        self._publish(3, ALARM, value)
        self.sea.after(self._rng.uniform(20.0, 60.0), self._alarm)

    def _deliver(self, node: CrewNode, event: Event) -> None:
        if not isinstance(event, SampleReceived):
            return
        if event.stream_id == PHOTO:
            self._has_arrived = True
        elif event.stream_id == ALARM and node.address == self._end:
            assert isinstance(event.value, bytes)
            self.delays_s.append(ns_to_seconds(self.sea.now - self._at[event.value]))


def _table(end: int | None = None) -> StreamTable:
    """Return the table of two nodes, or of three of which the third has alarms for one."""
    urgent = Qos(priority=Priority.REAL_TIME, reliability=Reliability.RELIABLE, depth=8)
    alarm = TopicSpec(
        stream_id=ALARM, name="alarm", publishers=(3,), subscribers=(end or 1,), qos=urgent
    )
    third: dict[int, str] = {3: "third"} if end else {}
    return StreamTable(
        [
            *([alarm] if end else []),
            TopicSpec(
                stream_id=PHOTO,
                name="photo",
                publishers=(1,),
                subscribers=(2,),
                qos=Qos(reliability=Reliability.RELIABLE, depth=2),
            ),
            TopicSpec(stream_id=REPORT, name="report", qos=Qos(depth=1)),
            TopicSpec(stream_id=URGENT, name="urgent", qos=Qos(priority=Priority.REAL_TIME)),
        ],
        nodes={1: "shore", 2: "vehicle"} | third,
    )


if __name__ == "__main__":
    sys.exit(main())
