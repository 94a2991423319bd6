import asyncio
from contextlib import AsyncExitStack
from typing import Any

import cbor2
import pytest
import zenoh

from tests.gateway.networks import (
    Channel,
    cbor,
    counts,
    get,
    hear,
    local_network,
    matched,
    run,
    until,
)
from zacoustic.gateway import Marker, read_marker

DOCUMENTS = (
    "clock", "dropped", "events", "journal", "ledger", "link", "node", "objects", "peers",
    "streams", "channel",
)  # fmt: skip
NAV = {"depth": 12.5, "mode": "survey"}


class Pair:
    """Shore 1 and vehicle 2, each with a plain client."""

    def __init__(self, stack: AsyncExitStack) -> None:
        self._stack = stack

    async def open(self, **channel: Any) -> None:
        self.channel = Channel(**channel)
        self.a = await self._stack.enter_async_context(local_network(1, self.channel))
        self.b = await self._stack.enter_async_context(local_network(2, self.channel))
        self.shore = self._stack.enter_context(self.a.client())
        self.auv = self._stack.enter_context(self.b.client())
        for session, key in ((self.shore, "chat"), (self.auv, "chat"), (self.auv, "auv1/nav")):
            await matched(session, key)

    async def settle(self) -> None:
        """Let what is under way cross: another sample behind it, there and back."""
        for sender, receiver in ((self.auv, self.shore), (self.shore, self.auv)):
            heard = await hear(receiver, "chat")
            sender.put("chat", b"settle")
            await heard.next()


def with_pair(test: Any) -> Any:
    """Run a test with a pair of local networks."""

    async def opened() -> None:
        async with AsyncExitStack() as stack:
            pair = Pair(stack)
            await pair.open()
            await test(pair)

    def runs() -> None:
        run(opened())

    runs.__name__ = test.__name__
    return runs


@with_pair
async def test_typed_sample_crosses_as_cbor_with_its_origin_and_age(pair: Pair) -> None:
    heard = await hear(pair.shore, "auv1/**")
    pair.auv.put("auv1/nav", cbor(**NAV), encoding="application/cbor")
    sample = await heard.next()
    assert str(sample.key_expr) == "auv1/nav"
    assert cbor2.loads(sample.payload.to_bytes()) == NAV
    assert str(sample.encoding) == "application/cbor"
    assert sample.attachment is not None
    marker = read_marker(sample.attachment.to_bytes())
    assert marker is not None
    assert marker.acoustic == 2
    assert marker.age_s is not None
    assert 0 <= marker.age_s < 5


@with_pair
async def test_sample_without_an_encoding_is_read_as_its_stream_says(pair: Pair) -> None:
    heard = await hear(pair.shore, "auv1/**")
    pair.auv.put("auv1/nav", cbor(**NAV))
    assert cbor2.loads(await heard.payload()) == NAV
    await matched(pair.auv, "auv1/json")
    pair.auv.put("auv1/json", b'{"depth": 12.5, "mode": "survey"}')
    sample = await heard.next()
    assert str(sample.encoding) == "application/json"
    assert sample.payload.to_bytes() == b'{"depth":12.5,"mode":"survey"}'


@with_pair
async def test_json_of_a_sample_stays_json_where_the_stream_is_cbor(pair: Pair) -> None:
    heard = await hear(pair.shore, "auv1/nav")
    pair.auv.put(
        "auv1/nav", b'{"depth": 1, "mode": "idle"}', encoding="application/json;charset=utf-8"
    )
    sample = await heard.next()
    assert str(sample.encoding) == "application/json"
    assert sample.payload.to_bytes() == b'{"depth":1.0,"mode":"idle"}'


@with_pair
async def test_opaque_bytes_cross_with_their_encoding_and_priority(pair: Pair) -> None:
    await matched(pair.shore, "auv1/text")
    heard = await hear(pair.auv, "auv1/text")
    pair.shore.put("auv1/text", b"\x00\xff", encoding="text/plain")
    sample = await heard.next()
    assert sample.payload.to_bytes() == b"\x00\xff"
    assert str(sample.encoding) == "text/plain"
    assert sample.priority == zenoh.Priority.REAL_TIME
    assert sample.congestion_control == zenoh.CongestionControl.DROP


