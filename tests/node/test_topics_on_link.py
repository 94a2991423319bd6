"""Publishers and subscriptions in direct mode, over simulated water."""

import asyncio
import logging
import threading
import time
from typing import Annotated

import msgspec
import pytest

from tests.node.fleet import Nav, channel, config
from tests.runtime.loop_checks import run
from zacoustic import (
    Bounds,
    Durability,
    LinkClosedError,
    LocalError,
    Node,
    PayloadInvalidError,
    PayloadTooLargeError,
    Qos,
    Sample,
    Stamp,
)
from zacoustic.core.engine.events import LinkStateChanged, PeerSeen, StreamsDiffer
from zacoustic_sim.medium import SimMedium


def two_nodes(medium: SimMedium) -> tuple[Node, Node]:
    shore = Node("shore", config=config(), link=medium.link(1))
    return shore, Node("auv1", config=config(), link=medium.link(2))


def test_a_struct_crosses_and_arrives_as_its_class() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                subscription = shore.subscribe(Nav, "auv1/nav")
                auv.create_publisher(Nav, "auv1/nav").publish(Nav(depth=12.34, mode="survey"))
                sample = await subscription.receive()
                assert sample.value.depth == pytest.approx(12.3)
                assert sample.value.mode == "survey"
                assert (sample.key, sample.source, sample.deleted) == ("auv1/nav", 2, False)
                assert (sample.encoding, sample.age_s) == ("application/cbor", None)
                assert sample.received_at <= time.monotonic_ns()
                assert sample.metrics.snr_db is not None
                assert (shore.name, shore.address, auv.address) == ("shore", 1, 2)

    run(main())


def test_a_late_subscription_to_a_latched_topic_has_the_last_samples_at_once() -> None:
    latched = Qos(durability=Durability.TRANSIENT_LOCAL, depth=2)

    async def main() -> None:
        with channel() as medium:
            auv = Node(2, link=medium.link(2))
            async with Node("shore", address=1, link=medium.link(1)) as shore, auv:
                early = shore.subscribe(bytes, "map", latched, stream_id=10)
                publisher = auv.create_publisher(bytes, "map", latched, stream_id=10)
                for payload in (b"1", b"2", b"3"):
                    publisher.publish(payload)
                    assert (await early.receive()).value == payload
                late = shore.subscribe(bytes, "map")
                assert [(await late.receive()).value for _ in range(2)] == [b"2", b"3"]
                publisher.delete()
                assert (await late.receive()).deleted
                after = shore.subscribe(bytes, "map")
                publisher.publish(b"4")
                assert (await after.receive()).value == b"4"

    run(main())


def test_without_a_config_the_code_declares_the_stream_by_its_id() -> None:
    async def main() -> None:
        with channel() as medium:
            auv = Node(2, link=medium.link(2))
            async with Node("shore", address=1, link=medium.link(1)) as shore, auv:
                subscription = shore.subscribe(Nav, "nav", stream_id=10)
                publisher = auv.create_publisher(Nav, "nav", stream_id=10)
                again = auv.create_publisher(Nav, "nav")
                publisher.publish(Nav(depth=1.0, mode="idle"))
                assert (await subscription.receive()).value.mode == "idle"
                again.publish(Nav(depth=1.0, mode="abort"))
                assert (await subscription.receive()).value.mode == "abort"

    run(main())


def test_two_classes_of_one_name_are_two_types() -> None:
    def first() -> type[msgspec.Struct]:
        class Twin(msgspec.Struct):
            x: int

        return Twin

    def second() -> type[msgspec.Struct]:
        class Twin(msgspec.Struct):
            y: float

        return Twin

    async def main() -> None:
        with channel() as medium:
            auv = Node(2, link=medium.link(2))
            async with Node("shore", address=1, link=medium.link(1)) as shore, auv:
                for node in (shore, auv):
                    node.subscribe(first(), "one", stream_id=1)
                two = shore.subscribe(second(), "two", stream_id=2)
                auv.create_publisher(second(), "two", stream_id=2).publish(second()(y=0.5))
                assert msgspec.to_builtins((await two.receive()).value) == {"y": 0.5}

    run(main())


def test_a_type_by_name_gives_dicts_and_bytes_are_opaque() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                by_name = shore.subscribe("Nav", "auv1/nav")
                opaque = shore.subscribe(bytes, "note")
                auv.create_publisher("Nav", "auv1/nav").publish({"depth": 5, "mode": "idle"})
                publisher = auv.create_publisher(bytes, "note")
                publisher.publish(b"\x00\xff", encoding="image/png")
                assert (await by_name.receive()).value == {"depth": 5.0, "mode": "idle"}
                sample = await opaque.receive()
                assert (sample.value, sample.encoding) == (b"\x00\xff", "image/png")
                assert sample.age_s is not None

    run(main())


