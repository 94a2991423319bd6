"""Positions, tracks, ranges and images of a recording, as Foxglove's own panels read them.

Foxglove shows a message without any setting if its schema is one that it knows by name. So beside
the channels with the values as they are, a recording has some with these, found by what a value
has, not by what its topic is called::

    latitude, longitude                    foxglove.LocationFix      map: place and track
    north, east; a pose; x, y, z of one    foxglove.PoseInFrame      3D: place
    the same, the last hundred             foxglove.PosesInFrame     3D: track
    JPEG, PNG, WebP or AVIF                foxglove.CompressedImage  image
    a range to a node, a place of one end  foxglove.GeoJSON          map: a ring

The schemas are those parts of the published ones that are filled in here. Messages of ROS are known
to Foxglove as they are.
"""

import base64
import json
import math
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.values.types import FieldSpec, TypeSpec
from zacoustic.run.recording.channels import JSON, JSON_SCHEMA, Channel
from zacoustic.run.recording.schemas import as_json

PREFIX: Final = "/foxglove"
"""Beginning of the topics."""
NOMINAL_M_S: Final = 1500.0
"""Sound speed where a modem knows none, m/s."""
TRACK_POSES: Final = 100
"""Poses of a track: the newest ones."""
_MOST_TOPICS: Final = 256
_MOST_MEMBERS: Final = 20
_DEEPEST: Final = 4
_EARTH_M: Final = 6_371_008.8
_RING_POINTS: Final = 72
_MOST: Final = 1e300
_LOCAL: Final = "local"
"""The frame of positions that are north and east of somewhere."""

_LATITUDES: Final = ("latitude", "lat", "latitude_deg", "lat_deg")
_LONGITUDES: Final = ("longitude", "lon", "lng", "long", "longitude_deg", "lon_deg")
_NORTHS: Final = ("north", "north_m")
_EASTS: Final = ("east", "east_m")
_DOWNS: Final = ("depth", "depth_m", "down", "down_m")
_UPS: Final = ("altitude", "alt", "altitude_m", "alt_m", "up", "up_m")
_HEADINGS: Final = ("heading", "yaw", "heading_deg", "yaw_deg", "heading_rad", "yaw_rad")
_E7: Final = "deg*1e7"
_BEGINNINGS: Final = ((b"\xff\xd8\xff", "jpeg"), (b"\x89PNG\r\n\x1a\n", "png"))

_NUMBER: Final[dict[str, Any]] = {"type": "number"}
_INTEGER: Final[dict[str, Any]] = {"type": "integer"}
_TEXT: Final[dict[str, Any]] = {"type": "string"}


def _object(**properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "object", "properties": properties}


def _list(items: dict[str, Any]) -> dict[str, Any]:
    return {"type": "array", "items": items}


_POSE: Final = _object(
    position=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER),
    orientation=_object(x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER),
)
_STAMPED: Final = {"timestamp": _object(sec=_INTEGER, nsec=_INTEGER), "frame_id": _TEXT}
SCHEMAS: Final[dict[str, dict[str, Any]]] = {
    "foxglove.LocationFix": _object(
        **_STAMPED, latitude=_NUMBER, longitude=_NUMBER, altitude=_NUMBER,
        position_covariance=_list(_NUMBER), position_covariance_type=_INTEGER, heading=_NUMBER,
        metadata=_list(_object(key=_TEXT, value=_TEXT)),
    ),
    "foxglove.PoseInFrame": _object(**_STAMPED, pose=_POSE),
    "foxglove.PosesInFrame": _object(**_STAMPED, poses=_list(_POSE)),
    "foxglove.CompressedImage": _object(
        **_STAMPED, data={"type": "string", "contentEncoding": "base64"}, format=_TEXT
    ),
    "foxglove.GeoJSON": _object(geojson=_TEXT),
}  # fmt: skip
"""The schemas, by name."""


def made_at(utc_ns: int, age_s: float | None) -> int:
    """Return when a sample was made, ns since 1970: now, if its stream has no ages."""
    return utc_ns if age_s is None else utc_ns - seconds_to_ns(age_s)


