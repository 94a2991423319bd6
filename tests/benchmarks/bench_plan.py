"""`config plan` against gateways in real time: the airtime that it foretells, node by node.

    .venv/bin/python tests/benchmarks/bench_plan.py [MINUTES] [pair|five|relay …]

For each fleet one process serves the simulated channel and each node has a gateway, a process as
well. Programs on their local networks publish and call what the scenario's traffic says. All fleets
run at once, and `MINUTES` count (7 unless told otherwise), after they have met. Printed are what
`plan` says by itself, what it says of these minutes, and what was measured. Exits 1 when the latter
two are more than 5 % apart for a pair or five nodes, or more than 10 % for three nodes, the middle
one a relay.
"""

import contextlib
import heapq
import json
import random
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any, Final

import msgspec
import zenoh

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.benchmarks.bench_init import airtime_s, running
from tests.gateway.networks import free_port, zenoh_config, zenoh_settings
from zacoustic.app.tools.design.plan.fleet import AssumedChannel, fleet_of
from zacoustic.app.tools.design.plan.offers import Offer, offers_of_traffic
from zacoustic.app.tools.design.plan.report import PlanReport, plan
from zacoustic.app.tools.design.plan.verdict import walk
from zacoustic.channel.scenario import scenario_from_mapping
from zacoustic.config import read_config

MINUTES: Final = 7.0
STARTING_S: Final = 90.0
"""How long all processes have to start, at most."""
MEETING_S: Final = 240.0
"""How long there is traffic before it counts: the nodes agree on their tables first."""
SEEDS: Final = range(1, 7)
"""What is foretold is the mean of so many simulations of the same minutes."""

NAV: Final = {
    "name": "Nav",
    "fields": [
        {"name": "lat", "type": "float64", "range": [-90, 90], "step": 1e-6},
        {"name": "depth", "type": "float32", "range": [0, 1000], "step": 0.1},
    ],
}
VALUES: Final = {"value": {}, "vary": {"lat": [54, 54.01], "depth": [0, 40]}}


class Fleet(msgspec.Struct, frozen=True, kw_only=True):
    """A fleet, its channel and its traffic."""

    name: str
    """What it is."""
    allowed: float
    """How far the foretold airtime may be from the measured one, relatively."""
    section: dict[str, Any]
    """The config of all nodes."""
    channel: dict[str, Any]
    """The scenario, without the nodes."""
    places: tuple[tuple[float, float, float], ...]
    """Place of each node, m; addresses begin with 1."""
    traffic: list[dict[str, Any]]
    """What the programs publish and call."""

    @property
    def addresses(self) -> range:
        """Addresses of the nodes."""
        return range(1, len(self.places) + 1)

    def write(self, folder: Path, ports: Mapping[int, int]) -> Path:
        """Write the config of each node and the scenario; returns the latter."""
        nodes = [{"address": each, "name": f"n{each}"} for each in self.addresses]
        section = {"nodes": nodes, "types": [NAV], **self.section}
        for address, port in ports.items():
            settings = json.loads(zenoh_settings("router", listen=port))
            settings["plugins_loading"] = {"enabled": False}
            settings["plugins"] = {"acoustic": {**section, "address": address}}
            (folder / f"{address}.json5").write_text(json.dumps(settings), encoding="utf-8")
        path = folder / "water.json5"
        placed = [
            {**node, "position": place} for node, place in zip(nodes, self.places, strict=True)
        ]
        scenario = {**self.channel, "config": "1.json5", "nodes": placed, "traffic": self.traffic}
        path.write_text(json.dumps(scenario), encoding="utf-8")
        return path


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """What came of a fleet."""

    fleet: Fleet
    """The fleet."""
    report: PlanReport
    """What `plan` says without an option."""
    plan_s: float
    """How long that took, s."""
    foretold: dict[int, float]
    """Share of the time that each node should transmit in these minutes."""
    measured: dict[int, float]
    """Share of the time that each node has transmitted."""

    @property
    def off(self) -> float:
        """How far the foretold airtime is off, relatively."""
        return sum(self.foretold.values()) / sum(self.measured.values()) - 1.0


def _says(node: int, topic: str, every_s: float, **more: object) -> dict[str, Any]:
    return {"node": node, "topic": topic, "every_s": every_s, **more}


