"""The way of a frame through the engine does not grow unnoticed: `.ci/walk.py` counts it.

Versions of Python count some calls of generators differently, so each limit has a few percent of
room. Whoever lowers a count lowers its limit; whoever raises one says why in the commit.
"""

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Final

WALK: Final = Path(__file__).parents[1] / ".ci" / "walk.py"
MOST: Final = {
    "best-effort sample": (325, 210, 655),
    "reliable sample": (530, 490, 1660),
    "call": (460, 755, 2280),
    "goal": (480, 830, 2510),
    "400 bytes": (615, 1670, 6920),
}
"""Functions, crossings between rooms, and calls of both engines, at most."""
MOST_OBJECTS: Final = 260


def load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("walk", WALK)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_no_walk_is_longer_than_it_was() -> None:
    walks = load().walks()
    found = {kind: (each.functions, each.crossings, each.calls) for kind, each in walks.items()}
    assert found.keys() == MOST.keys()
    longer = {
        kind: counts
        for kind, counts in found.items()
        if any(count > most for count, most in zip(counts, MOST[kind], strict=True))
    }
    assert longer == {}
    assert all(calls > 200 for _, _, calls in found.values()), "it counts what runs"


def test_an_idle_engine_has_no_more_objects_than_it_had() -> None:
    walk = load()
    found = walk.live_objects(walk.network().engine(1))
    assert 100 < found.total() <= MOST_OBJECTS
    assert found["Engine"] == found["TransmitQueue"] == 1
