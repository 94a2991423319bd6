"""The gate says why a frame waits, one word a reason, and the frame goes when it says."""

from functools import partial

import msgspec
import pytest

from tests.core.bulklink import BulkSea
from tests.virtual.waiting import LINK, Waiter
from zacoustic.core.base.qos import Priority, Qos, Reliability
from zacoustic.core.base.waits import Waits, Why
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import ObjectProgress
from zacoustic.core.linktypes import LinkState, Transmission
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.schedule.access import (
    AlohaSpec,
    CarrierSenseSpec,
    PollingSpec,
    TdmaSpec,
)
from zacoustic.core.schedule.queue import QueuedRecord, TransmitQueue
from zacoustic.core.schedule.silence import QuietWindow
from zacoustic.core.schedule.transmitter import Opening
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.testing.scenarios import draw_scenario, run_scenario

S = NS_PER_S
HALF_DUPLEX = msgspec.structs.replace(LINK, half_duplex=True)
SENSING = msgspec.structs.replace(LINK, senses_carrier=True)
UTC_S = 20_610 * 86_400 + 0.25
TDMA = TdmaSpec(slots=(2, 1, 2), slot_s=3.0, clock_error_s=0.01, max_range_m=1500)


def table(qos: Qos | None = None) -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=10, name="nav", qos=qos or Qos(depth=50)),
            TopicSpec(stream_id=11, name="photo", qos=Qos(reliability=Reliability.RELIABLE)),
            TopicSpec(stream_id=12, name="stop", qos=Qos(priority=Priority.REAL_TIME)),
        ],
        nodes={1: "shore", 2: "auv"},
    )


def with_access(access: object) -> TransmitRules:
    return TransmitRules(access=access)  # type: ignore[arg-type]


def test_nothing_waits_in_an_idle_node_nor_where_a_frame_goes_at_once() -> None:
    node = Waiter(table())
    assert node.waits is None
    node.publish(10)
    assert len(node.sent) == 1
    assert node.waits is None
    node.run(3600 * S)
    assert node.waits is None


@pytest.mark.parametrize("was_up", [False, True])
def test_link(was_up: bool) -> None:
    node = Waiter(table(), is_up=was_up)
    if was_up:
        node.change(LinkState.DOWN)
    assert node.waits is None
    node.publish(10)
    assert node.waits == Waits(why=Why.LINK, until=None)
    node.run(60 * S)
    assert node.waits == Waits(why=Why.LINK, until=None)
    node.change(LinkState.UP)
    assert [at for at, _ in node.sent] == [60 * S]
    assert node.waits is None


def test_modem_transmits_and_then_needs_its_gap() -> None:
    node = Waiter(table(), capabilities=msgspec.structs.replace(LINK, gap_s=0.5))
    node.publish(10, bytes(40))
    node.publish(10, bytes(40))
    assert node.waits == Waits(why=Why.MODEM, until=None)
    ended_at = node.sent[0][0] + LINK.airtime_ns(len(node.sent[0][1].frame_bytes))
    node.run(ended_at + 1)
    assert node.sends_as_told(Why.MODEM) == ended_at + S // 2
    assert node.waits is None


def test_journal() -> None:
    node = Waiter(table(), commits=False)
    node.publish(10)
    assert node.waits == Waits(why=Why.JOURNAL, until=None)
    node.commits = True
    node.poll()
    assert len(node.sent) == 1
    assert node.waits is None


def test_linger() -> None:
    node = Waiter(table(Qos(linger_s=2.5)))
    node.publish(10)
    assert node.sends_as_told(Why.LINGER) == 5 * S // 2
    assert node.waits is None


def test_interval() -> None:
    node = Waiter(table(Qos(min_interval_s=20.0)))
    node.publish(10)
    node.run(5 * S)
    node.publish(10)
    assert node.sends_as_told(Why.INTERVAL) == 20 * S


def spend(node: Waiter) -> None:
    """Publish until the airtime cap is spent."""
    while node.waits is None or node.waits.why is not Why.AIRTIME:
        node.publish(10, bytes(40))
        node.run(node.now + 2 * S)
        assert node.now < 100 * S
    assert node.waits.until is not None
    assert node.waits.until > node.now + S


def test_airtime_of_the_node_and_not_for_what_is_urgent() -> None:
    node = Waiter(table(), TransmitRules(max_airtime=0.005))
    spend(node)
    node.sends_as_told(Why.AIRTIME)
    spend(node)
    count = len(node.sent)
    node.publish(12)
    assert len(node.sent) == count + 1


def test_airtime_of_a_stream() -> None:
    node = Waiter(table(Qos(max_airtime=0.005)))
    spend(node)
    node.sends_as_told(Why.AIRTIME)


def test_replies_to_a_node_that_has_used_up_its_budget() -> None:
    queue = TransmitQueue()
    item = QueuedRecord(stream_id=10, destination=2, payload=b"", queued_at=0, is_reply=True)
    queue.push((10, 1), item, Qos())
    assert queue.held(5) == (0, Why.LINGER)
    queue.hold_replies(2, 9 * S)
    assert queue.held(5) == (9 * S, Why.REPLIES)


