"""Ranges on demand, by hand: which frame goes, what it asks for, which answer counts."""

import itertools
import random

import pytest

from tests.core.rig import End, Rig, link
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.engine.engine import Engine
from zacoustic.core.linktypes import (
    BROADCAST,
    LinkMetrics,
    LinkState,
    ModemRead,
    PeerMeasured,
    Transmission,
    TransmitOutcome,
)
from zacoustic.core.peers.ranging import RangeFailed, RangeFailure, RangeMeasured
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.errors import LocalError, RangeUnavailableError

MODEM = link(acknowledges=True, measures_range=True, propagation_s=1.0)
DELIVERED, LOST = TransmitOutcome.DELIVERED, TransmitOutcome.NOT_DELIVERED


def table(*, nodes: tuple[int, ...] = (1, 2, 3)) -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=1, name="all", qos=Qos(depth=9)),
            TopicSpec(stream_id=2, name="urgent", qos=Qos(depth=9, priority=Priority.REAL_TIME)),
            TopicSpec(stream_id=3, name="to2", subscribers=(2,), qos=Qos(depth=9)),
            TopicSpec(
                stream_id=4,
                name="order",
                subscribers=(2,),
                qos=Qos(depth=9, priority=Priority.INTERACTIVE_HIGH),
            ),
        ],
        nodes={address: f"n{address}" for address in nodes},
    )


def rig() -> Rig:
    """Three nodes that have confirmed each other."""
    rig = Rig({address: table() for address in (1, 2, 3)}, capabilities=MODEM)
    for _ in range(3):
        for address in rig.ends:
            rig.publish(address, 1, b"hi")
            rig.run(30.0)
    for end in rig.ends.values():
        assert all(end.engine.peers().values())
        end.events.clear()
    rig.frames.clear()
    return rig


def at(end: End) -> Transmission:
    transmission = end.poll(end.now)
    assert transmission is not None
    return transmission


def measure(end: End, address: int, *, measured_at: int | None = None, **metrics: float) -> None:
    found = LinkMetrics(**({"propagation_s": 0.5, "range_m": 750.0} | metrics))
    instant = end.now if measured_at is None else measured_at
    end.engine.handle_measurement(
        PeerMeasured(address=address, measured_at=instant, metrics=found), end.now
    )
    end.settle()


def pass_time(end: End, duration_s: float) -> None:
    end.now += seconds_to_ns(duration_s)
    end.engine.handle_timeout(end.now)
    end.settle()


def test_without_anything_to_say_one_byte_of_padding_is_acknowledged() -> None:
    world = rig()
    end = world[1]
    end.now = world.now
    range_id = end.engine.ranging.request(2, end.now, timeout_s=30)
    frame = at(end)
    assert (frame.frame_bytes, frame.destination, frame.acknowledge) == (b"\0", 2, True)
    world.now = end.now
    world.deliver(1, frame)
    assert world[2].events == []
    assert world[2].engine.stats.dropped == {}
    end.report(frame, DELIVERED)
    assert end.got(RangeMeasured) == []
    measure(end, 2, integrity=133.0)
    (found,) = end.got(RangeMeasured)
    assert found.range_id == range_id
    assert (found.range.address, found.range.propagation_s, found.range.range_m) == (2, 0.5, 750.0)
    assert (found.range.integrity, found.range.measured_at) == (133.0, end.now)
    assert end.engine.is_idle
    ledger = {(line.stream_id, line.cause) for line in end.engine.stats.ledger()}
    assert (0, Cause.RANGE) in ledger


def test_frame_that_goes_anyway_is_acknowledged_and_no_other_goes() -> None:
    end = rig()[1]
    end.engine.publish(3, b"payload", end.now)
    end.engine.ranging.request(2, end.now, timeout_s=30)
    frame = at(end)
    assert (frame.frame_bytes, frame.destination, frame.acknowledge) == (b"\3payload", 2, True)
    end.report(frame, DELIVERED)
    measure(end, 2)
    assert end.poll(end.now) is None
    end.engine.publish(3, b"more", end.now)
    assert not at(end).acknowledge


def test_real_time_goes_first_and_then_the_range_before_what_waits() -> None:
    end = rig()[1]
    end.engine.ranging.request(2, end.now, timeout_s=30)
    for stream_id in (1, 2):
        end.engine.publish(stream_id, b"payload", end.now)
    urgent = at(end)
    assert (urgent.destination, urgent.acknowledge) == (BROADCAST, False)
    assert urgent.frame_bytes.startswith(b"\xb2\x0e\xb8\x00\x01\x00\x00\x00\x02payload")
    end.report(urgent)
    assert (frame := at(end)).acknowledge
    assert frame.destination == 2


def test_unknown_peer_is_not_introduced_to_but_for_what_waits() -> None:
    end = End(1, table(), capabilities=MODEM)
    end.engine.ranging.request(2, 0, timeout_s=30)
    assert at(end).frame_bytes == b"\0"
    end = End(1, table(), capabilities=MODEM)
    end.engine.publish(3, b"payload", 0)
    end.engine.ranging.request(2, 0, timeout_s=30)
    frame = at(end)
    assert (frame.frame_bytes[0], frame.acknowledge) == (0xB0, True)


