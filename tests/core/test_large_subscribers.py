"""Large samples of on-demand topics, whose subscribers come and go."""

from typing import Any

from tests.core.rig import Rig, link
from zacoustic.core.base.qos import Forward, Qos, Reliability
from zacoustic.core.engine.events import DeliveryEnded, DeliveryOutcome, SampleReceived
from zacoustic.core.linktypes import Transmission
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.objects.progress import ObjectProgress, ObjectState
from zacoustic.core.wire.objects import FRAGMENT_CODE

LOG = 30
NODES = {1: "shore", 2: "auv", 3: "buoy"}
FLEET = NODES | {4: "ship"}
PHOTO = bytes(range(250)) * 4


def fleet(count: int = 3, **settings: Any) -> StreamTable:
    qos = Qos(reliability=Reliability.RELIABLE, **({"depth": 16} | settings))
    log = TopicSpec(stream_id=LOG, name="log", publishers=(2,), qos=qos, journal=True)
    return StreamTable([log], nodes={each: FLEET[each] for each in range(1, count + 1)})


def on_demand() -> Rig:
    capabilities = link(bit_rate_bps=2000, propagation_s=0.1)
    table = fleet(forward=Forward.ON_DEMAND)
    return Rig(dict.fromkeys(NODES, table), capabilities=capabilities)


def want(water: Rig, node: int, *sources: int) -> None:
    water[node].engine.subscriptions.want(LOG, water.now, sources)


def values(water: Rig, node: int) -> list[object]:
    return [each.value for each in water[node].got(SampleReceived)]


def ended(water: Rig) -> list[tuple[DeliveryOutcome, str]]:
    return [(each.outcome, each.detail) for each in water[2].got(DeliveryEnded)]


def no_fragments(source: int, node: int, sent: Transmission) -> bool:
    return sent.frame_bytes[0] != FRAGMENT_CODE


def short_only(source: int, node: int, sent: Transmission) -> bool:
    return len(sent.frame_bytes) < 30


def test_who_comes_while_an_object_is_under_way_does_not_wait_for_it() -> None:
    water = on_demand()
    want(water, 1, 2)
    water.run(20)
    water.publish(2, LOG, PHOTO)
    water.publish(2, LOG, b"behind")
    want(water, 3, 2)
    water.run(20, no_fragments)
    water.run(200)
    assert values(water, 1) == [PHOTO, b"behind"]
    water.publish(2, LOG, b"last")
    water.run(100)
    assert values(water, 1) == [PHOTO, b"behind", b"last"]
    assert values(water, 3) == [b"behind", b"last"]
    assert ended(water) == [(DeliveryOutcome.DELIVERED, "")] * 3
    assert all(end.engine.is_idle for end in water.ends.values())


def test_who_leaves_is_not_waited_for() -> None:
    water = on_demand()
    want(water, 1, 2)
    want(water, 3, 2)
    water.run(30)
    water.publish(2, LOG, PHOTO)
    water.publish(2, LOG, b"behind")
    # Node 3 hears no fragment of it, and says that it does not want it any more.
    water.run(5, no_fragments)
    want(water, 3)
    water.run(300, lambda source, node, sent: node != 3 or no_fragments(source, node, sent))
    assert values(water, 1) == [PHOTO, b"behind"]
    assert ended(water) == [(DeliveryOutcome.DELIVERED, "")] * 2
    # It comes back, and gets what is published from then on.
    want(water, 3, 2)
    water.run(30)
    water.publish(2, LOG, b"again")
    water.run(100)
    assert values(water, 3) == [b"behind", b"again"], "it had subscribed to what was behind"
    assert values(water, 1) == [PHOTO, b"behind", b"again"]


def test_object_that_is_for_nobody_any_more_is_given_up_though_others_have_come() -> None:
    water = on_demand()
    want(water, 1, 2)
    water.run(20)
    water.publish(2, LOG, PHOTO)
    water.publish(2, LOG, b"behind")
    want(water, 3, 2)
    water.run(20, no_fragments)
    want(water, 1)
    water.run(200, no_fragments)
    assert (DeliveryOutcome.REFUSED, "nobody subscribes") in ended(water)
    water.run(100)
    assert values(water, 3) == [b"behind"]
    assert values(water, 1) == []
    assert all(end.engine.is_idle for end in water.ends.values())