FLEETS: Final = (
    Fleet(
        name="pair",
        allowed=0.05,
        section={
            "streams": [
                {"id": 10, "topic": "auv/nav", "type": "Nav", "publishers": [2], "stamp": "age",
                 "encoding": "application/json"},
                {"id": 11, "topic": "auv/log", "publishers": [2], "lifespan_s": 60, "depth": 4},
                {"id": 12, "topic": "auv/cmd", "publishers": [1], "subscribers": [2],
                 "reliability": "reliable", "depth": 8},
                {"id": 13, "service": "auv/arm", "server": 2, "timeout_s": 60},
            ]
        },
        channel={"seed": 11, "channel": "none", "loss": {"frame": 0.02}},
        places=((0, 0, 10), (1000, 0, 50)),
        traffic=[
            _says(2, "auv/nav", 4, first_s=0.5, **VALUES),
            _says(2, "auv/log", 9, first_s=2, size_bytes=[10, 30]),
            _says(1, "auv/cmd", 11, first_s=3, size_bytes=12),
            {"node": 1, "service": "auv/arm", "every_s": 23, "first_s": 7, "size_bytes": 4},
        ],
    ),
    Fleet(
        name="five",
        allowed=0.05,
        section={
            "streams": [
                {"id": 10, "topic": "{node}/nav", "type": "Nav", "depth": 2,
                 "encoding": "application/json"},
                {"id": 11, "topic": "{node}/log", "publishers": [2, 3, 4, 5], "subscribers": [1],
                 "reliability": "reliable", "depth": 4},
                {"id": 12, "topic": "stop", "publishers": [1], "reliability": "reliable",
                 "depth": 4},
            ]
        },
        channel={"seed": 12, "channel": "none", "loss": {"frame": 0.01}},
        places=((0, 0, 10), (800, 0, 30), (0, 900, 30), (-700, 0, 40), (0, -600, 20)),
        traffic=[
            *(_says(each, f"n{each}/nav", 20, first_s=6.5 + 2.3 * each, **VALUES)
              for each in range(1, 6)),
            *(_says(each, f"n{each}/log", 80, first_s=20 * each, size_bytes=16)
              for each in range(2, 6)),
            _says(1, "stop", 80, first_s=24, size_bytes=3),
        ],
    ),
    Fleet(
        name="relay",
        allowed=0.10,
        section={
            "routes": [{"id": 1, "name": "far", "path": [1, 2, 3], "lifetime_s": 60}],
            "relay": {"max_airtime": 0.5},
            "streams": [
                {"id": 10, "topic": "auv/nav", "type": "Nav", "publishers": [3],
                 "subscribers": [1], "link": "far", "encoding": "application/json"},
                {"id": 11, "topic": "auv/plan", "publishers": [1], "subscribers": [3],
                 "reliability": "reliable", "depth": 8, "link": "far"},
                {"id": 12, "service": "auv/arm", "server": 3, "timeout_s": 120, "link": "far"},
                {"id": 13, "topic": "buoy/state", "publishers": [2]},
            ],
        },
        channel={
            "seed": 13,
            "channel": "none",
            "loss": {"frame": 0.01},
            "links": [{"from": 1, "to": 3, "loss": {"frame": 1}},
                      {"from": 3, "to": 1, "loss": {"frame": 1}}],
        },
        places=((0, 0, 10), (1200, 0, 20), (2400, 0, 40)),
        traffic=[
            _says(3, "auv/nav", 15, first_s=1, **VALUES),
            _says(1, "auv/plan", 60, first_s=7.5, size_bytes=14),
            {"node": 1, "service": "auv/arm", "every_s": 60, "first_s": 37.5, "size_bytes": 4},
            _says(2, "buoy/state", 30, first_s=22.5, size_bytes=8),
        ],
    ),
)  # fmt: skip


def main() -> int:
    """Print the tables and return the exit code."""
    words = sys.argv[1:]
    minutes = float(words.pop(0)) if words and words[0][0].isdigit() else MINUTES
    fleets = [each for each in FLEETS if not words or each.name in words]
    with contextlib.ExitStack() as stack:
        trials = [
            Trial(each, Path(stack.enter_context(tempfile.TemporaryDirectory())), minutes)
            for each in fleets
        ]
        print(f"{minutes:g} min of real time, all fleets at once", flush=True)
        with ThreadPoolExecutor(len(fleets)) as pool:
            outcomes = list(pool.map(Trial.run, trials))
    for each in outcomes:
        print(
            f"\n{each.fleet.name}: planned within {each.plan_s:.1f} s; "
            f"{each.report.hours:.1f} h simulated, ±{each.report.confidence:.2%}"
        )
        print(f"{'node':>6s} {'plan':>9s} {'foretold':>9s} {'measured':>9s} {'off':>7s}")
        for node in each.report.nodes:
            foretold, measured = each.foretold[node.address], each.measured[node.address]
            print(
                f"{node.address:6d} {node.utilisation:9.3%} {foretold:9.3%} {measured:9.3%} "
                f"{foretold / measured - 1.0:+7.1%}"
            )
        print(
            f"{'all':>6s} {each.report.utilisation:9.3%} {sum(each.foretold.values()):9.3%} "
            f"{sum(each.measured.values()):9.3%} "
            f"{each.off:+7.1%}{'' if abs(each.off) <= each.fleet.allowed else '   NO'}"
        )
    return 0 if all(abs(each.off) <= each.fleet.allowed for each in outcomes) else 1


