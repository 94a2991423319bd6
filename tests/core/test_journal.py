"""The journal port: what the engine says of it, and what it makes of a store that fails."""

import random

from zacoustic.core.base.journal import EPOCH_KEY
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import JournalStateChanged
from zacoustic.core.streams.specs import ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import StreamTable


def test_application_is_told_once_that_the_journal_fails_and_once_that_it_works() -> None:
    records: list[TraceRecord] = []
    engine = Engine(
        address=1, table=StreamTable(), epoch=7, rng=random.Random(1), trace=records.append
    )
    for failure, now in (("", 1), ("full", 2), ("full", 3), ("read-only", 4), ("", 5), ("", 6)):
        engine.handle_journal_state(failure, now)
        assert engine.journal_failure == failure
    events = []
    while (event := engine.poll_event()) is not None:
        events.append(event)
    assert events == [
        JournalStateChanged(failure="full", changed_at=2),
        JournalStateChanged(failure="read-only", changed_at=4),
        JournalStateChanged(failure="", changed_at=5),
    ]
    assert [record.detail for record in records if record.what == "journal"] == [
        "fails", "fails", "works",
    ]  # fmt: skip


def test_engine_begins_with_what_is_stored_and_writes_its_epoch() -> None:
    stored = {EPOCH_KEY: b"\x00\x06"}
    engine = Engine(address=1, table=StreamTable(), epoch=7, rng=random.Random(1), stored=stored)
    write = engine.poll_journal()
    assert write is not None
    assert (write.key, write.value) == (EPOCH_KEY, b"\x00\x07")


def test_what_a_node_keeps_is_not_in_the_digest() -> None:
    topic = TopicSpec(stream_id=1, name="a")
    service = ServiceSpec(stream_id=2, name="b", server=1)
    assert not topic.journal
    assert service.journal
    overridden: list[StreamSpec] = [
        TopicSpec(stream_id=1, name="a", journal=True),
        ServiceSpec(stream_id=2, name="b", server=1, journal=False),
    ]
    assert StreamTable([topic, service]).digest == StreamTable(overridden).digest
