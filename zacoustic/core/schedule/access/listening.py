"""Listen windows: a node that transmits for long pauses regularly, so that others reach it.

A half-duplex modem is deaf while it transmits. A node that sends one frame behind the other (an
object, a thousand queued samples) would not hear an emergency, nor the acknowledgement that it
waits for. So no node transmits for more than four seconds without a pause that holds a short frame
and some uncertainty about the distance. Frames in a row are a *run*; runs and pauses alternate in a
fixed rhythm as long as there is something to send.

The delay of sound makes the rhythm necessary. At 1 km a frame that was sent when the pause was
heard arrives 1.3 s after it began, when the next run is under way. The other node must start
*before* it hears the pause, by the round trip. So the pause is announced: a TURN for anybody says
when it begins, counted from the beginning of the frame, and a node that has heard it computes the
later pauses from the same rhythm. The TURN costs three bytes in the second frame of a first run and
in one of every third run, and only while so much waits that the run will be full. Payloads that
fill a frame leave no room for it; their mechanism can announce the pause in its own way and hand it
to `heard_pause` at the other end; `end_run` tells this one.

An announced rhythm is kept until nothing was transmitted for more than a period: while an answer is
awaited it goes on, and the next run begins in its midst. A smaller frame, such as a report among
the fragments of a photo, leaves no room for a whole number of fragments: the last one waits until
it ends with the run, so that it can announce the pause (`sends_full`). If none fits, the pause is
longer: it begins when the last frame ends, and ends as planned. Such a frame does not announce a
pause (`frames_before_pause`).

A node that hears a run and does not know its pauses has to hear an announcement, and does not
transmit meanwhile (`listens_until`). If none came of a run of largest frames, where carriers are
sensed, copies of an emergency go for a whole period, whatever is heard: one of them is in the pause
(`search_ns`). What is heard of others is in `zacoustic.core.schedule.access.otherruns`.

While another node is in a run, a frame of this node starts so that it arrives in the next pause,
and shall be short (`comfort_ns`); a longer one goes nevertheless. Any one frame may be lost, and
the next pause is four seconds away. So where carriers are sensed, the pausing node hears out what
begins in its pause. If no frame came of it, it waits for another one to follow at once, again and
again, for the airtime of the largest frame and the round trip (`_heard_out_until`). A node with
something urgent counts on that and sends a few copies in a row (`is_heard_out`,
`zacoustic.core.schedule.copies`). A frame for another node than the pausing one may arrive too
early by the round trip, so the row goes on for that much longer (`detour_ns`). A pause that is
longer because of that costs a frame, but not the rhythm.

`exclusive` switches the own pauses off, for a transfer that has the channel alone by agreement.
Policies with turns (TDMA, polling) need no windows: in the turns of others this node is silent. Nor
do devices that hear while they send; DESERT counts as one, since its airtime is mostly waiting,
with sound for some hundredths of it.
"""

from typing import Final

from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.schedule.access.otherruns import MARGIN_NS, OtherRuns
from zacoustic.core.wire.access import ANYBODY, TURN_BYTES, Turn

ANNOUNCED_RUNS: Final = 3
"""Runs for which one announcement holds."""
_BACKLOG_FRAMES: Final = 2
"""Frames that must wait behind the pause to make it worth while."""
_LISTENED_PERIODS: Final = 2
"""An announcement is awaited for this many runs and pauses: at 40 % loss one comes in 84 of 100
cases."""
_LONG_ROW_FRAMES: Final = 3
"""This many of the largest frames in a row are a run that has pauses."""
_LISTENED_PERIODS_OF_SEARCH: Final = 1
"""The same before something urgent that finds the pause by itself."""
_GOLDEN_RATIO: Final = 0.618


