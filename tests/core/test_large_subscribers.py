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


def want(medium: Rig, node: int, *sources: int) -> None:
    medium[node].engine.subscriptions.want(LOG, medium.now, sources)


def values(medium: Rig, node: int) -> list[object]:
    return [each.value for each in medium[node].got(SampleReceived)]


def ended(medium: Rig) -> list[tuple[DeliveryOutcome, str]]:
    return [(each.outcome, each.detail) for each in medium[2].got(DeliveryEnded)]


def no_fragments(source: int, node: int, sent: Transmission) -> bool:
    return sent.frame_bytes[0] != FRAGMENT_CODE


def short_only(source: int, node: int, sent: Transmission) -> bool:
    return len(sent.frame_bytes) < 30


def test_who_comes_while_an_object_is_under_way_does_not_wait_for_it() -> None:
    medium = on_demand()
    want(medium, 1, 2)
    medium.run(20)
    medium.publish(2, LOG, PHOTO)
    medium.publish(2, LOG, b"behind")
    want(medium, 3, 2)
    medium.run(20, no_fragments)
    medium.run(200)
    assert values(medium, 1) == [PHOTO, b"behind"]
    medium.publish(2, LOG, b"last")
    medium.run(100)
    assert values(medium, 1) == [PHOTO, b"behind", b"last"]
    assert values(medium, 3) == [b"behind", b"last"]
    assert ended(medium) == [(DeliveryOutcome.DELIVERED, "")] * 3
    assert all(end.engine.is_idle for end in medium.ends.values())


def test_who_leaves_is_not_waited_for() -> None:
    medium = on_demand()
    want(medium, 1, 2)
    want(medium, 3, 2)
    medium.run(30)
    medium.publish(2, LOG, PHOTO)
    medium.publish(2, LOG, b"behind")
    # Node 3 hears no fragment of it, and says that it does not want it any more.
    medium.run(5, no_fragments)
    want(medium, 3)
    medium.run(300, lambda source, node, sent: node != 3 or no_fragments(source, node, sent))
    assert values(medium, 1) == [PHOTO, b"behind"]
    assert ended(medium) == [(DeliveryOutcome.DELIVERED, "")] * 2
    # It comes back, and gets what is published from then on.
    want(medium, 3, 2)
    medium.run(30)
    medium.publish(2, LOG, b"again")
    medium.run(100)
    assert values(medium, 3) == [b"behind", b"again"], "it had subscribed to what was behind"
    assert values(medium, 1) == [PHOTO, b"behind", b"again"]


def test_object_that_is_for_nobody_any_more_is_given_up_though_others_have_come() -> None:
    medium = on_demand()
    want(medium, 1, 2)
    medium.run(20)
    medium.publish(2, LOG, PHOTO)
    medium.publish(2, LOG, b"behind")
    want(medium, 3, 2)
    medium.run(20, no_fragments)
    want(medium, 1)
    medium.run(200, no_fragments)
    assert (DeliveryOutcome.REFUSED, "nobody subscribes") in ended(medium)
    medium.run(100)
    assert values(medium, 3) == [b"behind"]
    assert values(medium, 1) == []
    assert all(end.engine.is_idle for end in medium.ends.values())


def test_restarted_publisher_goes_on_for_those_who_had_subscribed() -> None:
    medium = on_demand()
    want(medium, 1, 2)
    medium.run(20)
    medium.publish(2, LOG, PHOTO)
    medium.publish(2, LOG, b"behind")
    want(medium, 3, 2)
    medium.run(20, no_fragments)
    medium.restart(2, medium[2].engine.table, keeps=True)
    medium.run(200)
    assert values(medium, 1) == [PHOTO, b"behind"]
    assert values(medium, 3) == [b"behind"]
    assert ended(medium) == [(DeliveryOutcome.DELIVERED, "")] * 2


def test_who_has_not_subscribed_keeps_nothing_of_what_others_get_and_says_so_once() -> None:
    table = fleet(4, forward=Forward.ON_DEMAND)
    medium = Rig(dict.fromkeys(FLEET, table), capabilities=link(bit_rate_bps=2000))
    for node in (1, 3):
        want(medium, node, 2)
    medium.run(30)
    medium.publish(2, LOG, PHOTO * 4)
    written: set[str] = set()
    for _ in range(600):
        medium.run(0.5)
        written |= medium[4].journal.keys()
    assert values(medium, 1) == values(medium, 3) == [PHOTO * 4]
    assert not {key for key in written if key.startswith("object")}
    assert medium[4].got(ObjectProgress) == values(medium, 4) == []
    assert ended(medium) == [(DeliveryOutcome.DELIVERED, "")]
    # A letter, and maybe its repetition: it wants none.
    assert 1 <= medium[4].engine.stats.frames_transmitted <= 3
    assert all(end.engine.is_idle for end in medium.ends.values())


def test_restarted_node_that_does_not_subscribe_again_is_not_waited_for() -> None:
    medium = on_demand()
    for node in (1, 3):
        want(medium, node, 2)
    medium.run(30)
    medium.restart(3, medium[3].engine.table, keeps=True)
    medium.publish(2, LOG, PHOTO)
    medium.run(300)
    assert values(medium, 1) == [PHOTO]
    assert values(medium, 3) == []
    assert ended(medium) == [(DeliveryOutcome.DELIVERED, "")]
    assert all(end.engine.is_idle for end in medium.ends.values())


def test_only_who_still_wants_an_object_is_missing_when_it_is_given_up() -> None:
    medium = on_demand()
    for node in (1, 3):
        want(medium, node, 2)
    medium.run(30)
    delivery = medium[2].engine.publish(LOG, PHOTO, medium.now)
    medium.run(5, short_only)
    want(medium, 3)
    medium.run(20, short_only)
    medium[2].engine.cancel_delivery(delivery, medium.now)
    medium.run(100)
    (end,) = medium[2].got(DeliveryEnded)
    assert (end.outcome, end.missing) == (DeliveryOutcome.CANCELLED, (1,))


def test_who_has_refused_an_object_and_leaves_does_not_make_it_refused() -> None:
    medium = on_demand()
    for node in (1, 3):
        want(medium, node, 2)
    medium.run(30)
    medium.publish(2, LOG, PHOTO * 4)
    # Node 3 has a beginning of it, and refuses the rest; node 1 has nothing.
    frames = iter([True] * 10)

    def begins(source: int, node: int, sent: Transmission) -> bool:
        return short_only(source, node, sent) or (node == 3 and next(frames, False))

    medium.run(5, begins)
    transfer = medium[2].got(ObjectProgress)[-1].transfer
    assert medium[3].engine.refuse_object(2, transfer, medium.now)
    medium.run(60, lambda source, node, sent: node != 1 or short_only(source, node, sent))
    assert medium[2].got(ObjectProgress)[-1].state is ObjectState.UNDER_WAY
    want(medium, 3)
    medium.run(300)
    assert values(medium, 1) == [PHOTO * 4]
    (end,) = medium[2].got(DeliveryEnded)
    assert (end.outcome, end.missing) == (DeliveryOutcome.DELIVERED, ())
