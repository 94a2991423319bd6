"""Latched topics: late joiners have the last samples at once, also after the gateway was restarted.

What ROS sees of it is in test_ros_topics.py.
"""

from contextlib import AsyncExitStack
from typing import Any, Final

import pytest
import zenoh
import zenoh.ext

from tests.gateway.networks import (
    Channel,
    Heard,
    config_of,
    get,
    hear,
    local_network,
    matched,
    run,
    zenoh_config,
    zenoh_router,
)
from tests.gateway.rosnode import LATCHED, Node, ros_session
from tests.gateway.rospair import SECTION as ROS_SECTION
from tests.gateway.rospair import STRING
from zacoustic.config import config_from_mapping
from zacoustic.core.base.qos import Priority
from zacoustic.gateway import Gateway
from zacoustic.run.journal import MemoryJournal
from zacoustic.zenoh.gateway.dialect.lastvalues import LastValue
from zacoustic.zenoh.gateway.streams.kept import KeptSamples
from zacoustic.zenoh.gateway.streams.localpublishers import LocalPublishers
from zacoustic.zenoh.session.latching import LatchedPublisher
from zacoustic.zenoh.session.marker import is_marked

SENSORS: Final = [{"name": "sensor", "values": ["ctd", "sonar"]}]
STREAMS: Final[list[dict[str, Any]]] = [
    {
        "id": 40,
        "topic": "auv1/map",
        "durability": "transient_local",
        "reliability": "reliable",
        "publishers": [2],
    },
    {
        "id": 11,
        "topic": "auv1/raw/{sensor}",
        "wildcards": SENSORS,
        "durability": "transient_local",
        "depth": 2,
    },
    {"id": 12, "topic": "chat"},
]
SECTION: Final[dict[str, Any]] = {
    "address": 1,
    "nodes": [{"address": 1, "name": "shore"}, {"address": 2, "name": "auv1"}],
    "streams": STREAMS,
}


def test_a_late_subscriber_of_zenoh_has_the_last_samples_at_once() -> None:
    async def main() -> None:
        channel = Channel()
        async with AsyncExitStack() as stack:
            a = await stack.enter_async_context(local_network(1, channel, section=SECTION))
            shore = stack.enter_context(a.client())
            early = await hear(shore, "auv1/**")
            async with local_network(2, channel, section=SECTION) as b:
                with b.client() as auv:
                    for key, payload in (
                        ("auv1/map", b"the map"),
                        ("auv1/raw/ctd", b"1"),
                        ("auv1/raw/ctd", b"2"),
                        ("auv1/raw/ctd", b"3"),
                        ("auv1/raw/sonar", b"ping"),
                    ):
                        await matched(auv, key)
                        auv.put(key, payload)
                        assert await early.payload() == payload
            # Nobody is left across the channel: it comes from the gateway of this local network.
            late = stack.enter_context(a.client())
            sample = await Heard(late, "auv1/map", history=1).next()
            assert sample.payload.to_bytes() == b"the map"
            assert sample.attachment is not None
            assert is_marked(sample.attachment.to_bytes())
            # Each by its own key: of a wildcard Zenoh's history leaves some out.
            ctd = Heard(late, "auv1/raw/ctd", history=2)
            assert [await ctd.payload(), await ctd.payload()] == [b"2", b"3"]
            assert await Heard(late, "auv1/raw/sonar", history=2).payload() == b"ping"
            assert (await get(late, "auv1/map")).payload("auv1/map") == b"the map"

    run(main())


@pytest.mark.parametrize("mode", ["client", "peer"])
def test_late_joiners_have_it_whatever_the_mode_of_the_gateway(mode: str) -> None:
    async def main() -> None:
        channel = Channel()
        with zenoh_router() as port:
            async with AsyncExitStack() as stack:
                link = channel.medium.link(1)
                shore = zenoh.open(zenoh_config("client", connect=port))
                stack.callback(shore.close)
                settings = zenoh_config(mode, connect=port)
                gateway = Gateway(config_of(1, settings, SECTION), link=link)
                await stack.enter_async_context(gateway)
                early = await hear(shore, "auv1/map")
                async with local_network(2, channel, section=SECTION) as b:
                    with b.client() as auv:
                        await matched(auv, "auv1/map")
                        auv.put("auv1/map", b"the map")
                        assert await early.payload() == b"the map"
                late = zenoh.open(zenoh_config("client", connect=port))
                stack.callback(late.close)
                assert await Heard(late, "auv1/map", history=1).payload() == b"the map"

    run(main())