@with_pair
async def test_each_node_publishes_its_own_key_of_a_stream_with_node_in_its_name(
    pair: Pair,
) -> None:
    await matched(pair.auv, "fleet/auv1/status")
    heard = await hear(pair.shore, "fleet/**")
    pair.auv.put("fleet/shore/status", b"not mine")
    pair.auv.put("fleet/auv1/status", b"mine")
    sample = await heard.next()
    assert (str(sample.key_expr), sample.payload.to_bytes()) == ("fleet/auv1/status", b"mine")


@with_pair
async def test_wildcard_takes_the_listed_values_and_complains_about_others(pair: Pair) -> None:
    await matched(pair.auv, "sonar/raw/auv1")
    heard = await hear(pair.shore, "*/raw/*")
    pair.auv.put("lidar/raw/auv1", b"not listed")
    pair.auv.put("sonar/raw/auv1", b"1")
    pair.auv.put("ctd/raw/auv1", b"2")
    found = [await heard.next() for _ in range(2)]
    assert {str(each.key_expr): each.payload.to_bytes() for each in found} == {
        "sonar/raw/auv1": b"1",
        "ctd/raw/auv1": b"2",
    }
    assert set((await get(pair.shore, "ctd/raw/*")).good) == {"ctd/raw/auv1"}
    dropped = (await get(pair.auv, "@acoustic/2/dropped")).payload("@acoustic/2/dropped")
    assert b'"{sensor}/raw/{node}":{"unknown_key":1}' in dropped


@with_pair
async def test_last_value_answers_a_get_until_the_key_is_deleted(pair: Pair) -> None:
    heard = await hear(pair.shore, "auv1/nav")
    assert (await get(pair.shore, "auv1/nav")).good == {}
    pair.auv.put("auv1/nav", cbor(depth=1, mode="idle"))
    pair.auv.put("auv1/nav", cbor(**NAV))
    while cbor2.loads(await heard.payload()) != NAV:
        pass
    for selector in ("auv1/nav", "*/nav"):
        replies = await get(pair.shore, selector)
        assert cbor2.loads(replies.payload("auv1/nav")) == NAV
    attachment = replies.good["auv1/nav"].attachment
    assert attachment is not None
    marker = read_marker(attachment.to_bytes())
    assert marker is not None
    assert marker.acoustic == 2
    assert marker.age_s is not None
    pair.auv.delete("auv1/nav")
    assert (await heard.next()).kind == zenoh.SampleKind.DELETE
    replies = await get(pair.shore, "auv1/nav")
    assert (replies.good, replies.errors) == ({}, [])


@with_pair
async def test_get_on_the_local_network_of_the_publisher_is_not_answered_by_the_gateway(
    pair: Pair,
) -> None:
    heard = await hear(pair.shore, "auv1/nav")
    pair.auv.put("auv1/nav", cbor(**NAV))
    await heard.next()
    assert (await get(pair.auv, "auv1/nav")).good == {}


@with_pair
async def test_nothing_comes_back_and_nothing_is_sent_twice(pair: Pair) -> None:
    at_shore, at_auv = await hear(pair.shore, "chat"), await hear(pair.auv, "chat")
    pair.shore.put("chat", b"from shore")
    assert await at_auv.payload() == b"from shore"
    pair.auv.put("chat", b"from the vehicle")  # would arrive behind an echo
    expected = [b"from shore", b"from the vehicle"]
    assert [await at_shore.payload() for _ in expected] == expected
    pair.shore.put("chat", b"the end")
    assert [await at_auv.payload() for _ in expected] == [b"from the vehicle", b"the end"]
    transmitted = (await get(pair.shore, "@acoustic/1/streams")).payload("@acoustic/1/streams")
    assert counts(transmitted, "chat") == {"published": 2, "received": 1, "transmitted": 2}


