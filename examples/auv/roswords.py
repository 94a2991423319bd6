"""What is another word in ROS 2: names without a chunk "0", numbers for words, pictures.

`fleet_ros.json5` has the streams of `fleet.json5` with types of ROS, and the same table on the
water. Two programs need the translation: the vehicle as a node of ROS (`rosspeech`), and a console
on the shore, which stays a plain Zenoh client there and sees types of ROS as maps.
"""

from pathlib import Path
from typing import Any, Final

from examples.auv.messages import JOINTS, NAV, PHOTO, STOP, Mode
from zacoustic.json5 import read_json5

FLEET: Final = Path(__file__).parent / "fleet_ros.json5"

_MODES: Final = [each.value for each in Mode]
_REASONS: Final = ["operator", "script"]
_NUMBERS: Final = {NAV: ("mode", _MODES), STOP: ("reason", _REASONS)}


def name_in_ros(topic: str) -> str:
    """Return the name of a topic, service or action, without its leading slash."""
    return topic.replace("/0/cmd_", "/cmd_") if topic in JOINTS else topic


def to_ros(topic: str, said: dict[str, Any] | bytes) -> dict[str, Any]:
    """Return a value in the members of the ROS type."""
    if isinstance(said, bytes):
        return {"data": said}  # the picture's other members are constants of the file
    if topic not in _NUMBERS:
        return said
    field, words = _NUMBERS[topic]
    return said | {field: words.index(said[field])}


def from_ros(topic: str, said: dict[str, Any]) -> Any:  # noqa: ANN401 (a map, or bytes)
    """Return a value in the form of `messages`."""
    if topic == PHOTO:
        return said["data"]
    if topic not in _NUMBERS:
        return said
    field, words = _NUMBERS[topic]
    return said | {field: words[said[field]]}


def shore_section() -> dict[str, Any]:
    """Return the section of `fleet_ros.json5` for a network without ROS: types, and no `ros: {}`.

    The table is the same, so its gateway and that of the vehicle understand each other.
    """
    whole: Any = read_json5(FLEET)
    section: dict[str, Any] = whole["plugins"]["acoustic"]
    section["ros"]["packages"] = str(FLEET.parent / section["ros"]["packages"])
    for stream in section["streams"]:
        del stream["ros"]
        kind = next(each for each in ("topic", "service", "action") if each in stream)
        stream[kind] = stream[kind].lstrip("/")
    return section
