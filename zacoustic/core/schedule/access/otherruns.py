"""The runs of other nodes, as far as they can be heard: their pauses, and whether there are any.

A node in a run announces its pauses, and keeps the rhythm until it has been silent for long
(`zacoustic.core.schedule.access.listening`). A node that has heard one announcement knows all later
pauses. Where modems do not hand over frames for other nodes, a third node hears little of the run
but sound. So sound keeps a rhythm alive, and a row of sounds of an unknown rhythm shows that there
is something to listen to.
"""

from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities

RUN_LIMIT_NS: Final = 4 * NS_PER_S
"""The longest time that a node transmits without a pause, ns; a single frame may be longer."""
_LEAST_PAUSE_NS: Final = NS_PER_S * 45 // 100
_SHORT_FRAME_BYTES: Final = 8
_RANGING_NS: Final = NS_PER_S // 8
"""The distance may be wrong by 90 m, there and back."""
_LONG_RUN_FRAMES: Final = 3
"""A run of at least this many frames is still one when it begins more than a frame late."""
_REMEMBERED_PERIODS: Final = 16
"""For how many periods sound is attributed to a node whose pauses are known, without a frame."""
MARGIN_NS: Final = NS_PER_S // 20
"""A frame is aimed this long after the start of a pause, and must end as long before the pause's
end."""


class Rhythm(msgspec.Struct):
    """What is known of another node's pauses."""

    pause_at: int
    """Start of one of its pauses, in this node's time, at its place, ns."""
    way_ns: int
    """Propagation delay to it, ns."""
    frame_at: int
    """Instant at which its last frame arrived, ns."""
    heard_at: int
    """Instant at which it was last heard, ns, perhaps only as the sound of a frame for another
    node."""
    is_listening: bool = False
    """Whether it has said that it listens until it is answered."""