def test_a_deleted_key_arrives_as_a_sample_without_a_value() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                subscription = shore.subscribe(Nav, "auv1/nav")
                auv.create_publisher(Nav, "auv1/nav").delete()
                sample = await subscription.receive()
                assert sample.deleted
                assert sample.content is None
                with pytest.raises(LocalError, match="auv1/nav was deleted"):
                    _ = sample.value

    run(main())


def test_node_in_a_name_is_the_own_name_and_subscriptions_get_keys() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv, Node("auv2", config=config(), link=medium.link(3)) as other:
                every = shore.subscribe("Nav", "fleet/{node}/status")
                one = shore.subscribe("Nav", "fleet/auv2/status")
                for node in (auv, other):
                    publisher = node.create_publisher("Nav", "fleet/{node}/status")
                    assert publisher.key == f"fleet/{node.name}/status"
                    publisher.publish({"depth": node.address, "mode": "idle"})
                    await node.flush()
                keys = {(await every.receive()).key for _ in range(2)}
                assert keys == {"fleet/auv1/status", "fleet/auv2/status"}
                assert (await one.receive()).source == 3
                with pytest.raises(LocalError, match="no key that node 2"):
                    auv.create_publisher("Nav", "fleet/auv2/status")

    run(main())


def test_other_placeholders_are_filled_in_by_the_publisher() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                subscription = shore.subscribe(bytes, "{node}/part/{part}")
                auv.create_publisher(bytes, "{node}/part/thruster").publish(b"ok")
                assert (await subscription.receive()).key == "auv1/part/thruster"
                with pytest.raises(LocalError, match="one of their values"):
                    auv.create_publisher(bytes, "{node}/part/{part}")

    run(main())


def test_a_callback_gets_every_sample_and_may_be_a_coroutine_function() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                seen: list[str] = []
                done = asyncio.Event()

                def note(sample: Sample[Nav]) -> None:
                    seen.append(f"plain {sample.value.mode}")

                async def wait(sample: Sample[Nav]) -> None:
                    await asyncio.sleep(0)
                    seen.append(f"async {sample.value.mode}")
                    done.set()

                shore.create_subscription(Nav, "auv1/nav", note)
                shore.create_subscription(Nav, "auv1/nav", wait, Qos(depth=1))
                auv.create_publisher(Nav, "auv1/nav").publish(Nav(depth=1.0, mode="abort"))
                await done.wait()
                assert sorted(seen) == ["async abort", "plain abort"]

    run(main())