class Listening(OtherRuns):
    """Pauses of this node and of the others.

    Args:
        capabilities: The link's.
    """

    def __init__(self, capabilities: LinkCapabilities) -> None:
        super().__init__(capabilities)
        self.sends_full = False
        """The waiting payloads fill frames, and announce a pause if one ends with the run."""
        self.exclusive = False
        """A transfer has the channel alone: no pauses."""
        self._run_begun_at = 0
        self._last_ended_at: int | None = None
        self._is_announced = False
        """Other nodes were told of the rhythm since it began."""
        self._runs_since_announcement = ANNOUNCED_RUNS
        self._announces = False
        self._ends_run = False
        self._row_since: int | None = None
        """Instant since when others are heard, one sound directly behind the other, ns."""
        self._row_ends_at: int | None = None
        """Instant until which a sound is awaited behind one that gave no frame, ns."""
        self._is_understood = False
        """The sound that is, or was, heard gave a frame."""
        self._burst_at: int | None = None
        """Start of the first own frame of those that followed each other at once."""
        self._searches = False
        """It went into a run whose pauses are not known."""
        self._largest_in_row = 0
        """Sounds as long as a largest frame, one directly behind the other."""
        self._largest_ended_at = 0
        """End of the last one, ns."""

    # This node

    def pauses_until(self, due_at: int, now: int, *, is_urgent: bool) -> int:
        """Return `due_at`, or the end of the own pause that a frame has to wait for, ns."""
        if self._last_ended_at is None or self.exclusive or is_urgent:
            return due_at
        at = max(due_at, now)
        paused_until = self._own_pause_end(at)
        return paused_until if paused_until > at else due_at

    def comfort_ns(self, now: int, *, is_copy: bool = False) -> int | None:
        """Return the longest desirable airtime of a frame that starts now, ns; None: any.

        Args:
            now: The instant.
            is_copy: It follows itself, maybe to find a pause.
        """
        comforts = [
            opens_at + self.pause_ns - 2 * MARGIN_NS - now
            for opens_at in (self._opens_at(each, now) for each in self._active(now))
            if opens_at <= now < opens_at + self.pause_ns
        ]
        if comforts:
            return max(0, min(comforts))
        is_short = self._is_in_pause(now) or (is_copy and self._finds_pause(now))
        return 0 if is_short else None

    def frames_before_pause(self, now: int) -> int:
        """Return how many of the largest frames go before the pause, one that starts now included.

        1 only if others may expect the pause behind this frame, and behind all that follow.
        """
        if not self._continues(now):
            begin_at = self._told_begin_at(now)
            return self._frames if begin_at is None else self._fitting(begin_at, now)
        return self._fitting(self._run_begun_at, now)

    def ends_run_now(self, now: int) -> bool:
        """Tell whether a largest frame that starts now is the last of several in a run."""
        has_pauses = self._frames > 1 and not self.exclusive
        return has_pauses and self.frames_before_pause(now) == 1

    def end_run(self) -> None:
        """Take note: the frame that is about to start announces a pause."""
        self._ends_run = True

    def controls(
        self, room_bytes: int, backlog_bytes: int, now: int, *, has_object: bool = False
    ) -> bytes:
        """Return the announcement of the pause, if it is worth it.

        Args:
            room_bytes: What the frame, which starts now, has left.
            backlog_bytes: All that waits, this frame's payload included.
            now: The instant.
            has_object: An object is being sent. Its fragments have no room for this, so whatever
                has says it, in every run.
        """
        if self.exclusive or room_bytes < TURN_BYTES or not self._follows(now):
            return b""
        begins_anew = not self._continues(now)
        runs = 1 if has_object else ANNOUNCED_RUNS
        told = self._runs_since_announcement + begins_anew < runs
        full_frames = self.frames_before_pause(now) + _BACKLOG_FRAMES
        if told or (backlog_bytes < full_frames * room_bytes and not has_object):
            return b""
        begin_at = self._told_begin_at(now)
        begun_at = self._run_begun_at
        if begins_anew:
            begun_at = now if begin_at is None else begin_at
        self._announces = True
        return Turn(ANYBODY, begun_at + self._run_ns - now).encode()

    def handle_started(self, now: int) -> None:
        """Take note of an own frame that goes to the link."""
        if not self._follows_at_once(now):
            self._burst_at = now
            self._searches = self._hears_full_run(now) and not self._active(now)
        if not self._continues(now):
            begin_at = self._told_begin_at(now)
            if self._follows(now):
                self._runs_since_announcement += 1
            else:
                self._runs_since_announcement, self._is_announced = ANNOUNCED_RUNS, False
            self._run_begun_at = now if begin_at is None else begin_at
        if self._announces:
            self._announces, self._is_announced = False, True
            self._runs_since_announcement = 0

    def handle_transmitted(self, started_at: int, ended_at: int) -> None:
        """Take note of its end; it began when the device was ready."""
        is_told = self._is_told(started_at)
        if not is_told and not self._continues(started_at):
            self._run_begun_at = started_at
        self._last_ended_at = self._listens_since = ended_at
        self._listened += 1
        if self._ends_run:
            self._ends_run = False
            if not is_told:
                self._run_begun_at = ended_at - self._run_ns
            self._is_announced = True
            self._runs_since_announcement = 0

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Another node began to be heard, or is not heard any more."""
        if busy:
            if self._busy_since is None:
                self._is_understood = False
            is_next = self._row_ends_at is not None and now <= self._row_ends_at
            if self._row_since is None or not (is_next or self._busy_since is not None):
                self._row_since = now
            is_run = now - self._row_since >= self._largest_ns
            if is_run or now <= self._run_heard_until:
                self._heard_run(now + self._unit_ns + self.pause_ns + self._latest_ns, now)
            self._busy_since = now
        elif self._busy_since is not None:
            for rhythm in self._active(now):
                rhythm.heard_at = self._heard_at(rhythm, now)
            self._heard_sound(self._busy_since, now)
            self._busy_since = None
            self._row_ends_at = now if self._is_understood else now + self._gap_ns + 2 * MARGIN_NS

    # Others

    def invited_at(self, at: int, *, follows: bool = False) -> int | None:
        """Return when to start, not before `at`, to arrive in the pauses of those in a run, ns.

        None when nobody is known to be in one.

        Args:
            at: The instant.
            follows: It may follow at once what was sent into a pause.
        """
        if follows and self.is_heard_out(at):
            return at
        invited_at: int | None = None
        for rhythm in self._active(at):
            opens_at = self._opens_at(rhythm, at)
            if at > opens_at + self._last_ns:
                opens_at += self.period_ns
            if opens_at - self._heard_at(rhythm, at) <= self._memory_ns + rhythm.way_ns:
                invited_at = max(invited_at or at, opens_at)
        return invited_at

    def listens_until(self, at: int, *, is_urgent: bool, follows: bool) -> int:
        """Return until when to listen for an announcement before a frame starts, ns; or `at`.

        A node that transmits into a run is not heard, and does not hear when it ends. But a run may
        be one that is never announced, so the wait is bounded.

        Args:
            at: When the frame is to start.
            is_urgent: What is said is; else an own run goes on.
            follows: It may follow at once what was sent last.
        """
        goes_on = self._follows_at_once(at) if follows else not is_urgent and self._follows(at)
        if at > self._run_heard_until or goes_on or self._active(at):
            return at
        # Never twice at the same place of a run: its announcement may be there.
        part = self._listened * _GOLDEN_RATIO % 1.0
        searches = is_urgent and self._hears_full_run(at)
        periods = _LISTENED_PERIODS_OF_SEARCH if searches else _LISTENED_PERIODS
        until = self._listens_since + round((periods + part) * self.period_ns)
        return max(at, min(until, self._run_heard_until + 1))

    def row_began_at(self, ended_at: int) -> int:
        """Return when the first of the own frames began that ended then in a row, ns."""
        return ended_at if self._burst_at is None else min(ended_at, self._burst_at)

    def next_invitation_at(self, now: int, not_before: int) -> int | None:
        """Return when to start, from `not_before` on, by what is known now; None: of nobody."""
        opens = [self._opens_at(each, not_before) for each in self._active(now)]
        last_ns, period_ns = self._last_ns, self.period_ns
        return max((at + (not_before > at + last_ns) * period_ns for at in opens), default=None)

    @property
    def search_ns(self) -> int:
        """How long copies of what was sent last go on to find a pause that is not known, ns."""
        return self.period_ns if self._searches else 0

    def is_heard_out(self, at: int) -> bool:
        """Tell whether the last frame went into a pause, and a short one may follow it there.

        So it may where the pause is not known, for one period: then it is in one of these frames.
        """
        return self._finds_pause(at) or self._is_in_pause(at)

    def heard_frame(self, source: int, airtime_ns: int, now: int) -> None:
        """A frame of `source` has arrived."""
        self._is_understood = True
        if self._busy_since is None and self._row_ends_at is not None:
            self._row_ends_at = min(self._row_ends_at, now)
        super().heard_frame(source, airtime_ns, now)

    # Below the methods above

    def _heard_sound(self, began_at: int, now: int) -> None:
        """A sound has ended: a few that are as long as a largest frame, in a row, are a full run.

        Shorter ones are not: copies in a row are such, and what is said in a busy fleet.
        """
        if abs(now - began_at - self._largest_ns) > 2 * MARGIN_NS:
            self._largest_in_row = 0
            return
        follows = began_at - self._largest_ended_at <= self._gap_ns + 2 * MARGIN_NS
        self._largest_in_row = self._largest_in_row + 1 if follows else 1
        self._largest_ended_at = now
        if self._largest_in_row >= min(_LONG_ROW_FRAMES, self._frames):
            self._full_run_heard_until = now + self._memory_ns

    def _hears_full_run(self, at: int) -> bool:
        """Whether somebody is in a run that has pauses, as far as it can be heard."""
        return self._senses_carrier and at <= min(self._run_heard_until, self._full_run_heard_until)

    def _continues(self, now: int) -> bool:
        """Whether a frame that starts now would be in the run that there is."""
        if self._last_ended_at is None:
            return False
        if self._is_told(now) and now < self._run_begun_at + self._run_ns:
            return True
        return now - self._last_ended_at < self.pause_ns

    def _is_told(self, now: int) -> bool:
        """Whether others know the rhythm of this node, and count on it."""
        return self._is_announced and self._follows(now)

    def _told_begin_at(self, now: int) -> int | None:
        """When the run began, or was to begin, in which a frame is now, ns; None: nobody knows."""
        if not self._is_told(now):
            return None
        periods = max(0, now - self._run_begun_at) // self.period_ns
        begin_at = self._run_begun_at + periods * self.period_ns
        return begin_at if self._keeps_phase or now < begin_at + self._latest_ns else None

    def _fitting(self, begun_at: int, now: int) -> int:
        """How many of the largest frames fit the rest of a run, as `frames_before_pause`."""
        left_ns = begun_at + self._frames * self._unit_ns - now
        count = max(1, (left_ns + self._late_ns) // self._unit_ns)
        is_early = left_ns - self._unit_ns > MARGIN_NS
        return count + 1 if count == 1 and is_early and self._is_told(now) else count

    def _follows(self, now: int) -> bool:
        """Whether a frame that starts now comes so soon behind the last that there is a rhythm."""
        if self._last_ended_at is None:
            return False
        if self._is_announced and self._keeps_phase:
            return now - self._last_ended_at <= self._memory_ns
        ended_at = self._last_ended_at
        if self._is_announced:
            ended_at = max(ended_at, self._run_begun_at + self._run_ns)
        return now - ended_at < self.pause_ns + self._latest_ns

    def _own_pause_end(self, at: int) -> int:
        """End of the own pause that has to come before a frame at `at`, ns; or earlier."""
        assert self._last_ended_at is not None
        if self._continues(at):
            run_ends_at = self._run_begun_at + self._run_ns
            if self._fits(run_ends_at, at):
                return max(at, self._last_at(run_ends_at, at))
            # Nobody counts on an end of the run that nobody was told.
            told_at = run_ends_at if self._is_told(at) else 0
            return max(self._last_ended_at, told_at) + self.pause_ns
        pause_until = self._last_ended_at + self.pause_ns
        begin_at = self._told_begin_at(at)
        if begin_at is not None:
            run_ends_at = begin_at + self._run_ns
            if at >= run_ends_at or (self._keeps_phase and not self._fits(run_ends_at, at)):
                return begin_at + self.period_ns
            pause_until = max(pause_until, begin_at)
            return max(self._heard_out_until(pause_until), self._last_at(run_ends_at, at))
        return self._heard_out_until(pause_until)

    def _last_at(self, run_ends_at: int, at: int) -> int:
        """When the last full frame of a told run starts, so that it ends with the run; or 0, ns.

        What else went in the run has left no room for a whole number of them. Behind this one the
        pause begins, and it says so.
        """
        last_at = run_ends_at - self._largest_ns
        is_last = self.sends_full and self._is_told(at) and at + self._unit_ns > last_at
        return last_at if is_last else 0

    def _fits(self, run_ends_at: int, at: int) -> bool:
        """Whether the largest frame may start then, in a run that ends or was to end so."""
        return at + self._largest_ns <= run_ends_at + self._late_ns

    def _heard_out_until(self, pause_until: int) -> int:
        """Until when the own pause is, for who was invited to speak, and spoke; or earlier, ns."""
        if self._row_since is None or self._row_since >= pause_until:
            return pause_until
        ends_at = self._row_ends_at or 0
        if self._busy_since is not None:
            ends_at = self._busy_since + self._largest_ns
        return min(ends_at, pause_until + self._patience_ns + self._detour_ns)

    @property
    def _last_ns(self) -> int:
        """How long after a pause opens a short frame may start, ns."""
        return self.pause_ns - 2 * MARGIN_NS - self._short_ns

    def _follows_at_once(self, at: int) -> bool:
        """Whether a frame that starts then is in a row with the last one."""
        ended_at = self._last_ended_at
        return ended_at is not None and at <= ended_at + self._gap_ns + MARGIN_NS

    def _finds_pause(self, at: int) -> bool:
        """Whether copies of what was sent last go on, since one of them will be in a pause."""
        if self._burst_at is None or not self._searches or not self._follows_at_once(at):
            return False
        return at <= self._burst_at + self.period_ns + self._patience_ns

    def _is_in_pause(self, at: int) -> bool:
        """Whether the last frame went into a known pause, and a short one may follow it there."""
        if self._burst_at is None:
            return False
        rhythms = self._active(self._burst_at)
        return any(self._hears_out(self._opens_at(each, at), at) for each in rhythms)

    def _hears_out(self, opens_at: int, at: int) -> bool:
        """Whether who heard our first frame in its pause still listens for a short one."""
        first_at = self._burst_at
        if first_at is None or not self._senses_carrier or not self._follows_at_once(at):
            return False
        last_at = opens_at + self._last_ns
        latest_at = last_at + self._patience_ns + self._detour_ns
        return opens_at <= first_at <= last_at and at <= latest_at
