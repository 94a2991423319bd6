"""Deadlines in direct mode: what does not come in time is an event at both ends."""

from typing import Any

import pytest

from tests.node.fleet import SECTION, channel
from tests.runtime.loop_checks import run
from zacoustic import ConfigError, DeadlineMissed, DeadlineSide, Node, Qos
from zacoustic.config import Config, config_from_mapping

STREAMS: list[dict[str, Any]] = [
    {"id": 10, "topic": "nav/{node}", "deadline_s": 0.1},
    {"id": 11, "topic": "chat"},
]


def config(address: int) -> Config:
    section = {"nodes": SECTION["nodes"], "streams": STREAMS, "address": address}
    return config_from_mapping(section, source="fleet.json5")


async def missed(node: Node, number: int) -> DeadlineMissed:
    """Wait for a missed period, counted from the start of the node."""
    async for event in node.events():
        if isinstance(event, DeadlineMissed) and event.missed >= number:
            return event
    raise AssertionError("the node has ended")


def test_both_ends_are_told_of_each_period_without_a_sample() -> None:
    async def main() -> None:
        with channel() as medium:
            shore = Node("shore", config=config(1), link=medium.link(1))
            auv = Node("auv1", config=config(2), link=medium.link(2))
            async with shore, auv:
                auv.create_publisher(bytes, "nav/auv1").publish(b"here")
                for number in (1, 3):
                    ours, theirs = await missed(auv, number), await missed(shore, number)
                    assert (ours.side, theirs.side) == (
                        DeadlineSide.OFFERED,
                        DeadlineSide.REQUESTED,
                    )
                    assert {ours.key, theirs.key} == {"nav/auv1"}
                    assert {ours.source, theirs.source} == {2}
                assert shore.stats.deadlines_missed[10] >= 3

    run(main())


def test_code_may_say_another_deadline_and_leaves_that_of_the_file_otherwise() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node(2, config=config(2), link=medium.link(2)) as node:
                node.create_publisher(bytes, "nav/auv1", Qos(depth=2))
                stream = node.find_stream("nav/auv1")
                assert stream is not None
                assert stream.qos.deadline_s == 0.1
                with pytest.raises(ConfigError, match="min_interval_s: 5; allowed: below deadline"):
                    node.create_publisher(bytes, "nav/auv1", Qos(min_interval_s=5))
                node.create_publisher(bytes, "nav/auv1", Qos(deadline_s=9, min_interval_s=5))
                assert stream.qos.deadline_s == 9

    run(main())
