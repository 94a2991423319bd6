"""Measurements of the modem: the newest of each quantity, of each peer and of the modem itself.

They come with frames and between them, field by field and out of order: a position comes half a
second after the exchange in which it was measured. Values that only make sense together are kept
together with their instant: a `Range`, a `Position`, a `Direction`. An older value never replaces a
newer one.
"""

from typing import Final, TypeVar

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.base.linktypes import LinkMetrics, Measurement, ModemRead, PeerMeasured
from zacoustic.core.peers.peers import Peers, PerPeer


class Range(msgspec.Struct, frozen=True, kw_only=True):
    """How far away another node is."""

    address: int
    """The node."""
    propagation_s: float
    """Propagation delay, one way, s."""
    range_m: float | None
    """Slant distance, m; None: the device does not know the sound speed."""
    integrity: float | None = None
    """Signal quality in the modem's own scale; None: the modem does not report it."""
    measured_at: int
    """Instant of the measurement, ns on the monotonic clock."""

    def age_s(self, now: int) -> float:
        """Return its age at an instant, s; a program passes `time.monotonic_ns()` as `now`."""
        return ns_to_seconds(now - self.measured_at)


class Position(msgspec.Struct, frozen=True, kw_only=True):
    """The position of another node, relative to this one."""

    address: int
    """The node."""
    east_m: float
    """Towards the east, m."""
    north_m: float
    """Towards the north, m."""
    up_m: float
    """Upwards, m: negative where it is deeper."""
    accuracy_m: float | None = None
    """Uncertainty as the device reports it, m."""
    measured_at: int
    """Instant of the measurement, ns on the monotonic clock."""


class Direction(msgspec.Struct, frozen=True, kw_only=True):
    """The direction from which another node is heard."""

    address: int
    """The node."""
    bearing_rad: float
    """0…2π: 0 is north, π/2 east."""
    elevation_rad: float
    """Above the horizontal, -π/2…π/2."""
    accuracy_rad: float | None = None
    """Uncertainty as the device reports it, rad."""
    measured_at: int
    """Instant of the measurement, ns on the monotonic clock."""


Found = TypeVar("Found", Range, Position, Direction)


class _Measured:
    """The newest measurements of one peer."""

    __slots__ = ("direction", "metrics", "position", "range")

    def __init__(self) -> None:
        self.metrics = LinkMetrics()
        self.range: Range | None = None
        self.position: Position | None = None
        self.direction: Direction | None = None


class Measurements:
    """The newest measurements of all peers, and of this node's modems.

    Args:
        peers: The other nodes.
    """

    def __init__(self, peers: Peers) -> None:
        self.modems: dict[str, ModemRead] = {}
        """The last reading of each link's modem, by the name of the link."""
        self._measured = PerPeer(peers, _Measured)

    def handle(self, measurement: Measurement, link: str) -> None:
        """Keep a measurement of a link."""
        if isinstance(measurement, PeerMeasured):
            self.note(measurement.address, measurement.metrics, measurement.measured_at)
        else:
            self.modems[link] = measurement

    def note(self, address: int, metrics: LinkMetrics, at: int) -> None:
        """Keep a measurement of a peer, with a frame or alone.

        Args:
            address: The peer.
            metrics: What was measured.
            at: Instant of the measurement, ns.
        """
        told = {name: each for name in _FIELDS if (each := getattr(metrics, name)) is not None}
        if not told:
            return
        measured = self._measured[address]
        measured.metrics = msgspec.structs.replace(measured.metrics, **told)
        measured.range = _newest(measured.range, range_in(address, metrics, at))
        if metrics.east_m is not None and metrics.north_m is not None and metrics.up_m is not None:
            position = Position(
                address=address,
                east_m=metrics.east_m,
                north_m=metrics.north_m,
                up_m=metrics.up_m,
                accuracy_m=metrics.accuracy_m,
                measured_at=at,
            )
            measured.position = _newest(measured.position, position)
        if metrics.bearing_rad is not None and metrics.elevation_rad is not None:
            direction = Direction(
                address=address,
                bearing_rad=metrics.bearing_rad,
                elevation_rad=metrics.elevation_rad,
                accuracy_rad=metrics.accuracy_rad,
                measured_at=at,
            )
            measured.direction = _newest(measured.direction, direction)

    def addresses(self) -> list[int]:
        """Return the peers with any measurement, in order."""
        return sorted(self._measured)

    def metrics(self, address: int) -> LinkMetrics | None:
        """Return the newest value of each field; None: no measurement yet."""
        measured = self._measured.get(address)
        return measured.metrics if measured else None

    def range(self, address: int) -> Range | None:
        """Return the newest range."""
        measured = self._measured.get(address)
        return measured.range if measured else None

    def position(self, address: int) -> Position | None:
        """Return the newest position."""
        measured = self._measured.get(address)
        return measured.position if measured else None

    def direction(self, address: int) -> Direction | None:
        """Return the newest direction."""
        measured = self._measured.get(address)
        return measured.direction if measured else None


def range_in(address: int, metrics: LinkMetrics, at: int) -> Range | None:
    """Return the range that is among the metrics, or None."""
    if metrics.propagation_s is None:
        return None
    return Range(
        address=address,
        propagation_s=metrics.propagation_s,
        range_m=metrics.range_m,
        integrity=metrics.integrity,
        measured_at=at,
    )


_FIELDS: Final = LinkMetrics.__struct_fields__


def _newest(known: Found | None, found: Found | None) -> Found | None:
    if found is None or (known is not None and found.measured_at < known.measured_at):
        return known
    return found