def test_what_is_owed_to_the_peer_rides_on_the_frame() -> None:
    world = Rig({address: table() for address in (1, 2)}, capabilities=MODEM)
    world.publish(2, 1, b"hi")
    world.exchange()
    end = world[1]
    end.now = world.now + seconds_to_ns(20)  # it may be confirmed now
    end.engine.ranging.request(2, end.now, timeout_s=30)
    frame = at(end)
    assert (frame.frame_bytes, frame.acknowledge) == (b"\xb5\x02\x00\x01", True)


def test_two_requests_share_an_exchange_and_an_older_measurement_answers_none() -> None:
    end = rig()[1]
    end.now = seconds_to_ns(500)
    first = end.engine.ranging.request(2, end.now, timeout_s=30)
    frame = at(end)
    end.now += seconds_to_ns(1)
    late = end.engine.ranging.request(2, end.now, timeout_s=30)
    measure(end, 2, measured_at=end.now - seconds_to_ns(2))
    assert end.got(RangeMeasured) == []
    measure(end, 2, measured_at=end.now - seconds_to_ns(0.5))
    assert [each.range_id for each in end.got(RangeMeasured)] == [first]
    end.report(frame, DELIVERED)
    end.now += 1
    measure(end, 2)
    assert [each.range_id for each in end.got(RangeMeasured)] == [first, late]
    assert end.engine.is_idle


def test_measurement_of_another_peer_or_without_a_delay_answers_none() -> None:
    end = rig()[1]
    end.engine.ranging.request(2, end.now, timeout_s=30)
    measure(end, 3)
    end.engine.handle_measurement(
        PeerMeasured(address=2, measured_at=end.now, metrics=LinkMetrics(integrity=1.0)), end.now
    )
    end.settle()
    assert end.got(RangeMeasured) == []
    assert len(end.got(PeerMeasured)) == 2


def test_exchange_without_a_result_is_tried_again_with_growing_pauses_until_the_time_is_over() -> (
    None
):
    end = rig()[1]
    began_at = end.now = seconds_to_ns(500)
    range_id = end.engine.ranging.request(2, end.now, timeout_s=30)
    sent_at = []
    while not end.got(RangeFailed):
        frame = end.poll(end.now)
        if frame is not None:
            assert frame.acknowledge
            sent_at.append((end.now - began_at) / 1e9)
            end.report(frame, LOST)
            continue
        due_at = end.engine.poll_timeout()
        assert due_at is not None
        end.now = due_at
        end.engine.handle_timeout(end.now)
        end.settle()
    assert sent_at == pytest.approx([0, 2, 6, 14], abs=0.1)
    (failed,) = end.got(RangeFailed)
    assert (failed.range_id, failed.address) == (range_id, 2)
    assert failed.failure is RangeFailure.TIMED_OUT
    assert failed.text == "no range within 30 s: not delivered"
    assert end.now - began_at == seconds_to_ns(30)
    assert end.engine.is_idle


def test_other_frames_pass_while_a_range_waits_for_its_next_try() -> None:
    end = rig()[1]
    end.engine.ranging.request(2, end.now, timeout_s=30)
    end.report(at(end), LOST)
    began_at = end.now
    end.engine.publish(1, b"payload", end.now)
    while (frame := end.poll(end.now)) is None:
        due_at = end.engine.poll_timeout()
        assert due_at is not None
        end.now = due_at
    assert (frame.destination, frame.acknowledge) == (BROADCAST, False)
    assert end.now - began_at < seconds_to_ns(1)


def test_modem_that_tells_no_delay_is_named_in_the_failure() -> None:
    end = rig()[1]
    end.engine.ranging.request(2, end.now, timeout_s=1)
    end.report(at(end), DELIVERED)
    pass_time(end, 1.0)
    (failed,) = end.got(RangeFailed)
    assert failed.text == "no range within 1 s: acknowledged, but the modem reports no delay"


def test_request_on_a_link_that_is_down_times_out_and_sends_nothing() -> None:
    end = rig()[1]
    end.engine.handle_link_state(LinkState.DOWN, end.now)
    end.engine.ranging.request(2, end.now, timeout_s=5)
    assert end.engine.poll_timeout() == end.now + seconds_to_ns(5)
    assert end.poll(end.now) is None
    pass_time(end, 5.0)
    assert end.got(RangeFailed)[0].text == "no range within 5 s: nothing could be sent"
    assert end.engine.poll_timeout() is None


def test_cancelled_request_is_silent() -> None:
    end = rig()[1]
    range_id = end.engine.ranging.request(2, end.now, timeout_s=5)
    end.engine.ranging.cancel(range_id)
    end.engine.ranging.cancel(range_id)
    assert end.poll(end.now) is None
    assert end.engine.is_idle


