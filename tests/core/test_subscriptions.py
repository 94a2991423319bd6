"""On-demand topics, two or three ends by hand: what crosses, and what does not."""

from typing import Any

import pytest

from tests.core.rig import Rig
from zacoustic.core.base.qos import Forward, Priority, Qos, Reliability
from zacoustic.core.base.stats import Cause
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import (
    DeliveryEnded,
    DeliveryOutcome,
    SampleReceived,
    SubscribersChanged,
)
from zacoustic.core.linktypes import BROADCAST, Transmission
from zacoustic.core.profiles.native.controls import CONTROLS
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.frame import parse_frame
from zacoustic.core.wire.subscriptions import Subscribe
from zacoustic.errors import ConfigError, LocalError, UnknownStreamError

ON_DEMAND = Qos(forward=Forward.ON_DEMAND, depth=4)
RELIABLE = Qos(forward=Forward.ON_DEMAND, reliability=Reliability.RELIABLE, depth=8)


def fleet(nodes: int = 2, **settings: Any) -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=10, name="view", publishers=(2,), qos=ON_DEMAND),
            TopicSpec(stream_id=11, name="other", publishers=(2,), qos=ON_DEMAND),
            TopicSpec(stream_id=12, name="always"),
            TopicSpec(stream_id=17, name="each/{node}", qos=ON_DEMAND),
            ServiceSpec(stream_id=20, name="arm", server=2),
            TopicSpec(stream_id=30, name="log", publishers=(2,), qos=RELIABLE, journal=True),
        ],
        nodes={address: f"n{address}" for address in range(1, nodes + 1)},
    )


def rig(nodes: int = 2) -> Rig:
    return Rig(dict.fromkeys(range(1, nodes + 1), fleet(nodes)))


def acquainted(nodes: int = 2) -> Rig:
    """Return ends that have confirmed each other."""
    medium = rig(nodes)
    for address in (*medium.ends, *medium.ends):
        medium.publish(address, 12, b"")
        medium.run(100)
    return medium


def want(medium: Rig, node: int, stream_id: int, *sources: int) -> None:
    medium[node].engine.subscriptions.want(stream_id, medium.now, sources)


def messages(frames: list[bytes]) -> list[Subscribe]:
    """Return the letters and answers in frames without records of other streams before them."""
    return [
        item
        for frame in frames
        for item in parse_frame(frame, lambda *_: None, CONTROLS, unicast=True)
        if isinstance(item, Subscribe)
    ]


def subscribers(medium: Rig, node: int, stream_id: int) -> set[int]:
    engine = medium[node].engine
    subscribers = engine.subscriptions.subscribers(engine.table.by_id(stream_id))
    assert subscribers is not None
    return set(subscribers)


def test_nothing_crosses_before_somebody_subscribes() -> None:
    medium = rig()
    for _ in range(3):
        medium.publish(2, 10, b"seen by nobody")
        assert medium.run(100) == []
    assert medium[2].engine.stats.unsubscribed == {10: 3}
    assert medium[2].engine.is_idle


def test_subscription_crosses_once_and_samples_go_to_the_subscriber() -> None:
    medium = rig()
    want(medium, 1, 10, 2)
    frames = medium.run(1)
    assert messages(frames) == [
        Subscribe(1, 1, 0b100),  # it has not heard the publisher
        Subscribe(1, 1, 0b100, is_answer=True, heard=1),
        Subscribe(1, 1, 0b100, heard=1),
        Subscribe(1, 1, 0b100, is_answer=True, heard=1, is_kept=True),
    ]
    medium.publish(2, 10, b"sample")
    medium.run(100)
    assert [each.value for each in medium[1].got(SampleReceived)] == [b"sample"]
    assert medium.frames[-1][1].destination in (1, 2)
    assert medium[2].got(SubscribersChanged)[-1].subscribers == (1,)
    assert all(end.engine.is_idle for end in medium.ends.values())
    ledger = {(each.stream_id, each.cause) for each in medium[1].engine.stats.ledger()}
    assert (0, Cause.SUBSCRIBE) in ledger


def test_known_ends_spend_six_bytes_each_way() -> None:
    medium = acquainted()
    want(medium, 1, 10, 2)
    assert [frame.hex() for frame in medium.run(100)] == ["bc4101040001", "bce101040001"]


