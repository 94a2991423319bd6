"""The runs of others, as far as they can be heard: when they pause, and whether there are any.

A node in a run announces its pauses, and keeps the rhythm until it has been silent for long
(`zacoustic.core.schedule.access.listening`). Whoever has heard one announcement knows all pauses
behind it. Between modems that hand over nothing that is for others, a third node hears little else
of the run than sound: so sound keeps a rhythm alive, and a row of sounds of an unknown one shows
that there is something to listen to.
"""

from typing import Final

import msgspec

from zacoustic.core.base.clock import NS_PER_S, seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities

RUN_LIMIT_NS: Final = 4 * NS_PER_S
"""Longest time that a node transmits without a pause, ns; a single frame may be longer."""
_LEAST_PAUSE_NS: Final = NS_PER_S * 45 // 100
_SHORT_FRAME_BYTES: Final = 8
_RANGING_NS: Final = NS_PER_S // 8
"""The distance may be known to 90 m, the way there and back."""
_LONG_RUN_FRAMES: Final = 3
"""A run of so many frames is still one when it begins more than a frame late."""
_REMEMBERED_PERIODS: Final = 16
"""For so many runs sound is taken for that of a node whose pauses are known, without a frame."""
MARGIN_NS: Final = NS_PER_S // 20
"""A frame is aimed at so much behind the beginning of a pause, and to end as much before its
end."""


class Rhythm(msgspec.Struct):
    """What is known of the pauses of another node."""

    pause_at: int
    """Beginning of one of its pauses, in our time, at its place, ns."""
    way_ns: int
    """Propagation delay to it, ns."""
    frame_at: int
    """When the last frame of it arrived, ns."""
    heard_at: int
    """When it was last heard, ns; maybe as sound only, of a frame for somebody else."""
    is_listening: bool = False
    """It has said that it listens until it is answered."""


class OtherRuns:
    """What is heard of the runs and pauses of others, and how long such are on a link.

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
        """Length of the pause, ns."""
        longer_ns = short_ns if self._frames >= _LONG_RUN_FRAMES else 0
        self._patience_ns = largest_ns + longer_ns
        """How much longer than its pause a node listens when it is spoken to, at most, ns."""
        self._detour_ns = 2 * seconds_to_ns(capabilities.propagation_s)
        """So much earlier what arrives in a pause of one node may arrive at another one, ns."""
        self._latest_ns = self._patience_ns + gap_ns
        """How much later than it was to begin a run begins, and is still one of a rhythm, ns."""
        self._keeps_phase = self._frames >= _LONG_RUN_FRAMES
        """After a silence the next run begins where the rhythm says, or within that run: where runs
        are of one frame or two, to wait for that would cost too much."""
        self._late_ns = max(0, min(MARGIN_NS, max(RUN_LIMIT_NS, largest_ns) - self._run_ns))
        """How much later than it was to end a run may end, for a device that is a little slow."""
        self._rhythms: dict[int, Rhythm] = {}
        self._senses_carrier = capabilities.senses_carrier
        self._sound_tells = capabilities.senses_carrier and capabilities.addressed
        """What is heard may be a frame for somebody else, which is not handed over."""
        self._busy_since: int | None = None
        self._run_heard_until = -1
        """A run goes on until then, of a node whose pauses are not known, ns."""
        self._full_run_heard_until = -1
        """One of largest frames was heard not long before, ns."""
        self._listener_heard_until = -1
        """Somebody has a run to go on with, and listens for an answer to it, at the latest until
        then, ns."""
        self._listens_since = 0
        """Since when it is listened to, ns."""
        self._listened = 0
        """How often that was in vain."""

    @property
    def period_ns(self) -> int:
        """A run and its pause, ns."""
        return self._run_ns + self.pause_ns

    def hears_run(self, at: int) -> bool:
        """Tell whether somebody is in a run, or between two, as far as it can be heard."""
        rhythms = self._rhythms.values()
        is_known = any(at - self._heard_at(each, at) <= self._memory_ns for each in rhythms)
        return is_known or at <= max(self._run_heard_until, self._listener_heard_until)

    def detour_ns(self, destination: int, at: int) -> int:
        """Return how much earlier what is for a pause of others may arrive at a node, ns.

        As long as it goes on being sent they are silent, and in the end it is heard there.
        """
        others = any(
            each != destination and rhythm in self._active(at)
            for each, rhythm in self._rhythms.items()
        )
        return self._detour_ns if others else 0

    def heard_frame(self, source: int, airtime_ns: int, now: int) -> None:
        """A frame of `source` has arrived: its run goes on.

        If it was sent in what was taken for a pause, the rhythm is another one meanwhile, and it is
        forgotten: whoever aims at old pauses is deaf, time and again, while the new ones are told.
        """
        rhythm = self._rhythms.get(source)
        if rhythm is None:
            return
        if now - self._heard_at(rhythm, now) > self._memory_ns + airtime_ns:
            del self._rhythms[source]  # it was silent for so long that it begins another one
            return
        rhythm.frame_at = rhythm.heard_at = now
        middle_at = rhythm.pause_at + rhythm.way_ns + self.pause_ns // 2
        since_ns = now - middle_at
        if since_ns >= 0 and since_ns % self.period_ns < airtime_ns:
            del self._rhythms[source]

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
        self._rhythms[source] = Rhythm(started_at + begins_in_ns, way_ns, now, now)
        self._run_heard_until = -1

    def heard_listening(self, source: int, *, listens: bool, now: int) -> None:
        """`source` has said that it listens now until it is answered, or that it does not."""
        rhythm = self._rhythms.get(source)
        if rhythm is not None:
            rhythm.is_listening = listens
        if listens:
            self._run_heard_until = -1
            self._listener_heard_until = now + self._memory_ns
        else:
            is_sound = self._senses_carrier  # a frame of it that is lost is heard as well
            self._heard_run(
                now + (self._unit_ns if is_sound else self.period_ns) + self.pause_ns, now
            )

    def forget(self, source: int) -> None:
        """Nothing is known of the rhythm of a node."""
        self._rhythms.pop(source, None)

    # Below the methods above

    def _heard_run(self, until: int, now: int) -> None:
        """Somebody is in a run, and will be heard before an instant if that goes on."""
        if self._run_heard_until < now:
            self._listens_since = max(self._listens_since, now)
        self._run_heard_until = max(self._run_heard_until, until)

    @property
    def _memory_ns(self) -> int:
        """After so long a silence there is no rhythm any more, ns."""
        return self.period_ns + self._latest_ns

    def _active(self, at: int) -> list[Rhythm]:
        """Rhythms of nodes that still speak at an instant; it may be one to come."""
        return [
            each
            for each in self._rhythms.values()
            if not each.is_listening and at - self._heard_at(each, at) <= self._memory_ns
        ]

    def _heard_at(self, rhythm: Rhythm, at: int) -> int:
        """When a node was last heard, ns: now, if somebody is, and it may be that one."""
        is_sound = self._sound_tells and self._busy_since is not None
        is_fresh = at - rhythm.frame_at <= _REMEMBERED_PERIODS * self.period_ns
        return at if is_sound and is_fresh else rhythm.heard_at

    def _opens_at(self, rhythm: Rhythm, at: int) -> int:
        """When a frame has to start to arrive in a pause: last time not after `at`, or next."""
        first_at = rhythm.pause_at - rhythm.way_ns + MARGIN_NS
        periods = max(0, (at - first_at) // self.period_ns)
        return first_at + periods * self.period_ns
