"""Polling: one node gives each of the others its turn, so that no node transmits unasked.

No clock is needed, and no guard time but the round trip. The poller goes round its list: its own
turn first, then a TURN to each node. A node that has the turn sends what it has, as long as the
largest frame still ends within the turn, and gives the channel back by a TURN for no node. If a
node is not heard, the poller takes the channel back when the turn and a round trip are over. After
a round in which no node had anything to send the poller rests; only then is the channel quiet::

                    a payload is due                      its list has ended, somebody spoke
    REST ────────────────────────────────► OWN ◄─────────────────────────────────┐
      │ the rest is over                    │ nothing due, or its turn is over   │
      └──────────────► ASK ◄────────────────┘                                    │
                        │ TURN sent                                              │
                        ▼        channel given back, or its time is over         │
                      HEAR ─────────────────────────────► next one: ASK ─────────┘
"""

import enum
from typing import Final

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.schedule.access.base import TurnAccess, Wanted
from zacoustic.core.schedule.access.spec import SLOWEST_SOUND_M_S, PollingSpec
from zacoustic.core.wire.access import (
    LONGEST_SPAN_NS,
    NOBODY,
    SPAN_STEP_NS,
    TURN_BYTES,
    AccessControl,
    Turn,
)
from zacoustic.errors import ConfigError

# The most that a bare TURN needs: three bytes, and the envelope of a link that brings none.
_GIVING_BACK_BYTES: Final = TURN_BYTES + 9
# Timers of both nodes, and the modem's time between receiving and sending.
_TURNAROUND_NS: Final = NS_PER_S // 4
_TURN_FRAMES: Final = 2


class _Phase(enum.Enum):
    """The state of the poller."""

    REST = enum.auto()
    """The last round was empty."""
    OWN = enum.auto()
    """The poller sends its own frames."""
    ASK = enum.auto()
    """The poller is about to give the next node its turn."""
    HEAR = enum.auto()
    """Another node has the turn."""


def polling(spec: PollingSpec, capabilities: LinkCapabilities, address: int) -> "Poller | Polled":
    """Make the policy of a node: that of the poller or that of a polled node.

    Raises:
        ConfigError: A turn does not hold the largest frame.
    """
    times = _Times(spec, capabilities)
    if address == spec.poller:
        return Poller(spec, times)
    return Polled(spec, times, address)


class _Times:
    """Durations of polling on one link, ns."""

    def __init__(self, spec: PollingSpec, capabilities: LinkCapabilities) -> None:
        gap_ns = seconds_to_ns(capabilities.gap_s)
        self.largest_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
        self.giving_back_ns = gap_ns + capabilities.airtime_ns(_GIVING_BACK_BYTES)
        least_ns = self.largest_ns + self.giving_back_ns
        frames_ns = _TURN_FRAMES * (self.largest_ns + gap_ns) + self.giving_back_ns
        if spec.turn_s is not None:
            self.turn_ns = seconds_to_ns(spec.turn_s)
        else:
            self.turn_ns = min(max(frames_ns, least_ns), LONGEST_SPAN_NS)
        self.turn_ns -= self.turn_ns % SPAN_STEP_NS
        if self.turn_ns < least_ns:
            raise ConfigError(
                f"access.turn_s: {self.turn_ns / NS_PER_S:g} s; the largest frame of this link and "
                f"giving the channel back take {least_ns / NS_PER_S:.3f} s; allowed: at least that,"
                f" at most {LONGEST_SPAN_NS / NS_PER_S:g}"
            )
        way_s = capabilities.propagation_s
        if spec.max_range_m is not None:
            way_s = spec.max_range_m / SLOWEST_SOUND_M_S
        self.ways_ns = 2 * seconds_to_ns(way_s) + _TURNAROUND_NS
        self.idle_ns = seconds_to_ns(spec.idle_s)


