"""Six deployments that have little in common, for `plan` against `sim`; and how far the two are."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.app.tools.design.plan.report import plan
from zacoustic.app.tools.design.sim.simulation import simulate

ALLOWED: Final = 0.05
"""How far the planned utilisation may be from the measured one, relatively."""
HOURS: Final = 8.0
"""How long both go, h: long enough that what is drawn at random is no matter."""
SEED: Final = 2026
"""Of `sim`; the plan draws on its own."""

_NAV: Final = {
    "name": "Nav",
    "fields": [
        {"name": "lat", "type": "float64", "range": [-90, 90], "step": 1e-6},
        {"name": "lon", "type": "float64", "range": [-180, 180], "step": 1e-6},
        {"name": "depth", "type": "float32", "range": [0, 1000], "step": 0.1},
        {"name": "mode", "type": "enum", "values": ["idle", "survey", "abort"]},
    ],
}
_VALUES: Final = {
    "value": {"mode": "survey"},
    "vary": {"lat": [54, 54.01], "lon": [9, 9.01], "depth": [0, 40]},
}


class Case(msgspec.Struct, frozen=True, kw_only=True):
    """One deployment."""

    name: str
    """What it is."""
    streams: list[dict[str, Any]]
    """Its table."""
    nodes: int
    """How many there are."""
    range_m: float
    """From node 1 to the others, m."""
    channel: dict[str, Any]
    """What else the scenario says."""
    traffic: list[dict[str, Any]]
    """What is said."""
    access: dict[str, Any] | None = None
    """Medium access."""
    short_hours: float = 0.25
    """What a quick look takes, h; more where chance decides more."""

    def write(self, folder: Path) -> Path:
        """Write config and scenario; returns the latter."""
        nodes = [{"address": each, "name": f"n{each}"} for each in range(1, self.nodes + 1)]
        link: dict[str, Any] = {"locator": "sim/127.0.0.1:7000"}
        if self.access is not None:
            link["access"] = self.access
        section = {"nodes": nodes, "links": [link], "types": [_NAV], "streams": self.streams}
        config = folder / f"{self.name}.config.json5"
        config.write_text(json.dumps({"plugins": {"acoustic": section}}))
        places: list[list[float]] = [[0, 0, 10]]
        for number in range(2, self.nodes + 1):
            side = 1 if number % 2 == 0 else -1
            places.append([side * self.range_m, 200.0 * (number - 2), 20 + 5 * number])
        scenario = {
            "config": config.name,
            "nodes": [
                {**node, "position": place} for node, place in zip(nodes, places, strict=True)
            ],
            "traffic": self.traffic,
            **self.channel,
        }
        path = folder / f"{self.name}.json5"
        path.write_text(json.dumps(scenario))
        return path


class Compared(msgspec.Struct, frozen=True, kw_only=True):
    """What was planned, and what `sim` measured."""

    name: str
    """Of the case."""
    planned: float
    """Utilisation."""
    measured: float
    """Utilisation."""

    @property
    def off(self) -> float:
        """How far the plan is off, relatively."""
        return self.planned / self.measured - 1.0


def compare(case: Case, folder: Path, hours: float = HOURS) -> Compared:
    """Plan a case, and simulate it."""
    path = case.write(folder)
    planned = plan(path, hours=hours)
    measured = simulate(path, seed=SEED, until_s=hours * 3600.0)
    return Compared(
        name=case.name,
        planned=planned.utilisation,
        measured=measured.airtime_s / measured.until_s,
    )


def compare_all(folder: Path, hours: float = HOURS) -> Iterator[Compared]:
    """Compare all cases."""
    for case in CASES:
        yield compare(case, folder, hours)


def _says(node: int, topic: str, every_s: float, **more: object) -> dict[str, Any]:
    return {"node": node, "topic": topic, "every_s": every_s, **more}


CASES: Final = (
    Case(
        name="best_effort",
        streams=[
            {"id": 10, "topic": "nav", "type": "Nav", "publishers": [2], "stamp": "age"},
            {"id": 11, "topic": "log", "publishers": [2], "lifespan_s": 60},
            {"id": 12, "topic": "cmd", "publishers": [1]},
        ],
        nodes=2,
        range_m=1000,
        channel={"seed": 1},
        traffic=[
            _says(2, "nav", 5, **_VALUES),
            _says(2, "log", 12, pattern="random", size_bytes=[10, 30]),
            _says(1, "cmd", 20, pattern="random", size_bytes=6),
        ],
    ),
    Case(
        name="reliable_20_percent_loss",
        short_hours=1.0,
        streams=[
            {"id": 10, "topic": "orders", "publishers": [1], "subscribers": [2],
             "reliability": "reliable", "depth": 20},
            {"id": 11, "topic": "nav", "type": "Nav", "publishers": [2], "subscribers": [1],
             "reliability": "reliable", "depth": 8},
        ],
        nodes=2,
        range_m=1500,
        channel={"seed": 2, "channel": "none", "loss": {"frame": 0.2}},
        traffic=[
            _says(1, "orders", 25, pattern="random", size_bytes=[8, 20]),
            _says(2, "nav", 15, **_VALUES),
        ],
    ),
    Case(
        name="dense_packed_linger",
        streams=[
            {"id": 10, "topic": "nav", "type": "Nav", "codec": "dense", "publishers": [2],
             "depth": 8, "linger_s": 8},
            {"id": 11, "topic": "ctd", "type": "Nav", "codec": "packed", "publishers": [2],
             "depth": 4, "linger_s": 8},
            {"id": 12, "topic": "cmd", "publishers": [1]},
        ],
        nodes=2,
        range_m=800,
        channel={"seed": 3, "loss": {"frame": 0.1}},
        traffic=[
            _says(2, "nav", 2, **_VALUES),
            _says(2, "ctd", 7, **_VALUES),
            _says(1, "cmd", 30, size_bytes=5),
        ],
    ),
    Case(
        name="services_three_nodes",
        short_hours=1.5,
        streams=[
            {"id": 10, "service": "arm", "server": 2},
            {"id": 11, "service": "get", "server": 3, "timeout_s": 120},
            {"id": 12, "topic": "beat", "publishers": [2, 3]},
        ],
        nodes=3,
        range_m=1000,
        channel={"seed": 4, "channel": "none", "loss": {"frame": 0.1}},
        traffic=[
            {"node": 1, "service": "arm", "every_s": 40, "pattern": "random", "size_bytes": 4},
            {"node": 1, "service": "get", "every_s": 60, "pattern": "random", "size_bytes": 10},
            _says(2, "beat", 30, size_bytes=8),
            _says(3, "beat", 30, size_bytes=8, first_s=11),
        ],
    ),
    Case(
        name="objects_beside_reports",
        short_hours=1.0,
        streams=[
            {"id": 10, "topic": "photo", "publishers": [2], "subscribers": [1],
             "reliability": "reliable", "depth": 4, "priority": "background"},
            {"id": 11, "topic": "nav", "type": "Nav", "publishers": [2]},
        ],
        nodes=2,
        range_m=1200,
        channel={"seed": 5, "channel": "none", "loss": {"frame": 0.1}},
        traffic=[
            _says(2, "photo", 300, size_bytes=3000),
            _says(2, "nav", 20, **_VALUES),
        ],
    ),
    Case(
        name="tdma_four_nodes_broadcast",
        streams=[
            {"id": 10, "topic": "{node}/nav", "type": "Nav", "depth": 4},
            {"id": 11, "topic": "cmd", "publishers": [1], "reliability": "reliable", "depth": 10},
        ],
        nodes=4,
        range_m=700,
        channel={"seed": 6, "loss": {"frame": 0.05}},
        traffic=[
            *(_says(node, f"n{node}/nav", 9, **_VALUES) for node in (2, 3, 4)),
            _says(1, "cmd", 40, pattern="random", size_bytes=12),
        ],
        access={"method": "tdma", "slots": [1, 2, 3, 4], "slot_s": 3, "max_range_m": 1500,
                "clock_error_s": 0.01},
    ),
    Case(
        name="polling_three_nodes",
        streams=[{"id": 10, "topic": "{node}/nav", "type": "Nav", "depth": 4}],
        nodes=3,
        range_m=700,
        channel={"seed": 7},
        traffic=[_says(node, f"n{node}/nav", 15, **_VALUES) for node in (2, 3)],
        access={"method": "polling", "poller": 1, "nodes": [2, 3], "max_range_m": 1500},
    ),
)  # fmt: skip
"""Six, and one more: polling."""
