"""Samples larger than a frame, between whole engines on the simulated channel."""

import random
import statistics
from functools import partial
from typing import Any

import pytest

from tests.virtual.fleet import line
from tests.virtual.sealed import SealedFleet
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access.spec import AccessSpec, AlohaSpec, CarrierSenseSpec, TdmaSpec
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.objects.progress import ObjectProgress
from zacoustic.errors import LocalError
from zacoustic.testing.virtual import Modem, VirtualNetwork

PHOTO, ALARM, NAV = 12, 13, 14
NODES = {1: "shore", 2: "auv1", 3: "auv2"}


def table(nodes: int = 2, **qos: Any) -> StreamTable:
    names = {address: NODES[address] for address in range(1, nodes + 1)}
    reliable = Reliability.RELIABLE
    return StreamTable(
        [
            TopicSpec(
                stream_id=PHOTO,
                name="{node}/photo",
                qos=Qos(reliability=reliable, priority=Priority.BACKGROUND, **qos),
                journal=True,
            ),
            TopicSpec(
                stream_id=ALARM,
                name="{node}/alarm",
                qos=Qos(reliability=reliable, priority=Priority.REAL_TIME),
            ),
            TopicSpec(stream_id=NAV, name="{node}/nav"),
        ],
        nodes=names,
    )


def endings(network: VirtualNetwork, address: int) -> list[DeliveryEnded]:
    return [
        event
        for at, event in network.events
        if at == address and isinstance(event, DeliveryEnded) and event.stream_id == PHOTO
    ]


def payload(size_bytes: int, seed: int = 0) -> bytes:
    return random.Random(f"photo {seed}").randbytes(size_bytes)


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_photo_arrives(loss: float) -> None:
    network = VirtualNetwork(line(0, 1500, loss={"frame": loss}), table())
    sample = payload(10_240)
    network.at(1, lambda: network.publish(2, PHOTO, sample))
    network.run(until_s=2000)
    assert [event.value for event in network.samples(1, PHOTO)] == [sample]
    ended = endings(network, 2)
    assert [each.outcome for each in ended] == [DeliveryOutcome.DELIVERED]
    network.run()
    assert network.is_quiet
    assert network.engine(2).is_idle
    assert network.engine(1).is_idle


def test_what_crosses_as_objects_is_counted_once_each_as_transmitted_and_received() -> None:
    network = VirtualNetwork(line(0, 1500, channel="none", loss={"frame": 0.3}), table(depth=4))
    for number in range(3):
        network.at(1 + number, partial(network.publish, 2, PHOTO, payload(3000, number)))
    network.at(5, partial(network.publish, 2, PHOTO, b"small"))
    network.run(until_s=4000)
    assert len(network.samples(1, PHOTO)) == 4
    assert network.engine(2).stats.transmitted[PHOTO] == 4
    assert network.engine(1).stats.received[PHOTO] == 4


def test_sender_tells_what_was_on_the_air_before_the_receiver_says_what_it_has(count: Any) -> None:
    for seed in (42, *range(count(100))):  # in 42 repair fragments were ahead of the source's
        medium = line(0, 1500, channel="none", loss={"frame": 0.2}, seed=seed)
        network = VirtualNetwork(medium, table())
        network.at(1, partial(network.publish, 2, PHOTO, payload(4000)))
        network.run(until_s=2000)
        told = [
            event
            for _, event in network.events
            if isinstance(event, ObjectProgress) and event.object_id is not None
        ]
        sent = [event.sent_bytes for event in told]
        assert sent == sorted(sent, key=lambda sent_bytes: sent_bytes or 0), seed
        assert (sent[0], sent[-1]) == (0, 4000), seed
        assert len(set(sent)) > 20, seed  # it is told again and again, not at the end
        assert all(event.done_bytes <= (event.sent_bytes or 0) for event in told), seed
        arrived = [event.done_bytes for _, event in network.events
                   if isinstance(event, ObjectProgress) and event.object_id is None
                   and event.sent_bytes is None]  # fmt: skip
        assert arrived[-1] == 4000, seed


def test_a_photo_to_several(count: Any) -> None:
    for seed in range(count(200)):
        medium = line(0, 500, 1000, channel="none", loss={"frame": 0.2}, seed=seed)
        network = VirtualNetwork(medium, table(3))
        sample = payload(4000)
        network.at(1, partial(network.publish, 2, PHOTO, sample))
        network.run(until_s=2000)
        for address in (1, 3):
            assert [event.value for event in network.samples(address, PHOTO)] == [sample]
        assert [each.missing for each in endings(network, 2)] == [()]


