"""What crosses the channel now: frames, and samples larger than a frame."""

import msgspec
from msgspec import UNSET, UnsetType


class FrameRow(msgspec.Struct, kw_only=True):
    """Of ``channel``: one frame."""

    way: str = ""
    """``out`` or ``in``."""
    peer: int | None = None
    """The other node; None: everybody, or unknown."""
    size_bytes: int = msgspec.field(name="bytes", default=0)
    """Its size."""
    streams: list[str] = []
    """Streams with a record in it, each once; empty: only controls, or the link's own frame."""
    begun_unix_s: float = 0.0
    """When the modem got it, or, if received, when it began to arrive."""
    airtime_s: float = 0.0
    """By the bit rate of its link, s; of a received frame of a list of links, of the one in use."""
    outcome: str = ""
    """Outcome of a sent frame, a word of `TransmitOutcome`; empty: none yet, or it came."""


class ChannelDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``channel``: the frame being sent, and the last frames sent and received."""

    transmitting: FrameRow | None = None
    """The one being sent."""
    last: list[FrameRow] = []
    """The last ones, the oldest first."""


class TransferRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``objects``: one sample that is larger than a frame."""

    id: int | UnsetType = UNSET
    """Number of an outgoing one."""
    to: int | UnsetType | None = UNSET
    """Receiver of an outgoing one; None: several."""
    sent_bytes: int | UnsetType | None = UNSET
    """Bytes of an outgoing one that were transmitted at least once, without repair."""
    source: int | UnsetType = UNSET
    """Sender of an incoming one."""
    transfer: int | UnsetType = UNSET
    """The sender's number of an incoming one."""
    stream: str | None = None
    """Name of its stream; None: its beginning has not arrived."""
    done_bytes: int = 0
    """Bytes that the receivers have, as far as known."""
    total_bytes: int | None = None
    """Its size; None: unknown yet."""
    outcome: str | UnsetType | None = UNSET
    """Its outcome; unset: it is under way."""
    missing: list[int] | UnsetType = UNSET
    """Receivers that do not have it, once it has ended."""
    detail: str | UnsetType = UNSET
    """Reason of the outcome, one line."""


class ObjectsDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``objects``: samples larger than a frame."""

    sending: list[TransferRow] = []
    """Outgoing ones."""
    receiving: list[TransferRow] = []
    """Incoming ones."""
    ended: list[TransferRow] = []
    """The last ones that ended, the oldest first."""
