"""A node that is closed says what it has to acknowledge: nobody else can tell the publisher."""

import asyncio
import json
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from tests.gateway.networkpair import verb
from tests.node.fleet import SECTION, ChannelServer, channel
from tests.runtime.loop_checks import run
from zacoustic import CommandKind, Config, DeliveryOutcome, Node, RemoteCommand
from zacoustic.blocking import Node as BlockingNode
from zacoustic.config import config_from_mapping
from zacoustic.zenoh.node.onlink.onlink import CLOSE_LINGER_S

S2C = "evologics_s2c_18_34"
# Slow enough that no answer is late for want of processor time: it would fall under a repetition.
TIME_SCALE = 10.0
RELIABLE = {"reliability": "reliable", "publishers": [1], "subscribers": [2], "depth": 8}
STREAMS: list[dict[str, Any]] = [
    {"id": 1, "topic": "note", **RELIABLE},
    {"id": 2, "topic": "photo", "max_bytes": 4000, **RELIABLE},
    {"id": 3, "topic": "log", "journal": True, **RELIABLE},
    {"id": 4, "topic": "kept", "journal": True, "max_bytes": 4000, **RELIABLE},
]
ONE_FLEET = SECTION | {"streams": STREAMS}
SIZES = [("note", 10), ("photo", 500), ("log", 10), ("kept", 500)]


def config(address: int) -> Config:
    return config_from_mapping(ONE_FLEET, source="fleet.json5", address=address)


@pytest.mark.parametrize(("topic", "size"), SIZES)
def test_publisher_hears_of_a_sample_behind_which_its_receiver_closes(
    topic: str, size: int, tmp_path: Path
) -> None:
    async def main() -> None:
        heard = 0
        with channel(S2C, TIME_SCALE) as medium:
            for round_ in range(3):
                shore = Node(1, config=config(1), link=medium.link(1), journal=tmp_path / "1")
                auv = Node(2, config=config(2), link=medium.link(2), journal=tmp_path / "2")
                async with shore:
                    async with auv:
                        taken = auv.subscribe(bytes, topic)
                        value = f"{topic} {round_}".encode().ljust(size)
                        delivery = shore.create_publisher(bytes, topic).publish(value)
                        assert (await taken.receive()).value == value
                    assert delivery is not None
                    with suppress(TimeoutError):
                        async with asyncio.timeout(10):
                            assert await delivery is DeliveryOutcome.DELIVERED
                            heard += 1
        assert heard >= 2  # the last word of a node that closes may collide, and is not repeated

    run(main(), limit_s=60)


def test_sub_that_ends_behind_a_sample_ends_pub_that_waits(tmp_path: Path) -> None:
    file = tmp_path / "fleet.json5"
    file.write_text(json.dumps({"plugins": {"acoustic": ONE_FLEET}}), encoding="utf-8")

    async def main(locator: str) -> None:
        where = ["--link", locator, "--config", str(file), "--address"]
        listening = asyncio.create_task(verb("topic", "echo", "note", *where, "2", "--count", "1"))
        told = await verb("topic", "pub", "note", "x", *where, "1", "--wait")
        assert told == 0
        assert await listening == 0

    with ChannelServer(S2C, TIME_SCALE) as locator:
        run(main(locator))


def test_blocking_node_says_it_as_well() -> None:
    with (
        ChannelServer(S2C, TIME_SCALE) as locator,
        BlockingNode(1, config=config(1), link=locator) as shore,
    ):
        with BlockingNode(2, config=config(2), link=locator) as auv:
            taken = auv.subscribe(bytes, "note")
            delivery = shore.create_publisher(bytes, "note").publish(b"x")
            assert taken.receive(timeout_s=10).value == b"x"
        assert delivery is not None
        assert delivery.wait(timeout_s=10) is DeliveryOutcome.DELIVERED


def test_node_that_owes_nothing_or_cannot_speak_closes_at_once() -> None:
    async def main() -> None:
        with channel(S2C, TIME_SCALE) as medium:
            async with Node(1, config=config(1), link=medium.link(1)) as shore:
                auv = Node(2, config=config(2), link=medium.link(2))
                await auv.open()
                taken = auv.subscribe(bytes, "note")
                await auv.command(2, RemoteCommand(kind=CommandKind.SILENCE, for_s=1000.0))
                shore.create_publisher(bytes, "note").publish(b"x")
                await taken.receive()
                began_s = time.monotonic()
                await auv.close()
                assert time.monotonic() - began_s < CLOSE_LINGER_S / 2

    run(main())
