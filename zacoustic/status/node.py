"""A gateway itself: constant facts, its journal and modem, dropped data, its last events."""

import msgspec
from msgspec import UNSET, UnsetType


class NodeDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``node``: constant facts."""

    address: int | None = None
    """Acoustic address."""
    name: str = ""
    """Name in the table."""
    version: str = ""
    """Version of its program."""
    wire: str = ""
    """Wire profile."""
    link: str = ""
    """Locator of the modem."""
    started_at_unix_s: float | None = None
    """When it was started."""
    doubt: str = ""
    """Why the journal may lack the last writes; empty: it does not."""
    is_shared: bool = msgspec.field(name="shared", default=False)
    """Another node has its address too."""


class JournalDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``journal``."""

    kept: bool = False
    """It outlives the process."""
    failure: str = ""
    """Why it cannot be written now; empty: it can."""
    doubt: str = ""
    """Why it may lack the last writes; empty: it does not."""


class SealDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``seal``: public facts of the key and the life; there is none if frames are not sealed."""

    network: str = ""
    """Name of the fleet's key."""
    generation: int | None = None
    """Generation of the key."""
    fingerprint: str = ""
    """Fingerprint of the key."""
    mode: str = ""
    """Whether the node transmits or only receives."""
    life: int | None = None
    """Life of the node; None: it transmits nothing."""
    failure: str = ""
    """Why no frame is sealed; empty: they are."""


class ContactDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``contact/NAME``: an entry of `lost_contact`."""

    state: str = ""
    """``counting``, ``lost`` (and not answered yet) or ``acted``."""
    of: tuple[int, ...] = ()
    """The nodes whose silence counts; empty: any other node."""
    lost_after_s: float | None = None
    """How long none of them is heard, s."""
    silent_since_unix_s: float | None = None
    """When the last frame of one of them came, or the first start."""
    acts_at_unix_s: float | None = None
    """When it acts if nobody is heard; None: contact is lost."""
    call: str | UnsetType = UNSET
    """The service that it calls; unset: it publishes."""
    publish: str | UnsetType = UNSET
    """The key that it publishes; unset: it calls."""
    served: bool | None = None
    """Somebody serves that service, or subscribes to that key, now; None: unknown."""
    attempts: int = 0
    """Attempts of the present loss."""
    failure: str = ""
    """Why the last of them has failed, one line."""
    answer: str = ""
    """What it was answered, one line."""


class ModemDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``modem`` or ``modem/NAME``: what a modem reports of itself."""

    firmware: str = ""
    """Its firmware version, in the vendor's words."""
    battery_v: float | None = None
    """Supply voltage, V."""
    source_level_db: float | None = None
    """Source level, dB re 1 µPa at 1 m."""
    relative_source_level_db: float | None = None
    """Source level relative to the device's loudest, dB, at most 0."""
    read_at_unix_s: float | None = None
    """When it was read."""


class DroppedDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``dropped``: useless input, by reason; samples by stream."""

    channel: dict[str, int] = {}
    """Receptions."""
    local: dict[str, dict[str, int]] = {}
    """Input of the local network, by stream and reason."""
    expired: dict[str, int] = {}
    """Samples that expired before transmission."""
    superseded: dict[str, int] = {}
    """Samples that newer ones have replaced."""
    unsubscribed: dict[str, int] = {}
    """Samples that nobody subscribes to."""


class EventRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``events``: one event."""

    at_unix_s: float = 0.0
    """When it was."""
    event: str = ""
    """Its kind."""
    is_trouble: bool = msgspec.field(name="trouble", default=False)
    """Somebody should look at it."""
    text: str = ""
    """One line for people."""


class EventsDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``events``: the last ones, the oldest first."""

    events: list[EventRow] = []


class ClockDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``clock``: only answered to a `get`, and put when somebody has set the clock."""

    now_unix_s: float
    """The time there."""