def test_withdrawn_subscription_ends_the_samples_that_wait() -> None:
    medium = rig()
    want(medium, 1, 10, 2)
    medium.run(100)
    want(medium, 1, 10)
    message = medium[1].send(medium.now)
    assert message is not None
    medium.publish(2, 10, b"too late")
    medium.deliver(1, message)
    assert SampleReceived not in {type(each) for each in medium[1].events}
    frames = medium.run(100)
    assert messages(frames)[-1] == Subscribe(1, 2, 0, is_answer=True, heard=1, is_kept=True)
    assert medium[1].got(SampleReceived) == []
    assert medium[2].engine.stats.unsubscribed == {10: 1}
    assert medium[2].got(SubscribersChanged)[-1].subscribers == ()


def test_what_changes_before_it_was_said_is_not_said() -> None:
    medium = rig()
    want(medium, 1, 10, 2)
    want(medium, 1, 10)
    assert medium.run(100) == []
    want(medium, 1, 10, 2)
    want(medium, 1, 11, 2)
    want(medium, 1, 17, 2)
    said = [each.streams for each in messages(medium.run(100)) if not each.is_answer]
    assert said == [0b1100, 0b10] * 2
    want(medium, 1, 10)
    want(medium, 1, 10, 2)
    assert medium.run(100) == []
    assert all(end.engine.is_idle for end in medium.ends.values())


def test_each_publisher_is_asked_for_itself() -> None:
    medium = rig(3)
    want(medium, 1, 17, 3)
    medium.run(10)
    medium.publish(2, 17, b"two")
    medium.publish(3, 17, b"three")
    medium.run(10)
    assert [each.value for each in medium[1].got(SampleReceived)] == [b"three"]
    medium[1].engine.subscriptions.want(17, medium.now)
    assert medium[1].engine.subscriptions.wanted(17) == {2, 3}
    medium.run(100)
    medium.publish(2, 17, b"two")
    medium.run(10)
    assert [each.value for each in medium[1].got(SampleReceived)] == [b"three", b"two"]


def test_samples_go_to_one_subscriber_alone_or_to_all() -> None:
    medium = rig(3)
    want(medium, 1, 10, 2)
    medium.run(100)
    medium.publish(2, 10, b"alone")
    medium.exchange()
    assert medium.frames[-1][1].destination == 1
    assert medium[3].got(SampleReceived) == []
    medium.publish(2, 10, b"waits")
    want(medium, 3, 10, 2)
    message = medium[3].send(medium.now)
    assert message is not None
    medium[2].hear(message.frame_bytes, medium.now, source=3, destination=2)
    medium.run(100)
    destinations = {sent.destination for _, sent in medium.frames if b"waits" in sent.frame_bytes}
    assert destinations == {BROADCAST}
    assert [each.value for each in medium[3].got(SampleReceived)] == [b"waits"]


@pytest.mark.parametrize("keeps", [True, False])
def test_subscription_survives_a_restart_of_the_publisher(keeps: bool) -> None:
    medium = rig()
    want(medium, 1, 10, 2)
    medium.run(100)
    medium.restart(2, fleet(), keeps=keeps)
    assert subscribers(medium, 2, 10) == ({1} if keeps else set())
    if not keeps:
        medium.publish(2, 12, b"the next frame tells the epoch")
        medium.run(100)
        assert subscribers(medium, 2, 10) == {1}
    medium.publish(2, 10, b"after")
    medium.run(100)
    assert [each.value for each in medium[1].got(SampleReceived)][-1] == b"after"
    assert all(end.engine.is_idle for end in medium.ends.values())


def test_subscriber_that_restarts_and_wants_no_more_says_so() -> None:
    medium = rig()
    want(medium, 1, 10, 2)
    medium.run(100)
    medium.restart(1, fleet())
    for _ in range(4):
        medium.publish(2, 10, b"who wants it?")
        medium.run(100)
    assert subscribers(medium, 2, 10) == set()
    assert medium.run(1000) == []


def test_subscriber_that_restarts_and_wants_still_goes_on() -> None:
    medium = rig()
    want(medium, 1, 10, 2)
    medium.run(100)
    medium.restart(1, fleet())
    want(medium, 1, 10, 2)
    medium.run(100)
    medium.publish(2, 10, b"after")
    medium.run(100)
    assert [each.value for each in medium[1].got(SampleReceived)] == [b"after"]
    assert len(medium[2].got(SubscribersChanged)) == 1


def test_answer_to_a_former_life_is_not_one_to_what_has_not_been_sent() -> None:
    medium = acquainted()
    want(medium, 1, 10, 2)
    answer = b"\xbc" + Subscribe(1, 1, 0b100, is_answer=True).body
    medium[1].hear(answer, medium.now, source=2, destination=1)
    assert messages(medium.run(1))
    assert subscribers(medium, 2, 10) == {1}
    medium.restart(2, fleet())
    medium.publish(2, 12, b"")
    medium.run(100)
    assert subscribers(medium, 2, 10) == {1}