def test_late_joiners_have_nothing_of_a_key_that_was_deleted() -> None:
    async def main() -> None:
        channel = Channel()
        async with AsyncExitStack() as stack:
            a = await stack.enter_async_context(local_network(1, channel, section=SECTION))
            shore = stack.enter_context(a.client())
            early = await hear(shore, "auv1/raw/**")
            b = await stack.enter_async_context(local_network(2, channel, section=SECTION))
            auv = stack.enter_context(b.client())
            await matched(auv, "auv1/raw/ctd")
            await matched(auv, "auv1/raw/sonar")
            auv.put("auv1/raw/sonar", b"ping")
            assert await early.payload() == b"ping"
            auv.put("auv1/raw/ctd", b"1")
            assert await early.payload() == b"1"
            auv.delete("auv1/raw/ctd")
            assert (await early.next()).kind == zenoh.SampleKind.DELETE
            late = Heard(stack.enter_context(a.client()), "auv1/raw/ctd", history=2)
            other = Heard(stack.enter_context(a.client()), "auv1/raw/sonar", history=2)
            assert await other.payload() == b"ping"
            # It is as if nothing had been there; and what comes later is kept as ever.
            auv.put("auv1/raw/ctd", b"2")
            assert await early.payload() == b"2"
            assert await late.payload() == b"2"
            later = Heard(stack.enter_context(a.client()), "auv1/raw/ctd", history=2)
            assert await later.payload() == b"2"
            assert [each.payload.to_bytes() for each in late.samples] == [b"2"]

    run(main())


def test_what_zenoh_has_in_a_cache_before_the_gateway_begins_crosses_too() -> None:
    async def main() -> None:
        channel = Channel()
        async with AsyncExitStack() as stack:
            b = await stack.enter_async_context(
                local_network(3, channel, section={"address": 3, "streams": []})
            )
            auv = stack.enter_context(ros_session(b.port))
            publisher = zenoh.ext.declare_advanced_publisher(
                auv, "auv1/map", cache=zenoh.ext.CacheConfig(max_samples=1)
            )
            publisher.put(b"the map")
            a = await stack.enter_async_context(local_network(1, channel, section=SECTION))
            told = await hear(stack.enter_context(a.client()), "auv1/map")
            await stack.enter_async_context(local_network(2, channel, section=SECTION, join=b.port))
            assert await told.payload() == b"the map"

    run(main())


def test_late_joiners_have_it_after_the_gateway_was_restarted() -> None:
    async def main() -> None:
        channel, journal = Channel(), MemoryJournal()
        section = ROS_SECTION | {"streams": [*ROS_SECTION["streams"], STREAMS[0]]}
        async with AsyncExitStack() as stack:
            async with local_network(1, channel, section=section, journal=journal) as a:
                shore = stack.enter_context(a.client())
                early = await hear(shore, "auv1/map")
                ros = stack.enter_context(ros_session(a.port))
                told = Node(ros, "early", domain=7).subscribe("/map", STRING, LATCHED)
                async with local_network(2, channel, section=section) as b:
                    with b.client() as auv, ros_session(b.port) as session:
                        await matched(auv, "auv1/map")
                        auv.put("auv1/map", b"the map")
                        await early.payload()
                        node = Node(session, "mapper", domain=7)
                        node.publisher("/map", STRING, LATCHED)({"data": "the map"})
                        await told.next()
            assert any(key.startswith("latched/") for key in journal.recover().entries)
            async with local_network(1, channel, section=section, journal=journal) as a:
                late = stack.enter_context(a.client())
                sample = await Heard(late, "auv1/map", history=1).next()
                assert sample.payload.to_bytes() == b"the map"
                assert (await get(late, "auv1/map")).payload("auv1/map") == b"the map"
                node = Node(stack.enter_context(ros_session(a.port)), "late", domain=7)
                value, beside = await node.subscribe("/map", STRING, LATCHED).next()
                assert value == {"data": "the map"}
                # A publisher that began anew: its numbers do, too.
                assert beside.sequence == 1
            # What another definition has made is nothing of this one's.
            streams = [each for each in section["streams"] if each.get("topic") == "auv1/map"]
            changed = [each | {"encoding": "text/plain"} for each in streams]
            async with local_network(
                1, channel, section=section | {"streams": changed}, journal=journal
            ):
                pass
            assert not any(key.startswith("latched/") for key in journal.recover().entries)

    run(main())


