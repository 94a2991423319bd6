"""Listen windows: whoever speaks for long stops now and then, so that others reach it.

A half-duplex modem that sends is deaf. A node that sends one frame behind the other (an object, a
thousand queued samples) would not hear an emergency, nor the acknowledgement that it waits for. So
no node transmits for more than four seconds without a pause, which holds a short frame and some
uncertainty about the distance; frames in a row are a *run*, and runs and pauses alternate in a
fixed rhythm as long as there is something to send.

The delay of sound makes the rhythm necessary. At 1 km a frame that was sent when the pause was
heard arrives 1.3 s after it began, when the next run is under way. The other node must start
*before* it hears the pause, by the way there and back. So the pause is announced: a TURN for
anybody says in how long it begins, seen from the beginning of the frame, and whoever has heard it
computes the later ones from the same rhythm. It costs three bytes in the second frame of a first
run and in one of every third run, and only while so much waits that the run will be full. Payloads
that fill a frame leave no room for it; who makes them can announce the pause in a way of its own
and hand it to `heard_pause` at the other end.

While another node is in a run, a frame of ours starts so that it arrives in the next pause, and is
to be short (`comfort_ns`): a longer one goes nevertheless, and the other side, when it senses a
carrier, stays quiet until its end.

`exclusive` switches the own pauses off, for a transfer that is agreed to have the channel alone.
Policies with turns (TDMA, polling) need no windows: in the turns of others this node is silent.
"""

from typing import Final

import msgspec

from zacoustic.core.access.controls import ANYBODY, TURN_BYTES, Turn
from zacoustic.core.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.linktypes import LinkCapabilities

RUN_LIMIT_NS: Final = 4 * NS_PER_S
"""Longest time that a node transmits without a pause, ns; a single frame may be longer."""
_LEAST_PAUSE_NS: Final = NS_PER_S * 45 // 100
_SHORT_FRAME_BYTES: Final = 8
_RANGING_NS: Final = NS_PER_S // 8
"""The distance may be known to 90 m, the way there and back."""
ANNOUNCED_RUNS: Final = 3
"""Runs for which one announcement holds."""
_BACKLOG_FRAMES: Final = 2
"""Frames that must be to send behind the pause, so that it is one."""
_MARGIN_NS: Final = NS_PER_S // 20
"""A frame is aimed at so much behind the beginning of a pause, and to end as much before its
end."""


class _Rhythm(msgspec.Struct):
    """What is known of the pauses of another node."""

    pause_at: int
    """Beginning of one of its pauses, in our time, at its place, ns."""
    way_ns: int
    """Propagation delay to it, ns."""
    heard_at: int
    """When the last frame of it arrived, ns."""