def test_link_without_ranges_is_a_clear_error() -> None:
    end = End(1, table())
    for ask in (
        lambda: end.engine.ranging.request(2, 0, timeout_s=5),
        lambda: end.engine.ranging.repeat(2, 30, 0),
    ):
        with pytest.raises(RangeUnavailableError, match="this link measures no ranges"):
            ask()
    near = End(1, table(), capabilities=link(
        acknowledges=True, measures_range=True, address_range=(1, 2)))  # fmt: skip
    with pytest.raises(RangeUnavailableError, match=r"no range of node 3; allowed: 1\.\.2"):
        near.engine.ranging.request(3, 0, timeout_s=5)


def test_link_that_turns_out_to_measure_none_fails_what_waits() -> None:
    later = Engine(address=1, table=table(), epoch=1, rng=random.Random(1))
    range_id = later.ranging.request(2, 0, timeout_s=5)
    later.ranging.repeat(2, 30, 0)
    assert later.poll_timeout() == seconds_to_ns(5)
    later.handle_link_state(LinkState.UP, 1, link())
    failed = [each for each in iter(later.poll_event, None) if isinstance(each, RangeFailed)]
    assert [(each.range_id, each.failure) for each in failed] == [
        (range_id, RangeFailure.UNAVAILABLE),
        (None, RangeFailure.UNAVAILABLE),
    ]
    assert later.poll_timeout() is None


@pytest.mark.parametrize(
    ("address", "timeout_s", "expected"),
    [
        (1, 5, "node 1 is this node"),
        (9, 5, r"node 9 is not known; allowed: 1 \(n1\), 2 \(n2\)"),
        (2, 0, "timeout_s is 0; allowed: above 0"),
        (2, float("inf"), "timeout_s is inf"),
    ],
)
def test_wrong_requests_are_refused(address: int, timeout_s: float, expected: str) -> None:
    end = End(1, table(), capabilities=MODEM)
    with pytest.raises(LocalError, match=expected):
        end.engine.ranging.request(address, 0, timeout_s=timeout_s)


@pytest.mark.parametrize("every_s", [0, 0.5, 100_000, float("nan")])
def test_wrong_periods_are_refused(every_s: float) -> None:
    end = End(1, table(), capabilities=MODEM)
    with pytest.raises(LocalError, match=r"every_s is .*; allowed: 1\.\.86400"):
        end.engine.ranging.repeat(2, every_s, 0)


def test_schedule_is_kept_and_put_off_by_any_other_measurement() -> None:
    end = rig()[1]
    end.now = seconds_to_ns(500)
    end.engine.ranging.repeat(2, 20, end.now)
    due_at = end.engine.poll_timeout()
    assert due_at is not None
    assert end.now <= due_at <= end.now + seconds_to_ns(5)
    end.now = due_at
    end.report(at(end), DELIVERED)
    end.now += seconds_to_ns(1)
    measure(end, 2)
    assert end.engine.poll_timeout() == end.now + seconds_to_ns(20)
    end.now += seconds_to_ns(12)
    measure(end, 2)
    assert end.engine.poll_timeout() == end.now + seconds_to_ns(20)
    assert [each.address for each in end.got(PeerMeasured)] == [2, 2]
    assert end.got(RangeMeasured) == []


def test_schedule_of_a_peer_that_is_gone_grows_rare() -> None:
    end = rig()[1]
    end.now = seconds_to_ns(500)
    end.engine.ranging.repeat(2, 1, end.now)
    sent_at: list[float] = []
    while len(sent_at) < 9:
        due_at = end.engine.poll_timeout()
        assert due_at is not None
        end.now = max(end.now, due_at)
        frame = at(end)
        sent_at.append(end.now / 1e9)
        end.report(frame, LOST)
    gaps = [after - before for before, after in itertools.pairwise(sent_at)]
    assert gaps == pytest.approx([2, 4, 8, 16, 32, 64, 64, 64], abs=0.1)
    assert end.got(RangeFailed) == []


def test_measurements_of_nobody_are_dropped_and_readings_of_the_modem_kept() -> None:
    end = rig()[1]
    for address in (0, 1, 255):
        measure(end, address)
    assert end.got(PeerMeasured) == []
    assert end.engine.stats.dropped["address"] == 3
    end.engine.handle_measurement(ModemRead(read_at=1, battery_v=24.0), end.now)
    end.settle()
    assert end.got(ModemRead) == [ModemRead(read_at=1, battery_v=24.0)]
    assert end.engine.measurements.modems == {"link": ModemRead(read_at=1, battery_v=24.0)}


def test_a_range_gives_way_to_what_presses_but_not_for_more_than_a_period() -> None:
    sea = rig()
    end = sea.ends[1]
    end.engine.ranging.repeat(2, 30.0, end.now)
    pass_time(end, 8.0)
    first = at(end)
    assert first.acknowledge
    end.report(first, DELIVERED)
    measure(end, 2)
    pass_time(end, 28.0)  # the next one is due in two seconds
    orders = 0
    for number in range(12):  # one every four seconds or so: a period would be spread
        orders += 1
        end.engine.publish(4, b"go", end.now)
        order = at(end)
        end.report(order)
        if order.acknowledge or end.poll(end.now) is not None:
            break
        pass_time(end, 4.0 + 0.4 * (-1) ** number)
    assert 8 <= orders <= 10, "a period behind, and not for ever"
