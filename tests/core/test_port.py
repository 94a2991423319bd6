"""Port: which frames are looked into."""

import pytest

from tests.core.rig import End, link
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import WIRE_VERSION, Hello

TABLE = StreamTable([TopicSpec(stream_id=1, name="a")], nodes={1: "shore", 2: "auv"})
FRAME = Hello(WIRE_VERSION, 1, TABLE.digest).encode() + b"\x01x"


@pytest.mark.parametrize(
    ("source", "destination", "reason"),
    [(1, 255, "own"), (2, 3, "not_for_us"), (0, 255, "address"), (255, 1, "address")],
)
def test_frame_that_does_not_concern_this_node_is_counted(
    source: int, destination: int, reason: str
) -> None:
    end = End(1, TABLE)
    end.hear(FRAME, 0, source=source, destination=destination)
    assert end.engine.stats.dropped == {reason: 1}
    assert end.engine.stats.received == {}


def test_same_bytes_sooner_than_they_can_have_been_sent_again_are_an_echo() -> None:
    capabilities = link(bit_rate_bps=800)
    airtime_ns = capabilities.airtime_ns(len(FRAME))
    end = End(1, TABLE, capabilities=capabilities)
    end.hear(FRAME, 0, source=2)
    end.hear(FRAME, airtime_ns - 1, source=2)
    assert end.engine.stats.dropped == {"echo": 1}
    end.hear(FRAME, 2 * airtime_ns, source=2)
    end.hear(FRAME, 2 * airtime_ns, source=3)
    assert end.engine.stats.received == {1: 3}


def test_equal_frames_in_one_piece_of_a_byte_stream_are_no_echo() -> None:
    end = End(1, TABLE, capabilities=link(framed=False, addressed=False, bit_rate_bps=800))
    sender = End(2, TABLE, capabilities=link(framed=False, addressed=False))
    sender.engine.publish(1, b"x", 0)
    sent = sender.send(0)
    assert sent is not None
    end.hear(sent.frame_bytes * 3, 0, source=0)
    assert end.engine.stats.received == {1: 3}