def test_restarted_publisher_goes_on_for_those_who_had_subscribed() -> None:
    water = on_demand()
    want(water, 1, 2)
    water.run(20)
    water.publish(2, LOG, PHOTO)
    water.publish(2, LOG, b"behind")
    want(water, 3, 2)
    water.run(20, no_fragments)
    water.restart(2, water[2].engine.table, keeps=True)
    water.run(200)
    assert values(water, 1) == [PHOTO, b"behind"]
    assert values(water, 3) == [b"behind"]
    assert ended(water) == [(DeliveryOutcome.DELIVERED, "")] * 2


def test_who_has_not_subscribed_keeps_nothing_of_what_others_get_and_says_so_once() -> None:
    table = fleet(4, forward=Forward.ON_DEMAND)
    water = Rig(dict.fromkeys(FLEET, table), capabilities=link(bit_rate_bps=2000))
    for node in (1, 3):
        want(water, node, 2)
    water.run(30)
    water.publish(2, LOG, PHOTO * 4)
    written: set[str] = set()
    for _ in range(600):
        water.run(0.5)
        written |= water[4].journal.keys()
    assert values(water, 1) == values(water, 3) == [PHOTO * 4]
    assert not {key for key in written if key.startswith("object")}
    assert water[4].got(ObjectProgress) == values(water, 4) == []
    assert ended(water) == [(DeliveryOutcome.DELIVERED, "")]
    # A letter, and maybe its repetition: it wants none.
    assert 1 <= water[4].engine.stats.frames_transmitted <= 3
    assert all(end.engine.is_idle for end in water.ends.values())


def test_restarted_node_that_does_not_subscribe_again_is_not_waited_for() -> None:
    water = on_demand()
    for node in (1, 3):
        want(water, node, 2)
    water.run(30)
    water.restart(3, water[3].engine.table, keeps=True)
    water.publish(2, LOG, PHOTO)
    water.run(300)
    assert values(water, 1) == [PHOTO]
    assert values(water, 3) == []
    assert ended(water) == [(DeliveryOutcome.DELIVERED, "")]
    assert all(end.engine.is_idle for end in water.ends.values())


def test_only_who_still_wants_an_object_is_missing_when_it_is_given_up() -> None:
    water = on_demand()
    for node in (1, 3):
        want(water, node, 2)
    water.run(30)
    delivery = water[2].engine.publish(LOG, PHOTO, water.now)
    water.run(5, short_only)
    want(water, 3)
    water.run(20, short_only)
    water[2].engine.cancel_delivery(delivery, water.now)
    water.run(100)
    (end,) = water[2].got(DeliveryEnded)
    assert (end.outcome, end.missing) == (DeliveryOutcome.CANCELLED, (1,))


def test_who_has_refused_an_object_and_leaves_does_not_make_it_refused() -> None:
    water = on_demand()
    for node in (1, 3):
        want(water, node, 2)
    water.run(30)
    water.publish(2, LOG, PHOTO * 4)
    # Node 3 has a beginning of it, and refuses the rest; node 1 has nothing.
    frames = iter([True] * 10)

    def begins(source: int, node: int, sent: Transmission) -> bool:
        return short_only(source, node, sent) or (node == 3 and next(frames, False))

    water.run(5, begins)
    transfer = water[2].got(ObjectProgress)[-1].transfer
    assert water[3].engine.refuse_object(2, transfer, water.now)
    water.run(60, lambda source, node, sent: node != 1 or short_only(source, node, sent))
    assert water[2].got(ObjectProgress)[-1].state is ObjectState.UNDER_WAY
    want(water, 3)
    water.run(300)
    assert values(water, 1) == [PHOTO * 4]
    (end,) = water[2].got(DeliveryEnded)
    assert (end.outcome, end.missing) == (DeliveryOutcome.DELIVERED, ())
