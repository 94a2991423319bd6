"""Trace: the same inputs give the same records, at the injected instants."""

import random

from tests.core.rig import link
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.linktypes import LinkState, ReceivedFrame, TransmitOutcome, TransmitReport
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import WIRE_VERSION, Hello


def told() -> list[TraceRecord]:
    records: list[TraceRecord] = []
    table = StreamTable([TopicSpec(stream_id=1, name="a")], nodes={1: "shore", 2: "auv"})
    engine = Engine(address=1, table=table, epoch=1, rng=random.Random(1), trace=records.append)
    engine.handle_journal_committed(1, 0)
    engine.handle_link_state(LinkState.UP, 1000, link())
    engine.publish(1, b"x", 2000)
    sent = engine.poll_transmit(3000)
    assert sent is not None
    engine.handle_transmit_report(
        TransmitReport(
            transmission_id=sent.transmission_id,
            outcome=TransmitOutcome.SENT,
            started_at=3000,
            finished_at=4000,
        ),
        4000,
    )
    hello = Hello(WIRE_VERSION, 7, b"abcd").encode()
    for frame, source in ((hello, 2), (b"", 1)):
        received = ReceivedFrame(frame_bytes=frame, received_at=5000, source=source)
        engine.handle_frame(received, 5000)
    return records


def test_everything_that_an_engine_does_is_in_its_trace() -> None:
    records = told()
    assert [(record.at, record.what, record.peer, record.detail) for record in records] == [
        (1000, "link", 0, "up"),
        (3000, "transmit", 255, ""),
        (4000, "report", 0, "sent"),
        (5000, "receive", 2, ""),
        (5000, "peer", 2, "other_table"),
        (5000, "drop", 1, "own"),
    ]
    transmit = records[1]
    assert transmit.streams == (1,)
    assert bytes.fromhex(transmit.frame)[-2:] == b"\x01x"
    assert transmit.size_bytes == 10


def test_same_inputs_give_the_same_trace() -> None:
    assert told() == told()


def test_record_is_rendered_as_one_line() -> None:
    lines = [record.render() for record in told()]
    assert lines[1] == "       0.000  node   1  transmit peer 255 10 B streams 1"
    assert lines[5] == "       0.000  node   1  drop peer 1 own"