Put = Callable[[Channel, int, bytes], object]
"""Takes a channel, the instant in ns since 1970, and a message."""


class FoxgloveWriter:
    """Writes what the panels show.

    Args:
        put: Takes the messages.
    """

    def __init__(self, put: Put) -> None:
        self._put = put
        self._channels: dict[str, Channel] = {}
        self._tracks: dict[str, deque[dict[str, Any]]] = {}
        self._places: dict[int, tuple[float, float]] = {}

    def value(
        self,
        topic: str,
        value: object,
        utc_ns: int,
        *,
        made_ns: int,
        node: int | None,
        spec: TypeSpec | None = None,
    ) -> None:
        """Write what is in a sample.

        Args:
            topic: Topic of its channel.
            value: A mapping, or bytes; anything else has nothing in it.
            utc_ns: When it is recorded.
            made_ns: When it was made.
            node: The node that published it, None: not known.
            spec: Its type, which has units.
        """
        stamp = _stamp(made_ns, _LOCAL if node is None else f"node_{node}")
        image = _image_in(value)
        if image is not None:
            form, octets = image
            said = stamp | {"data": base64.b64encode(octets).decode(), "format": form}
            self._write(topic, "image", "CompressedImage", said, utc_ns)
        if not isinstance(value, Mapping):
            return
        place = _place_in(value, spec)
        if place is not None:
            if node is not None:
                self._places[node] = (place["latitude"], place["longitude"])
            self._write(topic, "location", "LocationFix", stamp | place, utc_ns)
        pose = _pose_in(value, spec)
        if pose is not None:
            self._pose(topic, pose, utc_ns, made_ns)

    def measured_range(self, node: int, peer: int, range_m: float | None, utc_ns: int) -> None:
        """Write a ring around the end of a measured range whose place is known."""
        ends = ((node, peer), (peer, node))
        known = next((each for each in ends if each[0] in self._places), None)
        if known is None or range_m is None or not 0 < range_m < _EARTH_M:
            return
        centre, other = known
        ring = [_beside(self._places[centre], range_m, turn) for turn in _turns()]
        shape = {
            "type": "Feature",
            "geometry": {"type": "LineString", "coordinates": ring},
            "properties": {"name": f"node {other}: {range_m:.0f} m from node {centre}"},
        }
        said = {"geojson": json.dumps(shape)}
        self._write(f"/{node}", f"range_to_{peer}", "GeoJSON", said, utc_ns)

    def measured_position(
        self, node: int, peer: int, east_m: float, north_m: float, up_m: float, utc_ns: int
    ) -> None:
        """Write where a peer is as seen from a node."""
        topic = f"/{node}/position_of_{peer}"
        pose = _pose(east_m, north_m, up_m, _NO_TURN)
        said = {"timestamp": _time(utc_ns), "frame_id": f"node_{node}", "pose": pose}
        self._write(topic, "pose", "PoseInFrame", said, utc_ns)
        if node in self._places:
            reach_m = math.hypot(east_m, north_m)
            longitude, latitude = _beside(self._places[node], reach_m, math.atan2(east_m, north_m))
            place = _stamp(utc_ns, f"node_{peer}") | _fix(latitude, longitude, up_m)
            self._write(topic, "location", "LocationFix", place, utc_ns)

    # Below the methods above

    def _pose(self, topic: str, pose: dict[str, Any], utc_ns: int, made_ns: int) -> None:
        stamp = _stamp(made_ns, _LOCAL)
        if not self._write(topic, "pose", "PoseInFrame", stamp | {"pose": pose}, utc_ns):
            return
        track = self._tracks.setdefault(topic, deque(maxlen=TRACK_POSES))
        track.append(pose)
        self._write(topic, "track", "PosesInFrame", stamp | {"poses": list(track)}, utc_ns)

    def _write(self, topic: str, what: str, kind: str, said: dict[str, Any], utc_ns: int) -> bool:
        """Write a message; False: there are too many topics."""
        name = f"{PREFIX}{topic}/{what}"
        channel = self._channels.get(name)
        if channel is None:
            if len(self._channels) >= _MOST_TOPICS:
                return False
            schema = f"foxglove.{kind}"
            channel = self._channels[name] = Channel(
                topic=name,
                encoding=JSON,
                schema_name=schema,
                schema_encoding=JSON_SCHEMA,
                schema=as_json({"title": schema, **SCHEMAS[schema]}),
            )
        self._put(channel, utc_ns, as_json(said))
        return True