@pytest.mark.parametrize(
    "modem",
    [Modem(addressed=False), Modem(checked=False), Modem(addressed=False, framed=False)],
)
def test_a_photo_over_links_that_lack_something(modem: Modem) -> None:
    medium = line(0, 1500, channel="none", loss={"frame": 0.2})
    network = VirtualNetwork(medium, table(), modem=modem)
    sample = payload(4000)
    network.at(1, lambda: network.publish(2, PHOTO, sample))
    network.run(until_s=2000)
    assert [event.value for event in network.samples(1, PHOTO)] == [sample]


@pytest.mark.parametrize("is_lost", [False, True], ids=["restart", "outage"])
def test_a_sealed_photo_goes_on_after_its_receiver_was_away(is_lost: bool, count: Any) -> None:
    """Long heads are rare within a run: a receiver that missed more of it is in step soon again."""
    sample = payload(20_000)
    for seed in range(count(200)):
        rng = random.Random(seed)
        medium = line(0, 1500, channel="none", loss={"frame": rng.choice((0, 0.2))}, seed=seed)
        network = VirtualNetwork(medium, table(), build=SealedFleet())
        network.at(1, partial(network.publish, 2, PHOTO, sample))
        away_s, from_s = rng.choice((1, 60, 200)), rng.uniform(2, 250)
        if is_lost:
            network.at(from_s, partial(network.set_link, 1, up=False))
            network.at(from_s + away_s, partial(network.set_link, 1, up=True))
        else:
            network.at(from_s, partial(network.crash, 1))
            network.at(from_s + away_s, partial(network.start, 1))
        network.run(until_s=from_s + away_s + 1500)
        assert [event.value for event in network.samples(1, PHOTO)] == [sample], seed
        assert [each.outcome for each in endings(network, 2)] == [DeliveryOutcome.DELIVERED], seed


def met(network: VirtualNetwork) -> None:
    """Let both nodes know each other's tables."""
    for instant_s in (1, 61, 121, 181):
        sender = 1 + instant_s // 60 % 2
        network.at(instant_s, partial(network.publish, sender, NAV, b"here"))


def test_an_alarm_during_an_outgoing_object() -> None:
    sent: list[TraceRecord] = []
    network = VirtualNetwork(line(0, 1500, channel="none"), table(), trace=sent.append)
    met(network)
    network.at(300, lambda: network.publish(2, PHOTO, payload(10_240)))
    for number in range(20):
        network.at(320 + 6.3 * number, lambda: network.publish(2, ALARM, b"leak"))
    network.run(until_s=1000)
    alarms = [
        record.at / NS_PER_S
        for record in sent
        if record.what == "transmit" and record.node == 2 and ALARM in record.streams
    ]
    waits = []
    for number in range(20):
        published_s = 320 + 6.3 * number
        waits.append(min(at - published_s for at in alarms if at >= published_s))
    # Longer only where the ACK of the one before is just being heard.
    assert sorted(waits)[-3] <= 0.951 + 0.1
    assert max(waits) <= 0.951 + 0.1 + 0.235
    assert len(network.samples(1, PHOTO)) == 1


def test_an_alarm_during_an_incoming_object() -> None:
    network = VirtualNetwork(line(0, 1500, channel="none"), table())
    met(network)
    network.at(300, lambda: network.publish(2, PHOTO, payload(10_240)))
    instants = [330 + 13.7 * number for number in range(8)]
    for instant_s in instants:
        network.at(instant_s, lambda: network.publish(1, ALARM, b"surface"))
    network.run(until_s=1500)
    heard = sorted(event.received_at / NS_PER_S for event in network.samples(2, ALARM))
    assert len(heard) == len(instants)
    assert (
        statistics.median(at - published for at, published in zip(heard, instants, strict=True))
        <= 4.5 + 1.0 + 0.5
    )
    assert len(network.samples(1, PHOTO)) == 1


def test_small_samples_do_not_wait_for_a_photo() -> None:
    network = VirtualNetwork(line(0, 1500, channel="none"), table())
    met(network)
    network.at(300, lambda: network.publish(2, PHOTO, payload(20_000)))
    instants = [320 + 9.1 * number for number in range(15)]
    for instant_s in instants:
        network.at(instant_s, lambda: network.publish(2, NAV, b"0123456789"))
    network.run(until_s=1500)
    heard = [
        event.received_at / NS_PER_S
        for event in network.samples(1, NAV)
        if event.received_at > 310 * NS_PER_S
    ]
    assert len(heard) >= 14
    assert all(at - published < 6 for at, published in zip(heard, instants, strict=False))
    assert len(network.samples(1, PHOTO)) == 1


