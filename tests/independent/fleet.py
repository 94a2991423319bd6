"""The table of the vectors: node 1 is shore, node 2 auv1. Written from docs/wire.md alone.

The page sends its reader to the table in tests/golden/vectors.py, of which this is a copy. Some
vectors are of a table with more streams, or with dense ones in place of others.
"""

from tests.independent.table import Action, Field, Service, Stream, Table, Topic, Wildcard

SHORE, AUV = 1, 2
NODES = {SHORE: "shore", AUV: "auv1"}
NAV = (
    Field("lat", "float64", range=(-90, 90), step=1e-6),
    Field("depth", "float32", range=(0, 1000), step=0.1),
    Field("heading", "float32", range=(0, 360), step=0.1, wraps=True),
    Field("mode", "enum", values=("idle", "survey", "abort")),
)
NAV_VALUE = {"lat": 45.4, "depth": 12.3, "heading": 271.5, "mode": "survey"}
_SENSORS = (Wildcard("sensor", ("ctd", "adcp", "sonar")),)
_BASE: tuple[Stream, ...] = (
    Topic(10, "auv1/nav", "Nav"),
    Topic(11, "auv1/raw"),
    Topic(12, "auv1/old", aged=True),
    Topic(13, "fleet/{node}/{sensor}", wildcards=_SENSORS),
    Service(20, "auv1/arm", server=AUV, timeout_s=30),
    Topic(21, "auv1/other"),
)
_MORE: tuple[Stream, ...] = (
    Topic(30, "auv1/orders", subscribers=(AUV,), reliable=True, depth=8),
    Topic(31, "fleet/{node}/log/{sensor}", wildcards=_SENSORS, reliable=True, depth=8),
    Action(40, "auv1/goto", AUV, goal="Nav"),
    Topic(51, "auv1/log", encoding="text/plain", codec="packed"),
)


def _table(*streams: Stream) -> Table:
    return Table({one.id: one for one in streams}, {"Nav": NAV}, NODES)


TABLE = _table(*_BASE, *_MORE)
"""All streams of the vectors that do not contradict each other."""
BASE = _table(*_BASE)
DENSE = _table(
    *_BASE,
    Topic(10, "auv1/nav", "Nav", codec="dense", depth=4),
    Topic(50, "auv1/way", "Nav", codec="dense", aged=True),
)
