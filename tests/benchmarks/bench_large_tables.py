"""How long `load`, `check` and `plan` of a fleet take, by its nodes.

    .venv/bin/python tests/benchmarks/bench_large_tables.py

Each node reports, one commands all of them, one has a service. Verbs are timed as processes, with
their imports. Exits 1 when one takes longer than 5 s.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from zacoustic.config import read_config

SIZES = (10, 40, 254)
MOST_S = 5.0

POSITION = [
    {"name": "lat", "type": "float64", "range": [-90, 90], "step": 1e-6},
    {"name": "lon", "type": "float64", "range": [-180, 180], "step": 1e-6},
]
FLAG = [{"name": "flag", "type": "bool"}]


def section(nodes: int, agreement: str) -> dict[str, Any]:
    """Return the configuration of a fleet."""
    return {
        "agreement": agreement,
        "nodes": [{"address": each, "name": f"node{each}"} for each in range(1, nodes + 1)],
        "types": [{"name": "Position", "fields": POSITION}, {"name": "Flag", "fields": FLAG}],
        "streams": [
            {"id": 1, "topic": "{node}/report", "type": "Position", "deadline_s": 600},
            {"id": 2, "topic": "command", "type": "Flag", "publishers": [1],
             "reliability": "reliable", "deadline_s": 600},
            {"id": 3, "service": "node2/arm", "request": "Flag", "response": "Flag", "server": 2},
        ],
    }  # fmt: skip


def timed(*arguments: str) -> float:
    """Return how long a verb takes, s."""
    began_s = time.perf_counter()
    subprocess.run(
        [sys.executable, "-m", "zacoustic", *arguments], stdout=subprocess.DEVNULL, check=False
    )
    return time.perf_counter() - began_s


def main() -> int:
    """Print the table and return the exit code."""
    print(f"{'nodes':>5s} {'agreement':>9s} {'load':>8s} {'check':>8s} {'plan':>8s}")
    kept = True
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fleet.json5"
        for nodes in SIZES:
            for agreement in ("tag", "confirm"):
                config = {"plugins": {"acoustic": section(nodes, agreement)}}
                path.write_text(json.dumps(config))
                began_s = time.perf_counter()
                read_config(path, address=1)
                load_s = time.perf_counter() - began_s
                check_s = timed("check", str(path), "--address", "1")
                plan_s = timed("plan", str(path))
                kept = kept and max(load_s, check_s, plan_s) <= MOST_S
                print(
                    f"{nodes:5d} {agreement:>9s} {load_s:6.2f} s {check_s:6.2f} s {plan_s:6.2f} s"
                )
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
