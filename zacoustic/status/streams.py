"""Streams, as a gateway counts them."""

import msgspec
from msgspec import UNSET, UnsetType


class Override(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``streams``: how a topic of this node is sent, with commands that change it."""

    on: bool
    """Whether its samples are sent."""
    min_interval_s: float
    """Minimum time between two samples of a key, s."""
    priority: str
    """Zenoh's priority."""


class StreamRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``streams``: one stream. The outcomes are unset if it is not reliable."""

    id: int
    """Stream id."""
    name: str = ""
    """Name."""
    kind: str = ""
    """``topic``, ``service`` or ``action``."""
    jobs: list[str] = []
    """The gateway's roles in it."""
    published: int = 0
    """Local inputs that the gateway accepted."""
    sent: int = msgspec.field(name="transmitted", default=0)
    """Records transmitted."""
    heard: int = msgspec.field(name="received", default=0)
    """Received records."""
    waiting: int = 0
    """Samples, calls and goals that wait for transmission."""
    sent_at_unix_s: float | None = None
    """The last transmission, acknowledgements included."""
    sent_period_s: float | None = None
    """Mean time between two, s; None: less than two so far."""
    heard_at_unix_s: float | None = None
    """The last reception."""
    heard_period_s: float | None = None
    """Mean time between two, s; None: less than two so far."""
    age_s: float | None = None
    """Age of the newest received sample as it arrived, s; None: none, or without an age."""
    deadline_missed: int | UnsetType = UNSET
    """Missed deadlines; unset: it has none."""
    delivering: int | UnsetType = UNSET
    """Reliable samples without an outcome yet."""
    delivered: int | UnsetType = UNSET
    """Reliable samples that every subscriber has."""
    superseded: int | UnsetType = UNSET
    """Reliable samples that a newer one of their key has replaced."""
    expired: int | UnsetType = UNSET
    """Reliable samples whose lifespan has ended."""
    refused: int | UnsetType = UNSET
    """Reliable samples that a subscriber has refused."""
    cancelled: int | UnsetType = UNSET
    """Reliable samples that were cancelled."""
    unknown: int | UnsetType = UNSET
    """Reliable samples from before a restart, with the journal in doubt."""
    override: Override | UnsetType = UNSET
    """How this node sends it; unset: it does not."""
    subscribers: list[int] | UnsetType = UNSET
    """Remote nodes that have subscribed; unset: it is not on demand."""
    subscribed_to: list[int] | UnsetType = UNSET
    """Nodes to which this node has subscribed; unset: it is not on demand."""


class DifferRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``streams``: a stream that peers define otherwise; it is stopped between them."""

    id: int
    """Stream id."""
    name: str = ""
    """Its name here; empty: only the others have it."""
    peers: list[int] = []
    """Their addresses."""


class StreamsDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``streams``: all streams of the table."""

    digest: str = ""
    """Digest of the table, hexadecimal."""
    streams: list[StreamRow] = []
    """All of them, by id."""
    differ: list[DifferRow] = []
    """Streams that peers define otherwise."""
