"""Who gets a sample, and as what: publishers, subscribers, keys, deletes, encodings, ages."""

import random
from functools import partial

import pytest

from tests.virtual.fleet import line
from zacoustic.core.base.qos import Priority, Qos, Stamp
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.streams.keys import Wildcard
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.virtual import Modem, VirtualNetwork

NODES = {1: "shore", 2: "auv1", 3: "auv2"}
MODEMS = (Modem(), Modem(addressed=False, checked=False, framed=False))


def fleet() -> StreamTable:
    deep = Qos(depth=100)
    return StreamTable(
        [
            TopicSpec(stream_id=1, name="all", qos=deep),
            TopicSpec(stream_id=2, name="to2", subscribers=(2,), qos=deep),
            TopicSpec(stream_id=3, name="to12", subscribers=(1, 2), qos=deep),
            TopicSpec(stream_id=4, name="from1", publishers=(1,), qos=deep),
            TopicSpec(
                stream_id=5,
                name="fleet/{node}/{part}",
                wildcards=(Wildcard(name="part", values=("nav", "arm")),),
                qos=deep,
            ),
            TopicSpec(stream_id=6, name="aged", qos=Qos(stamp=Stamp.AGE, depth=100)),
            TopicSpec(stream_id=7, name="alarm", qos=Qos(priority=Priority.REAL_TIME)),
            TopicSpec(stream_id=8, name="bulk", qos=Qos(priority=Priority.BACKGROUND, depth=1000)),
            TopicSpec(stream_id=9, name="fresh", qos=Qos(lifespan_s=5, depth=100)),
        ],
        nodes=NODES,
    )


def network(modem: Modem | None = None) -> tuple[VirtualNetwork, list[TraceRecord]]:
    """Return a shore and two vehicles, and the frames that they send."""
    sent: list[TraceRecord] = []

    def trace(record: TraceRecord) -> None:
        if record.what == "transmit":
            sent.append(record)

    medium = VirtualNetwork(line(0, 400, 800, channel="none"), fleet(), modem=modem, trace=trace)
    return medium, sent


def got(medium: VirtualNetwork, address: int) -> list[tuple[int, object]]:
    return [(event.stream_id, event.value) for event in medium.samples(address)]


@pytest.mark.parametrize("modem", MODEMS)
def test_subscribers_hear_and_the_others_do_not(modem: Modem) -> None:
    medium, sent = network(modem)
    for minute, stream_id in enumerate((1, 2, 3, 4)):  # what confirms the first is over by then
        medium.at(90 * minute, partial(medium.publish, 1, stream_id, bytes((stream_id,))))
    medium.run(until_s=360)
    assert got(medium, 2) == [(1, b"\x01"), (2, b"\x02"), (3, b"\x03"), (4, b"\x04")]
    assert got(medium, 3) == [(1, b"\x01"), (4, b"\x04")]
    assert got(medium, 1) == []
    assert [record.peer for record in sent if record.streams] == [BROADCAST, 2, 2, BROADCAST]


@pytest.mark.parametrize("modem", MODEMS)
def test_key_is_filled_in_with_the_name_of_the_source(modem: Modem) -> None:
    medium, _ = network(modem)
    medium.at(0, lambda: medium.publish(2, 5, b"x", instance=(1,)))
    medium.at(20, lambda: medium.publish(3, 5, b"y", instance=(0,)))
    medium.run(until_s=60)
    keys = fleet().by_id(5).keys
    events = medium.samples(1)
    assert [keys.key(event.source, event.instance) for event in events] == [
        "fleet/auv1/arm",
        "fleet/auv2/nav",
    ]


def test_samples_of_other_keys_do_not_push_each_other_out() -> None:
    medium, _ = network()
    medium.set_link(1, up=False)
    for instance in ((0,), (1,)):
        for number in range(3):
            medium.publish(1, 5, bytes((number,)), instance=instance)
    medium.set_link(1, up=True)
    medium.run(until_s=30)
    for instance in ((0,), (1,)):
        values = [event.value for event in medium.samples(2) if event.instance == instance]
        assert values == [b"\x00", b"\x01", b"\x02"]


