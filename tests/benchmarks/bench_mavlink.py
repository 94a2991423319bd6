"""HIGH_LATENCY2 as `zacoustic mavlink` carries it: bytes of a sample, compared with MAVLink's.

Missions of made-up surveys, seen by an autopilot and packed into a HIGH_LATENCY2 every ten seconds.
Each sample is a frame of its own; "alone" means that nobody ever acknowledges one. Every frame that
arrives is decoded and compared.

    python -m tests.benchmarks.bench_mavlink
"""

import itertools
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

# Run as a file, as `make bench` does, the project's root is not on the path.
sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.telemetry.exchange import Counters, exchange
from tests.telemetry.mission import Mission
from zacoustic.config import config_from_mapping
from zacoustic.core.values.dense import DenseCodec, DenseSample
from zacoustic.core.values.types import TypeSpec
from zacoustic.mavlink.dialect import Message, PacketCodec
from zacoustic.mavlink.entries import CLOCK, TELEMETRY, entries
from zacoustic.mavlink.telemetry import HIGH_LATENCY2, heartbeat, value_of

EVERY: Final = 2
"""One of so many nav messages, which come every five seconds."""
STREAM_ID: Final = 60
SUBMARINE, ARDUPILOT = 12, 3


def main() -> int:
    """Measure and print."""
    missions = [list(reports(Mission(seed))) for seed in (1, 2, 3, 4)]
    type_spec = type_of_telemetry()
    beat = heartbeat(SUBMARINE, ARDUPILOT, base_mode=209, custom_mode=3)
    rows = {
        "alone": (None, 0.0),
        "acknowledged": (1, 0.0),
        "acknowledged, 10 % loss": (1, 0.1),
        "every fourth acknowledged": (4, 0.0),
        "every fourth acknowledged, 30 % loss": (4, 0.3),
    }
    packets = PacketCodec()
    sizes = [len(packets.pack(each, system=1, component=1)) for each in itertools.chain(*missions)]
    print(f"{'a HIGH_LATENCY2':40}{'mean bytes':>12}{'p95':>6}{'undecodable':>13}{'wrong':>7}")
    print(f"{'MAVLink 2 packet':40}{sum(sizes) / len(sizes):12.1f}{max(sizes):6}")
    for name, (ack_every, loss) in rows.items():
        found = [run(mission, beat, type_spec, ack_every, loss) for mission in missions]
        every = Counters(
            sizes=[size for each in found for size in each.sizes],
            messages=[],
            undecodable=sum(each.undecodable for each in found),
            wrong=sum(each.wrong for each in found),
        )
        print(f"{name:40}{every.mean:12.1f}{every.p95:6}{every.undecodable:13}{every.wrong:7}")
    return 0


def run(
    mission: list[Message],
    beat: Message,
    type_spec: TypeSpec,
    ack_every: int | None,
    loss: float,
) -> Counters:
    """Send a mission."""
    groups = [
        [DenseSample(STREAM_ID, value_of(report, beat, 1) | clock_of(report), count)]
        for count, report in enumerate(mission)
    ]
    codec = DenseCodec({STREAM_ID: type_spec})
    return exchange(codec, groups, ack_every=ack_every, loss=loss)


def clock_of(report: Message) -> dict[str, int]:
    """Return the clock of the bridge: begins at a random time, and is as late as the report."""
    return {CLOCK: (report.fields["timestamp"] + 2_345_678_000) % 2**32}


def type_of_telemetry() -> TypeSpec:
    """Return the type that `zacoustic mavlink streams` prints."""
    made = entries("auv1/mavlink", vehicle=2, shore=1, first_id=STREAM_ID)
    config = config_from_mapping({"address": 1, **made}, source="bench")
    (found,) = (each.type for each in config.table if each.name.endswith(TELEMETRY))
    assert found is not None
    return found


def reports(mission: Mission) -> Iterator[Message]:
    """Give what an autopilot would say of a mission."""
    waypoint: dict[str, float] = {}
    number = battery = 0
    count = itertools.count()
    for at_s, name, value in mission.samples:
        if name == "wp":
            waypoint, number = value, number + 1
        elif name == "status":
            battery = value["battery"]
        elif name == "nav" and next(count) % EVERY == 0:
            yield report(at_s, value, waypoint, number, battery)


def report(
    at_s: float, nav: dict[str, Any], waypoint: dict[str, float], number: int, battery: int
) -> Message:
    """Pack a nav message into a HIGH_LATENCY2."""
    north_m = (waypoint.get("lat", nav["lat"]) - nav["lat"]) * 111_200
    east_m = (waypoint.get("lon", nav["lon"]) - nav["lon"]) * 111_200
    return Message(
        HIGH_LATENCY2,
        {
            # Seconds, as they cross; an autopilot is late by up to a third of one.
            "timestamp": round(12.3 + at_s + (at_s * 7 % 11) / 33) * 1000,
            "type": SUBMARINE,
            "autopilot": ARDUPILOT,
            "custom_mode": 3,
            "latitude": round(nav["lat"] * 1e7),
            "longitude": round(nav["lon"] * 1e7),
            "altitude": -round(nav["depth"]),
            "target_altitude": -round(waypoint.get("depth", nav["depth"])),
            "heading": int(nav["heading"] / 2) % 180,
            "target_heading": int(nav["heading"] / 10) * 5 % 180,
            "target_distance": min(65535, int((north_m**2 + east_m**2) ** 0.5 / 10)),
            "throttle": 45,
            "airspeed": 0,
            "airspeed_sp": 0,
            "groundspeed": round(nav["speed"] * 5),
            "windspeed": 0,
            "wind_heading": 0,
            "eph": 12,
            "epv": 3,
            "temperature_air": 11,
            "climb_rate": 0,
            "battery": max(0, battery),
            "wp_num": number,
            "failure_flags": 0,
            "custom0": -47,
            "custom1": 0,
            "custom2": 0,
        },
    )


if __name__ == "__main__":
    sys.exit(main())
