"""Payloads such as vehicles publish them as JSON or CBOR without a type.

What such payloads have in common is the names of their fields and the signs between them. `NAMES`
are those that turn up again and again; from each follow the octets that JSON and CBOR put around
it, and what usually stands behind.
"""

from typing import Final

NAMES: Final = (
    "lat", "lon", "latitude", "longitude", "depth", "altitude", "heading", "course", "speed",
    "pitch", "roll", "yaw", "yaw_rate", "x", "y", "z", "w", "vx", "vy", "vz", "u", "v", "position",
    "orientation", "linear", "angular", "velocity", "acceleration", "pose", "twist", "covariance",
    "header", "stamp", "sec", "nanosec", "frame_id", "time", "timestamp", "t", "id", "name", "type",
    "source", "status", "state", "mode", "battery", "voltage", "current", "percentage", "charge",
    "temperature", "conductivity", "salinity", "pressure", "density", "sound_speed", "turbidity",
    "oxygen", "chlorophyll", "ph", "range", "bearing", "elevation", "azimuth", "snr", "rssi",
    "leak", "fault", "error", "warning", "message", "text", "level", "code", "value", "unit",
    "data", "values", "count", "index", "sequence", "seq", "mission", "leg", "waypoint", "goal",
    "command", "cmd", "target", "result", "progress", "ok", "enabled", "active", "sensor", "node",
    "vehicle", "map", "base_link", "odom", "wind", "wave", "tide", "rpm", "thrust", "rudder",
)  # fmt: skip
"""Names of fields."""

_JSON_TAILS: Final = (b"0", b"1", b"12.", b"-0.", b'"', b"{", b"[", b"true", b"false", b"null")
_CBOR_TAILS: Final = (b"\xfb@", b"\xfb\xbf", b"\xfb?", b"\xfa", b"\xf9", b"\x00", b"\x18", b"\x19",
                      b"\xf4", b"\xf5", b"\xf6", b"\xa3", b"\x83", b"`")  # fmt: skip


def payload_examples() -> list[bytes]:
    """Give texts that teach a text model what such payloads look like."""
    found = []
    for place, name in enumerate(NAMES):
        word, head = name.encode(), bytes((0x60 + len(name),))
        found.append(b'{"' + word + b'":' + _JSON_TAILS[place % len(_JSON_TAILS)])
        found.append(b',"' + word + b'":' + _JSON_TAILS[(place + 1) % len(_JSON_TAILS)])
        found.append(bytes((0xA1 + place % 12,)) + head + word + _CBOR_TAILS[place % 3])
        found.append(b"\x00" + head + word + _CBOR_TAILS[place % len(_CBOR_TAILS)])
    return found
