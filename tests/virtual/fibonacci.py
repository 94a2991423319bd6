"""A Fibonacci action of ROS 2 in virtual time: a goal, ten pieces of feedback, a result.

What it costs is in docs/ros2.md; `tests.benchmarks.bench_action_bytes` measures it.
"""

from collections.abc import Callable
from functools import partial
from typing import Any, Final

from tests.virtual.fleet import line
from zacoustic.config import config_from_mapping
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import Event, GoalKey, GoalStatus
from zacoustic.core.transport.actions.events import (
    FeedbackReceived,
    GoalAnswered,
    GoalReceived,
    ResultReceived,
)
from zacoustic.testing.virtual import VirtualNetwork

TWIST: Final = "geometry_msgs/msg/Twist"
FIBONACCI: Final = "example_interfaces/action/Fibonacci"
ORDER: Final = 10
START_S: Final = 300.0
"""When the goal is sent."""
FEEDBACK_EVERY_S: Final = 10.0


def section(codec: str) -> dict[str, Any]:
    # What orders up to 10 need: eleven numbers, and the last is 55.
    sequence = {"field": "sequence", "range": [0, 55], "max_length": ORDER + 1}
    return {
        "address": 1,
        "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
        "overlays": [
            {"type": TWIST, "fields": [{"field": "*.*", "range": [-2, 2], "step": 0.01}]},
            {"type": f"{FIBONACCI}_Goal", "fields": [{"field": "order", "range": [0, ORDER]}]},
            {"type": f"{FIBONACCI}_Feedback", "fields": [sequence]},
            {"type": f"{FIBONACCI}_Result", "fields": [sequence]},
        ],
        "streams": [
            {
                "id": 11,
                "topic": "/auv1/cmd_vel",
                "type": TWIST,
                "ros": {},
                "codec": codec,
                "publishers": [1],
                "subscribers": [2],
            },
            {"id": 12, "topic": "log", "publishers": [2], "subscribers": [1]},
            {"id": 13, "topic": "news", "publishers": [1], "subscribers": [2]},
            {
                "id": 30,
                "action": "/fibonacci",
                "type": FIBONACCI,
                "server": 2,
                "ros": {},
                "codec": "packed",
            },
        ],
    }


def network(
    codec: str,
    deliver: Callable[[int, Event], None],
    build: Callable[..., Engine] = Engine,
    **medium: Any,
) -> VirtualNetwork:
    table = config_from_mapping(section(codec), source="test").table
    scenario = line(0.0, 500.0, channel="none", **medium)
    return VirtualNetwork(scenario, table, deliver=deliver, digest=False, build=build)


def fibonacci(count: int) -> list[int]:
    numbers = [0, 1]
    while len(numbers) < count:
        numbers.append(numbers[-1] + numbers[-2])
    return numbers[:count]


class Run:
    """One goal.

    Args:
        seed: Of the water.
        loss: Share of the frames that it loses.
        cold: The nodes have never heard of each other; else each has said six things before.
        build: As that of `VirtualNetwork`.
    """

    def __init__(
        self,
        seed: int,
        *,
        loss: float = 0.3,
        cold: bool = False,
        build: Callable[..., Engine] = Engine,
    ) -> None:
        self.received = 0
        self.accepted: bool | None = None
        self.fed: list[list[int]] = []
        self.result: ResultReceived | None = None
        self._key: GoalKey | None = None
        self.medium = network("packed", self._take, build, seed=seed, loss={"frame": loss})
        for number in range(0 if cold else 6):
            self.medium.at(20 * number, partial(self.medium.publish, 2, 12, b"log"))
            self.medium.at(20 * number + 10, partial(self.medium.publish, 1, 13, b"log"))
        self._bytes_before = 0
        self.medium.at(START_S, self._send)
        self.medium.run(until_s=1500)

    @property
    def bytes_on_link(self) -> int:
        return self._count() - self._bytes_before

    def _count(self) -> int:
        return sum(stats.bytes_transmitted for stats in self.medium.stats())

    def _send(self) -> None:
        self._bytes_before = self._count()
        goal = {"order": ORDER}
        self.medium.apply(1, lambda engine, now: engine.actions.send_goal(30, goal, now))

    def _take(self, node: int, event: Event) -> None:
        match event:
            case GoalReceived():
                assert event.value == {"order": ORDER}
                self.received += 1
                self._key = event.goal
                self._serve(lambda engine, now: engine.actions.accept(event.goal, now))
                start_s = self.medium.now / 1e9
                for number in range(ORDER):
                    self.medium.at(
                        start_s + FEEDBACK_EVERY_S * (number + 1), partial(self._feed, number)
                    )
                self.medium.at(start_s + FEEDBACK_EVERY_S * (ORDER + 1), self._finish)
            case GoalAnswered():
                self.accepted = event.accepted
            case FeedbackReceived():
                self.fed.append(event.value["sequence"])
            case ResultReceived():
                self.result = event
            case _:
                pass

    def _feed(self, number: int) -> None:
        value = {"sequence": fibonacci(number + 2)}
        key = self._goal()
        self._serve(lambda engine, now: engine.actions.publish_feedback(key, value, now))

    def _finish(self) -> None:
        value, key = {"sequence": fibonacci(ORDER + 1)}, self._goal()
        self._serve(
            lambda engine, now: engine.actions.finish(key, GoalStatus.SUCCEEDED, value, now)
        )

    def _goal(self) -> GoalKey:
        assert self._key is not None
        return self._key

    def _serve(self, command: Callable[[Any, int], object]) -> None:
        self.medium.apply(2, command)

    def check(self) -> None:
        """Assert that the goal ran once, and that its client was told everything in order."""
        assert self.received == 1
        assert self.accepted
        assert self.result is not None
        assert self.result.value == {"sequence": fibonacci(ORDER + 1)}
        assert self.fed == sorted(self.fed, key=len)
        assert all(each == fibonacci(len(each)) for each in self.fed)
