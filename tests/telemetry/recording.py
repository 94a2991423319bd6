"""Recordings of telemetry: JSON lines, compressed, the first of which says what they are.

``{"meta": {"lat0": …, "lon0": …, "fields": {…}}}``, then ``{"t": seconds, "s": stream, "v": […]}``
in full precision. Without `fields` the streams are those of `vehicle_types`; a log of a real
vehicle says which fields it has.
"""

import gzip
import json
import math
from pathlib import Path
from typing import Any, Final

from tests.telemetry.streams import Sample, number, vehicle_types
from zacoustic.core.values.types import FieldSpec, TypeSpec

# Bounds and step of the fields of real logs: as narrow as their values allow, widened where a
# vehicle leaves them.
_FIELDS: Final[dict[str, tuple[float, tuple[tuple[float, float], ...]]]] = {
    "depth": (0.1, ((0, 1000), (-10, 1000))),
    "pitch": (0.1, ((-45, 45), (-90, 90))),
    "roll": (0.1, ((-45, 45), (-90, 90), (-180, 180))),
    "speed": (0.01, ((-1, 4), (-5, 20))),
    "altitude": (0.1, ((0, 200), (-10, 2000))),
    "yaw_rate": (0.1, ((-20, 20), (-60, 60), (-400, 400))),
    "temp": (0.001, ((-2, 35),)),
    "cond": (0.001, ((0, 70),)),
    "pressure": (0.01, ((0, 1100), (-10, 1100))),
}
_MEASURED: Final = ("nav", "ctd")


class Recording:
    """A recording in a file.

    Args:
        path: Of the file.
    """

    def __init__(self, path: Path) -> None:
        self.name = path.name.partition(".")[0]
        with gzip.open(path, "rt", encoding="utf-8") as file:
            meta = json.loads(next(file))["meta"]
            lines = [json.loads(line) for line in file]
        self.is_real = "fields" in meta
        self.periods_s: dict[str, float] = meta.get("period_s", {})
        self.types: dict[str, TypeSpec] = (
            _real_types(meta, lines) if self.is_real else vehicle_types(meta["lat0"], meta["lon0"])
        )
        self.samples: list[Sample] = [
            (line["t"], line["s"], _value(self.types[line["s"]], line["v"]))
            for line in lines
            if line["s"] in self.types
        ]


def recordings_in(folder: Path) -> list[Recording]:
    """Read all recordings of a folder and its folders."""
    return [Recording(path) for path in sorted(folder.rglob("*.jsonl.gz"))]


def _value(type_spec: TypeSpec, values: Any) -> dict[str, Any]:
    if isinstance(values, str):
        values = [values]
    found = {}
    for field, value in zip(type_spec.fields, values, strict=True):
        if field.type == "bool":
            value = bool(value)
        elif field.range is not None and not field.wraps:
            value = min(max(value, field.range[0]), field.range[1])
        found[field.name] = value
    return found


def _real_types(meta: dict[str, Any], lines: list[dict[str, Any]]) -> dict[str, TypeSpec]:
    types = {}
    for name in _MEASURED:
        rows = [line["v"] for line in lines if line["s"] == name]
        if not rows:
            continue
        columns = zip(meta["fields"][name], zip(*rows, strict=True), strict=True)
        fields = tuple(_real_field(each, column, meta) for each, column in columns)
        types[name] = TypeSpec(name=name.title(), fields=fields)
    return types


def _real_field(name: str, column: tuple[float, ...], meta: dict[str, Any]) -> FieldSpec:
    if name == "heading":
        return number(name, 0, 360, 0.1, wraps=True)
    if name in ("lat", "lon"):
        datum = meta[f"{name}0"]
        reach = math.ceil(max(abs(value - datum) for value in column) * 10) / 10
        return number(name, round(datum - reach, 6), round(datum + reach, 6), 1e-6)
    step, choices = _FIELDS[name]
    least, greatest = min(column), max(column)
    for low, high in choices:
        if low <= least and greatest <= high:
            return number(name, low, high, step)
    return number(name, math.floor(least), math.ceil(greatest), step)
