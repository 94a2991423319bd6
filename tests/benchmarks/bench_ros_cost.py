"""What a ROS message costs a gateway (`ros_cost`): CDR to bytes for the channel, and back.

Sending is reading the CDR, checking the value and coding it; receiving is decoding and writing the
CDR. Twist is bounded by an overlay; the others are as ROS defines them, every number in full width.
Target: at most 100 us of processor time for each.

    python -m tests.benchmarks.bench_ros_cost [--strict]
"""

import argparse
import math
import sys
import time
from pathlib import Path
from typing import Any, Final

# Run as a file, as `make bench` does, the project's root is not on the path.
sys.path.insert(0, str(Path(__file__).parents[2]))

from zacoustic.core.values.payload import CborCodec, PackedCodec, TypedCodec
from zacoustic.ros.interfaces import Interfaces
from zacoustic.ros.mapping import TypeMapper
from zacoustic.ros.messages import HeaderStamp, RosMessage
from zacoustic.ros.overlays import Overlay, OverlayField

TARGET_US: Final = 100.0
REPEATS: Final = 400
ROUNDS: Final = 25
OVERLAYS: Final = (
    Overlay(
        type="geometry_msgs/msg/Twist",
        fields=(OverlayField(field="*.*", range=(-2, 2), step=0.01),),
    ),
)
MESSAGES: Final = (
    ("geometry_msgs/msg/Twist", HeaderStamp.EXACT),
    ("nav_msgs/msg/Odometry", HeaderStamp.AGE),
    ("sensor_msgs/msg/NavSatFix", HeaderStamp.EXACT),
)


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--strict", action="store_true", help="fail where a target is missed")
    is_strict = parser.parse_args().strict
    interfaces = Interfaces("jazzy")
    mapper = TypeMapper(interfaces, OVERLAYS)
    worst = 0.0
    print(f"{'message':28} {'codec':7} {'CDR':>5} {'bytes':>6} {'send us':>9} {'receive us':>11}")
    for name, stamp in MESSAGES:
        message = RosMessage(interfaces, mapper, name, stamp)
        value = _filled(message.spec)
        cdr = message.write(value)
        codecs: tuple[TypedCodec, ...] = (CborCodec(message.spec), PackedCodec(message.spec))
        for codec in codecs:
            payload = codec.encode(message.read(cdr)[0])
            send_us = _best(lambda: codec.encode(message.read(cdr)[0]))  # noqa: B023
            receive_us = _best(lambda: message.write(codec.decode(payload)))  # noqa: B023
            worst = max(worst, send_us, receive_us)
            called = type(codec).__name__.removesuffix("Codec").lower()
            print(
                f"{name:28} {called:7} {len(cdr):5} {len(payload):6} {send_us:9.1f} "
                f"{receive_us:11.1f}"
            )
    print(f"worst {worst:.1f} us, target {TARGET_US:g} us")
    return int(is_strict and worst > TARGET_US)


def _best(step: Any) -> float:
    """Return the least mean processor time of a step, us."""
    best = math.inf
    for _ in range(ROUNDS):
        begun = time.process_time()
        for _ in range(REPEATS):
            step()
        best = min(best, (time.process_time() - begun) / REPEATS)
    return best * 1e6


def _filled(spec: Any) -> dict[str, Any]:
    """Make a value whose numbers are no round ones."""
    filled: dict[str, Any] = {}
    for index, field in enumerate(spec.fields):
        if field.is_nested:
            filled[field.name] = _filled(spec.nested_type(field.type))
        elif field.length is not None:
            filled[field.name] = [math.sqrt(number) for number in range(field.length)]
        elif field.type == "string":
            filled[field.name] = "base_link"
        else:
            filled[field.name] = math.sqrt(index) if field.type == "float64" else index
    return filled


if __name__ == "__main__":
    sys.exit(main())
