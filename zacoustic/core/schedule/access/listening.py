"""Listen windows: a node that transmits for long pauses regularly, so that others reach it.

A half-duplex modem is deaf while it transmits. A node that sends one frame after another (an
object, a thousand queued samples) would hear neither an emergency nor the acknowledgement that it
awaits. So no node transmits for more than four seconds without a pause; the pause holds a short
frame and some uncertainty about the distance. Frames in a row are a *run*; runs and pauses
alternate in a fixed rhythm as long as there is something to send.

The propagation delay makes the rhythm necessary. At 1 km a frame that is sent when the pause is
heard arrives 1.3 s after the pause began, when the next run is under way. The other node must start
*before* it hears the pause, by the round trip. So the pause is announced: a TURN for all nodes says
when it begins, counted from the start of the frame, and a node that has heard the TURN computes the
later pauses from the same rhythm. The TURN costs three bytes in the second frame of a first run and
in one frame of every third run, and only while so much waits that the run will be full. Payloads
that fill a frame leave no room for it; their mechanism can announce the pause in its own way and
pass it to `heard_pause` at the other end; `end_run` informs this end.

An announced rhythm is kept until nothing was transmitted for more than a period: while an answer is
awaited it continues, and the next run begins in the middle of a run period. A smaller frame, such
as a report among the fragments of a photo, leaves no room for a whole number of fragments: the last
fragment waits until it ends with the run, so that it can announce the pause (`_last_at`). If none
fits, the pause is longer: it begins when the last frame ends, and ends as planned. Such a frame
does not announce a pause (`frames_before_pause`).

A node that hears a run and does not know its pauses must hear an announcement, and does not
transmit meanwhile (`listens_until`). If a run of largest frames brings no announcement, and
carriers are sensed, copies of an emergency go for a whole period, whatever is heard: one of them is
in the pause (`search_ns`). `zacoustic.core.schedule.access.otherruns` records what is heard of
other nodes.

While another node is in a run, a frame of this node starts so that it arrives in the next pause,
and should be short (`comfort_ns`); a longer one goes all the same. Any one frame may be lost, and
the next pause is four seconds away. So where carriers are sensed, the pausing node keeps listening
to a sound that begins in its pause. If the sound gave no frame, it waits for another one to follow
at once, again and again, for the airtime of the largest frame and the round trip
(`_heard_out_until`). A node with something urgent counts on that and sends a few copies in a row
(`is_heard_out`, `zacoustic.core.schedule.copies`). A frame for another node than the pausing one
may arrive too early by the round trip, so the row continues for that much longer (`detour_ns`). A
pause that is longer because of that costs a frame, but not the rhythm.

All this is between two nodes. Where a node knows of more, it *rests* after each run, for a random
time (`zacoustic.core.schedule.access.fairshare`): nobody tells of pauses, nor aims at them, and the
copies of an emergency go at random times as well.

An exclusive object switches this node's pauses off: it has the channel to itself by agreement.
Policies with turns (TDMA, polling) need no windows: in the turns of others this node is
silent. Nor do devices that hear while they send; DESERT counts as one, since its airtime is mostly
waiting, with a few hundredths of sound.
"""

from collections.abc import Callable
from typing import Final, Protocol

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.schedule.access.fairshare import FairShare
from zacoustic.core.schedule.access.otherruns import MARGIN_NS, OtherRuns, Rhythm
from zacoustic.core.wire.access import ANYBODY, TURN_BYTES, Turn

ANNOUNCED_RUNS: Final = 3
"""Runs for which one announcement holds."""
_BACKLOG_FRAMES: Final = 2
"""Frames that must wait behind the pause to make it worthwhile."""
_LISTENED_PERIODS: Final = 2
"""An announcement is awaited for this many runs and pauses: at 40 % loss one comes in 84 of 100
cases."""
_LONG_ROW_FRAMES: Final = 2
"""This many of the largest frames in a row are a run with pauses."""
_LISTENED_PERIODS_OF_SEARCH: Final = 1
"""The same for an urgent frame that searches for the pause by itself."""
_BESIDE_OTHERS_NS: Final = 15 * NS_PER_S
"""A node that always has something to say is heard this often, rests included, where carriers are
sensed."""
_LEAST_REST_WINDOWS: Final = 2
"""The shortest rest of a node in a crowd, in listen windows: two short frames fit it in a row, so
that one of several copies arrives whole wherever their receiver is."""
_GOLDEN_RATIO: Final = 0.618


