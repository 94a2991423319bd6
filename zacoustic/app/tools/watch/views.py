"""Views of a gateway for people: records with ages, rates and shares of one moment.

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
    """The gateway's roles in it."""
    published: int
    """Local inputs that the gateway accepted."""
    sent: int
    """Records transmitted."""
    heard: int
    """Received records."""
    sent_ago_s: float | None
    """Time since the last transmission, s."""
    heard_ago_s: float | None
    """Time since the last reception, s."""
    sent_rate_hz: float | None
    """Present rate, 1/s; None: less than two so far."""
    heard_rate_hz: float | None
    """Present rate, 1/s; None: less than two so far."""
    age_s: float | None
    """Age of the newest received sample, s; None: none, or without an age."""
    waiting: int
    """Samples, calls and goals that wait for transmission."""
    delivering: int | None
    """Reliable samples under way; None: it is not reliable."""
    outcomes: dict[str, int]
    """Number of reliable samples by outcome; empty: it is not reliable."""
    useless: int
    """Samples that expired, were superseded, or had no subscribers."""
    expired: int
    """Samples of those that expired before transmission, or did not arrive in time."""
    refused: int
    """Inputs that the gateway refused: too large, not of the type, no room."""
    deadline_missed: int | None
    """Number of missed deadlines; None: it has no deadline."""
    airtime_bytes: int
    """Bytes on the link since the gateway runs."""
    airtime_share: float
    """Share of the gateway's airtime, 0…1."""
    differs_at: tuple[int, ...]
    """Nodes that define it otherwise: it is stopped between them."""


class WaitsView(msgspec.Struct, frozen=True, kw_only=True):
    """Why the next frame of a link waits."""

    why: str
    """One word, as in docs/monitoring.md."""
    left_s: float | None
    """Time until it goes if nothing else happens, s; None: something must happen first."""


class LinkView(msgspec.Struct, frozen=True, kw_only=True):
    """A link of the gateway."""

    name: str
    """Its name; empty: the file gives it none."""
    state: str
    """``up``, ``down`` or ``opening``."""
    detail: str
    """What it waits for."""
    frames_sent: int
    """Frames given to its modem."""
    frames_heard: int
    """Received frames, including damaged ones."""
    airtime_s: float
    """Airtime of the frames sent, s."""
    paid: float | None = None
    """What they cost, in the currency of the tariff; None: it has none."""
    waits: WaitsView | None = None
    """Why its next frame waits; None: nothing waits."""


class RouteView(msgspec.Struct, frozen=True, kw_only=True):
    """A route that ends at this node."""

    name: str
    """Its name."""
    path: tuple[int, ...]
    """Addresses from one end to the other."""
    link: str
    """Name of the link of its hops."""
    link_state: str
    """State of that link here: ``up``, ``down`` or ``opening``."""
    frames_sent: int
    """Frames that this end has sent over it."""
    frames_heard: int
    """Frames that came over it."""


class HopView(msgspec.Struct, frozen=True, kw_only=True):
    """A hop of a route from this node."""

    route: str
    """Name of the route."""
    next_node: int
    """Address of the node to which it goes."""
    waiting: int
    """Frames that are held for it."""
    transmissions: int
    """How often a frame was transmitted."""
    passed_on: int
    """Frames that have arrived there."""
    given_up: int
    """Frames that were given up."""


class CarriedView(msgspec.Struct, frozen=True, kw_only=True):
    """What this node keeps of one carried topic."""

    stream: str
    """Its name."""
    own: dict[int, int]
    """By subscriber, how many samples of this node it is not known to have."""
    custodians: dict[int, int]
    """By custodian, how many of these it has as well."""
    carried: dict[int, int]
    """By subscriber, how many samples of other nodes are kept for it."""
    carried_bytes: int
    """Their size, bytes."""
    oldest_s: float | None
    """Time since the first of all was published or taken here, s; None: unknown."""
    ends_in_s: float | None
    """Time until the first of all is worthless, s; None: unknown."""


class CarryView(msgspec.Struct, frozen=True, kw_only=True):
    """What this node keeps of carried topics until its subscribers have it."""

    own: int
    """Its own samples."""
    in_custody: int
    """How many of these a custodian has as well."""
    carried: int
    """Samples of other nodes."""
    carried_bytes: int
    """Their size, bytes."""
    max_bytes: int
    """How large they may be together, bytes."""
    refused: int
    """Samples of other nodes that there was no room for."""
    expired: int
    """Samples of other nodes that have become worthless here."""
    streams: tuple[CarriedView, ...]
    """The same by topic, of those of which something is kept."""


class BondView(msgspec.Struct, frozen=True, kw_only=True):
    """A list of links that is used as one."""

    name: str
    """Its name."""
    links: tuple[str, ...]
    """Its links at this node, the best one first."""
    in_use: str | None
    """The best link that reaches all nodes, else the last one that is up; None: none is up."""
    reach: dict[int, dict[str, str]]
    """``up``, ``doubt`` or ``down``, by node and link."""
    again: int
    """Frames that went again by the next link."""
    frames_sent: int
    """Frames that were given to it."""
    frames_heard: int
    """Frames that came by it."""


class ReceivedView(msgspec.Struct, frozen=True, kw_only=True):
    """What came from a node by one link, directly, since the gateway runs."""

    link: str
    """Name of the link."""
    frames: int
    """Frames."""
    airtime_s: float | None
    """Their airtime, s; None: unknown."""