def test_answer_about_an_object() -> None:
    node = Waiter(table())
    node.publish(11, bytes(200))
    node.run(4 * S)
    assert node.waits is None, "an object that awaits an answer is no frame that waits"
    node.publish(10)
    node.sends_as_told(Why.ANSWER)


def test_pause_of_this_node() -> None:
    node = Waiter(table(), capabilities=HALF_DUPLEX)
    for _ in range(20):
        node.publish(10, bytes(40))
    while node.waits is None or node.waits.why is not Why.PAUSE:
        node.run(node.now + S // 20)
        assert node.now < 30 * S
    node.sends_as_told(Why.PAUSE)


def test_burst_data_of_another_node() -> None:
    sea = BulkSea(table(), (1, 2))
    shore, auv = sea.nodes[1], sea.nodes[2]
    shore.engine.publish(11, bytes(8000), sea.now)
    shore.serve()
    sea.run(lambda: any(isinstance(event, ObjectProgress) for event in auv.events))
    auv.engine.publish(10, b"x", sea.now)
    auv.serve()
    waits = auv.engine.waits(sea.now)
    assert waits is not None
    assert waits.why is Why.BURST


def test_carrier_and_back_off() -> None:
    node = Waiter(table(), with_access(CarrierSenseSpec()), SENSING)
    node.tell(partial(node.engine.handle_carrier, True))
    assert node.waits is None
    node.publish(10)
    assert node.waits == Waits(why=Why.CARRIER, until=2 * LINK.airtime_ns(64))
    node.run(S)
    node.tell(partial(node.engine.handle_carrier, False))
    node.sends_as_told(Why.BACK_OFF)


@pytest.mark.parametrize("is_told", [False, True])
def test_sample_that_waits_outside_of_the_engine_takes_part_in_the_back_off(is_told: bool) -> None:
    node = Waiter(table(), with_access(CarrierSenseSpec()), SENSING)
    node.tell(partial(node.engine.handle_carrier, True))
    node.run(S)
    assert node.engine.opening("link", node.now) is Opening.CLOSED
    if is_told:
        node.tell(partial(node.engine.handle_waiting, "link"))
    assert node.waits is None
    node.tell(partial(node.engine.handle_carrier, False))
    assert node.engine.opening("link", node.now) is (Opening.CLOSED if is_told else Opening.FREE)


def test_carrier_that_never_ends() -> None:
    node = Waiter(table(), with_access(CarrierSenseSpec()), SENSING)
    node.tell(partial(node.engine.handle_carrier, True))
    node.publish(10)
    assert node.sends_as_told(Why.CARRIER) == 2 * LINK.airtime_ns(64)


@pytest.mark.parametrize("access", [TDMA, AlohaSpec(slot_s=5.0)])
def test_slot(access: object) -> None:
    node = Waiter(table(), with_access(access), offset_s=UTC_S)
    node.run(S // 2)
    node.publish(10)
    node.sends_as_told(Why.SLOT)


def test_clock() -> None:
    node = Waiter(table(), with_access(TDMA))
    node.publish(10)
    assert node.waits == Waits(why=Why.CLOCK, until=None)
    node.tell(lambda now: node.engine.handle_clock(seconds_to_ns(UTC_S), 0, now))
    node.sends_as_told(Why.SLOT)


def test_turn() -> None:
    node = Waiter(table(), with_access(PollingSpec(poller=2, nodes=(1,))))
    node.publish(10)
    assert node.waits == Waits(why=Why.TURN, until=None)


def test_silence() -> None:
    node = Waiter(table())
    node.tell(lambda now: node.engine.silence.begin(now, duration_s=60.0))
    assert node.waits is None
    node.publish(10)
    assert node.sends_as_told(Why.SILENCE) == 60 * S
    node.run(70 * S)
    node.tell(node.engine.silence.begin)
    node.publish(10)
    assert node.waits == Waits(why=Why.SILENCE, until=None)


def test_quiet_window() -> None:
    quiet = QuietWindow(begins_ns=0, ends_ns=3600 * S)
    node = Waiter(table(), TransmitRules(quiet=(quiet,)), offset_s=UTC_S)
    node.publish(10)
    node.sends_as_told(Why.SILENCE)


def test_last_of_several_reasons_is_named() -> None:
    """A slot after the linger, and a slot after the silence."""
    node = Waiter(table(Qos(linger_s=1.0)), with_access(TDMA), offset_s=UTC_S)
    node.publish(10)
    slot_at = node.sends_as_told(Why.SLOT)
    node.run(slot_at + 2 * S)
    node.tell(lambda now: node.engine.silence.begin(now, duration_s=60.0))
    silent_until = node.now + 60 * S
    node.publish(10)
    assert node.sends_as_told(Why.SLOT) > silent_until


class Asked(Engine):
    """An engine that is asked again and again, also about later instants."""

    def poll_transmit(self, now: int) -> Transmission | None:
        for link in self.links:
            for later_s in (0, 1, 5, 60):
                self.waits(now + later_s * S, link)
                self.opening(link, now + later_s * S)
        return super().poll_transmit(now)


@pytest.mark.parametrize("seed", range(3))
def test_to_ask_changes_nothing(seed: int) -> None:
    plain = run_scenario(draw_scenario(seed), (), digest=True)
    asked = run_scenario(draw_scenario(seed), (), digest=True, build=Asked)
    assert asked.digest == plain.digest