@pytest.mark.parametrize("victim", [1, 2])
def test_a_photo_survives_crashes(victim: int, count: Any) -> None:
    rng = random.Random(4)
    for seed in range(2 * count(200)):
        medium = line(0, 1500, channel="none", loss={"frame": 0.2}, seed=seed)
        network = VirtualNetwork(medium, table())
        sample = payload(6000, seed)
        network.at(1, partial(network.publish, 2, PHOTO, sample))
        instant_s = 1.5
        for _ in range(4):
            instant_s += rng.uniform(1, 40)
            reboots = rng.random() < 0.5
            network.at(instant_s, partial(network.crash, victim, reboots=reboots))
            instant_s += rng.uniform(0.1, 10)
            network.at(instant_s, partial(network.start, victim))
        network.run(until_s=5000)
        assert [event.value for event in network.samples(1, PHOTO)] == [sample]
        assert [each.outcome for each in endings(network, 2)] == [DeliveryOutcome.DELIVERED]
        for address in (1, 2):
            kept = [key for key in network.journal(address).entries if key.startswith("object/")]
            assert all(key.startswith("object/done/") for key in kept)


def test_nobody_to_receive() -> None:
    network = VirtualNetwork(
        line(0, 1500),
        StreamTable(
            [TopicSpec(stream_id=PHOTO, name="photo", qos=Qos(reliability=Reliability.RELIABLE))]
        ),
    )
    with pytest.raises(LocalError, match="nobody is listed"):
        network.publish(2, PHOTO, payload(1000))


def test_cancel_and_refuse() -> None:
    network = VirtualNetwork(line(0, 1500, channel="none"), table())
    delivery_ids: list[int] = []

    def publish() -> None:
        delivery_ids.append(
            network.apply(2, lambda engine, now: engine.publish(PHOTO, payload(8000), now))
        )

    def cancel() -> None:
        assert network.apply(2, lambda engine, now: engine.cancel_delivery(delivery_ids[-1], now))

    def refuse() -> None:
        told = [event for at, event in network.events if isinstance(event, ObjectProgress)]
        assert network.apply(1, lambda engine, now: engine.refuse_object(2, told[-1].transfer, now))

    network.at(1, publish)
    network.at(40, cancel)
    network.at(200, publish)
    network.at(260, refuse)
    network.run(until_s=1000)
    assert [each.outcome for each in endings(network, 2)] == [
        DeliveryOutcome.CANCELLED,
        DeliveryOutcome.REFUSED,
    ]
    assert [each.missing for each in endings(network, 2)] == [(1,), (1,)]
    assert network.samples(1, PHOTO) == []
    network.run()
    assert network.engine(1).is_idle
    assert network.engine(2).is_idle


@pytest.mark.parametrize(
    "access",
    [
        AlohaSpec(),
        AlohaSpec(slot_s=2.0),
        CarrierSenseSpec(),
        TdmaSpec(slots=(1, 2), slot_s=6.0, clock_error_s=0.01, max_range_m=1600),
        TdmaSpec(slots=(1, 2, 3, 4, 5, 6), slot_s=4.0, clock_error_s=0.01, max_range_m=1600),
    ],
    ids=["aloha", "slotted", "carrier_sense", "tdma", "tdma_rare"],
)
def test_a_photo_by_any_medium_access(access: AccessSpec) -> None:
    medium = line(0, 1500, channel="none", loss={"frame": 0.3})
    network = VirtualNetwork(medium, table(), rules=TransmitRules(access=access))
    sample = payload(4000)
    network.at(1, lambda: network.publish(2, PHOTO, sample))
    network.run(until_s=3000)
    assert [event.value for event in network.samples(1, PHOTO)] == [sample]
    assert [each.outcome for each in endings(network, 2)] == [DeliveryOutcome.DELIVERED]
    # 67 source fragments; what is lost, handshake and questions beside it.
    assert network.engine(2).stats.frames_transmitted < 67 / 0.7 * 1.3


def percentage(seed: int, loss: float, *, exclusive: bool) -> float:
    """Send 10 KiB between engines that know each other; return the share of 539 bit/s, %."""
    medium = line(0, 1500, channel="none", loss={"frame": loss}, seed=seed)
    network = VirtualNetwork(medium, table(exclusive=exclusive))
    met(network)
    network.at(300, lambda: network.publish(2, PHOTO, payload(10_240, seed)))
    network.run(until_s=5000)
    return 100 * 10_240 * 8 / (endings(network, 2)[0].ended_at / NS_PER_S - 300) / 539


@pytest.mark.parametrize(
    ("loss", "exclusive", "promised"),
    [
        (0.0, False, 82),
        (0.2, False, 62),
        (0.3, False, 53),
        (0.5, False, 36),
        (0.0, True, 90),
        (0.2, True, 70),
        (0.3, True, 60),
        (0.5, True, 42),
    ],
)
def test_share_of_the_bit_rate_between_engines(
    loss: float, exclusive: bool, promised: int, count: Any
) -> None:
    shares = [percentage(seed, loss, exclusive=exclusive) for seed in range(count(300))]
    assert statistics.fmean(shares) >= promised