class Trial:
    """A fleet on its ports, planned.

    Args:
        fleet: The fleet.
        folder: Takes its files.
        minutes: How long it counts, min.
    """

    def __init__(self, fleet: Fleet, folder: Path, minutes: float) -> None:
        self._fleet = fleet
        self._folder = folder
        self._ports = {address: free_port() for address in fleet.addresses}
        self._path = fleet.write(folder, self._ports)
        began_s = time.monotonic()
        self._report = plan(self._path)
        self._plan_s = time.monotonic() - began_s
        self._minutes = minutes
        self._foretold = _foretold(self._path, MEETING_S, MEETING_S + 60.0 * minutes)

    def run(self) -> Outcome:
        """Let the fleet run."""
        ports, listen = self._ports, f"127.0.0.1:{free_port()}"
        with contextlib.ExitStack() as stack:
            medium = ("run", "medium", self._path.name, "--listen", listen)
            stack.enter_context(running(self._folder, *medium))
            for each in ports:
                gateway = ("run", "gateway", f"{each}.json5", "--link", f"sim/{listen}")
                stack.enter_context(running(self._folder, *gateway))
            stack.enter_context(living(self._fleet, self._path, ports))
            time.sleep(MEETING_S)
            before, began_s = _transmitted_s(ports), time.monotonic()
            time.sleep(60.0 * self._minutes)
            after, spent_s = _transmitted_s(ports), time.monotonic() - began_s
        return Outcome(
            fleet=self._fleet,
            report=self._report,
            plan_s=self._plan_s,
            foretold=self._foretold,
            measured={each: (after[each] - before[each]) / spent_s for each in ports},
        )


def _foretold(path: Path, begin_s: float, end_s: float) -> dict[int, float]:
    """Return the foretold share of the time of each node between two instants, s."""
    fleet = fleet_of(path, (), AssumedChannel())
    spent_s: dict[int, float] = {}
    for seed in SEEDS:
        # The shorter simulation is the beginning of the longer one.
        for until_s, sign in ((end_s, 1), (begin_s, -1)):
            for node, sound_s in walk(fleet, until_s, seed).airtime_s.items():
                spent_s[node] = spent_s.get(node, 0.0) + sign * sound_s
    return {each: sum_s / len(SEEDS) / (end_s - begin_s) for each, sum_s in spent_s.items()}


def _transmitted_s(ports: Mapping[int, int]) -> dict[int, float]:
    return {address: airtime_s(port) for address, port in ports.items()}


@contextlib.contextmanager
def living(fleet: Fleet, path: Path, ports: Mapping[int, int]) -> Iterator[None]:
    """Publish, call and answer on the local networks as the scenario's traffic says.

    It begins when all gateways have started.
    """
    scenario = scenario_from_mapping(json.loads(path.read_text(encoding="utf-8")), source=str(path))
    table = read_config(path.parent / "1.json5", address=1).table
    offers = offers_of_traffic(scenario.traffic, table)
    ended = threading.Event()
    with contextlib.ExitStack() as stack:
        sessions = {address: stack.enter_context(_session(port)) for address, port in ports.items()}
        for entry in fleet.section["streams"]:
            if "service" in entry:
                key = entry["service"]
                sessions[entry["server"]].declare_queryable(key, partial(_answer, key))
        keys = [entry.get("topic") or entry["service"] for entry in fleet.traffic]
        thread = threading.Thread(
            target=_speak, args=(list(zip(keys, offers, strict=True)), sessions, ended)
        )
        thread.start()
        try:
            yield
        finally:
            ended.set()
            thread.join()


def _session(port: int) -> zenoh.Session:
    """Open a session at a gateway, which may still start."""
    until_s = time.monotonic() + STARTING_S
    while True:
        try:
            return zenoh.open(zenoh_config("client", connect=port))
        except zenoh.ZError:
            if time.monotonic() > until_s:
                raise
            time.sleep(1.0)


def _answer(key: str, query: zenoh.Query) -> None:
    query.reply(key, b"")


def _speak(
    offers: list[tuple[str, Offer]], sessions: Mapping[int, zenoh.Session], ended: threading.Event
) -> None:
    """Publish and call at the instants of the traffic until the end."""
    rng, began_ns = random.Random(2026), time.monotonic_ns()
    instants = [offer.instants(rng) for _, offer in offers]
    values = [offer.values(rng) for _, offer in offers]
    due = [(next(each), index) for index, each in enumerate(instants)]
    heapq.heapify(due)
    while due:
        at_ns, index = heapq.heappop(due)
        if ended.wait(max(0.0, (began_ns + at_ns - time.monotonic_ns()) / 1e9)):
            return
        key, offer = offers[index]
        value, session = next(values[index]), sessions[offer.node]
        payload = value if isinstance(value, bytes) else json.dumps(value).encode()
        if offer.is_call:
            session.get(key, lambda reply: None, payload=payload, timeout=120.0)
        else:
            session.put(key, payload, encoding=offer.stream.encoding)
        if (again_ns := next(instants[index], None)) is not None:
            heapq.heappush(due, (again_ns, index))


if __name__ == "__main__":
    sys.exit(main())