class Transfers(Protocol):
    """The objects that a node sends, as far as its pauses are concerned."""

    @property
    def is_exclusive(self) -> bool:
        """Whether one has the channel to itself, so that there are no pauses."""

    def has_fragment(self, now: int) -> bool:
        """Return whether a fragment is due: it fills its frame, and may announce a pause."""


class Listening(OtherRuns):
    """The pauses of this node and of others.

    Args:
        capabilities: The link's.
        share: What this node leaves free for others; None: it never knows of two.
    """

    def __init__(self, capabilities: LinkCapabilities, share: FairShare | None = None) -> None:
        super().__init__(capabilities)
        self._share = share
        self._least_rest_ns = _LEAST_REST_WINDOWS * self.pause_ns
        self.transfers: Transfers | None = None
        """The objects that this node sends; None: it sends none."""
        self._run_begun_at = 0
        self._last_ended_at: int | None = None
        self._is_announced = False
        """Whether other nodes were told of the rhythm since it began."""
        self._runs_since_announcement = ANNOUNCED_RUNS
        self._announces = False
        self._ends_run = False
        self._row_since: int | None = None
        """Instant since which others are heard, one sound directly after another, ns."""
        self._row_ends_at: int | None = None
        """Instant until which a sound is awaited after one that gave no frame, ns."""
        self._is_understood = False
        """Whether the present or last sound gave a frame."""
        self._burst_at: int | None = None
        """Start of the first of the own frames that followed each other at once, ns."""
        self._searches = False
        """Whether these frames went into a run whose pauses are unknown."""
        self._largest_in_row = 0
        """Sounds as long as a largest frame, one directly after another."""
        self._largest_ended_at = 0
        """End of the last one, ns."""
        self._others_heard_until = -1
        """Until when it counts that another node was heard, ns."""

    # This node

    @property
    def is_crowd(self) -> bool:
        """Whether at least two other nodes are known."""
        return self._share is not None and self._share.is_crowd()

    def pauses_until(self, due_at: int, now: int, *, is_urgent: bool, goes_on: bool = False) -> int:
        """Return `due_at`, or the end of this node's pause or rest that a frame must wait for, ns.

        Args:
            due_at: When the frame should start, ns.
            now: The instant.
            is_urgent: Its content is urgent.
            goes_on: The last frame has announced that it follows, or it is a copy of that one.
        """
        if self._last_ended_at is None or is_urgent or self._is_exclusive:
            return due_at
        if self._share is not None and self.is_crowd and not goes_on:
            due_at = max(due_at, self._share.rests_until)
        at = max(due_at, now)
        paused_until = self._own_pause_end(at, now)
        return paused_until if paused_until > at else due_at

    def comfort_ns(self, now: int, *, is_copy: bool = False) -> int | None:
        """Return the longest preferred airtime of a frame that starts now, ns; None: any.

        Args:
            now: The instant.
            is_copy: It follows a copy of itself, perhaps to find a pause.
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
        """Return how many largest frames go before the pause, one that starts now included.

        1 only if other nodes may expect the pause after this frame, or after any later one.
        """
        if not self._continues(now):
            begin_at = self._told_begin_at(now)
            return self._frames if begin_at is None else self._fitting(begin_at, now)
        return self._fitting(self._run_begun_at, now)

    def keeps_rhythm(self, now: int) -> bool:
        """Return whether a frame that starts now belongs to an object or to a told run."""
        return self._is_told(now) or self._sends_full(now) or self._is_exclusive

    def ends_run_now(self, now: int) -> bool:
        """Return whether a largest frame that starts now is the last of several in a run."""
        has_pauses = self._frames > 1 and not self._is_exclusive
        return has_pauses and self.frames_before_pause(now) == 1

    def end_run(self) -> None:
        """Record that the frame that is about to start announces a pause."""
        self._ends_run = True

    def controls(
        self,
        room_bytes: int,
        has_bytes: Callable[[int], bool],
        now: int,
        *,
        has_object: bool = False,
    ) -> bytes:
        """Return the announcement of the pause, if it is worth it.

        Args:
            room_bytes: Room left in the frame, which starts now, bytes.
            has_bytes: Tells whether at least so many bytes wait, this frame's included.
            now: The instant.
            has_object: An object is being sent. Its fragments have no room for a TURN, so any other
                frame with room carries one, in every run.
        """
        if room_bytes < TURN_BYTES or not self._follows(now):
            return b""
        if self._is_exclusive or self.is_crowd:
            return b""
        begins_anew = not self._continues(now)
        runs = 1 if has_object else ANNOUNCED_RUNS
        told = self._runs_since_announcement + begins_anew < runs
        full_frames = self.frames_before_pause(now) + _BACKLOG_FRAMES
        if told or not (has_object or has_bytes(full_frames * room_bytes)):
            return b""
        begin_at = self._told_begin_at(now)
        begun_at = self._run_begun_at
        if begins_anew:
            begun_at = now if begin_at is None else begin_at
        self._announces = True
        return Turn(ANYBODY, begun_at + self._run_ns - now).encode()

    def handle_started(self, now: int) -> None:
        """Record an own frame that goes to the link."""
        if not self._follows_at_once(now):
            self._burst_at = now
            is_run = self._senses_carrier and self._hears_full_run(now)
            self._searches = is_run and not self._active(now)
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
        """Record the end of an own frame, and its start, for which the device may have waited."""
        is_told = self._is_told(started_at)
        if not is_told and not self._continues(started_at):
            self._run_begun_at = started_at
        self._last_ended_at = self._listens_since = ended_at
        if self._share is not None:
            free_at = ended_at + self._gap_ns
            fills_run = not self._fits(self._run_begun_at + self._run_ns, free_at)
            least_ns = self._least_rest_ns
            self._share.spend(started_at, free_at, fills_run=fills_run, least_ns=least_ns)
        self._listened += 1
        if self._ends_run:
            self._ends_run = False
            if not is_told:
                self._run_begun_at = ended_at - self._run_ns
            self._is_announced = True
            self._runs_since_announcement = 0

    @property
    def hears_sound(self) -> bool:
        """Whether another node's sound is sensed."""
        return self._busy_since is not None

    def handle_carrier(self, busy: bool, now: int) -> None:
        """Record the begin or end of another node's sound."""
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
            self._others_heard_until = now + _BESIDE_OTHERS_NS
            self._row_ends_at = now if self._is_understood else now + self._gap_ns + 2 * MARGIN_NS

    # Others

    def invited_at(self, at: int, *, follows: bool = False) -> int | None:
        """Return when to start, not before `at`, to arrive in the pauses of nodes in a run, ns.

        None when no node is known to be in one.

        Args:
            at: The instant.
            follows: It may directly follow what was sent into a pause.
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
        """Return until when to listen for an announcement before a frame starts, ns, or `at`.

        A node that transmits into a run is not heard, and does not hear when the run ends. But a
        run may never be announced, so the wait is bounded.

        Args:
            at: When the frame should start.
            is_urgent: Its content is urgent; otherwise an own run continues.
            follows: It may directly follow what was sent last.
        """
        goes_on = self._follows_at_once(at) if follows else not is_urgent and self._follows(at)
        if not self._hears_full_run(at) or goes_on or self._active(at):
            return at
        # Never twice at the same position in a run: its announcement may be there.
        part = self._listened * _GOLDEN_RATIO % 1.0
        searches = is_urgent and self._senses_carrier
        periods = _LISTENED_PERIODS_OF_SEARCH if searches else _LISTENED_PERIODS
        until = self._listens_since + round((periods + part) * self.period_ns)
        return max(at, min(until, self._run_heard_until + 1))

    def row_began_at(self, ended_at: int) -> int:
        """Return when the first frame of the own row began that ended at an instant, ns."""
        return ended_at if self._burst_at is None else min(ended_at, self._burst_at)

    def next_invitation_at(self, now: int, not_before: int) -> int | None:
        """Return when to start, from `not_before` on, by what is known now, ns; None: no rhythm."""
        opens = [self._opens_at(each, not_before) for each in self._active(now)]
        last_ns, period_ns = self._last_ns, self.period_ns
        return max((at + (not_before > at + last_ns) * period_ns for at in opens), default=None)

    def is_beside_others(self, now: int) -> bool:
        """Return whether any of several other nodes may be in a run, or rest between two."""
        is_heard = self.hears_sound or now <= self._others_heard_until
        return self.is_crowd and (is_heard or not self._senses_carrier)

    @property
    def search_ns(self) -> int:
        """How long copies of the last record continue to search for an unknown pause, ns."""
        return self.period_ns if self._searches else 0

    def is_heard_out(self, at: int) -> bool:
        """Return whether the last frame went into a pause and a short one may follow it there.

        This also holds where the pause is unknown, for one period: one of these frames meets it.
        """
        return self._finds_pause(at) or self._is_in_pause(at)

    def heard_frame(self, source: int, airtime_ns: int, now: int) -> None:
        """Record a frame from `source`."""
        self._is_understood = True
        if self._busy_since is None and self._row_ends_at is not None:
            self._row_ends_at = min(self._row_ends_at, now)
        super().heard_frame(source, airtime_ns, now)

    # Below the methods above

    @property
    def _is_exclusive(self) -> bool:
        return self.transfers is not None and self.transfers.is_exclusive

    def _sends_full(self, now: int) -> bool:
        return self.transfers is not None and self.transfers.has_fragment(now)

    def _heard_sound(self, began_at: int, now: int) -> None:
        """Record that a sound has ended; a few of a largest frame's length in a row are a full run.

        Shorter sounds are not: rows of copies, and the traffic of a busy fleet.
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
        """Return whether a run that has pauses can be heard, or was told of.

        Sounds that follow each other are none: that is what a busy fleet sounds like.
        """
        if self.is_crowd:
            return False
        is_full = not self._senses_carrier or at <= self._full_run_heard_until
        return is_full and at <= self._run_heard_until

    def _active(self, at: int) -> list[Rhythm]:
        """Return the rhythms to which this node keeps: none among nodes that rest."""
        return [] if self.is_crowd else super()._active(at)

    def _continues(self, now: int) -> bool:
        """Return whether a frame that starts now would belong to the present run."""
        if self._last_ended_at is None:
            return False
        if self._is_told(now) and now < self._run_begun_at + self._run_ns:
            return True
        return now - self._last_ended_at < self.pause_ns

    def _is_told(self, now: int) -> bool:
        """Return whether other nodes know this node's rhythm and count on it."""
        return self._is_announced and self._follows(now)

    def _told_begin_at(self, now: int) -> int | None:
        """Return the planned start of the run that holds `now`, ns; None: no node knows it."""
        if not self._is_told(now):
            return None
        periods = max(0, now - self._run_begun_at) // self.period_ns
        begin_at = self._run_begun_at + periods * self.period_ns
        return begin_at if self._keeps_phase or now < begin_at + self._latest_ns else None

    def _fitting(self, begun_at: int, now: int) -> int:
        """Return how many largest frames fit the rest of a run; see `frames_before_pause`."""
        left_ns = begun_at + self._frames * self._unit_ns - now
        count = max(1, (left_ns + self._late_ns) // self._unit_ns)
        is_early = left_ns - self._unit_ns > MARGIN_NS
        return count + 1 if count == 1 and is_early and self._is_told(now) else count

    def _follows(self, now: int) -> bool:
        """Return whether a frame that starts now follows the last one soon enough for a rhythm."""
        if self._last_ended_at is None:
            return False
        if self._is_announced and self._keeps_phase:
            return now - self._last_ended_at <= self._memory_ns
        ended_at = self._last_ended_at
        if self._is_announced:
            ended_at = max(ended_at, self._run_begun_at + self._run_ns)
        return now - ended_at < self.pause_ns + self._latest_ns

    def _own_pause_end(self, at: int, now: int) -> int:
        """Return the end of the own pause that must precede a frame at `at`, ns, or less."""
        assert self._last_ended_at is not None
        if self._continues(at):
            run_ends_at = self._run_begun_at + self._run_ns
            if self._fits(run_ends_at, at):
                return max(at, self._last_at(run_ends_at, at, now))
            # No node counts on an end of the run that was not announced.
            told_at = run_ends_at if self._is_told(at) else 0
            return max(self._last_ended_at, told_at) + self.pause_ns
        pause_until = self._last_ended_at + self.pause_ns
        begin_at = self._told_begin_at(at)
        if begin_at is not None:
            run_ends_at = begin_at + self._run_ns
            if at >= run_ends_at or (self._keeps_phase and not self._fits(run_ends_at, at)):
                return begin_at + self.period_ns
            pause_until = max(pause_until, begin_at)
            last_at = self._last_at(run_ends_at, at, now)
            return max(self._heard_out_until(pause_until), last_at)
        return self._heard_out_until(pause_until)

    def _last_at(self, run_ends_at: int, at: int, now: int) -> int:
        """Return when the last full frame of an announced run starts to end with the run, ns, or 0.

        Other frames of the run have left no room for a whole number of full ones. The pause begins
        after this frame, which announces it.
        """
        last_at = run_ends_at - self._largest_ns
        is_last = at + self._unit_ns > last_at and self._is_told(at) and self._sends_full(now)
        return last_at if is_last else 0

    def _fits(self, run_ends_at: int, at: int) -> bool:
        """Return whether the largest frame may start then, given the planned end of the run."""
        return at + self._largest_ns <= run_ends_at + self._late_ns

    def _heard_out_until(self, pause_until: int) -> int:
        """Return the end of this node's pause, extended for nodes that used it, ns, or earlier."""
        if self._row_since is None or self._row_since >= pause_until:
            return pause_until
        ends_at = self._row_ends_at or 0
        if self._busy_since is not None:
            ends_at = self._busy_since + self._largest_ns
        return min(ends_at, pause_until + self._patience_ns + self._detour_ns)

    @property
    def _last_ns(self) -> int:
        """How long after the start of a pause a short frame may start, ns."""
        return self.pause_ns - 2 * MARGIN_NS - self._short_ns

    def _follows_at_once(self, at: int) -> bool:
        """Return whether a frame that starts then is in a row with the last one."""
        ended_at = self._last_ended_at
        return ended_at is not None and at <= ended_at + self._gap_ns + MARGIN_NS

    def _finds_pause(self, at: int) -> bool:
        """Return whether copies of the last record continue, since one will meet a pause."""
        if self._burst_at is None or not self._searches or not self._follows_at_once(at):
            return False
        return at <= self._burst_at + self.period_ns + self._patience_ns

    def _is_in_pause(self, at: int) -> bool:
        """Return whether the last frame went into a known pause and a short one may follow."""
        if self._burst_at is None:
            return False
        rhythms = self._active(self._burst_at)
        return any(self._hears_out(self._opens_at(each, at), at) for each in rhythms)

    def _hears_out(self, opens_at: int, at: int) -> bool:
        """Return whether a node that heard our first frame in its pause still listens."""
        first_at = self._burst_at
        if first_at is None or not self._senses_carrier or not self._follows_at_once(at):
            return False
        last_at = opens_at + self._last_ns
        latest_at = last_at + self._patience_ns + self._detour_ns
        return opens_at <= first_at <= last_at and at <= latest_at