def test_answer_waits_for_the_journal() -> None:
    medium = acquainted()
    before = len(medium.frames)
    medium[2].commits = False
    medium[2].engine.poll_journal()
    want(medium, 1, 10, 2)
    message = medium[1].send(medium.now)
    assert message is not None
    medium.deliver(1, message)
    again = medium[1].engine.poll_timeout()
    assert again is not None
    assert not messages([sent.frame_bytes for _, sent in medium.frames[before:]])
    assert subscribers(medium, 2, 10) == {1}
    sent = medium[2].send(medium.now)
    assert sent is None or messages([sent.frame_bytes]) == []
    medium[2].commits = True
    medium[2].settle()
    due_at = medium[2].engine.poll_timeout()
    assert due_at is not None
    sent = medium[2].send(due_at)
    assert sent is not None
    assert messages([sent.frame_bytes]) == [
        Subscribe(1, 1, 0b100, is_answer=True, heard=1, is_kept=True)
    ]


def test_late_message_of_before_is_ignored_for_the_settling_time() -> None:
    medium = acquainted()
    want(medium, 1, 10, 2)
    (first, _) = medium.run(10)
    want(medium, 1, 10)
    medium.exchange()
    assert subscribers(medium, 2, 10) == set()
    medium[2].hear(first, medium.now, source=1, destination=2)
    assert subscribers(medium, 2, 10) == set()
    assert medium[2].engine.stats.dropped == {"stale_subscribe": 1}


def everything(source: int, node: int, transmission: Transmission) -> bool:
    return True


def nothing(source: int, node: int, transmission: Transmission) -> bool:
    return False


def test_versions_run_round_without_end() -> None:
    medium = rig()
    for number in range(300):
        want(medium, 1, 10, *([2] if number % 2 else []))
        # Nothing arrives while more than half of the versions are used up.
        medium.run(0.02, everything if not 20 < number < 200 else nothing)
    want(medium, 1, 10, 2)
    medium.run(1000)
    assert subscribers(medium, 2, 10) == {1}
    assert all(end.engine.is_idle for end in medium.ends.values())


def test_version_that_was_said_in_a_former_life_of_the_publisher_says_nothing_else() -> None:
    medium = acquainted()
    want(medium, 1, 10, 2)
    medium.run(100)
    medium.restart(2, fleet(), keeps=True)
    medium.publish(2, 12, b"new epoch")
    sent = medium[2].send(medium.now)
    assert sent is not None
    medium.deliver(2, sent)
    want(medium, 1, 10)
    said = {(each.version, each.streams) for each in messages(medium.run(100))}
    assert said == {(2, 0)}


def test_message_about_a_stream_that_differs_counts_for_nothing() -> None:
    specs = [each.spec for each in fleet() if each.stream_id != 10]
    specs.append(TopicSpec(stream_id=10, name="another", publishers=(2,), qos=ON_DEMAND))
    medium = Rig({1: fleet(), 2: StreamTable(specs, nodes=fleet().nodes)})
    want(medium, 1, 10, 2)
    want(medium, 1, 11, 2)
    medium.run(1000)
    assert subscribers(medium, 2, 10) == set()
    assert subscribers(medium, 2, 11) == {1}


def test_message_that_nobody_may_write_counts_for_nothing() -> None:
    medium = rig()
    for page, streams in ((1, 0b10000), (2, 0b10000), (31, 1), (21, 0xFF)):
        message = b"\xb0\x02\x00\x01" + fleet().digest + Subscribe(page, 1, streams).encode()
        for destination in (2, BROADCAST):
            medium.now += NS_PER_S
            medium[2].hear(message, medium.now, source=1, destination=destination)
    assert medium[2].got(SubscribersChanged) == []
    dropped = medium[2].engine.stats.dropped
    assert dropped["not_for_us"] == 4
    assert dropped["payload"] == 1


def test_answer_to_nothing_is_counted() -> None:
    medium = acquainted()
    want(medium, 1, 10, 2)
    for answer in (Subscribe(1, 9, 4, is_answer=True), Subscribe(3, 1, 4, is_answer=True)):
        medium[1].hear(answer.encode(), medium.now, source=2, destination=1)
    assert medium[1].engine.stats.dropped == {"unexpected_ack": 2}


