"""The tables of the vectors: node 1 is shore, node 2 auv1. Read from tests/golden/tables.json."""

import json
from pathlib import Path
from typing import Any

from tests.independent.table import Table, table_of

GOLDEN = Path(__file__).parent.parent / "golden"
SHORE, AUV = 1, 2
NODES = {SHORE: "shore", AUV: "auv1"}
READ_ONLY = {"error_later", "error_no_text"}
"""Vectors of which a reader takes less than they say: no sender of this page writes them."""
NAV_VALUE = {"lat": 45.4, "depth": 12.3, "heading": 271.5, "mode": "survey"}


def load(name: str) -> Any:
    """Return the content of a file of vectors."""
    return json.loads((GOLDEN / name).read_text(encoding="utf-8"))


TABLES = {name: table_of(plain) for name, plain in load("tables.json")["tables"].items()}
BASE, DENSE = TABLES["base"], TABLES["dense"]


def _all() -> Table:
    streams = {**BASE.streams}
    for name, several in (("reliable", (30, 31)), ("action", (40,)), ("bytes", (51,))):
        streams |= {stream: TABLES[name].streams[stream] for stream in several}
    return Table(streams, BASE.types, NODES)


TABLE = _all()
"""All streams of the vectors that do not contradict each other, but the on-demand one."""