class Bare:
    """A session as the cache uses it."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session

    def callback(self, function: Any) -> Any:
        return zenoh.handlers.Callback(function)


def test_late_joiners_get_the_last_samples_of_each_publisher_and_none_that_is_too_old() -> None:
    async def main() -> None:
        now = 0
        with zenoh_router() as port:
            server = zenoh.open(zenoh_config("client", connect=port))
            late = zenoh.open(zenoh_config("client", connect=port))
            bare: Any = Bare(server)
            cache = LatchedPublisher(bare, "tf_static", 1, Priority.DATA, clock=lambda: now)
            cache.put(b"waits for the declaration", encoding="zenoh/bytes", source=7)
            cache.declare()
            for source, expires_at in enumerate((None, 10, 1000)):
                for payload in (b"old", b"new"):
                    said = payload + b" %d" % source
                    cache.put(said, encoding="zenoh/bytes", source=source, expires_at=expires_at)
            first = Heard(late, "tf_static", history=1)
            payloads = [await first.payload() for _ in range(4)]
            assert payloads == [b"waits for the declaration", b"new 0", b"new 1", b"new 2"]
            now = 10
            second = Heard(late, "tf_static", history=1)
            payloads = [await second.payload() for _ in range(3)]
            assert payloads == [b"waits for the declaration", b"new 0", b"new 2"]
            cache.clear()
            third = Heard(late, "tf_static", history=1)
            cache.put(b"next", encoding="zenoh/bytes")
            assert await third.payload() == b"next"
            cache.undeclare()
            late.close()  # type: ignore[no-untyped-call]
            server.close()  # type: ignore[no-untyped-call]

    run(main())


def test_a_publisher_that_starts_again_takes_the_number_of_one_that_has_gone() -> None:
    told: list[str] = []
    gone: set[bytes] = set()
    seen = LocalPublishers(2, gone.__contains__, told.append, sees_them=True)
    assert [seen.number("tf", each) for each in (b"a", b"b", b"a", b"b")] == [0, 1, 0, 1]
    gone.add(b"a")
    assert seen.number("tf", b"c") == 0
    assert not told
    assert seen.number("tf", b"d") == 1
    assert "more than 2 publishers" in told[0]
    assert seen.numbers("tf") == [0, 1]
    assert seen.numbers("other") == [0]
    unseen = LocalPublishers(1, lambda _: False, told.append, sees_them=False)
    assert [unseen.number("tf", each) for each in (b"a", b"b", b"b")] == [0, 0, 0]
    assert len(told) == 1  # the first may have started again
    unseen.number("tf", b"a")
    assert len(told) == 2


class Shelf:
    """A journal of one topic's samples, without a gateway."""

    def __init__(
        self, depth: int = 2, limit_bytes: int = 10_000, lifespan_s: float | None = None
    ) -> None:
        stream = STREAMS[1] | {"depth": depth}
        if lifespan_s is not None:
            stream |= {"lifespan_s": lifespan_s}
        self.table = config_from_mapping(SECTION | {"streams": [stream]}, source="test").table
        self.stream = self.table.by_id(11)
        self.stored: dict[str, bytes] = {}
        self.utc_ns = 10**18
        self.limit_bytes = limit_bytes
        self.begin()

    def begin(self) -> list[LastValue]:
        """Begin a life; returns what the one before has kept."""
        self.kept = KeptSamples(
            self._write,
            clock=lambda: 5,
            wall_clock=lambda: self.utc_ns,
            limit_bytes=self.limit_bytes,
        )
        return [value for _, value in self.kept.recover(dict(self.stored), self.table)]

    def keep(self, key: str, payload: bytes, age_s: float | None = None) -> None:
        self.kept.keep(
            self.stream,
            LastValue(
                key=key,
                stream_id=11,
                payload=payload,
                encoding="zenoh/bytes",
                source=2,
                age_s=age_s,
                received_at=5,
            ),
        )

    def _write(self, name: str, value: bytes | None) -> None:
        if value is None:
            del self.stored[name]
        else:
            self.stored[name] = value


def test_of_each_key_as_many_are_kept_as_the_topic_has() -> None:
    shelf = Shelf(depth=2)
    for number in range(5):
        shelf.keep("auv1/raw/ctd", b"%d" % number)
        shelf.keep("auv1/raw/sonar", b"%d" % (10 + number))
    payloads = [value.payload for value in shelf.begin()]
    assert payloads == [b"3", b"13", b"4", b"14"]
    shelf.keep("auv1/raw/ctd", b"5")
    shelf.kept.forget(shelf.stream, "auv1/raw/sonar")
    assert [value.payload for value in shelf.begin()] == [b"4", b"5"]


def test_the_room_is_bounded_and_the_oldest_go() -> None:
    shelf = Shelf(depth=1000, limit_bytes=10_000)
    for number in range(300):
        shelf.keep("auv1/raw/ctd", b"%04d" % number * 20)
        assert sum(map(len, shelf.stored.values())) < shelf.limit_bytes
    numbers = [int(value.payload[:4]) for value in shelf.begin()]
    assert len(numbers) > 20
    assert numbers == list(range(300 - len(numbers), 300))
    shelf.keep("auv1/raw/ctd", bytes(20_000))
    assert shelf.begin() == []


def test_the_age_goes_on_while_nobody_is_there() -> None:
    shelf = Shelf()
    shelf.keep("auv1/raw/ctd", b"x", age_s=2.0)
    shelf.utc_ns += 3600 * 10**9
    assert [value.age_s for value in shelf.begin()] == [3602.0]
    # A clock that was set back makes nothing younger.
    shelf.utc_ns -= 7200 * 10**9
    assert [value.age_s for value in shelf.begin()] == [2.0]


def test_what_is_older_than_its_lifespan_is_not_restored() -> None:
    shelf = Shelf(depth=4, lifespan_s=60.0)
    shelf.keep("auv1/raw/ctd", b"old", age_s=40.0)
    shelf.keep("auv1/raw/ctd", b"unknown")
    shelf.keep("auv1/raw/ctd", b"fresh", age_s=1.0)
    shelf.utc_ns += 30 * 10**9
    found = shelf.begin()
    assert [value.payload for value in found] == [b"unknown", b"fresh"]
    assert [value.expires_at(60.0) for value in found] == [5 + 30 * 10**9, 5 + 29 * 10**9]
    shelf.utc_ns += 31 * 10**9
    assert shelf.begin() == []
    assert not shelf.stored
