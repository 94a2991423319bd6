"""A frame's airtime has a bound, whatever its size: an emergency waits for the frame under way."""

import random

import pytest

from tests.core.rig import Rig
from zacoustic.core.base.linktypes import LEAST_FRAME_BYTES, LinkCapabilities, ReceivedFrame
from zacoustic.core.base.qos import Qos, Reliability
from zacoustic.core.clock import NS_PER_S
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.envelope import Envelope, Opened

SLOW = LinkCapabilities(mtu_bytes=1200, bit_rate_bps=700.0, preamble_s=0.15)


def longest_frame_s(rules: TransmitRules, capabilities: LinkCapabilities = SLOW) -> float:
    """Publish a large sample and return the airtime of the longest frame, s."""
    qos = Qos(reliability=Reliability.RELIABLE)
    table = StreamTable(
        [TopicSpec(stream_id=1, name="photo", qos=qos, publishers=(1,), subscribers=(2,))],
        nodes={1: "a", 2: "b"},
    )
    rig = Rig({1: table, 2: table}, capabilities=capabilities, rules={1: rules, 2: rules})
    rig.publish(1, 1, random.Random(1).randbytes(5000))
    rig.run(300.0)
    assert any(isinstance(each, SampleReceived) for each in rig.ends[2].events)
    longest = max(len(each.frame_bytes) for _, each in rig.frames)
    return capabilities.airtime_ns(longest) / NS_PER_S


def test_frame_lasts_at_most_four_seconds_by_default() -> None:
    assert 3.5 < longest_frame_s(TransmitRules()) <= 4.0


@pytest.mark.parametrize("max_frame_s", [1.5, 8.0, None])
def test_bound_can_be_set(max_frame_s: float | None) -> None:
    found_s = longest_frame_s(TransmitRules(max_frame_s=max_frame_s))
    bound_s = max_frame_s or SLOW.airtime_ns(SLOW.mtu_bytes) / NS_PER_S
    assert 0.8 * bound_s < found_s <= bound_s


@pytest.mark.parametrize("bit_rate_bps", [20.0, 80.0, 700.0, 10_000.0])
@pytest.mark.parametrize("preamble_s", [0.0, 1.2, 9.0])
def test_bound_leaves_room_for_a_short_frame(bit_rate_bps: float, preamble_s: float) -> None:
    link = LinkCapabilities(mtu_bytes=1200, bit_rate_bps=bit_rate_bps, preamble_s=preamble_s)
    bounded = link.bounded(4.0)
    assert bounded.bounded(4.0) == bounded
    assert bounded.mtu_bytes == LEAST_FRAME_BYTES or (
        bounded.airtime_ns(bounded.mtu_bytes) <= 4 * NS_PER_S
    )
    fits_one_more = bounded.airtime_ns(bounded.mtu_bytes + 1) <= 4 * NS_PER_S
    assert bounded.mtu_bytes == link.mtu_bytes or not fits_one_more


def test_longer_frames_of_others_arrive_over_a_byte_stream() -> None:
    stream = LinkCapabilities(mtu_bytes=1200, bit_rate_bps=700.0, framed=False, addressed=False)
    bounded = stream.bounded(4.0)
    assert bounded.mtu_bytes < 400
    frame = Envelope(stream, 1).wrap(bytes(1000), 2)
    received = ReceivedFrame(frame_bytes=frame, received_at=0)
    (opened,) = Envelope(bounded, 2).open(received)
    assert isinstance(opened, Opened)
    assert opened.records == bytes(1000)
