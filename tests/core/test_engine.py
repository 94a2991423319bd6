"""Engine: its contract with whoever drives it, and the errors of its commands."""

import random
from collections.abc import Callable

import pytest

from tests.core.rig import End, link
from zacoustic.core.base.journal import EPOCH_KEY
from zacoustic.core.base.qos import Qos
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallKey, LinkStateChanged
from zacoustic.core.linktypes import LinkState, ReceivedFrame, TransmitOutcome, TransmitReport
from zacoustic.core.streams.specs import ServiceSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import (
    ConfigError,
    LocalError,
    PayloadInvalidError,
    PayloadTooLargeError,
    QueueFullError,
    UnknownStreamError,
)


def fleet() -> StreamTable:
    return StreamTable(
        [
            TopicSpec(stream_id=1, name="a", qos=Qos(depth=9)),
            TopicSpec(stream_id=2, name="typed", type_name="N"),
            TopicSpec(stream_id=3, name="theirs", publishers=(2,)),
            ServiceSpec(stream_id=20, name="arm", server=2, timeout_s=10),
            ServiceSpec(stream_id=21, name="own", server=1),
        ],
        types=TypeTable([TypeSpec(name="N", fields=(FieldSpec(name="n", type="uint8"),))]),
        nodes={1: "shore", 2: "auv"},
    )


def bare(epoch: int = 1) -> Engine:
    return Engine(address=1, table=fleet(), epoch=epoch, rng=random.Random(1))


def test_one_transmission_is_outstanding_at_most() -> None:
    end = End(1, fleet())
    end.engine.publish(1, b"x", 0)
    first = end.poll(0)
    assert first is not None
    end.engine.publish(1, b"y", 0)
    assert end.poll(10**12) is None
    assert end.engine.poll_timeout() is None
    assert not end.engine.is_idle
    end.report(first)
    second = end.poll(10**12)
    assert second is not None
    assert second.transmission_id != first.transmission_id


@pytest.mark.parametrize("outcome", list(TransmitOutcome))
def test_any_report_frees_the_link_and_is_counted(outcome: TransmitOutcome) -> None:
    end = End(1, fleet())
    end.engine.publish(1, b"x", 0)
    sent = end.poll(0)
    assert sent is not None
    end.report(sent, outcome)
    assert end.engine.stats.reports == {outcome.value: 1}
    assert end.engine.is_idle


def test_gap_of_the_device_is_respected() -> None:
    end = End(1, fleet(), capabilities=link(gap_s=0.5))
    end.engine.publish(1, b"x", 0)
    sent = end.poll(1000)
    assert sent is not None
    end.engine.publish(1, b"y", 1000)
    end.engine.handle_transmit_report(
        TransmitReport(
            transmission_id=sent.transmission_id,
            outcome=TransmitOutcome.SENT,
            started_at=1000,
            finished_at=2000,
        ),
        3000,
    )
    assert end.engine.poll_timeout() == 2000 + 500_000_000
    assert end.poll(2000 + 500_000_000 - 1) is None
    assert end.poll(2000 + 500_000_000) is not None


def test_nothing_is_sent_before_the_epoch_is_committed() -> None:
    end = End(1, fleet(), epoch=258, commits=False)
    end.engine.publish(1, b"x", 0)
    assert end.poll(0) is None
    assert end.engine.poll_timeout() is None
    write = end.engine.poll_journal()
    assert write is not None
    assert (write.key, write.value) == (EPOCH_KEY, b"\x01\x02")
    assert end.poll(1) is None
    end.engine.handle_journal_committed(write.write_id + 7, 1)
    assert end.poll(1) is None
    end.engine.handle_journal_committed(write.write_id, 2)
    assert end.engine.poll_timeout() is not None
    assert end.poll(2) is not None


def test_epoch_of_a_changed_table_is_committed_before_it_is_used() -> None:
    end = End(1, fleet())
    end.commits = False
    end.engine.declare(TopicSpec(stream_id=9, name="new"), 0)
    end.engine.publish(9, b"x", 0)
    assert end.engine.epoch == 2
    assert end.poll(0) is None
    end.commits = True
    sent = end.poll(0)
    assert sent is not None
    assert sent.frame_bytes[:4] == b"\xb0\x02\x00\x02"


def test_epoch_after_the_last_is_the_first() -> None:
    engine = bare(epoch=0xFFFF)
    engine.declare(TopicSpec(stream_id=9, name="new"), 0)
    assert engine.epoch == 0


def test_engine_without_anything_to_do_has_no_timer() -> None:
    end = End(1, fleet())
    assert end.engine.poll_timeout() is None
    assert end.engine.is_idle
    assert end.poll(10**15) is None
    assert bare().poll_timeout() is None


