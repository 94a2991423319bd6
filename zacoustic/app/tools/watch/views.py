"""Views of a gateway for people: its documents, with what depends on the moment.

A view of a subject has the members of its document (`zacoustic.status`) and adds ages, rates and
shares of one moment, and figures of other documents. Ages are seconds before that moment, None:
never. The same records are drawn on a terminal and on a page, and are the lines of
`zacoustic monitor --json`: there every member has the name that it has here.
"""

from typing import Any

import msgspec
from msgspec import UNSET

from zacoustic.core.relay.relay import Hop
from zacoustic.status.channel import FrameRow, TransferRow
from zacoustic.status.link import (
    BondDocument,
    CarriedRow,
    CarryDocument,
    LinkDocument,
    RouteDocument,
    WaitsDocument,
)
from zacoustic.status.node import EventRow, ModemDocument, NodeDocument
from zacoustic.status.peers import PeerFigures, ReceivedRow
from zacoustic.status.streams import StreamRow


class StreamView(StreamRow, frozen=True, kw_only=True):
    """One stream; `age_s` is its age now, `expired` and `refused` count for the whole gateway."""

    sent_ago_s: float | None
    """Time since the last transmission, s."""
    heard_ago_s: float | None
    """Time since the last reception, s."""
    sent_rate_hz: float | None
    """Present rate, 1/s; None: less than two so far."""
    heard_rate_hz: float | None
    """Present rate, 1/s; None: less than two so far."""
    outcomes: dict[str, int]
    """Number of reliable samples by outcome; empty: it is not reliable."""
    useless: int
    """Samples that expired, were superseded, or had no subscribers."""
    expired: int
    """Samples of those that expired before transmission, or did not arrive in time."""
    refused: int
    """Inputs that the gateway refused, too large, not of the type, no room, and samples that a
    subscriber refused."""
    airtime_bytes: int
    """Bytes on the link since the gateway runs."""
    airtime_share: float
    """Share of the gateway's airtime, 0…1."""
    differs_at: tuple[int, ...]
    """Nodes that define it otherwise: it is stopped between them."""


class WaitsView(WaitsDocument, frozen=True, kw_only=True):
    """Why the next frame of a link waits."""

    left_s: float | None
    """Time until it goes if nothing else happens, s; None: something must happen first."""


class LinkView(LinkDocument, frozen=True, kw_only=True):
    """A link of the gateway."""

    waits: WaitsView | None = None
    """Why its next frame waits; None: nothing waits, or the gateway is gone."""


class CarriedView(CarriedRow, frozen=True, kw_only=True):
    """What this node keeps of one carried topic."""

    oldest_s: float | None
    """Time since the first of all was published or taken here, s; None: unknown."""
    ends_in_s: float | None
    """Time until the first of all is worthless, s; None: unknown."""


class CarryView(CarryDocument, frozen=True, kw_only=True):
    """What this node keeps of carried topics until its subscribers have it."""

    streams: tuple[CarriedView, ...]
    """The same by topic, of those of which something is kept."""


class ReceivedView(ReceivedRow, frozen=True, kw_only=True):
    """What came from a node by one link, directly, since the gateway runs."""

    link: str
    """Name of the link."""


class PeerView(PeerFigures, frozen=True, kw_only=True):
    """Another node, as this one receives it."""

    address: int
    """Acoustic address."""
    heard_ago_s: float | None
    """Time since its last frame, s."""
    is_lost: bool
    """Not heard for the file's `lost_after_s`."""
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


class TransferView(TransferRow, frozen=True, kw_only=True):
    """A sample larger than a frame; `stream` is empty until its beginning has arrived."""

    stream: str
    """Name of its stream."""
    direction: str
    """``to`` or ``from``."""
    peer: int | None
    """The other node; None: several."""
    sent_bytes: int | None
    """Transmitted bytes, without repair; None: it is an incoming one."""
    outcome: str | None
    """Its outcome; None: it is under way."""


class FrameView(FrameRow, kw_only=True):
    """A frame."""

    ago_s: float
    """Time since its beginning, s."""


class EventView(EventRow, frozen=True, kw_only=True):
    """An event."""

    ago_s: float
    """Its age, s."""


class GatewayView(NodeDocument, frozen=True, kw_only=True):
    """One gateway, at one moment."""

    unix_s: float
    """The moment."""
    address: int
    """Acoustic address."""
    is_alive: bool
    """It runs, its network is reached, and it answers."""
    gone_s: float | None
    """Time for which it has not, s; None: it does."""
    uptime_s: float | None
    """Time since its start, s."""
    whole: LinkView
    """Counters of all its links together; state, reasons and capabilities of the first one."""
    modem: ModemDocument
    """What its modem reports of itself."""
    links: tuple[LinkView, ...]
    """Each of its links, by name."""
    routes: tuple[RouteDocument, ...]
    """Routes that end here, by name."""
    hops: tuple[Hop, ...]
    """Hops of routes from here."""
    bonds: tuple[BondDocument, ...]
    """Lists of links, by name."""
    carry: CarryView | None = None
    """Its carried samples; None: no topic is carried."""
    journal: str
    """``kept``, ``none``, or why it cannot be written."""
    digest: str
    """Digest of the stream table."""
    frames_damaged: int
    """Damaged frames among them."""
    utilisation: float | None
    """Share of the time that it was on the air, over `window_s`, 0…1; None: unknown yet."""
    window_s: float
    """Observed time, s."""
    waiting: int
    """Waiting samples, calls and goals of all streams."""
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


def told(part: Any) -> Any:  # noqa: ANN401 (what JSON holds)
    """Return a view as JSON holds it: each member by its name here, null where it is unset."""
    if isinstance(part, GatewayView):
        members = {name: told(getattr(part, name)) for name in part.__struct_fields__}
        members |= _of_link(members.pop("whole")) | members.pop("modem")
        return members | {"journal_doubt": members["doubt"]}
    if isinstance(part, msgspec.Struct):
        return {name: told(getattr(part, name)) for name in part.__struct_fields__}
    if isinstance(part, dict):
        return {str(name): told(each) for name, each in part.items()}
    if isinstance(part, (list, tuple)):
        return [told(each) for each in part]
    return None if part is UNSET else msgspec.to_builtins(part)


def _of_link(whole: dict[str, Any]) -> dict[str, Any]:
    """Return what the JSON of a gateway has of its link."""
    can = whole["capabilities"] or {}
    same = ("is_silent", "why_silent", "frames_sent", "frames_heard", "bytes_sent", "airtime_s")
    return {
        "link_state": whole["state"],
        "link_detail": whole["detail"],
        "mtu_bytes": can.get("mtu_bytes"),
        "bit_rate_bps": can.get("bit_rate_bps"),
        "waits": whole["waits"],
        **{name: whole[name] for name in same},
    }
