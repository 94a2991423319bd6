"""The documents of a gateway, as far as they are displayed; missing members have defaults."""

from typing import Any

import msgspec


class NodeDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``node``: constant facts."""

    name: str = ""
    version: str = ""
    wire: str = ""
    link: str = ""
    shared: bool = False
    started_at_unix_s: float | None = None


class Capabilities(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``link``: capabilities of the modem."""

    mtu_bytes: int | None = None
    bit_rate_bps: float | None = None


class WaitsDocument(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``link``: why its next frame waits."""

    why: str = ""
    until_unix_s: float | None = None


class LinkDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``link`` or ``link/NAME``: state and counters."""

    name: str = ""
    state: str = "unknown"
    detail: str = ""
    silent: bool = False
    why_silent: str = ""
    waits: WaitsDocument | None = None
    capabilities: Capabilities | None = None
    frames_transmitted: int = 0
    frames_received: int = 0
    bytes_transmitted: int = 0
    bytes_received: int = 0
    airtime_s: float = 0.0
    paid_bytes: int | None = None
    paid: float | None = None
    reports: dict[str, int] = {}


class RouteDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``route/NAME``: a route that ends at this node."""

    path: list[int] = []
    link: str = ""
    link_state: str = "unknown"
    frames_transmitted: int = 0
    frames_received: int = 0
    bytes_transmitted: int = 0


class HopRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``relay``: a hop from this node."""

    route: str = ""
    next_node: int
    waiting: int = 0
    transmissions: int = 0
    passed_on: int = 0
    given_up: int = 0


class RelayDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``relay``."""

    hops: list[HopRow] = []


class CarriedRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``carry``: what is kept of one topic; by address how many samples."""

    stream: str = ""
    own: dict[int, int] = {}
    custodians: dict[int, int] = {}
    carried: dict[int, int] = {}
    carried_bytes: int = 0
    oldest_at_unix_s: float | None = None
    ends_at_unix_s: float | None = None


class CarryDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``carry``: what is kept of carried topics."""

    own: int = 0
    in_custody: int = 0
    carried: int = 0
    carried_bytes: int = 0
    max_bytes: int = 0
    refused: int = 0
    expired: int = 0
    streams: list[CarriedRow] = []


class BondDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``bond/NAME``: a list of links that is used as one."""

    links: list[str] = []
    in_use: str | None = None
    reach: dict[int, dict[str, str]] = {}
    again: int = 0
    frames_transmitted: int = 0
    frames_received: int = 0


class LedgerRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``ledger``: bytes of one stream for one cause."""

    id: int = 0
    stream: str = ""
    cause: str = ""
    bytes: int = 0
    airtime_s: float = 0.0


class LedgerDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``ledger``: every byte on the link."""

    entries: list[LedgerRow] = []


class StreamRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``streams``: one stream."""

    id: int
    name: str = ""
    kind: str = ""
    jobs: list[str] = []
    published: int = 0
    transmitted: int = 0
    received: int = 0
    waiting: int = 0
    delivering: int | None = None
    delivered: int = 0
    superseded: int = 0
    expired: int = 0
    refused: int = 0
    cancelled: int = 0
    unknown: int = 0
    deadline_missed: int | None = None
    sent_at_unix_s: float | None = None
    sent_period_s: float | None = None
    heard_at_unix_s: float | None = None
    heard_period_s: float | None = None
    age_s: float | None = None


class DifferRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``streams``: a stream that a peer defines otherwise."""

    id: int
    peers: list[int] = []


class StreamsDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``streams``: all streams of the table."""

    digest: str = ""
    streams: list[StreamRow] = []
    differ: list[DifferRow] = []


class Metrics(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``peers``: measurements of the modem."""

    snr_db: float | None = None
    received_level_db: float | None = None
    integrity: float | None = None
    range_rate_m_s: float | None = None


class ReceivedRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``peers``: what came from one node by one link."""

    frames: int = 0
    bytes: int = 0
    airtime_s: float | None = None


class PeerRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``peers``: one node."""

    name: str = ""
    same_table: bool | None = None
    shared: bool = False
    confirmed_us: bool = False
    heard_at_unix_s: float | None = None
    delivered: int = 0
    not_delivered: int = 0
    per: float | None = None
    received: dict[str, ReceivedRow] | None = None
    metrics: Metrics | None = None


class RangeDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``peer/N/range``."""

    range_m: float | None = None
    propagation_s: float | None = None
    measured_at_unix_s: float | None = None


class LostDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``peer/N/lost``."""

    lost: bool = False


class LateDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``peer/N/late``."""

    late: list[str] = []


class TransferRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``objects``: one sample that is larger than a frame."""

    stream: str | None = None
    to: int | None = None
    source: int | None = None
    done_bytes: int = 0
    sent_bytes: int | None = None
    total_bytes: int | None = None
    outcome: str | None = None


class ObjectsDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``objects``."""

    sending: list[TransferRow] = []
    receiving: list[TransferRow] = []
    ended: list[TransferRow] = []


class FrameRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``channel``: one frame."""

    way: str = ""
    peer: int | None = None
    bytes: int = 0
    streams: list[str] = []
    begun_unix_s: float = 0.0
    airtime_s: float = 0.0
    outcome: str = ""


class ChannelDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``channel``: the frame being sent, and the last frames sent and received."""

    transmitting: FrameRow | None = None
    last: list[FrameRow] = []


class JournalDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``journal``."""

    kept: bool = False
    failure: str = ""
    doubt: str = ""


class DroppedDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``dropped``."""

    channel: dict[str, int] = {}
    local: dict[str, dict[str, int]] = {}
    expired: dict[str, int] = {}
    superseded: dict[str, int] = {}
    unsubscribed: dict[str, int] = {}


class EventRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``events``: one event."""

    at_unix_s: float = 0.0
    event: str = ""
    trouble: bool = False
    text: str = ""


class EventsDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``events``."""

    events: list[EventRow] = []


class ModemDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``modem``."""

    firmware: str = ""
    battery_v: float | None = None


class ClockDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``clock``: only answered to a `get`."""

    now_unix_s: float


DOCUMENTS: dict[str, Any] = {
    "node": NodeDocument,
    "link": LinkDocument,
    "relay": RelayDocument,
    "carry": CarryDocument,
    "ledger": LedgerDocument,
    "peers": dict[int, PeerRow],
    "streams": StreamsDocument,
    "objects": ObjectsDocument,
    "channel": ChannelDocument,
    "journal": JournalDocument,
    "dropped": DroppedDocument,
    "events": EventsDocument,
    "modem": ModemDocument,
    "clock": ClockDocument,
}
"""Type of each document, by the end of its key."""
NAMED_DOCUMENTS: dict[str, Any] = {
    "link": LinkDocument,
    "route": RouteDocument,
    "bond": BondDocument,
}
"""Type of each document of which there is one for each name, by the chunk before the name."""
PEER_DOCUMENTS: dict[str, Any] = {
    "range": RangeDocument,
    "lost": LostDocument,
    "late": LateDocument,
}
"""Type of each document about a node, by the end of its key."""