def test_reliable_sample_that_nobody_wants_is_refused() -> None:
    medium = rig(3)
    delivery = medium[2].engine.publish(30, b"nobody", 0)
    medium.run(1)
    (ended,) = medium[2].got(DeliveryEnded)
    assert (ended.delivery_id, ended.outcome) == (delivery, DeliveryOutcome.REFUSED)
    assert ended.detail == "nobody subscribes"
    assert medium.frames == []


def test_reliable_sample_is_for_those_who_subscribe() -> None:
    medium = rig(3)
    want(medium, 1, 30, 2)
    medium.run(10)
    medium.publish(2, 30, b"one")
    medium.run(10, lambda source, node, transmission: node != 3)
    want(medium, 3, 30, 2)
    medium.run(10)
    medium.publish(2, 30, b"both")
    medium.run(100)
    assert [each.outcome for each in medium[2].got(DeliveryEnded)] == [
        DeliveryOutcome.DELIVERED,
        DeliveryOutcome.DELIVERED,
    ]
    assert [each.value for each in medium[1].got(SampleReceived)] == [b"one", b"both"]
    assert [each.value for each in medium[3].got(SampleReceived)] == [b"both"]


def test_reliable_sample_ends_with_the_last_subscription() -> None:
    medium = rig(3)
    for node in (1, 3):
        want(medium, node, 30, 2)
        medium.run(10)
    medium.publish(2, 30, b"lost so far")
    medium.exchange(lambda source, node, transmission: source != 2)
    want(medium, 1, 30)
    medium.run(1, lambda source, node, transmission: source != 2)
    assert medium[2].got(DeliveryEnded) == []
    want(medium, 3, 30)
    medium.run(1, lambda source, node, transmission: source != 2)
    assert [each.outcome for each in medium[2].got(DeliveryEnded)] == [DeliveryOutcome.REFUSED]
    medium.run(100)
    want(medium, 3, 30, 2)
    medium.run(100)
    medium.publish(2, 30, b"anew")
    medium.run(100)
    assert [each.value for each in medium[3].got(SampleReceived)] == [b"anew"]
    assert medium[1].got(SampleReceived) == []
    assert all(end.engine.is_idle for end in medium.ends.values())


def test_object_is_for_those_who_subscribe_and_ends_with_the_last() -> None:
    medium = rig(3)
    medium.publish(2, 30, bytes(500))
    assert medium.run(10) == []
    want(medium, 3, 30, 2)
    medium.run(10)
    medium.publish(2, 30, bytes(500))
    medium.run(100)
    assert [each.value for each in medium[3].got(SampleReceived)] == [bytes(500)]
    assert medium[1].got(SampleReceived) == []
    medium.publish(2, 30, bytes(600))
    want(medium, 3, 30)
    medium.run(1, lambda source, node, transmission: source != 2)
    medium.run(100)
    assert [each.outcome for each in medium[2].got(DeliveryEnded)] == [
        DeliveryOutcome.REFUSED,
        DeliveryOutcome.DELIVERED,
        DeliveryOutcome.REFUSED,
    ]
    assert all(end.engine.is_idle for end in medium.ends.values())


def test_what_cannot_be_wanted_is_refused() -> None:
    engine = rig()[1].engine
    engine.subscriptions.want(12, 0)
    with pytest.raises(UnknownStreamError, match="not a topic"):
        engine.subscriptions.want(20, 0)
    table = StreamTable([TopicSpec(stream_id=1, name="a", subscribers=(2,), publishers=(1,))])
    with pytest.raises(LocalError, match="not a subscriber"):
        Rig({1: table})[1].engine.subscriptions.want(1, 0)


def test_topic_that_nobody_could_be_asked_for_is_refused() -> None:
    with pytest.raises(ConfigError, match="forward: on_demand, and nobody is known"):
        StreamTable([TopicSpec(stream_id=1, name="a", qos=ON_DEMAND)])


def test_forward_is_in_the_digest() -> None:
    digests = {
        StreamTable([TopicSpec(stream_id=1, name="a", publishers=(1,), qos=qos)]).digest
        for qos in (Qos(), ON_DEMAND, Qos(forward=Forward.ON_DEMAND, priority=Priority.DATA_LOW))
    }
    assert len(digests) == 2


def test_nothing_is_armed_while_a_subscription_holds() -> None:
    medium = rig()
    want(medium, 1, 10, 2)
    medium.run(100)
    for end in medium.ends.values():
        assert end.engine.poll_timeout() is None
    medium.now += 10**6 * NS_PER_S
    assert medium.exchange() == []