class Listening:
    """Pauses of this node and of the others.

    Args:
        capabilities: The link's.
    """

    def __init__(self, capabilities: LinkCapabilities) -> None:
        self.exclusive = False
        """A transfer has the channel alone: no pauses."""
        largest_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
        self._largest_ns = largest_ns
        gap_ns = seconds_to_ns(capabilities.gap_s)
        self._unit_ns = largest_ns + gap_ns
        self._frames = max(1, (RUN_LIMIT_NS + gap_ns) // self._unit_ns)
        self._run_ns = self._frames * self._unit_ns - gap_ns
        self._short_ns = short_ns = capabilities.airtime_ns(
            min(_SHORT_FRAME_BYTES, capabilities.mtu_bytes)
        )
        self.pause_ns = max(_LEAST_PAUSE_NS, short_ns + gap_ns + _RANGING_NS)
        """Length of the pause, ns."""
        self._run_begun_at = 0
        self._last_ended_at: int | None = None
        self._runs_since_announcement = ANNOUNCED_RUNS
        self._rhythms: dict[int, _Rhythm] = {}
        self._busy_since: int | None = None

    @property
    def period_ns(self) -> int:
        """A run and its pause, ns."""
        return self._run_ns + self.pause_ns

    # This node

    def pauses_until(self, due_at: int, now: int, *, is_urgent: bool) -> int:
        """Return `due_at`, or the end of the own pause that a frame has to wait for, ns."""
        if self._last_ended_at is None or self.exclusive or is_urgent:
            return due_at
        at = max(due_at, now)
        paused_until = self._own_pause_end(at)
        return paused_until if paused_until > at else due_at

    def comfort_ns(self, now: int) -> int | None:
        """How long a frame that starts now had better be, at most, ns; None: no matter."""
        comforts = [
            opens_at + self.pause_ns - 2 * _MARGIN_NS - now
            for opens_at in (self._opens_at(each, now) for each in self._active(now))
            if opens_at <= now < opens_at + self.pause_ns
        ]
        return max(0, min(comforts)) if comforts else None

    def frames_before_pause(self, now: int) -> int:
        """How many of the largest frames, one that starts now included, go before the pause."""
        if not self._continues(now):
            return self._frames
        left_ns = self._run_begun_at + self._frames * self._unit_ns - now
        return max(1, left_ns // self._unit_ns)

    def controls(self, room_bytes: int, backlog_bytes: int, now: int) -> bytes:
        """Announce the pause, if that is worth it.

        Args:
            room_bytes: What the frame, which starts now, has left.
            backlog_bytes: All that waits, this frame's payload included.
            now: The instant.
        """
        if self.exclusive or room_bytes < TURN_BYTES or not self._follows(now):
            return b""
        begins_anew = not self._continues(now)
        told = self._runs_since_announcement + begins_anew < ANNOUNCED_RUNS
        full_frames = self.frames_before_pause(now) + _BACKLOG_FRAMES
        if told or backlog_bytes < full_frames * room_bytes:
            return b""
        self._runs_since_announcement = -begins_anew  # a new run is counted when it starts
        begun_at = now if begins_anew else self._run_begun_at
        return Turn(ANYBODY, begun_at + self._run_ns - now).encode()

    def handle_started(self, now: int) -> None:
        """An own frame is handed to the link."""
        if not self._continues(now):
            if self._follows(now):
                self._runs_since_announcement += 1
            else:
                self._runs_since_announcement = ANNOUNCED_RUNS
            self._run_begun_at = now

    def handle_transmitted(self, started_at: int, ended_at: int) -> None:
        """That frame has ended; it began when the device was ready."""
        if not self._continues(started_at):
            self._run_begun_at = started_at
        self._last_ended_at = ended_at

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Somebody else began to be heard, or is not heard any more."""
        self._busy_since = now if busy else None

    # Others

    def invited_at(self, at: int) -> int | None:
        """Return when to start, not before `at`, to arrive in the pauses of those in a run, ns.

        None when nobody is known to be in one.
        """
        invited_at: int | None = None
        for rhythm in self._active(at):
            opens_at = self._opens_at(rhythm, at)
            if at > opens_at + self.pause_ns - 2 * _MARGIN_NS - self._short_ns:
                opens_at += self.period_ns
            if opens_at - rhythm.heard_at <= self.period_ns + self._unit_ns + rhythm.way_ns:
                invited_at = max(invited_at or at, opens_at)
        return invited_at

    def heard_frame(self, source: int, now: int) -> None:
        """A frame of `source` has arrived: its run goes on."""
        rhythm = self._rhythms.get(source)
        if rhythm is not None:
            rhythm.heard_at = now

    def heard_pause(
        self, source: int, begins_in_ns: int, started_at: int, way_ns: int, now: int
    ) -> None:
        """`source` announced a pause.

        Args:
            source: Who said it.
            begins_in_ns: When it begins, seen from the beginning of the frame, ns.
            started_at: Instant at which the frame began to leave there, in our time, ns.
            way_ns: Propagation delay from there, ns.
            now: The instant.
        """
        self._rhythms[source] = _Rhythm(started_at + begins_in_ns, way_ns, now)

    def heard_end(self, source: int) -> None:
        """`source` has said that it listens now until it is answered: its rhythm is over."""
        self._rhythms.pop(source, None)

    # Below the methods above

    def _continues(self, now: int) -> bool:
        """Whether a frame that starts now would be in the run that there is."""
        return self._last_ended_at is not None and now - self._last_ended_at < self.pause_ns

    def _follows(self, now: int) -> bool:
        """Whether a frame that starts now comes so soon behind the last that there is a rhythm."""
        if self._last_ended_at is None:
            return False
        return now - self._last_ended_at < self.pause_ns + self._unit_ns

    def _own_pause_end(self, at: int) -> int:
        """End of the own pause that has to come before a frame at `at`, ns; or earlier."""
        assert self._last_ended_at is not None
        if not self._continues(at):
            # Whoever was invited to speak, and is heard, is heard out.
            if (
                self._busy_since is not None
                and self._busy_since - self._last_ended_at < self.pause_ns
            ):
                return self._busy_since + self._largest_ns
            return at
        if at + self._largest_ns <= self._run_begun_at + self._run_ns:
            return at
        pause_at = max(self._last_ended_at, self._run_begun_at + self._run_ns)
        if self._runs_since_announcement >= ANNOUNCED_RUNS:
            pause_at = self._last_ended_at  # nobody was told when
        return pause_at + self.pause_ns

    def _active(self, at: int) -> list[_Rhythm]:
        """Rhythms of nodes that still speak; the others are forgotten."""
        for source, rhythm in list(self._rhythms.items()):
            if at - rhythm.heard_at > ANNOUNCED_RUNS * self.period_ns:
                del self._rhythms[source]
        limit_ns = self.period_ns + self._unit_ns
        return [each for each in self._rhythms.values() if at - each.heard_at <= limit_ns]

    def _opens_at(self, rhythm: _Rhythm, at: int) -> int:
        """When a frame has to start to arrive in a pause: last time not after `at`, or next."""
        first_at = rhythm.pause_at - rhythm.way_ns + _MARGIN_NS
        periods = max(0, (at - first_at) // self.period_ns)
        return first_at + periods * self.period_ns