class OtherRuns:
    """The runs and pauses of other nodes, and how long they are on a link.

    Args:
        capabilities: The link's.
    """

    def __init__(self, capabilities: LinkCapabilities) -> None:
        largest_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
        self._largest_ns = largest_ns
        self._gap_ns = gap_ns = seconds_to_ns(capabilities.gap_s)
        self._unit_ns = largest_ns + gap_ns
        self._frames = max(1, (RUN_LIMIT_NS + gap_ns) // self._unit_ns)
        self._run_ns = self._frames * self._unit_ns - gap_ns
        self._short_ns = short_ns = capabilities.airtime_ns(
            min(_SHORT_FRAME_BYTES, capabilities.mtu_bytes)
        )
        self.pause_ns = max(_LEAST_PAUSE_NS, short_ns + gap_ns + _RANGING_NS)
        """Length of a pause, ns."""
        longer_ns = short_ns if self._frames >= _LONG_RUN_FRAMES else 0
        self._patience_ns = largest_ns + longer_ns
        """How much longer than its pause a node listens, at most, when it is addressed, ns."""
        self._detour_ns = 2 * seconds_to_ns(capabilities.propagation_s)
        """How much earlier a frame for the pause of one node may arrive at another one, ns."""
        self._latest_ns = self._patience_ns + gap_ns
        """How late a run may begin and still belong to a rhythm, ns."""
        self._keeps_phase = self._frames >= _LONG_RUN_FRAMES
        """Whether the next run after a silence begins where the rhythm says, or within that run:
        with runs of one or two frames, waiting for that would cost too much."""
        self._late_ns = max(0, min(MARGIN_NS, max(RUN_LIMIT_NS, largest_ns) - self._run_ns))
        """How late a run may end, for a device that is a little slow, ns."""
        self._rhythms: dict[int, Rhythm] = {}
        self._senses_carrier = capabilities.senses_carrier
        self._sound_tells = capabilities.senses_carrier and capabilities.addressed
        """Whether a sound may be a frame for another node that the modem does not hand over."""
        self._busy_since: int | None = None
        self._run_heard_until = -1
        """Instant until which a run goes on of a node whose pauses are unknown, ns."""
        self._full_run_heard_until = -1
        """Instant until which a run of largest frames counts as heard lately, ns."""
        self._listener_heard_until = -1
        """Latest instant until which a node listens for an answer before its run continues, ns."""
        self._listens_since = 0
        """Instant since which this node listens to the run, ns."""
        self._listened = 0
        """How often that was in vain."""

    @property
    def period_ns(self) -> int:
        """Length of a run and its pause, ns."""
        return self._run_ns + self.pause_ns

    def hears_run(self, at: int) -> bool:
        """Return whether a node is in a run or between two, as far as it can be heard."""
        rhythms = self._rhythms.values()
        is_known = any(at - self._heard_at(each, at) <= self._memory_ns for each in rhythms)
        return is_known or at <= max(self._run_heard_until, self._listener_heard_until)

    def detour_ns(self, destination: int, at: int) -> int:
        """Return how much earlier a frame for another node's pause may arrive at a node, ns.

        While it is being sent the other nodes are silent, and in the end it is heard there.
        """
        others = any(
            each != destination and rhythm in self._active(at)
            for each, rhythm in self._rhythms.items()
        )
        return self._detour_ns if others else 0

    def heard_frame(self, source: int, airtime_ns: int, now: int) -> None:
        """Record a frame from `source`: its run continues.

        If it was sent in what was assumed to be a pause, the rhythm has changed, and it is
        forgotten: a node that aims at old pauses is deaf, time and again, while the new ones are
        announced.
        """
        rhythm = self._rhythms.get(source)
        if rhythm is None:
            return
        if now - self._heard_at(rhythm, now) > self._memory_ns + airtime_ns:
            del self._rhythms[source]  # it was silent for so long that it begins a new rhythm
            return
        rhythm.frame_at = rhythm.heard_at = now
        middle_at = rhythm.pause_at + rhythm.way_ns + self.pause_ns // 2
        since_ns = now - middle_at
        if since_ns >= 0 and since_ns % self.period_ns < airtime_ns:
            del self._rhythms[source]

    def heard_pause(
        self, source: int, begins_in_ns: int, started_at: int, way_ns: int, now: int
    ) -> None:
        """Record an announced pause of `source`.

        Args:
            source: The node.
            begins_in_ns: Start of the pause, counted from the start of the frame, ns.
            started_at: Instant at which the frame began to leave there, in this node's time, ns.
            way_ns: Propagation delay from there, ns.
            now: The instant.
        """
        self._rhythms[source] = Rhythm(started_at + begins_in_ns, way_ns, now, now)
        self._run_heard_until = -1

    def heard_listening(self, source: int, *, listens: bool, now: int) -> None:
        """Record whether `source` says that it listens now until it is answered."""
        rhythm = self._rhythms.get(source)
        if rhythm is not None:
            rhythm.is_listening = listens
        if listens:
            self._run_heard_until = -1
            self._listener_heard_until = now + self._memory_ns
        else:
            is_sound = self._senses_carrier  # a lost frame is heard as sound
            self._heard_run(
                now + (self._unit_ns if is_sound else self.period_ns) + self.pause_ns, now
            )

    def forget(self, source: int) -> None:
        """Forget the rhythm of a node."""
        self._rhythms.pop(source, None)

    # Below the methods above

    def _heard_run(self, until: int, now: int) -> None:
        """Record a run that, if it continues, will be heard again before an instant."""
        if self._run_heard_until < now:
            self._listens_since = max(self._listens_since, now)
        self._run_heard_until = max(self._run_heard_until, until)

    @property
    def _memory_ns(self) -> int:
        """The silence after which a rhythm has ended, ns."""
        return self.period_ns + self._latest_ns

    def _active(self, at: int) -> list[Rhythm]:
        """Return the rhythms of nodes that still transmit at an instant, which may lie ahead."""
        return [
            each
            for each in self._rhythms.values()
            if not each.is_listening and at - self._heard_at(each, at) <= self._memory_ns
        ]

    def _heard_at(self, rhythm: Rhythm, at: int) -> int:
        """Return when a node was last heard, ns; `at` if a present sound may come from it.

        Only the sounds of a full run keep a rhythm: in a busy fleet somebody is always heard, and
        every node would wait for the pauses of all others.
        """
        is_run = self._sound_tells and at <= self._full_run_heard_until
        is_sound = is_run and self._busy_since is not None
        is_fresh = at - rhythm.frame_at <= _REMEMBERED_PERIODS * self.period_ns
        return at if is_sound and is_fresh else rhythm.heard_at

    def _opens_at(self, rhythm: Rhythm, at: int) -> int:
        """Return the last start not after `at`, or else the first, to arrive in a pause, ns."""
        first_at = rhythm.pause_at - rhythm.way_ns + MARGIN_NS
        periods = max(0, (at - first_at) // self.period_ns)
        return first_at + periods * self.period_ns
