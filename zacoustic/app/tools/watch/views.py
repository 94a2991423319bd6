"""What people read of a gateway: records with ages, rates and shares of one moment.

Ages are seconds before that moment, None: never. The same records are drawn on a terminal and on a
page, and are the lines of `zacoustic monitor --json`.
"""

import msgspec


class StreamView(msgspec.Struct, frozen=True, kw_only=True):
    """One stream."""

    id: int
    """Stream id."""
    name: str
    """Name."""
    kind: str
    """``topic``, ``service`` or ``action``."""
    jobs: tuple[str, ...]
    """What the gateway does for it."""
    published: int
    """Local inputs that the gateway accepted."""
    sent: int
    """Records transmitted."""
    heard: int
    """Received records."""
    sent_ago_s: float | None
    """When the last one was transmitted, s ago."""
    heard_ago_s: float | None
    """When the last one came, s ago."""
    sent_rate_hz: float | None
    """How often now, 1/s; None: once at most."""
    heard_rate_hz: float | None
    """How often now, 1/s; None: once at most."""
    age_s: float | None
    """Age of the newest received sample, s; None: none, or without an age."""
    waiting: int
    """Samples, calls and goals that wait for transmission."""
    delivering: int | None
    """Reliable samples that have not arrived; None: it is not reliable."""
    outcomes: dict[str, int]
    """Reliable samples by how they ended; empty: it is not reliable."""
    useless: int
    """Samples that expired, were superseded, or had no subscribers."""
    expired: int
    """Those of them that became too old before they could go, or that did not arrive in time."""
    refused: int
    """What the gateway has not taken: too large, not of the type, no room."""
    deadline_missed: int | None
    """How often no sample came in time; None: it has no deadline."""
    airtime_bytes: int
    """Bytes on the link since the gateway runs."""
    airtime_share: float
    """Of all its airtime, 0…1."""
    differs_at: tuple[int, ...]
    """Nodes that define it in another way: it is stopped between them."""


class PeerView(msgspec.Struct, frozen=True, kw_only=True):
    """Another node, as this one hears it."""

    address: int
    """Acoustic address."""
    name: str
    """Name in the table."""
    heard_ago_s: float | None
    """When it was heard last, s ago."""
    is_lost: bool
    """Not heard for the file's `lost_after_s`."""
    same_table: bool | None
    """It has our stream table; None: unknown."""
    snr_db: float | None
    """Signal-to-noise ratio of the last reception, dB."""
    received_level_db: float | None
    """Received level, dB, by the modem's own reference."""
    integrity: float | None
    """Signal quality in the modem's own scale."""
    range_m: float | None
    """Slant distance, m."""
    propagation_s: float | None
    """Propagation delay, one way, s."""
    range_ago_s: float | None
    """When that was measured, s ago."""
    per: float | None
    """Of the last frames that its modem was to confirm, how many it has not, 0…1."""
    exchanges: int
    """Frames that its modem was to confirm."""
    late: tuple[str, ...]
    """Keys whose next sample is overdue."""


class CauseView(msgspec.Struct, frozen=True, kw_only=True):
    """What airtime was used for."""

    cause: str
    """Word of the ledger."""
    airtime_bytes: int
    """Bytes since the gateway runs."""
    airtime_s: float
    """Airtime, s."""
    share: float
    """Of all its airtime, 0…1."""


class TransferView(msgspec.Struct, frozen=True, kw_only=True):
    """A sample larger than a frame."""

    stream: str
    """Name; empty: its beginning has not come."""
    direction: str
    """``to`` or ``from``."""
    peer: int | None
    """The other node; None: several."""
    done_bytes: int
    """What the receivers have, as far as known."""
    sent_bytes: int | None
    """What was transmitted of it, repair included; None: it comes to here."""
    total_bytes: int | None
    """Its size; None: not known yet."""
    outcome: str | None
    """How it ended; None: it is under way."""


class FrameView(msgspec.Struct, frozen=True, kw_only=True):
    """A frame."""

    ago_s: float
    """When it began, s ago."""
    way: str
    """``out`` or ``in``."""
    peer: int | None
    """The other node; None: everybody, or unknown."""
    size_bytes: int
    """Its size."""
    airtime_s: float
    """How long it sounds."""
    streams: tuple[str, ...]
    """Names of those with a record in it; none: the link's own business."""
    outcome: str
    """Of a sent one: the modem's report; empty: none yet, or it was heard."""


class EventView(msgspec.Struct, frozen=True, kw_only=True):
    """Something that was worth a line."""

    ago_s: float
    """When, s ago."""
    event: str
    """Which kind."""
    is_trouble: bool
    """Somebody should look at it."""
    text: str
    """One line for people."""


class GatewayView(msgspec.Struct, frozen=True, kw_only=True):
    """One gateway, at one moment."""

    unix_s: float
    """The moment."""
    address: int
    """Acoustic address."""
    name: str
    """Name in the table."""
    is_alive: bool
    """It runs, its network is reached, and it answers."""
    gone_s: float | None
    """For how long it is not, s; None: it is."""
    version: str
    """Of its program."""
    uptime_s: float | None
    """Since when it runs, s."""
    wire: str
    """Wire profile."""
    link: str
    """Locator of the modem."""
    link_state: str
    """``up``, ``down`` or ``opening``."""
    link_detail: str
    """What it waits for."""
    is_silent: bool
    """Silence is kept."""
    why_silent: str = ""
    """Why, one line."""
    mtu_bytes: int | None
    """Largest frame, bytes."""
    bit_rate_bps: float | None
    """Acoustic bit rate, bit/s."""
    battery_v: float | None
    """Supply of the modem, V."""
    firmware: str
    """Of the modem."""
    journal: str
    """``kept``, ``none``, or why it cannot be written."""
    journal_doubt: str
    """Why it may lack the last writes; empty: it does not."""
    digest: str
    """Of the stream table."""
    frames_sent: int
    """Frames given to the modem."""
    frames_heard: int
    """Frames that came, damaged ones included."""
    frames_damaged: int
    """Those of them that were damaged."""
    bytes_sent: int
    """Bytes of those sent."""
    airtime_s: float
    """Airtime of those, s."""
    utilisation: float | None
    """Share of the time that it was on the air, over `window_s`, 0…1; None: not known yet."""
    window_s: float
    """Over how long that was observed, s."""
    waiting: int
    """What waits, of all streams."""
    streams: tuple[StreamView, ...]
    """By id."""
    peers: tuple[PeerView, ...]
    """By address."""
    causes: tuple[CauseView, ...]
    """The greatest first."""
    transfers: tuple[TransferView, ...]
    """Those under way, and how the last ones ended."""
    transmitting: FrameView | None
    """What the modem is sending now."""
    frames: tuple[FrameView, ...]
    """The last ones that were sent or heard, the newest first."""
    dropped: dict[str, int]
    """Dropped receptions, by reason."""
    events: tuple[EventView, ...]
    """The newest first."""
