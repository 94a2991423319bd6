"""A node has restarted with another table, and its HELLO was missed."""

from collections.abc import Callable

from tests.core.rig import End
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import WIRE_VERSION, Hello, Tag

EPOCHS = 1 << 16
FORMER = 4711


def test_tag_of_another_table_is_believed_in_one_epoch_of_65536(
    count: Callable[[int], int],
) -> None:
    """That of the former life, which no start has with a journal."""
    table = StreamTable([TopicSpec(stream_id=1, name="depth")], nodes={1: "shore", 2: "auv"})
    end = End(1, table)
    read, now = [], 0
    for place in range(count(EPOCHS)):
        epoch = (FORMER + place * 101) % EPOCHS  # the former one first, then all others
        now += 3600 * NS_PER_S
        end.hear(Hello(WIRE_VERSION, FORMER, table.digest).encode(), now, source=2)
        now += 3600 * NS_PER_S
        end.hear(Tag(epoch).encode() + b"\1sample", now, source=2)
        if end.got(SampleReceived):
            read.append(epoch)
        end.events.clear()
    assert read == [FORMER]
