"""What can cross at all: the largest record of a frame, and samples that cross in parts."""

from zacoustic.core.base.qos import Reliability
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.wire.agreement import TAG_BYTES


def room_bytes(mtu_bytes: int) -> int:
    """Return the largest record that an engine accepts, bytes: a TAG may share its frame."""
    return mtu_bytes - TAG_BYTES


def crosses_in_parts(stream: Stream) -> bool:
    """Tell whether a sample larger than a frame crosses as an object."""
    return isinstance(stream.spec, TopicSpec) and stream.qos.reliability is Reliability.RELIABLE
