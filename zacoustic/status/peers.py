"""Other nodes, as a gateway hears them."""

import msgspec

from zacoustic.core.base.linktypes import LinkMetrics


class ReceivedRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``peers``: what came from one node by one link, directly, since the gateway runs."""

    frames: int = 0
    """Frames."""
    bytes: int = 0
    """Their bytes."""
    airtime_s: float | None = None
    """Their airtime by the bit rates of the link, s; None: unknown."""


class PeerFigures(msgspec.Struct, frozen=True, kw_only=True):
    """What is known of one node, but for the links by which it is heard."""

    name: str = ""
    """Name in the table."""
    epoch: int | None = None
    """Its boot epoch; None: unknown."""
    same_table: bool | None = None
    """It has our stream table; None: unknown."""
    wire_version: int | None = None
    """Its wire version; None: unknown."""
    is_shared: bool = msgspec.field(name="shared", default=False)
    """Two nodes have its address."""
    confirmed_us: bool = False
    """It has confirmed our table."""
    heard_at_unix_s: float | None = None
    """When its last frame came; None: never."""
    delivered: int = 0
    """Frames that its modem has acknowledged, of those for which ours was to ask for that."""
    not_delivered: int = 0
    """Frames that it has not."""
    per: float | None = None
    """Share of frames without an acknowledgement of its modem, of the last ones, 0…1."""
    round_trip_s: float | None = None
    """How long it usually takes to acknowledge a reliable sample, s; None: unknown."""
    metrics: LinkMetrics | None = None
    """The modem's newest measurements of it."""


class PeerRow(PeerFigures, frozen=True, kw_only=True):
    """Of ``peers``: one node."""

    received: dict[str, ReceivedRow] | None = None
    """What came from it by each link, without relays; None: unknown."""


class RangeDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``peer/N/range``."""

    propagation_s: float | None = None
    """Propagation delay, one way, s."""
    range_m: float | None = None
    """Slant distance, m; None: the device does not know the sound speed."""
    integrity: float | None = None
    """Signal quality in the modem's own scale."""
    measured_at_unix_s: float | None = None
    """When it was measured."""


class PositionDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``peer/N/position``: relative to this node."""

    east_m: float | None = None
    """Towards the east, m."""
    north_m: float | None = None
    """Towards the north, m."""
    up_m: float | None = None
    """Upwards, m: negative where it is deeper."""
    accuracy_m: float | None = None
    """Uncertainty as the device reports it, m."""
    measured_at_unix_s: float | None = None
    """When it was measured."""


class DirectionDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``peer/N/direction``: from which it is heard."""

    bearing_rad: float | None = None
    """0…2π: 0 is north, π/2 east."""
    elevation_rad: float | None = None
    """Above the horizontal, -π/2…π/2."""
    accuracy_rad: float | None = None
    """Uncertainty as the device reports it, rad."""
    measured_at_unix_s: float | None = None
    """When it was measured."""


class LostDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``peer/N/lost``."""

    lost: bool = False
    """No frame of it came for the file's `lost_after_s`."""
    since_unix_s: float | None = None
    """Since when."""
    heard_at_unix_s: float | None = None
    """When its last frame came, while it is lost; None: never, or it is not lost."""


class LateDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``peer/N/late``: topics with a deadline."""

    late: list[str] = []
    """Keys whose next sample is overdue."""
    missed: dict[str, int] = {}
    """Missed deadlines, by key."""