_NO_TURN: Final = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def _time(utc_ns: int) -> dict[str, int]:
    seconds, rest = divmod(max(0, utc_ns), 10**9)
    return {"sec": seconds, "nsec": rest}


def _stamp(utc_ns: int, frame: str) -> dict[str, Any]:
    return {"timestamp": _time(utc_ns), "frame_id": frame}


def _turns() -> Iterator[float]:
    return (2 * math.pi * each / _RING_POINTS for each in range(_RING_POINTS + 1))


def _beside(place: tuple[float, float], reach_m: float, bearing_rad: float) -> tuple[float, float]:
    """Return longitude and latitude of a point so far from a place, on a sphere, degrees."""
    latitude, longitude = map(math.radians, place)
    angle = reach_m / _EARTH_M
    sine = math.sin(latitude) * math.cos(angle)
    sine += math.cos(latitude) * math.sin(angle) * math.cos(bearing_rad)
    there = math.asin(max(-1.0, min(1.0, sine)))
    east = math.sin(bearing_rad) * math.sin(angle) * math.cos(latitude)
    turn = math.atan2(east, math.cos(angle) - math.sin(latitude) * sine)
    around = (math.degrees(longitude + turn) + 180) % 360 - 180
    return round(around, 8), round(math.degrees(there), 8)


def _image_in(value: object) -> tuple[str, bytes] | None:
    """Return format and bytes of the image that a value is, or that a member of it is."""
    members = value.values() if isinstance(value, Mapping) else (value,)
    for each in members:
        if isinstance(each, bytes | bytearray | memoryview):
            octets = bytes(each)
            for beginning, form in _BEGINNINGS:
                if octets.startswith(beginning):
                    return form, octets
            if octets[:4] == b"RIFF" and octets[8:12] == b"WEBP":
                return "webp", octets
            if octets[4:12] == b"ftypavif":
                return "avif", octets
    return None


def _number(found: object) -> float | None:
    if not isinstance(found, int | float) or isinstance(found, bool):
        return None
    is_known = abs(found) < _MOST  # not so for infinity and NaN
    return float(found) if is_known else None


def _one_of(
    value: Mapping[str, Any], names: tuple[str, ...]
) -> tuple[str, float] | tuple[None, None]:
    """Return the first member of such a name that is a number, and the number."""
    low = {str(name).lower(): name for name in value}
    for name in names:
        if name in low and (number := _number(value[low[name]])) is not None:
            return low[name], number
    return None, None


def _unit(spec: TypeSpec | None, name: str) -> str:
    """Return the unit of a field: `deg`, `rad`, `deg*1e7`, or nothing that is known."""
    field = _field(spec, name)
    if field is None:
        return ""
    unit = field.unit.lower()
    if "e7" in unit:
        return _E7
    if unit.startswith(("rad", "deg", "°")):
        return "rad" if unit.startswith("rad") else "deg"
    if field.range is None:
        return ""
    return "deg" if max(abs(each) for each in field.range) > 7 else "rad"


def _field(spec: TypeSpec | None, name: str) -> FieldSpec | None:
    fields = () if spec is None else spec.fields
    return next((each for each in fields if each.name == name), None)


def _degrees(number: float, unit: str) -> float:
    return math.degrees(number) if unit == "rad" else number / 1e7 if unit == _E7 else number


def _parts(
    value: Mapping[str, Any], spec: TypeSpec | None, depth: int = 0
) -> Iterator[tuple[Mapping[str, Any], TypeSpec | None]]:
    """Return a value and the mappings in it, outer ones first, with their types."""
    yield value, spec
    if depth == _DEEPEST:
        return
    for name, each in value.items():
        if isinstance(each, Mapping):
            yield from _parts(each, _type_of(spec, name), depth + 1)