class Polled(TurnAccess):
    """A node that transmits when it is polled."""

    speaks = True

    def __init__(self, spec: PollingSpec, times: _Times, address: int) -> None:
        self.answers_to = spec.poller
        self._address = address
        self._times = times
        self._begun_at = 0
        self._ends_at: int | None = None

    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the due instant if it is within this node's turn, else None."""
        if self._ends_at is None:
            return None
        ready_at = wanted.earliest(now)
        needed_ns = self._times.largest_ns + self._times.giving_back_ns
        return ready_at if ready_at + needed_ns <= self._ends_at else None

    def speak_at(self, now: int) -> int | None:
        """Return when to give the channel back: as soon as nothing is due."""
        return None if self._ends_at is None else self._begun_at

    def controls(self, room_bytes: int, now: int, *, alone: bool) -> bytes:
        """Give the channel back."""
        if not alone or self._ends_at is None:
            return b""
        self._ends_at = None
        return Turn(NOBODY, 0).encode()

    def handle_timeout(self, now: int) -> None:
        """Treat an end that was missed, because the link was busy, as the end."""
        if self._ends_at is not None and now > self._ends_at:
            self._ends_at = None

    def handle_control(
        self, source: int, control: AccessControl, started_at: int, error_ns: int, now: int
    ) -> None:
        """Begin this node's turn.

        The frame may be for all: a turn is for the node that it names.
        """
        if not isinstance(control, Turn) or source != self.answers_to:
            return
        if control.node == self._address:
            self._begun_at = now
            self._ends_at = now + control.span_ns


class Poller(TurnAccess):
    """The node that polls."""

    speaks = True

    def __init__(self, spec: PollingSpec, times: _Times) -> None:
        self._nodes = spec.nodes
        self._times = times
        self._phase = _Phase.REST
        self._until = 0
        self._next = 0
        self._was_used = False
        self._heard = 0
        self.answers_to = self._nodes[0]

    def ready_at(self, wanted: Wanted, now: int) -> int | None:
        """Return the due instant if the channel is the poller's own, else None."""
        ready_at = wanted.earliest(now)
        if self._phase is _Phase.REST:
            return ready_at
        if self._phase is _Phase.OWN and ready_at + self._times.largest_ns <= self._until:
            return ready_at
        return None

    def speak_at(self, now: int) -> int | None:
        """Return when to poll the next node, or when a node's turn ends."""
        return now if self._phase in (_Phase.OWN, _Phase.ASK) else self._until

    def controls(self, room_bytes: int, now: int, *, alone: bool) -> bytes:
        """Give the next node its turn."""
        if not alone:
            return b""
        self.handle_timeout(now)
        if self._phase not in (_Phase.OWN, _Phase.ASK):
            return b""
        self._phase = _Phase.HEAR
        self._heard = 0
        self._until = now + self._times.giving_back_ns + self._times.turn_ns + self._times.ways_ns
        return Turn(self._nodes[self._next], self._times.turn_ns).encode()

    def handle_transmitted(self, now: int) -> None:
        """Begin a round with an own frame at rest."""
        if self._phase is _Phase.REST:
            self._begin(now)
        if self._phase is _Phase.OWN:
            self._was_used = True

    def handle_heard(self, source: int, now: int) -> None:
        """Record that a node transmits."""
        self._heard += 1

    def handle_timeout(self, now: int) -> None:
        """End the rest, or another node's turn."""
        if self._until > now:
            return
        if self._phase is _Phase.HEAR:
            self._advance(now)
        elif self._phase is _Phase.REST:
            self._phase = _Phase.ASK

    def handle_control(
        self, source: int, control: AccessControl, started_at: int, error_ns: int, now: int
    ) -> None:
        """Record that the channel was given back."""
        if (
            isinstance(control, Turn)
            and control.node == NOBODY
            and self._phase is _Phase.HEAR
            and source == self._nodes[self._next]
        ):
            self._heard -= 1
            self._advance(now)

    def _advance(self, now: int) -> None:
        """Poll the next node, or end the round."""
        self._was_used = self._was_used or self._heard > 0
        self._next = (self._next + 1) % len(self._nodes)
        self.answers_to = self._nodes[self._next]
        if self._next:
            self._phase = _Phase.ASK
        elif self._was_used:
            self._begin(now)
        else:
            self._phase = _Phase.REST
            self._until = now + self._times.idle_ns

    def _begin(self, now: int) -> None:
        self._phase = _Phase.OWN
        self._until = now + self._times.turn_ns
        self._was_used = False