@pytest.mark.parametrize("modem", MODEMS)
def test_delete_and_encoding_cross_with_their_sample(modem: Modem) -> None:
    medium, _ = network(modem)
    medium.apply(1, lambda engine, now: engine.publish(1, b"{}", now, encoding="application/json"))
    medium.apply(1, lambda engine, now: engine.publish(1, b"p", now, encoding="my/own"))
    medium.apply(1, lambda engine, now: engine.publish(1, None, now, delete=True))
    medium.apply(1, lambda engine, now: engine.publish(1, b"plain", now))
    medium.run(until_s=60)
    events = medium.samples(3, 1)
    assert [(event.value, event.encoding, event.deleted) for event in events] == [
        (b"{}", "application/json", False),
        (b"p", "my/own", False),
        (None, "zenoh/bytes", True),
        (b"plain", "zenoh/bytes", False),
    ]


def test_age_tells_how_old_a_sample_is_that_waited_in_queues() -> None:
    medium, _ = network()
    published_at: dict[bytes, int] = {}

    def publish(number: int) -> None:
        value = b"sample%02d" % number
        published_at[value] = medium.now
        medium.publish(1, 6, value)

    # The link is away for a while, in which samples wait.
    medium.at(100, lambda: medium.set_link(1, up=False))
    medium.at(400, lambda: medium.set_link(1, up=True))
    for number in range(40):
        medium.at(12.5 * number, partial(publish, number))
    medium.run(until_s=600)
    events = medium.samples(2, 6)
    assert [event.value for event in events] == list(published_at)
    ages_s = []
    for event in events:
        true_s = (event.received_at - published_at[event.value]) / 1e9
        assert event.age_s is not None
        assert abs(event.age_s - true_s) <= max(0.1, 0.05 * true_s)
        ages_s.append(event.age_s)
    assert min(ages_s) < 2.0
    assert max(ages_s) > 280


def test_sample_that_became_too_old_is_not_sent() -> None:
    medium, _ = network()
    medium.set_link(1, up=False)
    medium.publish(1, 9, b"old")
    medium.at(4, lambda: medium.publish(1, 9, b"new"))
    medium.at(6, lambda: medium.set_link(1, up=True))
    medium.run(until_s=60)
    assert got(medium, 2) == [(9, b"new")]
    assert medium.engine(1).expired == {9: 1}


@pytest.mark.parametrize("mtu_bytes", [8, 16, 32, 64])
def test_alarm_overtakes_a_thousand_background_samples(mtu_bytes: int) -> None:
    medium, sent = network(Modem(mtu_bytes=mtu_bytes))
    medium.publish(1, 1, b"")  # whoever hears it has confirmed it before the alarm

    def talk() -> None:
        for number in range(1000):
            medium.publish(1, 8, b"%03d" % (number % 1000))

    medium.at(90.0, talk)
    at_s = 120.0
    medium.at(at_s, lambda: medium.publish(1, 7, b"!!!"))
    medium.run(until_s=150)
    after = [record for record in sent if record.node == 1 and record.at >= at_s * 10**9]
    assert 7 in after[0].streams
    assert [event.value for event in medium.samples(2, 7)] == [b"!!!"]


@pytest.mark.parametrize("seed", range(10))
def test_samples_of_a_key_arrive_in_the_order_of_publication(seed: int) -> None:
    rng = random.Random(seed)
    medium = VirtualNetwork(
        line(0, 700, 300, channel="none", seed=seed, loss={"frame": 0.3}),
        fleet(),
        modem=Modem(mtu_bytes=rng.choice((16, 64))),
    )
    for number in range(200):
        source = rng.choice((1, 2, 3))
        value = number.to_bytes(2, "big")
        medium.at(rng.uniform(number, number + 1), partial(medium.publish, source, 1, value))
    medium.run(until_s=600)
    for address in NODES:
        for source in NODES:
            values = [event.value for event in medium.samples(address, 1) if event.source == source]
            assert values == sorted(set(values)), f"seed {seed}"
