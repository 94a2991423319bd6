"""Payloads in JSON or CBOR without a type, as vehicles publish them.

Such payloads share the names of their fields, which of these are adjacent, and the punctuation
between them. `MESSAGES` has messages of every usual kind, written as JSON; each also yields its
form with spaces, and its CBOR form, whose floats are spelled (`spelling`).
"""

import json
from typing import Final

from zacoustic.core.values.payload.items import FALSE, NULL, TEXT, TRUE, head, integer_item

_ARRAY: Final = 4
_MAP: Final = 5
_DOUBLE: Final = 0xFB

MESSAGES: Final = (
    '{"lat":54.321870,"lon":10.134522,"depth":35.4,"heading":271.5,"pitch":-4.1,"roll":0.8,'
    '"speed":1.24,"altitude":12.7,"yaw_rate":-0.3}',
    '{"latitude":54.321870,"longitude":-5.179849,"altitude":0.0,"heading":95.2,"course":96.0,'
    '"speed":0.92}',
    '{"lat":-33.8571,"lon":151.2152,"depth":120.0,"speed":1.5,"id":4}',
    '{"mode":2,"battery":87,"voltage":26.3,"current":3.42,"leak":false,"leg":7,"fault":0}',
    '{"state":"survey","mode":"auto","battery":{"voltage":24.81,"current":-2.3,'
    '"percentage":0.82,"charge":14.2},"armed":true,"error":null}',
    '{"status":"ok","name":"auv1","leak0":0,"leak1":0,"leak2":0,"leak3":0,"errors":[],'
    '"warnings":[]}',
    '{"temperature":12.408,"conductivity":38.204,"pressure":101.32,"salinity":34.92,'
    '"density":1026.1,"sound_speed":1502.4}',
    '{"temperature":4.1,"oxygen":212.5,"chlorophyll":0.42,"turbidity":1.07,"ph":8.05,'
    '"depth":310.6}',
    '{"range":412.6,"bearing":87.3,"elevation":-12.4,"sigma":0.5,"snr":14.2,"rssi":-52,'
    '"azimuth":181.0}',
    '{"surge":0.35,"sway":0.0,"heave":-0.12,"yaw":0.05,"enabled":true}',
    '{"x":104.25,"y":-31.08,"z":-35.42,"qx":0.012,"qy":-0.035,"qz":0.704,"qw":0.709}',
    '{"position":{"x":12.5,"y":-3.25,"z":0.0},"orientation":{"x":0.0,"y":0.0,"z":0.38,'
    '"w":0.924},"covariance":[0.0,0.0,0.0]}',
    '{"header":{"seq":1204,"stamp":{"sec":1771234567,"nanosec":250000000},'
    '"frame_id":"base_link"},"pose":{"pose":{"position":{"x":1.0,"y":2.0,"z":-3.0}}}}',
    '{"header":{"stamp":{"sec":12,"nanosec":0},"frame_id":"map"},"twist":{"linear":{"x":1.2,'
    '"y":0.0,"z":0.0},"angular":{"x":0.0,"y":0.0,"z":-0.05}}}',
    '{"time":1771234567.25,"vehicle":"auv1","type":"nav","data":{"lat":59.4271,"lon":24.7422,'
    '"depth":8.2,"yaw":1.571,"vx":0.81,"vy":-0.02,"vz":0.0}}',
    '{"t":105.0,"s":"nav","v":[54.321870,10.134522,35.4,330.7,-0.7,-0.1,1.06,140.1,-0.2]}',
    '{"timestamp":"2026-05-14T08:31:07.120Z","level":"info","source":"power",'
    '"message":"battery low","code":3}',
    '{"id":"auv1","seq":17,"cmd":"goto","target":{"lat":54.33,"lon":10.135,"depth":20.0,'
    '"speed":1.2},"timeout":600}',
    '{"command":"abort","reason":"operator","node":2}',
    '{"goal":12,"progress":0.45,"result":"reached","distance":25.4,"waypoint":3,'
    '"mission":"survey"}',
    '{"sensor":"ctd","value":8.412,"unit":"degC","valid":true,"count":120,"index":4}',
    '{"imu":{"accel":[0.02,-0.11,9.79],"gyro":[0.001,-0.004,0.012],"mag":[21.4,-3.2,44.0]},'
    '"pressure":1013.2}',
    '{"thrusters":[{"rpm":1250,"current":2.1,"temperature":18.4},{"rpm":-300,"current":0.4,'
    '"temperature":17.9}]}',
    '{"wind_speed":6.2,"wind_direction":225,"wave_height":0.8,"tide":1.4,"visibility":10}',
    '{"roll":0.8,"pitch":-4.1,"yaw":271.5,"rollspeed":0.01,"pitchspeed":0.0,"yawspeed":-0.02}',
    '{"tasks":[{"name":"dive","status":"done"},{"name":"survey","status":"active"},'
    '{"name":"surface","status":"pending"}]}',
    '{"key":"max_depth","text":"","values":[1,2,3],"ok":true,"active":false,"rudder":-5,'
    '"thrust":40}',
    '[{"lat":54.321870,"lon":10.134522,"name":"wp1"},{"lat":54.322501,"lon":10.135,"name":"wp2"}]',
    '{"north":12.4,"east":-3.1,"down":35.2,"u":0.12,"v":-0.05,"w":0.0,"fix":3,"satellites":9,'
    '"hdop":1.1}',
)
"""The messages; each number stands for any."""


class _Float(str):
    """A float as it is written."""

    __slots__ = ()


def payload_examples() -> list[bytes]:
    """Return spelled texts that train a text model on such payloads."""
    found = []
    for message in MESSAGES:
        value = json.loads(message, parse_float=_Float)
        found += [message.encode(), _spaced(value).encode(), _item(value)]
    return found


def _spaced(value: object) -> str:
    """Return JSON in Python's default spacing."""
    match value:
        case _Float():
            return value
        case dict():
            parts = (f"{json.dumps(key)}: {_spaced(each)}" for key, each in value.items())
            return "{" + ", ".join(parts) + "}"
        case list():
            return "[" + ", ".join(map(_spaced, value)) + "]"
        case _:
            return json.dumps(value)


def _item(value: object) -> bytes:
    """Return CBOR as most libraries write it: floats are doubles."""
    match value:
        case None:
            return bytes((NULL,))
        case bool():
            return bytes((TRUE if value else FALSE,))
        case int():
            return integer_item(value)
        case _Float():
            return bytes((_DOUBLE,)) + value.encode() + b"\n"
        case str():
            return head(TEXT, len(value)) + value.encode()
        case list():
            return head(_ARRAY, len(value)) + b"".join(map(_item, value))
        case dict():
            parts = (_item(key) + _item(each) for key, each in value.items())
            return head(_MAP, len(value)) + b"".join(parts)
        case _:
            raise TypeError(value)
