"""Links of a gateway, routes and lists of links over them, custody, and their ledgers."""

from typing import Any

import msgspec
from msgspec import UNSET, UnsetType

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.base.stats import EngineStats, LedgerEntry
from zacoustic.core.bond.bonding import BondStatus
from zacoustic.core.relay.relay import Hop
from zacoustic.core.schedule.access.base import AccessState
from zacoustic.core.transport.carry.status import CarriedSums, CarrySums


class LedgerRow(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``ledger``: bytes of one stream for one cause."""

    id: int = 0
    """Stream id; 0: of no stream."""
    stream: str = ""
    """Its name."""
    cause: str = ""
    """Why they were transmitted: a word of `Cause`."""
    bytes: int = 0
    """Bytes since the gateway runs."""
    airtime_s: float = 0.0
    """Their airtime, s."""

    @classmethod
    def of(cls, entry: LedgerEntry, stream: str) -> "LedgerRow":
        """Make a row of an entry; `stream` is the name of its stream, or empty."""
        return cls(
            id=entry.stream_id,
            stream=stream,
            cause=entry.cause.value,
            bytes=entry.transmitted_bytes,
            airtime_s=round(ns_to_seconds(entry.airtime_ns), 6),
        )


class LedgerDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``ledger``: every byte on the link."""

    bytes: int = 0
    """Their number."""
    airtime_s: float = 0.0
    """Their airtime, s."""
    entries: list[LedgerRow] = []
    """By stream and cause."""


class WaitsDocument(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``link``: why its next frame waits."""

    why: str = ""
    """A word of `Why`."""
    until_unix_s: float | None = None
    """When it goes if nothing else happens; None: something must happen first."""


class Crossed(msgspec.Struct, frozen=True, kw_only=True):
    """Frames of a link, or of what is made of links, since the gateway runs."""

    frames_sent: int = msgspec.field(name="frames_transmitted", default=0)
    """Frames given to it."""
    bytes_sent: int = msgspec.field(name="bytes_transmitted", default=0)
    """Their bytes."""
    frames_heard: int = msgspec.field(name="frames_received", default=0)
    """Received frames, damaged ones included."""
    bytes_heard: int = msgspec.field(name="bytes_received", default=0)
    """Their bytes."""


def crossed(stats: EngineStats) -> dict[str, Any]:
    """Return the members of `Crossed` from the counters of a link."""
    return {
        "frames_sent": stats.frames_transmitted,
        "bytes_sent": stats.bytes_transmitted,
        "frames_heard": stats.frames_received,
        "bytes_heard": stats.bytes_received,
    }


class LinkDocument(Crossed, frozen=True, kw_only=True):
    """``link`` or ``link/NAME``: state and counters."""

    name: str = ""
    """Its name; empty: the file gives it none."""
    state: str = "unknown"
    """``up``, ``down`` or ``opening``."""
    detail: str = ""
    """What it waits for."""
    is_silent: bool = msgspec.field(name="silent", default=False)
    """Nothing is transmitted, by command or by a quiet window."""
    why_silent: str = ""
    """Its reason, one line."""
    waits: WaitsDocument | None = None
    """Why its next frame waits; None: nothing waits."""
    access: AccessState | UnsetType = UNSET
    """What its schedule does; unset: it has none."""
    capabilities: LinkCapabilities | None = None
    """What it can do; None: it has not opened yet."""
    diagnostics: dict[str, Any] = {}
    """The device's own counters."""
    airtime_s: float = 0.0
    """Airtime of the frames sent, s."""
    reports: dict[str, int] = {}
    """Frames by reported outcome."""
    paid_bytes: int | UnsetType = UNSET
    """Bytes that are paid for; unset: it has no tariff."""
    paid: float | UnsetType = UNSET
    """What they cost, in the currency of the tariff."""
    ledger: LedgerDocument | UnsetType = UNSET
    """Its ledger; unset: it is the only link, or the sum of all."""


class RouteDocument(Crossed, frozen=True, kw_only=True):
    """``route/NAME``: a route that ends at this node; nobody knows whether its relays live."""

    name: str = ""
    """Its name."""
    path: tuple[int, ...] = ()
    """Addresses from one end to the other."""
    link: str = ""
    """Name of the link of its hops."""
    link_state: str = "unknown"
    """State of that link here: ``up``, ``down`` or ``opening``."""
    capabilities: LinkCapabilities | None = None
    """What it can do; None: its link has not opened yet."""
    ledger: LedgerDocument | UnsetType = UNSET
    """Its ledger."""


class ChangedPath(msgspec.Struct, frozen=True, kw_only=True):
    """Of ``relay``: the path that commands have given to a route."""

    revision: int
    """Revision of the path."""
    number: int
    """Its number in the frames of the route."""
    path: tuple[int, ...]
    """Addresses from one end to the other."""


class RelayDocument(msgspec.Struct, frozen=True, kw_only=True):
    """``relay``: the hops of routes from this node."""

    hops: list[Hop] = []
    """What the engine counts of each."""
    changed: dict[str, ChangedPath] | UnsetType = UNSET
    """Routes whose path commands have changed, by name; unset: none."""


class BondDocument(BondStatus, frozen=True, kw_only=True):
    """``bond/NAME``: what the engine says of a list of links that is used as one."""

    frames_sent: int = msgspec.field(name="frames_transmitted", default=0)
    """Frames given to it."""
    bytes_sent: int = msgspec.field(name="bytes_transmitted", default=0)
    """Their bytes."""
    frames_heard: int = msgspec.field(name="frames_received", default=0)
    """Frames that came by it."""
    bytes_heard: int = msgspec.field(name="bytes_received", default=0)
    """Their bytes."""
    ledger: LedgerDocument | UnsetType = UNSET
    """Its ledger."""


class CarriedRow(CarriedSums, frozen=True, kw_only=True):
    """Of ``carry``: what is kept of one topic."""

    id: int = 0
    """Stream id."""
    stream: str = ""
    """Its name."""
    oldest_at_unix_s: float | None = None
    """When the first of all was published or taken here; None: unknown until the link is up."""
    ends_at_unix_s: float | None = None
    """When the first of all is worthless; None: unknown until the link is up."""


class CarryDocument(CarrySums, frozen=True, kw_only=True):
    """``carry``: what is kept of carried topics until their subscribers have it."""

    streams: tuple[CarriedRow, ...] = ()
    """The same for each topic with samples kept here."""
