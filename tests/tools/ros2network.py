"""What five nodes of a real ROS 2 put on Zenoh, for the tools that listen to it.

Tokens and samples of `ros2_network.jsonl.gz`: rmw_zenoh_cpp 0.6.7 of Kilted, rclpy 9.1.2. Padding
bytes in its CDR are what was in the buffer. The vessel has `/auv1/vehicle`, `/auv1/nav/pilot`,
`/auv1/payload/sonar`, and `/beacon` in domain 3; the ship has `/ship/operator`.
"""

import gzip
import itertools
import json
import statistics
from pathlib import Path
from typing import Any, Final

from zacoustic.app.tools.design.first.survey import SeenTopic, Survey

_FILE: Final = Path(__file__).parent / "ros2_network.jsonl.gz"
_SHIP: Final = "%ship/operator"
_LISTENED_S: Final = 25.0
FROM_SHIP: Final = ("0/auv1/cmd_vel/", "0/auv1/order/", "0/auv1/plan/")
"""Keys that the ship publishes."""
DEFINITIONS: Final = {
    "action/Fibonacci.action": "int32 order\n---\nint32[] sequence\n---\nint32[] sequence\n",
    "msg/Strings.msg": (
        'string string_value\nstring string_value_default1 "Hello world!"\n'
        'string string_value_default2 "Hello\'world!"\n'
        "string string_value_default3 'Hello\"world!'\n"
        "string string_value_default4 'Hello\\'world!'\n"
        'string string_value_default5 "Hello\\"world!"\n'
        "string<=22 bounded_string_value\n"
        'string<=22 bounded_string_value_default1 "Hello world!"\n'
        'string<=22 bounded_string_value_default2 "Hello\'world!"\n'
        "string<=22 bounded_string_value_default3 'Hello\"world!'\n"
        "string<=22 bounded_string_value_default4 'Hello\\'world!'\n"
        'string<=22 bounded_string_value_default5 "Hello\\"world!"\n'
    ),
}
"""Files of the package ``test_msgs``, which does not ship."""


def rows(kind: str) -> list[dict[str, Any]]:
    """Return the tokens or the samples, in order."""
    with gzip.open(_FILE, "rt", encoding="utf-8") as lines:
        return [row for row in map(json.loads, lines) if row["kind"] == kind]


def tokens(*, of_ship: bool) -> tuple[str, ...]:
    """Return the tokens of the nodes of one side."""
    return tuple(row["key"] for row in rows("token") if (_SHIP in row["key"]) == of_ship)


def samples(*, of_ship: bool) -> dict[str, list[tuple[float, bytes]]]:
    """Return the instants, s, and payloads of one side by key."""
    found: dict[str, list[tuple[float, bytes]]] = {}
    for row in rows("sample"):
        if row["key"].startswith(FROM_SHIP) == of_ship:
            at_s = row["t"] / 1e3
            found.setdefault(row["key"], []).append((at_s, bytes.fromhex(row["payload"])))
    return found


def survey(*, of_ship: bool, silent: bool = False) -> Survey:
    """Return what somebody sees who listens to one side.

    Args:
        of_ship: Of the ship; otherwise of the vessel.
        silent: Nothing was published meanwhile.
    """
    heard = {} if silent else samples(of_ship=of_ship)
    return Survey(
        endpoint="tcp/127.0.0.1:7447" if not of_ship else "tcp/10.0.0.2:7447",
        listened_s=_LISTENED_S,
        topics=tuple(_seen(key, *zip(*each, strict=True)) for key, each in heard.items()),
        services=(),
        tells_services=True,
        ros_tokens=tokens(of_ship=of_ship),
    )


def write_definitions(folder: Path) -> Path:
    """Write the package ``test_msgs`` into a folder, and return the folder."""
    for name, text in DEFINITIONS.items():
        path = folder / "test_msgs" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return folder


def _seen(key: str, instants: tuple[float, ...], payloads: tuple[bytes, ...]) -> SeenTopic:
    gaps = [later - earlier for earlier, later in itertools.pairwise(instants)]
    sizes = [len(payload) for payload in payloads]
    return SeenTopic(
        key=key, samples=len(payloads), rate_hz=len(payloads) / _LISTENED_S,
        encoding="zenoh/bytes", smallest_bytes=min(sizes), largest_bytes=max(sizes),
        payloads=tuple(each for each in payloads if len(each) <= 4096),
        period_s=statistics.median(gaps) if gaps else None,
    )  # fmt: skip