@with_pair
async def test_sample_that_came_off_the_channel_is_not_sent_again(pair: Pair) -> None:
    heard = await hear(pair.auv, "chat")
    pair.shore.put("chat", b"another gateway's", attachment=Marker(acoustic=3).encode())
    pair.shore.put("chat", b"ours", attachment=b"an application's")
    assert await heard.payload() == b"ours"


@with_pair
async def test_bad_payloads_are_counted_and_the_next_good_one_crosses(
    pair: Pair,
) -> None:
    heard = await hear(pair.shore, "auv1/json")
    await matched(pair.auv, "auv1/json")
    bad: list[tuple[bytes, str | None]] = [
        (b"{", None),
        (b"\xff\xff", "application/cbor"),
        (cbor(depth=-1, mode="idle"), "application/cbor"),
        (cbor(depth=1, mode="asleep"), "application/cbor"),
        (cbor(depth=1), "application/cbor"),
        (b"plain", "text/plain"),
        (b'{"depth": 1, "mode": "idle"}', None),
    ]
    for payload, encoding in bad:
        pair.auv.put("auv1/json", payload, encoding=encoding)
        if payload == bad[-1][0]:
            assert await heard.payload() == b'{"depth":1.0,"mode":"idle"}'
        else:  # each alone: the mailbox of this stream keeps one
            await pair.settle()
    dropped = (await get(pair.auv, "@acoustic/2/dropped")).payload("@acoustic/2/dropped")
    assert b'"auv1/json":{"payload":6}' in dropped


@with_pair
async def test_health_is_answered_published_and_stays_on_its_local_network(pair: Pair) -> None:
    here, beyond = await hear(pair.auv, "@acoustic/**"), await hear(pair.shore, "@acoustic/2/**")
    at_shore = await hear(pair.shore, "auv1/nav")
    pair.auv.put("auv1/nav", cbor(**NAV))
    await at_shore.next()
    keys = {f"@acoustic/2/{name}" for name in DOCUMENTS}
    replies = await get(pair.auv, "@acoustic/**")
    # An answer of the other modem may have told how far away it is.
    assert set(replies.good) - {"@acoustic/2/peer/1/range"} == keys
    assert b'"state":"up"' in replies.payload("@acoustic/2/link")
    assert b'"cause":"payload"' in replies.payload("@acoustic/2/ledger")
    while {str(sample.key_expr) for sample in here.samples} < {"@acoustic/2/link"}:
        await here.next()
    assert not beyond.samples


def test_idle_gateways_transmit_nothing_and_have_no_timer() -> None:
    async def main() -> None:
        channel = Channel()
        async with local_network(1, channel) as a, local_network(2, channel):
            with a.client() as client:
                assert len((await get(client, "@acoustic/1/**")).good) == len(DOCUMENTS)
            if timers := armed():  # the first health report
                await until(lambda: not armed(), signal_behind(timers))
            assert armed() == []
        assert channel.emissions == []

    run(main())


def armed() -> list[Any]:
    """Return the timers of the loop that gateways have armed."""
    loop: Any = asyncio.get_running_loop()
    timers = [each for each in loop._scheduled if not each.cancelled()]
    return [each for each in timers if "Health" in repr(each) or "LinkRunner" in repr(each)]


def signal_behind(timers: list[Any]) -> asyncio.Event:
    """Make an event that is set behind the last of these timers."""
    passed = asyncio.Event()
    asyncio.get_running_loop().call_at(max(each.when() for each in timers), passed.set)
    return passed


@pytest.mark.parametrize("profile", ["evologics_s2c_18_34"])
def test_samples_cross_channel_with_airtime_and_delay(profile: str) -> None:
    async def main() -> None:
        async with AsyncExitStack() as stack:
            pair = Pair(stack)
            await pair.open(profile=profile, time_scale=20.0)
            heard = await hear(pair.shore, "auv1/nav")
            pair.auv.put("auv1/nav", cbor(**NAV))
            assert cbor2.loads(await heard.payload()) == NAV

    run(main())
