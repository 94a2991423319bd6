"""Probes: small frames that a node transmits on command, and counts of those that it hears.

Which nodes hear each other, and how well, only the water tells. A node that is asked to transmits a
*run* of probes to all; every other node counts what it hears. So one run measures the way from one
node to each other one, and the runs of all nodes measure each pair in both directions.

A probe is not sealed and nobody answers it: what it says is a measurement, as a carrier is.
"""

import random
from typing import Final

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import BROADCAST, LinkCapabilities
from zacoustic.core.base.parts import Offer
from zacoustic.core.base.qos import PATIENCE_NS, Priority
from zacoustic.core.base.signals import Signal
from zacoustic.core.base.stats import NO_STREAM, Cause, EngineStats
from zacoustic.core.schedule.sources import Forwarded
from zacoustic.core.wire.relay import MOST_PROBES, PROBE_BYTES, Probe
from zacoustic.errors import LocalError

_PAUSE_NS: Final = NS_PER_S
"""Time from the end of a probe to the next one, at least; the pause is drawn up to twice that."""
_ENVELOPE_BYTES: Final = 8
"""The most that the envelope of a link adds."""
_GRACE_NS: Final = 30 * NS_PER_S
"""What has not gone so long after the planned end of a run is left out: the node is silent."""
_PATIENCE_NS: Final = PATIENCE_NS[Priority.INTERACTIVE_HIGH]


class Prober:
    """The probes of a node on one link.

    Args:
        rng: Spreads pauses.
        stats: Counters of the link.
    """

    is_urgent = False
    has_granted = False
    goes_on = False

    def __init__(self, rng: random.Random, stats: EngineStats) -> None:
        self._rng = rng
        self._stats = stats
        self._frame_ns = self._turn_ns = NS_PER_S  # until the link is up
        self._run = self._next = self._count = 0
        self._next_at = self._until = 0
        self.begun = Signal[int]()
        """``(now)``: a run begins, so that there are probes to transmit."""
        self._heard: dict[int, tuple[int, int]] = {}
        """The last run of each source, and a bit for each probe that was heard."""

    def use_link(self, capabilities: LinkCapabilities) -> None:
        """Take what the link can do."""
        self._frame_ns = capabilities.airtime_ns(PROBE_BYTES + _ENVELOPE_BYTES)
        longest_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
        self._turn_ns = 2 * (longest_ns + seconds_to_ns(capabilities.propagation_s)) + NS_PER_S

    def begin(self, run: int, count: int, now: int) -> int:
        """Begin a run; return when it is over at the latest, ns.

        The first probe waits until the answer to the command, and what confirms it, have passed.

        Args:
            run: Its number, 0…255.
            count: How many probes, 1…32.
            now: The instant, ns.

        Raises:
            LocalError: Too many probes, or another run is under way.
        """
        if not 1 <= count <= MOST_PROBES:
            raise LocalError(f"{count} probes; allowed: 1..{MOST_PROBES}")
        ends_at = now + self._turn_ns + count * (self._frame_ns + 2 * _PAUSE_NS)
        if self._is_under_way(now):
            if run == self._run:  # the same command again
                return max(now, self._until - _GRACE_NS)
            raise LocalError("another run of probes is under way")
        self._run, self._next, self._count = run, 0, count
        self._next_at, self._until = now + self._turn_ns, ends_at + _GRACE_NS
        self.begun(now)
        return ends_at

    def handle(self, source: int, probe: Probe) -> None:
        """Count a probe of another node."""
        run, bits = self._heard.get(source, (probe.run, 0))
        if run != probe.run:
            bits = 0
        self._heard[source] = probe.run, bits | 1 << probe.number

    def heard(self, run: int) -> dict[int, int]:
        """Return how many probes of a run were heard of each node."""
        return {
            source: bits.bit_count()
            for source, (last, bits) in sorted(self._heard.items())
            if last == run
        }

    def probe_airtime_ns(self) -> int:
        """Return the airtime of a probe, ns."""
        return self._frame_ns

    # A source of the composer

    def take_granted(self, room_bytes: int, now: int) -> tuple[int, Forwarded] | None:
        """Return None: in silence no probe goes."""
        return None

    def due_at(self, now: int) -> int | None:
        """Return the instant at which a probe is due, ns; None: none."""
        return self._next_at if self._is_under_way(now) else None

    def offer(self, now: int) -> Offer | None:
        """Return what would go now; None: nothing is due."""
        if not self._is_under_way(now) or self._next_at > now:
            return None
        rank = self._next_at + _PATIENCE_NS
        return Offer(destination=BROADCAST, rank=rank, is_forwarded=True)

    def take(self, room_bytes: int, now: int) -> Forwarded | None:
        """Take the content of the frame that goes now, of at most `room_bytes`."""
        probe = Probe(self._run, self._next)
        self._next += 1
        self._next_at = now + self._frame_ns + round(_PAUSE_NS * (1 + self._rng.random()))
        if room_bytes < PROBE_BYTES:
            return None
        self._stats.attribute(NO_STREAM, Cause.RELAY, PROBE_BYTES)
        return Forwarded(content=probe.encode())

    # Below the methods above

    def _is_under_way(self, now: int) -> bool:
        return self._next < self._count and now < self._until