def _type_of(spec: TypeSpec | None, name: str) -> TypeSpec | None:
    field = _field(spec, name)
    if spec is None or field is None or not field.is_nested:
        return None
    return spec.nested_type(field.type)


def _place_in(value: Mapping[str, Any], spec: TypeSpec | None) -> dict[str, Any] | None:
    """Return the members of a location; None: there is none."""
    for part, kind in _parts(value, spec):
        north, latitude = _one_of(part, _LATITUDES)
        east, longitude = _one_of(part, _LONGITUDES)
        if latitude is None or longitude is None or north is None or east is None:
            continue
        latitude = _degrees(latitude, _unit(kind, north))
        longitude = _degrees(longitude, _unit(kind, east))
        if abs(latitude) > 90 or abs(longitude) > 180:
            continue
        others = {name: each for name, each in part.items() if name not in (north, east)}
        place = _fix(latitude, longitude, _up_in(part))
        heading_rad = _heading_in(part, kind)
        if heading_rad is not None:
            place["heading"] = heading_rad
        return place | {"metadata": _metadata(others)}
    return None


def _fix(latitude: float, longitude: float, altitude: float) -> dict[str, Any]:
    """Return a location without a covariance."""
    return {
        "latitude": latitude,
        "longitude": longitude,
        "altitude": altitude,
        "position_covariance": [0.0] * 9,
        "position_covariance_type": 0,
    }


def _metadata(others: Mapping[str, Any]) -> list[dict[str, str]]:
    """Return members as texts, which the map shows at the place."""
    plain = {name: each for name, each in others.items() if isinstance(each, int | float | str)}
    told = list(plain.items())[:_MOST_MEMBERS]
    return [{"key": str(name), "value": str(each)} for name, each in told]


def _up_in(part: Mapping[str, Any]) -> float:
    """Return the height of a position, m; below the surface it is negative."""
    _, down = _one_of(part, _DOWNS)
    if down is not None:
        return -down
    return _one_of(part, _UPS)[1] or 0.0


def _heading_in(part: Mapping[str, Any], kind: TypeSpec | None) -> float | None:
    """Return the heading, rad, clockwise from north; None: there is none, or in an unknown unit."""
    name, heading = _one_of(part, _HEADINGS)
    if name is None or heading is None:
        return None
    said = name.lower().rpartition("_")[2]
    unit = said if said in ("deg", "rad") else _unit(kind, name)
    return {"deg": math.radians(heading), "rad": heading}.get(unit)


def _pose(east: float, north: float, up: float, turn: dict[str, float]) -> dict[str, Any]:
    return {"position": {"x": east, "y": north, "z": up}, "orientation": turn}


def _pose_in(value: Mapping[str, Any], spec: TypeSpec | None) -> dict[str, Any] | None:
    """Return a pose, x east, y north, z up; None: there is none."""
    for part, kind in _parts(value, spec):
        _, north = _one_of(part, _NORTHS)
        _, east = _one_of(part, _EASTS)
        if north is not None and east is not None:
            heading_rad = _heading_in(part, kind)
            turn = _NO_TURN if heading_rad is None else _turned(math.pi / 2 - heading_rad)
            return _pose(east, north, _up_in(part), turn)
        position = part.get("position")
        if isinstance(position, Mapping):
            found = [_number(position.get(axis)) for axis in "xyz"]
            if None not in found:
                x, y, z = (each or 0.0 for each in found)
                return _pose(x, y, z, _orientation(part.get("orientation")))
    return None


def _turned(yaw_rad: float) -> dict[str, float]:
    return _NO_TURN | {"z": math.sin(yaw_rad / 2), "w": math.cos(yaw_rad / 2)}


def _orientation(written: object) -> dict[str, float]:
    found = written if isinstance(written, Mapping) else {}
    numbers = {axis: _number(found.get(axis)) for axis in "xyzw"}
    told = {axis: each for axis, each in numbers.items() if each is not None}
    length = math.sqrt(sum(each * each for each in told.values()))
    return told if len(told) == 4 and length > 0.5 else _NO_TURN