class PeerView(msgspec.Struct, frozen=True, kw_only=True):
    """Another node, as this one receives it."""

    address: int
    """Acoustic address."""
    name: str
    """Name in the table."""
    heard_ago_s: float | None
    """Time since its last frame, s."""
    is_lost: bool
    """Not heard for the file's `lost_after_s`."""
    same_table: bool | None
    """It has our stream table; None: unknown."""
    is_shared: bool = False
    """Two nodes have its address."""
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
    """Age of that measurement, s."""
    per: float | None
    """Share of frames without an acknowledgement of its modem, of the last ones, 0…1."""
    exchanges: int
    """Frames that its modem was asked to acknowledge."""
    late: tuple[str, ...]
    """Keys whose next sample is overdue."""
    link: str | None
    """The link that reaches it now; None: no list of links tells, or none reaches it."""
    received: tuple[ReceivedView, ...] | None
    """What came from it by each link, without relays; None: unknown."""


class CauseView(msgspec.Struct, frozen=True, kw_only=True):
    """The airtime of one cause."""

    cause: str
    """The cause, a word of the ledger."""
    airtime_bytes: int
    """Bytes since the gateway runs."""
    airtime_s: float
    """Airtime, s."""
    share: float
    """Share of the gateway's airtime, 0…1."""


class TransferView(msgspec.Struct, frozen=True, kw_only=True):
    """A sample larger than a frame."""

    stream: str
    """Name; empty: its beginning has not arrived."""
    direction: str
    """``to`` or ``from``."""
    peer: int | None
    """The other node; None: several."""
    done_bytes: int
    """Bytes that the receivers have, as far as known."""
    sent_bytes: int | None
    """Bytes transmitted, repair included; None: it is an incoming one."""
    total_bytes: int | None
    """Its size; None: unknown yet."""
    outcome: str | None
    """Its outcome; None: it is under way."""


class FrameView(msgspec.Struct, frozen=True, kw_only=True):
    """A frame."""

    ago_s: float
    """Time since its beginning, s."""
    way: str
    """``out`` or ``in``."""
    peer: int | None
    """The other node; None: broadcast, or unknown."""
    size_bytes: int
    """Its size."""
    airtime_s: float
    """Airtime, s."""
    streams: tuple[str, ...]
    """Streams with a record in it; none: only controls."""
    outcome: str
    """Report of the modem on a sent one; empty: none yet, or it was received."""


class EventView(msgspec.Struct, frozen=True, kw_only=True):
    """An event."""

    ago_s: float
    """Its age, s."""
    event: str
    """Its kind."""
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
    """Time for which it has not, s; None: it does."""
    version: str
    """Version of its program."""
    uptime_s: float | None
    """Time since its start, s."""
    wire: str
    """Wire profile."""
    link: str
    """Locator of the modem."""
    link_state: str
    """``up``, ``down`` or ``opening``."""
    link_detail: str
    """What it waits for."""
    links: tuple[LinkView, ...]
    """Each of its links, by name."""
    routes: tuple[RouteView, ...]
    """Routes that end here, by name."""
    hops: tuple[HopView, ...]
    """Hops of routes from here."""
    bonds: tuple[BondView, ...]
    """Lists of links, by name."""
    carry: CarryView | None = None
    """Its carried samples; None: no topic is carried."""
    is_silent: bool
    """Transmit silence is in force."""
    why_silent: str = ""
    """Its reason, one line."""
    mtu_bytes: int | None
    """Largest frame, bytes."""
    bit_rate_bps: float | None
    """Acoustic bit rate, bit/s."""
    battery_v: float | None
    """Supply voltage of the modem, V."""
    firmware: str
    """Firmware of the modem."""
    journal: str
    """``kept``, ``none``, or why it cannot be written."""
    is_shared: bool = False
    """Another node has its address too."""
    journal_doubt: str
    """Why it may lack the last writes; empty: it does not."""
    digest: str
    """Digest of the stream table."""
    frames_sent: int
    """Frames given to the modem."""
    frames_heard: int
    """Received frames, including damaged ones."""
    frames_damaged: int
    """Damaged frames among them."""
    bytes_sent: int
    """Bytes of the frames sent."""
    airtime_s: float
    """Their airtime, s."""
    utilisation: float | None
    """Share of the time that it was on the air, over `window_s`, 0…1; None: unknown yet."""
    window_s: float
    """Observed time, s."""
    waiting: int
    """Waiting samples, calls and goals of all streams."""
    waits: WaitsView | None = None
    """Why the next frame of the first link waits; None: nothing waits, or the gateway is gone."""
    streams: tuple[StreamView, ...]
    """The streams by id."""
    peers: tuple[PeerView, ...]
    """The other nodes by address."""
    causes: tuple[CauseView, ...]
    """Causes of airtime, the largest first."""
    transfers: tuple[TransferView, ...]
    """Transfers under way, and the last ones that ended."""
    transmitting: FrameView | None
    """The frame being sent."""
    frames: tuple[FrameView, ...]
    """The last frames sent or received, the newest first."""
    dropped: dict[str, int]
    """Dropped receptions, by reason."""
    events: tuple[EventView, ...]
    """The last events, the newest first."""
