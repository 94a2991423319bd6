"""Carried samples: each arrives once and in order, by whatever way, and its publisher learns it."""

import random
from collections.abc import Callable
from functools import partial
from typing import Any

import msgspec
import pytest

from tests.golden.tables import as_plain
from tests.independent import carried, frame
from tests.independent.record import Sample, Way
from tests.independent.table import table_of
from tests.virtual.mule import (
    LOG,
    MOORING,
    MULE,
    PERIOD_S,
    PHOTO,
    SHIP,
    Voyage,
    table,
)
from tests.virtual.sealed import SealedFleet
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import DeliveryOutcome
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.peers.contact import ContactRules
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.carry import CARRY_STREAM_ID, Carry
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.carry import (
    Bundle,
    CarryRefusal,
    Envelope,
    Receipt,
    encode_answer,
    encode_envelope,
)
from zacoustic.errors import LocalError
from zacoustic.testing.virtual import VirtualNetwork


def quickly(source: int, node: int, now: int) -> bool:
    """Return whether two nodes hear each other on a voyage with a pass every five minutes."""
    at_s = now / NS_PER_S % 300
    ends = {source, node}
    if ends == {MOORING, MULE}:
        return at_s < 60
    return ends == {MULE, SHIP} and 150 <= at_s < 210


def quick_table(**more: Any) -> Any:
    """Return a table for such a voyage."""
    return table(after_s=30.0, **more)


def report(voyage: Voyage, *, across_starts: bool = True) -> None:
    """Check that everything arrived once and in order, and that the mooring knows it.

    Args:
        voyage: The voyage.
        across_starts: Whether also what the mooring published before and after a restart is in
            order; it need not be if a custodian was restarted as well.
    """
    got = [value for value, _ in voyage.got]
    again = [value for value, is_again in voyage.got if is_again]
    firsts = list(dict.fromkeys(got))
    # What was not journalled when the mooring died may have gone with it.
    expected = [each for each in voyage.given if each in voyage.stored or each in firsts]
    assert set(firsts) == set(expected)
    for life in [None] if across_starts else set(voyage.lives.values()):
        assert [each for each in firsts if life in (None, voyage.lives[each])] == [
            each for each in expected if life in (None, voyage.lives[each])
        ]
    assert len(got) - len(firsts) <= len(again), "doubled, and not flagged"
    assert voyage.outcomes == dict.fromkeys(expected, DeliveryOutcome.DELIVERED)


def test_mule_brings_what_two_nodes_say_that_never_hear_each_other(
    sized: Callable[..., int],
) -> None:
    for seed in range(sized(12, share=1)):
        voyage = Voyage(seed, loss=0.2)
        hours = sized(12, share=3)
        for index in range(hours * 30):
            voyage.publish_at(120.0 * index + 60, b"%d" % index)
        voyage.network.run(until_s=(hours + 1.6) * PERIOD_S)
        report(voyage)
        assert all(each.custodian == MULE for each in voyage.custody)
        for address in (MOORING, MULE, SHIP):
            names = voyage.network.journal(address).entries
            assert not [key for key in names if key.startswith(("carry/", "carryback"))]


@pytest.mark.parametrize("address", [MOORING, MULE, SHIP])
def test_nothing_is_lost_or_doubled_when_a_node_is_killed(
    address: int, count: Callable[[int], int]
) -> None:
    swapped = 0
    for point in range(count(200)):
        rng = random.Random(1000 * address + point)
        voyage = Voyage(point, loss=0.2, hears=quickly, table=quick_table())
        for index in range(20):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        for _ in range(3):
            at_s = rng.uniform(5, 700)
            crash = partial(voyage.network.crash, address, reboots=rng.random() < 0.5)
            voyage.network.at(at_s, crash)
            voyage.network.at(at_s + rng.uniform(1, 40), partial(voyage.network.start, address))
        voyage.network.run(until_s=2400)
        # A restart of the publisher may cut a hand-over off: then one count waits for the other.
        report(voyage, across_starts=address != MOORING)
        got = list(dict.fromkeys(value for value, _ in voyage.got))
        swapped += got != sorted(got, key=voyage.given.index)
    assert swapped <= 0.03 * count(200) + 1