def test_a_callback_that_raises_is_logged_and_called_again(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                calls = 0
                twice = asyncio.Event()

                def fail(sample: Sample[bytes]) -> None:
                    nonlocal calls
                    calls += 1
                    if calls == 2:
                        twice.set()
                    raise RuntimeError("a bug of the application")

                shore.create_subscription(bytes, "note", fail)
                publisher = auv.create_publisher(bytes, "note")
                publisher.publish(b"1")
                publisher.publish(b"2")
                await twice.wait()

    with caplog.at_level(logging.ERROR):
        run(main())
    assert caplog.text.count("RuntimeError: a bug of the application") == 2


def test_what_nobody_takes_is_bounded_by_depth_and_the_latest_win() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                slow = shore.subscribe(bytes, "note", Qos(depth=2))
                counting = shore.subscribe(bytes, "note")
                publisher = auv.create_publisher(bytes, "note")
                for number in range(5):
                    publisher.publish(bytes([number]))
                for _ in range(5):
                    await counting.receive()
                assert [(await slow.receive()).value for _ in range(2)] == [b"\x03", b"\x04"]
                assert slow.dropped == 3

    run(main())


def test_a_node_does_not_hear_itself() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                own = auv.subscribe(bytes, "note")
                auv.create_publisher(bytes, "note").publish(b"mine")
                await auv.flush()
                shore.create_publisher(bytes, "note").publish(b"theirs")
                assert (await own.receive()).value == b"theirs"

    run(main())


def test_publish_works_from_another_thread_and_checks_the_value_there() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                subscription = shore.subscribe(Nav, "auv1/nav")
                publisher = auv.create_publisher(Nav, "auv1/nav")

                def other_thread() -> None:
                    assert threading.current_thread() is not threading.main_thread()
                    with pytest.raises(PayloadInvalidError, match=r"Nav\.depth"):
                        publisher.publish(Nav(depth=2000.0, mode="idle"))
                    publisher.publish(Nav(depth=7.0, mode="idle"))

                await asyncio.to_thread(other_thread)
                assert (await subscription.receive()).value.depth == pytest.approx(7.0)

    run(main())


def test_values_that_cannot_be_sent_are_refused_at_once() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                nav = auv.create_publisher(Nav, "auv1/nav")
                with pytest.raises(PayloadInvalidError, match=r"Nav\.depth is 2000\.0"):
                    nav.publish(Nav(depth=2000.0, mode="idle"))
                with pytest.raises(PayloadTooLargeError):
                    auv.create_publisher(bytes, "note").publish(b"x" * 1000)
                nav.close()
                with pytest.raises(LocalError, match="closed"):
                    nav.publish(Nav(depth=1.0, mode="idle"))

    run(main())


def test_a_class_that_refuses_a_sample_does_not_end_the_iteration() -> None:
    class Careful(msgspec.Struct):
        depth: Annotated[float, Bounds(0, 1000, step=0.1)]
        mode: str

    class Picky(msgspec.Struct):
        x: int

        def __post_init__(self) -> None:
            if self.x == 13:
                raise ValueError("13 is unlucky")

    async def main() -> None:
        with channel() as medium:
            auv = Node(2, link=medium.link(2))
            async with Node(1, link=medium.link(1)) as shore, auv:
                subscription = shore.subscribe(Picky, "x", stream_id=1)
                publisher = auv.create_publisher(
                    msgspec.defstruct("Picky", [("x", int)]), "x", Qos(depth=2), stream_id=1
                )
                publisher.publish(msgspec.defstruct("Any", [("x", int)])(x=13))
                publisher.publish(msgspec.defstruct("Any", [("x", int)])(x=14))
                assert (await subscription.receive()).value.x == 14
                assert shore.stats.dropped == {"refused_by_class": 1}

    run(main())


def test_iteration_ends_when_the_subscription_or_the_node_is_closed() -> None:
    async def main() -> None:
        with channel() as medium:
            async with Node("shore", config=config(), link=medium.link(1)) as shore:
                first, second = shore.subscribe(bytes, "note"), shore.subscribe(bytes, "note")
                first.close()
                assert [sample async for sample in first] == []
                with pytest.raises(LocalError, match="is closed"):
                    await first.receive()
                left = asyncio.create_task(anext(second, None))
                await asyncio.sleep(0)
            assert await left is None
            with pytest.raises(LocalError, match="node shore is closed"):
                shore.subscribe(bytes, "note")

    run(main())


def test_a_node_whose_engine_fails_says_so_everywhere(caplog: pytest.LogCaptureFixture) -> None:
    async def main() -> None:
        with channel() as medium:
            link = medium.link(1)
            async with Node("shore", config=config(), link=link) as shore:
                subscription = shore.subscribe(bytes, "note")

                def broken(*_: object) -> None:
                    raise RuntimeError("a bug of the link")

                link.transmit = broken  # type: ignore[assignment]
                shore.create_publisher(bytes, "note").publish(b"x")
                with pytest.raises(LinkClosedError, match="a bug of the link"):
                    await subscription.receive()
                with pytest.raises(LinkClosedError, match="a bug of the link"):
                    shore.create_publisher(bytes, "note").publish(b"x")
                with pytest.raises(LinkClosedError, match="a bug of the link"):
                    await shore.flush()

    run(main())
    assert "stopped by a fault" in caplog.text


def test_events_tell_of_link_peers_and_differing_streams(
    caplog: pytest.LogCaptureFixture,
) -> None:
    async def main() -> None:
        with channel() as medium:
            auv = Node(2, link=medium.link(2))
            async with Node(1, link=medium.link(1)) as shore, auv:
                shore.subscribe(bytes, "one", stream_id=1)
                shore.subscribe(bytes, "same", stream_id=2)
                same = auv.create_publisher(bytes, "same", stream_id=2)
                auv.create_publisher(bytes, "two", stream_id=1).publish(b"x")
                same.publish(b"y")
                kinds: list[type] = []
                async for event in shore.events():
                    kinds.append(type(event))
                    if isinstance(event, StreamsDiffer):
                        assert (event.address, event.stream_id) == (2, 1)
                        break
                assert kinds[:2] == [LinkStateChanged, PeerSeen]

    run(main())
    assert "define stream 1 (one) in different ways" in caplog.text


def test_stats_and_ledger_are_those_of_the_engine() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                subscription = shore.subscribe(bytes, "note")
                auv.create_publisher(bytes, "note").publish(b"x")
                await subscription.receive()
                await auv.flush()
                assert auv.stats.published == {11: 1}
                assert shore.stats.received == {11: 1}
                total = sum(entry.transmitted_bytes for entry in auv.ledger())
                assert total == auv.stats.bytes_transmitted > 0

    run(main())


def test_code_may_tune_how_samples_wait_and_not_what_both_ends_agree_on() -> None:
    async def main() -> None:
        with channel() as medium:
            shore, auv = two_nodes(medium)
            async with shore, auv:
                subscription = shore.subscribe(bytes, "note")
                publisher = auv.create_publisher(bytes, "note", Qos(depth=1))
                publisher.publish(b"old")
                publisher.publish(b"new")
                publisher.publish(b"newest")
                await auv.flush()
                sample = await subscription.receive()
                assert sample.age_s is not None
                values = [sample.value, (await subscription.receive()).value]
                assert values == [b"old", b"newest"]
                with pytest.raises(ValueError, match="stamp: age; allowed: none"):
                    auv.create_publisher(Nav, "auv1/nav", Qos(stamp=Stamp.AGE))

    run(main())