def test_nothing_is_sent_before_the_link_is_up_or_while_it_is_down() -> None:
    engine = bare()
    write = engine.poll_journal()
    assert write is not None
    engine.handle_journal_committed(write.write_id, 0)
    engine.publish(1, b"x", 0)
    assert engine.poll_transmit(0) is None
    assert engine.poll_timeout() is None
    assert engine.capabilities is None
    engine.handle_link_state(LinkState.UP, 5, link())
    assert engine.poll_timeout() == 5
    engine.handle_link_state(LinkState.DOWN, 6)
    assert engine.poll_transmit(7) is None
    assert engine.poll_timeout() is None
    engine.handle_link_state(LinkState.UP, 8)
    assert engine.poll_transmit(8) is not None
    states = []
    while (event := engine.poll_event()) is not None:
        assert isinstance(event, LinkStateChanged)
        states.append((event.state, event.changed_at))
    assert states == [(LinkState.UP, 5), (LinkState.DOWN, 6), (LinkState.UP, 8)]


def test_what_no_longer_fits_a_changed_link_is_dropped_and_counted() -> None:
    end = End(1, fleet(), capabilities=link(mtu_bytes=512))
    end.engine.publish(1, bytes(100), 0)
    end.engine.handle_link_state(LinkState.UP, 1, link(mtu_bytes=64))
    assert end.engine.stats.dropped == {"oversized": 1}
    assert end.engine.pending(1) == 0


def test_frame_before_the_link_is_up_and_stray_report_are_counted() -> None:
    engine = bare()
    report = TransmitReport(
        transmission_id=1, outcome=TransmitOutcome.SENT, started_at=0, finished_at=0
    )
    engine.handle_frame(ReceivedFrame(frame_bytes=b"x", received_at=0, source=2), 0)
    engine.handle_transmit_report(report, 0)
    engine.handle_carrier(True, 0)
    assert engine.stats.dropped == {"link_down": 1, "stray_report": 1}


@pytest.mark.parametrize(
    ("command", "error", "message"),
    [
        (lambda e: e.publish(9, b"", 0), UnknownStreamError, "no stream has id 9"),
        (lambda e: e.publish(20, b"", 0), UnknownStreamError, "is not a topic"),
        (lambda e: e.publish(3, b"", 0), LocalError, "node 1 is not a publisher of theirs"),
        (lambda e: e.publish(1, b"", 0, instance=(1,)), UnknownStreamError, "no key for node 1"),
        (lambda e: e.publish(1, "text", 0), PayloadInvalidError, "allowed: bytes"),
        (lambda e: e.publish(2, {"n": 256}, 0), PayloadInvalidError, "N.n is 256"),
        (lambda e: e.publish(1, bytes(61), 0), PayloadTooLargeError, "62 bytes; .* room for 61"),
        (lambda e: e.publish(1, b"", 0, encoding="x" * 256), PayloadInvalidError, "encoding has"),
        (lambda e: e.call(9, b"", 0), UnknownStreamError, "no stream has id 9"),
        (lambda e: e.call(1, b"", 0), UnknownStreamError, "is not a service"),
        (lambda e: e.call(21, b"", 0), LocalError, "own is served by this node, 1"),
        (lambda e: e.call(20, 5, 0), PayloadInvalidError, "allowed: bytes"),
        (lambda e: e.call(20, bytes(60), 0), PayloadTooLargeError, "62 bytes"),
        (lambda e: [e.call(20, b"", 0) for _ in range(65)], QueueFullError, "16 calls to node 2"),
        (lambda e: e.declare(TopicSpec(stream_id=1, name="b"), 0), ConfigError, "id: 1 is taken"),
        (lambda e: e.reply(CallKey(2, 1, 9, 0), b"", 0), UnknownStreamError, "no stream has id"),
        (lambda e: e.reply(CallKey(2, 1, 21, 0), 5, 0), PayloadInvalidError, "allowed: bytes"),
        (lambda e: e.reply(CallKey(2, 1, 21, 0), bytes(99), 0), PayloadTooLargeError, "102 bytes"),
    ],
)
def test_misused_command_raises_and_queues_nothing(
    command: Callable[[Engine], object], error: type[Exception], message: str
) -> None:
    end = End(1, fleet())
    with pytest.raises(error, match=message):
        command(end.engine)
    assert end.engine.pending(1) == end.engine.pending(2) == end.engine.pending(21) == 0


def test_answers_to_calls_that_nobody_made_are_refused() -> None:
    end = End(1, fleet())
    assert not end.engine.reply(CallKey(2, 1, 21, 0), b"", 0)
    end.engine.cancel(99, 0)
    assert end.engine.is_idle


def test_timer_that_fires_for_nothing_does_nothing() -> None:
    end = End(1, fleet())
    for now in range(0, 10**9, 10**8):
        end.engine.handle_timeout(now)
    assert end.engine.is_idle
    assert end.poll(10**9) is None


def test_getters_show_what_waits_and_what_was_lost() -> None:
    end = End(1, fleet())
    for number in range(12):
        end.engine.publish(1, bytes((number,)), 0)
    assert end.engine.pending(1) == 9
    assert end.engine.superseded == {1: 3}
    assert end.engine.expired == {}
    assert end.engine.link_state is LinkState.UP
    assert end.engine.peers() == {}