def test_straight_way_that_opens_now_and_then_doubles_nothing(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        rng = random.Random(seed)
        opens = sorted(rng.uniform(0, 1500) for _ in range(8))

        def hears(source: int, node: int, now: int) -> bool:
            at_s = now / NS_PER_S
            if {source, node} == {MOORING, SHIP}:
                return any(each <= at_s < each + 40 for each in opens)  # noqa: B023
            return quickly(source, node, now)

        voyage = Voyage(
            seed, loss=rng.choice([0.0, 0.2, 0.4]), hears=hears, copies=(rng.uniform(0, 20),),
            table=quick_table(),
        )  # fmt: skip
        for index in range(40):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        # At 40 % loss one of 150 voyages knows only after 3600 s that all has arrived.
        voyage.network.run(until_s=7200)
        report(voyage)


def test_large_samples_are_carried_as_well(count: Callable[[int], int]) -> None:
    for seed in range(count(20)):
        # Whoever is out of earshot is lost, and needs no part of the channel.
        lost_after_s = dict.fromkeys((1, 2, 3), 400.0)
        contact = ContactRules(heartbeat_s=30.0, lost_after_s=lost_after_s)
        rules = TransmitRules(contact=contact)
        voyage = Voyage(seed, loss=0.1, rules=rules)
        photos = [random.Random(seed + each).randbytes(10_240) for each in range(3)]
        for index, photo in enumerate(photos):
            voyage.publish_at(30.0 + 3000 * index, photo, PHOTO)
            voyage.publish_at(60.0 + 3000 * index, b"%d" % index)
        voyage.network.run(until_s=6 * PERIOD_S)
        assert sorted(value for value, _ in voyage.got) == sorted(voyage.given)
        assert voyage.ended == {DeliveryOutcome.DELIVERED: 6}


def test_full_custodian_refuses_and_the_publisher_learns(count: Callable[[int], int]) -> None:
    told = 0
    seeds = count(50)
    for seed in range(seeds):
        voyage = Voyage(
            seed, loss=0.2, hears=quickly, table=quick_table(),
            rules=TransmitRules(carry_bytes=100),
        )  # fmt: skip
        for index in range(12):
            voyage.publish_at(10.0 + 2 * index, b"%d" % index)
        voyage.network.run(until_s=2 * 3600)
        report(voyage)
        refused = [each for each in voyage.custody if each.custodian is None]
        told += bool(refused)
        assert all(each.detail == "node 2 has no room for it" for each in refused)
    # The straight way may open before the custodian's word is there.
    assert told >= 0.9 * seeds


def test_samples_go_along_a_chain_of_custodians_and_never_back(count: Callable[[int], int]) -> None:
    other = 4

    def hears(source: int, node: int, now: int) -> bool:
        at_s, ends = now / NS_PER_S % 400, {source, node}
        if ends == {MOORING, MULE}:
            return at_s < 60
        if ends == {MULE, other}:
            return 100 <= at_s < 160
        return ends == {other, SHIP} and 200 <= at_s < 260

    for seed in range(count(50)):
        nodes = (MOORING, MULE, SHIP, other)
        voyage = Voyage(
            seed,
            loss=0.2,
            hears=hears,
            nodes=nodes,
            table=quick_table(by=(other, MULE), nodes=nodes),
        )
        for index in range(12):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        voyage.network.run(until_s=3 * 3600)
        report(voyage)


def test_what_nobody_carries_in_time_expires_at_its_publisher_and_on_the_way() -> None:
    voyage = Voyage(hears=quickly, table=quick_table(expires_s=120.0))
    voyage.publish_at(10.0, b"too late")
    voyage.network.run(until_s=1200)
    assert voyage.got == []
    assert voyage.ended == {DeliveryOutcome.EXPIRED: 1}
    assert [each.custodian for each in voyage.custody] == [MULE]


def test_what_has_less_than_a_minute_to_live_is_not_handed_on_and_hinders_nothing() -> None:
    brief = msgspec.structs.replace(
        quick_table().by_id(PHOTO).spec, carry=Carry(by=(MULE,), after_s=30.0, expires_s=60.0)
    )
    voyage = Voyage(
        hears=quickly,
        table=StreamTable([quick_table().by_id(LOG).spec, brief], nodes=quick_table().nodes),
    )
    voyage.publish_at(10.0, b"brief", PHOTO)
    voyage.publish_at(11.0, b"log")
    voyage.network.run(until_s=1200)
    assert [value for value, _ in voyage.got] == [b"log"]
    assert voyage.outcomes[b"brief"] is DeliveryOutcome.EXPIRED
    assert [each.custodian for each in voyage.custody] == [MULE]
    kept = voyage.network.engine(MULE).carry
    assert kept is not None
    assert kept.refused == 0


def test_custodian_that_sinks_is_told_until_what_it_has_expires() -> None:
    voyage = Voyage(hears=quickly, table=quick_table(expires_s=1200.0))
    for index in range(3):
        voyage.publish_at(10.0 + index, b"%d" % index)
    voyage.network.at(100, partial(voyage.network.crash, MULE))
    voyage.network.run(until_s=900)
    kept = voyage.network.engine(MOORING).carry
    assert kept is not None
    (log,) = kept.streams
    assert (kept.own, kept.in_custody, log.own, log.custodians) == (3, 3, {SHIP: 3}, {MULE: 3})
    assert (log.oldest_at, log.ends_at) == (10 * NS_PER_S, 1210 * NS_PER_S)
    voyage.network.run(until_s=1300)
    kept = voyage.network.engine(MOORING).carry
    assert kept is not None
    assert (kept.own, kept.in_custody, kept.streams) == (0, 0, ())
    assert voyage.ended == {DeliveryOutcome.EXPIRED: 3}
    assert set(voyage.details.values()) == {f"in custody of {MULE}"}


def test_custodian_tells_what_it_has_for_whom_and_what_expired_with_it() -> None:
    voyage = Voyage(hears=quickly, table=quick_table(expires_s=1200.0))
    voyage.publish_at(10.0, b"log")
    voyage.publish_at(11.0, bytes(100), PHOTO)
    voyage.network.run(until_s=120)
    voyage.network.at(121, partial(voyage.network.crash, SHIP))
    voyage.network.at(130, partial(voyage.network.restart, MULE))
    voyage.network.run(until_s=600)
    kept = voyage.network.engine(MULE).carry
    assert kept is not None
    assert [(each.stream_id, each.own, each.carried) for each in kept.streams] == [
        (LOG, {}, {SHIP: 1}), (PHOTO, {}, {SHIP: 1}),
    ]  # fmt: skip
    assert sum(each.carried_bytes for each in kept.streams) == kept.carried_bytes > 100
    first = kept.streams[0]
    assert first.oldest_at is not None
    assert first.ends_at is not None
    assert 10 < first.oldest_at / NS_PER_S < 60
    assert 1000 < first.ends_at / NS_PER_S <= 1210
    voyage.network.run(until_s=1300)
    kept = voyage.network.engine(MULE).carry
    assert kept is not None
    assert (kept.carried, kept.expired, kept.streams) == (0, 2, ())


def test_newer_samples_supersede_older_ones_beyond_the_depth() -> None:
    voyage = Voyage(hears=quickly, table=quick_table(depth=3))
    for index in range(10):
        voyage.publish_at(70.0 + index, b"%d" % index)
    voyage.network.run(until_s=1200)
    assert [value for value, _ in voyage.got] == [b"7", b"8", b"9"]
    assert voyage.ended == {DeliveryOutcome.SUPERSEDED: 7, DeliveryOutcome.DELIVERED: 3}


def test_idle_fleet_is_silent() -> None:
    voyage = Voyage(rules=TransmitRules())
    voyage.network.run(until_s=24 * 3600)
    sent = sum(voyage.network.engine(each).stats.frames_transmitted for each in (1, 2, 3))
    assert sent == 0


def test_nodes_in_reach_talk_straight() -> None:
    voyage = Voyage(hears=lambda source, node, now: True)
    for index in range(20):
        voyage.publish_at(10.0 + 30 * index, b"%d" % index)
    voyage.network.run(until_s=1000)
    report(voyage)
    assert voyage.custody == []
    assert max(at_s for at_s in voyage.got_s.values()) < 10 + 30 * 19 + 30


@pytest.mark.parametrize("doubt", ["", "an old copy"])
def test_old_copy_of_the_publishers_journal_loses_and_doubles_nothing(
    doubt: str, count: Callable[[int], int]
) -> None:
    for seed in range(count(200)):
        rng = random.Random(seed)
        straight = rng.random() < 0.5
        voyage = Voyage(seed, loss=0.2, table=quick_table(), hears=_always if straight else quickly)
        network, journal = voyage.network, voyage.network.journal(MOORING)
        kept: dict[str, bytes] = {}
        for index in range(24):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        copied_s, restored_s = sorted(rng.uniform(20, 600) for _ in range(2))

        def put_back() -> None:
            voyage.may_end_again = True  # noqa: B023
            network.crash(MOORING)  # noqa: B023
            journal.put_back(kept, doubt)  # noqa: B023
            network.start(MOORING)  # noqa: B023

        network.at(copied_s, lambda: kept.update(journal.entries))  # noqa: B023
        network.at(restored_s, put_back)
        network.run(until_s=3600)
        got = [value for value, _ in voyage.got]
        flagged = sum(again for _, again in voyage.got)
        assert len(got) - len(set(got)) <= flagged
        # What was published after the copy and before its restoration may have gone with the disk.
        sure = [
            value
            for index, value in enumerate(voyage.given)
            if value in voyage.stored and not copied_s - 5 <= 10.0 + 25 * index <= restored_s
        ]
        assert set(sure) <= set(got), f"seed {seed}"


def _always(source: int, node: int, now: int) -> bool:
    return True


def test_old_copy_of_the_subscribers_journal_loses_nothing_later_and_doubles_nothing(
    count: Callable[[int], int],
) -> None:
    for seed in range(count(200)):
        rng = random.Random(seed)
        voyage = Voyage(seed, loss=0.2, table=quick_table(expires_s=2400.0), hears=quickly)
        network, journal = voyage.network, voyage.network.journal(SHIP)
        kept: dict[str, bytes] = {}
        for index in range(24):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        copied_s, restored_s = sorted(rng.uniform(20, 900) for _ in range(2))

        def put_back() -> None:
            network.crash(SHIP)  # noqa: B023
            journal.put_back(kept, "an old copy")  # noqa: B023
            network.start(SHIP)  # noqa: B023

        network.at(copied_s, lambda: kept.update(journal.entries))  # noqa: B023
        network.at(restored_s, put_back)
        network.run(until_s=7200)
        got = [value for value, _ in voyage.got]
        # What the ship held for others to come, and had taken over, went with its disk.
        late = [
            value
            for index, value in enumerate(voyage.given)
            if not copied_s - 600 < 10.0 + 25 * index < restored_s
        ]
        assert set(late) <= set(got), f"seed {seed}"
        assert len(got) - len(set(got)) <= sum(again for _, again in voyage.got)
        assert len(voyage.outcomes) == 24


def test_forged_messages_have_no_lasting_effect(count: Callable[[int], int]) -> None:
    for seed in range(count(200)):
        rng = random.Random(seed)
        hears = _always if rng.random() < 0.5 else quickly
        voyage = Voyage(seed, loss=0.1, table=quick_table(), hears=hears)
        network = voyage.network
        for index in range(40):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        network.run(until_s=rng.uniform(30, 300))
        known = {each.bundle.lineage for each in _envelopes(network)} or {rng.randrange(65536)}
        bundle = Bundle(MOORING, SHIP, LOG, (), rng.choice(sorted(known)))
        number = rng.randrange(1 << 24)
        forged = rng.choice([
            encode_answer(Receipt(bundle, number)),
            encode_answer(CarryRefusal(bundle, rng.randrange(30))),
            encode_envelope(
                Envelope(bundle=bundle, number=number, floor=number, digest=b"xx", life_s=3600.0,
                         payload=b"forged"), MULE, SHIP,
            ),
        ])  # fmt: skip
        for node in (MOORING, MULE, SHIP):
            network.apply(node, partial(_hear, node, forged))
        forged_at_s = voyage.now_s
        network.run(until_s=4000)
        late = [
            value
            for index, value in enumerate(voyage.given)
            if 10.0 + 25 * index > forged_at_s + 300
        ]
        got = [value for value, _ in voyage.got]
        assert [value for value in got if value in late] == late, f"seed {seed}"
        assert got.count(b"forged") <= 1


def test_what_a_custodian_drops_for_a_forged_receipt_is_offered_again() -> None:
    """The publisher finds the receipt impossible; the custodian has believed it."""
    voyage = Voyage(86, loss=0.1, table=quick_table(), hears=quickly)
    for index in range(40):
        voyage.publish_at(10.0 + 25 * index, b"%d" % index)
    voyage.network.run(until_s=38.379)
    (lineage,) = {each.bundle.lineage for each in _envelopes(voyage.network)}
    bundle = Bundle(MOORING, SHIP, LOG, (), lineage)
    assert [each.custodian for each in voyage.custody] == [MULE]
    forged = encode_answer(Receipt(bundle, 403_262))
    for node in (MOORING, MULE, SHIP):
        voyage.network.apply(node, partial(_hear, node, forged))
    voyage.network.run(until_s=4000)
    assert [value for value, _ in voyage.got] == voyage.given


def _envelopes(network: VirtualNetwork) -> list[Envelope]:
    entries = network.journal(MOORING).entries
    return [
        msgspec.msgpack.decode(
            msgspec.msgpack.encode(msgspec.msgpack.decode(value)[0]), type=Envelope
        )
        for key, value in entries.items()
        if key.startswith("carry/")
    ]


def _hear(node: int, message: bytes, engine: Engine, now: int) -> None:
    """Let a node hear a message of the stream of carried samples in a frame of a stranger."""
    source = MULE if node != MULE else MOORING
    sync = bytes((0xB8, 0x12, 0x34, 0, 0, 0))
    records = sync + bytes((CARRY_STREAM_ID, node, 0)) + message
    frame = ReceivedFrame(frame_bytes=records, source=source, destination=node, received_at=now)
    engine.handle_frame(frame, now)


def test_subscriber_that_defines_the_topic_differently_refuses(
    count: Callable[[int], int],
) -> None:
    for seed, hears in [(each, hears) for each in range(count(50)) for hears in (_always, quickly)]:
        voyage = Voyage(seed, loss=0.1, table=quick_table(), hears=hears)
        voyage.network.restart(SHIP, quick_table(depth=7))
        for index in range(5):
            voyage.publish_at(20.0 + 5 * index, b"%d" % index)
        voyage.network.run(until_s=3600)
        assert voyage.got == []
        assert voyage.ended == {DeliveryOutcome.REFUSED: 5}


def test_sealed_voyages(count: Callable[[int], int]) -> None:
    for seed in range(count(100)):
        rng = random.Random(seed)
        voyage = Voyage(
            seed, loss=0.2, table=quick_table(), hears=quickly, build=SealedFleet(),
            copies=(rng.uniform(0, 30),),
        )  # fmt: skip
        for index in range(20):
            voyage.publish_at(10.0 + 25 * index, b"%d" % index)
        for address in (MOORING, MULE, SHIP):
            at_s = rng.uniform(5, 700)
            voyage.network.at(at_s, partial(voyage.network.crash, address))
            voyage.network.at(at_s + 20, partial(voyage.network.start, address))
        voyage.network.run(until_s=7200)
        report(voyage, across_starts=False)


def test_topic_with_no_other_subscriber_is_refused() -> None:
    voyage = Voyage()
    spec = table().by_id(LOG).spec
    alone = msgspec.structs.replace(spec, publishers=(MOORING, SHIP))
    voyage.network.restart(SHIP, StreamTable([alone], nodes=table().nodes))
    with pytest.raises(LocalError, match="nobody is listed who could receive it"):
        voyage.network.publish(SHIP, LOG, b"to myself")


def test_gap_that_never_fills_is_given_up_when_nothing_is_worth_carrying_any_more() -> None:
    voyage = Voyage(hears=quickly, table=quick_table(expires_s=1800.0))
    for index in range(3):
        voyage.publish_at(10.0 + index, b"%d" % index)
    voyage.network.at(100, lambda: voyage.network.crash(MULE))
    voyage.network.at(101, lambda: voyage.network.journal(MULE).put_back({}))
    voyage.network.at(102, lambda: voyage.network.start(MULE))
    voyage.publish_at(320.0, b"3")
    voyage.network.run(until_s=2 * 3600)
    assert [value for value, _ in voyage.got] == [b"3"]
    # By then each of those before it has ended at its publisher, and so has this one.
    assert voyage.ended == {DeliveryOutcome.EXPIRED: 4}


def test_deletes_and_encodings_are_carried() -> None:
    voyage = Voyage(hears=quickly, table=quick_table())
    network = voyage.network
    said: list[dict[str, Any]] = [{"encoding": "text/plain"}, {"delete": True}, {}]
    for index, more in enumerate(said):
        voyage.given.append(b"%d" % index)
        say = partial(network.apply, MOORING, partial(_publish, more))
        network.at(10.0 + index, say)
    network.run(until_s=600)
    heard = [(each.value, each.deleted, each.encoding) for each in voyage.samples]
    usual = network.engine(SHIP).table.by_id(LOG).encoding
    assert heard == [(b"x", False, "text/plain"), (None, True, usual), (b"x", False, usual)]


def _publish(more: dict[str, Any], engine: Engine, now: int) -> int:
    return engine.publish(LOG, b"x", now, **more)


def test_reader_made_from_the_wire_page_alone_reads_every_frame_of_a_voyage() -> None:
    heard: list[TraceRecord] = []

    def note(record: TraceRecord) -> None:
        if record.what == "transmit":
            heard.append(record)

    known = quick_table()
    theirs = table_of(as_plain(known))
    voyage = Voyage(3, loss=0.2, hears=quickly, table=known, trace=note)
    for index in range(20):
        voyage.publish_at(10.0 + 25 * index, b"%d" % index)
    voyage.network.run(until_s=1500)
    kinds: set[int] = set()
    for each in heard:
        way = Way(theirs, each.node, each.peer)
        for placed in frame.read(bytes.fromhex(each.frame), way).placed:
            assert not isinstance(placed.item, frame.Unread)
            if isinstance(placed.item, Sample) and placed.item.stream == CARRY_STREAM_ID:
                assert isinstance(placed.item.payload, bytes)
                message = carried.read(placed.item.payload, each.node, each.peer, theirs)
                assert carried.write(message, theirs) == placed.item.payload
                kinds.add(message.kind)
    assert kinds == {carried.ENVELOPE, carried.RECEIPT, carried.DIRECT}
