"""A small made-up dive, and a fleet's configuration for it."""

import gzip
import json
import math
import random
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

LAT: Final = 43.1

Line = dict[str, Any]


def section(**changed: Any) -> dict[str, Any]:
    """The section of the configuration; `codec` is that of all topics."""
    codec = changed.pop("codec", "dense")
    streams = [
        {"id": 10, "topic": "{node}/nav", "type": "Nav", "codec": codec},
        {"id": 11, "topic": "auv1/status", "type": "Status", "codec": codec, "stamp": "age"},
        {"id": 12, "topic": "auv1/log", "type": "Log", "codec": codec, "publishers": [2]},
    ]
    return {
        "address": 1,
        "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
        "types": [
            {"name": "Nav", "fields": [
                {"name": "lat", "type": "float64", "range": [LAT - 0.1, LAT + 0.1], "step": 1e-6},
                {"name": "depth", "type": "float32", "range": [0, 200], "step": 0.1},
                {"name": "heading", "type": "float32", "range": [0, 360], "step": 0.1,
                 "wraps": True},
                {"name": "speed", "type": "float32", "range": [-1, 4], "step": 0.01},
            ]},
            {"name": "Status", "fields": [
                {"name": "mode", "type": "enum", "values": ["idle", "survey", "home"]},
                {"name": "leak", "type": "bool"},
                {"name": "battery", "type": "uint8", "range": [0, 100], "outside": "clamp"},
            ]},
            {"name": "Log", "fields": [{"name": "text", "type": "string", "max_length": 60}]},
        ],
        "streams": streams,
        **changed,
    }  # fmt: skip


def write_config(path: Path, **changed: Any) -> Path:
    path.write_text(json.dumps({"plugins": {"acoustic": section(**changed)}}), encoding="utf-8")
    return path


def dive(seed: int, samples: int = 200, lat: float = LAT) -> Iterator[Line]:
    """Yield the lines of a recording; one in five of its times has a status, one in ten a text."""
    rng = random.Random(f"dive/{seed}")
    heading, depth, battery = rng.uniform(0, 360), 20.0, 100.0
    for number in range(samples):
        at_s = 5.0 * number
        heading = (heading + rng.gauss(0, 2)) % 360
        depth = min(max(depth + rng.gauss(0, 0.3), 0), 200)
        lat += 6e-5 * math.cos(math.radians(heading))
        nav = [lat, depth, heading, 1.2 + rng.gauss(0, 0.01)]
        yield {"t": at_s, "s": "nav", "v": nav}
        if number % 5 == 0:
            battery -= 0.2
            yield {"t": at_s, "s": "status", "v": [1, 0, round(battery)]}
        if number % 10 == 0:
            text = f"leg {number // 10} of 20 begun, depth {depth:.1f} m"
            yield {"t": at_s + 1, "s": "auv1/log", "v": text}


def write(path: Path, lines: Iterable[Line | str]) -> Path:
    """Write a recording; compressed where the name says so."""
    text = "".join(f"{each if isinstance(each, str) else json.dumps(each)}\n" for each in lines)
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    return path
