"""When to repeat: from airtimes and measured round trips.

The first estimate comes from the link: the propagation delay to the other end and back, the ACK's
linger there, its own frame, and one short frame of uncertainty. Then the round trip is measured as
in RFC 6298, from samples that were sent once; but the first measurement is assumed to be wrong by
an eighth, not by a half: sound is slow, and equally slow the next time. This does not hold for a
device that controls access.

An answer measures the transmission that it answers, or nothing (Karn's rule): of a record that was
sent twice nobody knows which one it answers. Nor does it measure what lies beyond the bound that
the link's own figures give: an answer from behind an outage, or one that was held back.

Silence means a loss, or an answer that takes longer than estimated. Propagation delay and airtime
are known beforehand, so it is taken for a loss, and the first five repetitions keep the same pace.
The delay of a device that decides itself when it transmits is a guess: until a round trip is
measured, each vain pause doubles the next ones.

Repetitions to a silent node become rare: first by the round trip, later by the length of the
silence (`zacoustic.core.base.allowance`). The first frame heard from it releases one turn, and
its answer restores the usual pace. The same holds for a node that is heard and does not answer,
since the channel may be crowded. For an emergency the longest pause is a number of seconds,
whatever was measured, until the node was silent for ten minutes.
"""

import random
from collections.abc import Callable
from typing import Final

from zacoustic.core.base.allowance import Allowance
from zacoustic.core.base.clock import NS_PER_S, SHORTEST_S, seconds_to_ns
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.base.qos import Priority
from zacoustic.core.schedule.access.listening import Listening

FEW_RECEIVERS: Final = 4
"""Up to this many receivers of one sample acknowledge it directly one after another."""
_SLOTS_OF_MANY: Final = 3
_ACK_BYTES: Final = 5
_SHORT_BYTES: Final = 8
_BATCH_FRAMES: Final = 4
_FIRST_DEVIATION: Final = 8
"""The assumed error of the first round trip is this part of it."""
_FIRST_DEVIATION_DELEGATED: Final = 2
"""The same where a device decides when it transmits."""
_FACTORS: Final[tuple[float, ...]] = (
    *(1.0, 1.0, 1.0, 1.0, 1.0, 1.5, 2.0, 3.0, 4.0),
    *(6.0, 8.0, 12.0, 16.0, 24.0, 32.0),
)
"""Round trips between two repetitions, by the number of unanswered ones in a row. The last ones
apply only while no round trip is measured."""
_SILENT_FACTORS: Final[tuple[float, ...]] = (1.0, 1.0, 1.0, 1.0, 1.0, 3.0, 9.0, 17.5)
"""The least such factor, by the number of repetitions in a row without any sign of the node. The
first few may have been lost, the others go to an absent node. The last one is a minute where a
round trip takes three seconds: a node that returns after ten minutes and transmits nothing waits
that long."""

_FORGETTING_FACTOR: Final = 3.0
"""A node takes longer to start than the first such pause. Before it, losses are likelier by far,
and a node that has restarted in so short a time asks who this one is."""

_INTRODUCTION_BYTES: Final = 20
"""Room for that, and for an envelope, in a frame to such a node."""

_PATIENCE: Final = 2
"""This many times the usual number of unheard repetitions are no sign of absence: they come on top
of the first few. With six of ten frames lost, every sixth exchange succeeds."""
_MOST_USUAL: Final = 6.0
_USUAL_PARTS: Final = 8
"""The usual number shrinks by this part with each answer to a record that was sent once; it grows
by half of the difference."""

_LAST_EQUAL: Final = 4
"""Index of the last of the first factors, which are equal."""
_DOUBLING: Final = 2
"""A factor doubles within this many indices."""
_HEARD_PLACES: Final = 2
"""The first frame of a silent node takes back this many steps: one turn at once. Its answer to that
takes back all; so a forged frame does not restart everything."""

_IMPLAUSIBLE_PARTS: Final = 64
"""A round trip shorter than this part of the link's estimate is not believed: sound to the farthest
node takes seconds, and the shortest frame at least a tenth of one."""
_LEAST_FACTOR: Final = 4.0
"""An answer is awaited for at least this many round trips, in whatever haste: answers may take
longer than before, and a node that transmits all the time hears none."""
_URGENT_FACTOR: Final = 2.0
_URGENT_S: Final = 9.5
"""The longest pause of an emergency, s, unless two round trips to the farthest node are longer."""
_URGENT_DELEGATED_S: Final = 20.0
"""The same where a device decides when it transmits, or relays repeat what is lost: more copies
would fill what is between."""
_FRAMES_THROUGH: Final = 2
"""A frame that goes inside those of other links, and that nobody takes, is repeated on its way."""
_LONGEST_DRAW: Final = 1.25
"""The longest drawn pause, in parts of the mean one."""
_LONGEST_QUIET: Final = 2
"""A record that is sent for the first time postpones repetitions by at most this many of its
pauses."""
_SENSED_TRIES: Final = 2
"""Where carriers are sensed, this many repetitions go soon, give or take a short frame: a node that
hears the other end begin waits, so a loss was hardly a collision with it."""
_EARLIEST: Final = 0.75
"""The fixed part of a deadline; the rest is drawn, so that two ends do not repeat in step for
ever."""


class LinkTimes:
    """Times of acknowledgements that follow from a link's airtimes; all in ns.

    Args:
        capabilities: The link's.
        listening: When other nodes pause; None: they need not.
        crosses_within_ns: Where frames go inside those of other links: the time after which one has
            arrived or never will, ns; None: this is a link of its own.
    """

    def __init__(
        self,
        capabilities: LinkCapabilities,
        listening: Listening | None = None,
        *,
        crosses_within_ns: int | None = None,
    ) -> None:
        self.listening = listening
        """When other nodes pause; read-only."""
        self.airtime_ns: Callable[[int], int] = capabilities.airtime_ns
        """Returns the airtime of a frame by its size, bytes."""
        short_ns = capabilities.airtime_ns(_SHORT_BYTES)
        self.gap_ns = gap_ns = seconds_to_ns(capabilities.gap_s)
        """The device's pause after a frame."""
        self.ack_slot_ns = capabilities.airtime_ns(_ACK_BYTES) + gap_ns
        """Duration of one receiver's ACK; the next receiver in the list waits for it."""
        self.is_delegated = capabilities.controls_access
        """Whether the device decides when a frame starts; how long the frame waits there is
        unknown."""
        self.mtu_bytes = capabilities.mtu_bytes
        self.next_frame_ns = 0
        """How long to wait for the next frame of a publisher that continues, ns."""
        self.senses_carrier = capabilities.senses_carrier
        """Whether a node that is about to transmit knows that another one is heard."""
        if not capabilities.senses_carrier:
            self.next_frame_ns = capabilities.airtime_ns(capabilities.mtu_bytes)
        self.ack_patience_ns = _BATCH_FRAMES * (
            capabilities.airtime_ns(capabilities.mtu_bytes) + gap_ns
        )
        """The longest delay of an ACK, however long a publisher continues, ns."""
        self.ack_linger_ns = gap_ns + seconds_to_ns(capabilities.preamble_s / 2)
        """How long an ACK lingers, ns: a publisher that continues has begun its next frame by
        then."""
        linger_s = (self.ack_linger_ns + self.next_frame_ns) / NS_PER_S
        self.confirm_linger_s = max(SHORTEST_S, linger_s)  # on a simulated link it may be 0
        """How long a CONFIRM lingers, s: otherwise it would collide again and again with what is
        repeated together with its request."""
        self.doubt_ns = short_ns
        self.longest_ns = capabilities.airtime_ns(capabilities.mtu_bytes) + gap_ns
        """The longest frame that may be under way at the other end, ns."""
        self.way_ns = seconds_to_ns(capabilities.propagation_s)
        """Propagation delay to the farthest node, one way."""
        self.batch_bytes = _BATCH_FRAMES * capabilities.mtu_bytes
        """The most bytes repeated before an answer is awaited."""
        self.first_round_trip_ns: int = (
            2 * self.way_ns + self.ack_linger_ns + self.next_frame_ns + self.ack_slot_ns + short_ns
        )
        """The estimate before any measurement, ns, from the end of the sample's frame."""
        rarest = _FACTORS[-1] if self.is_delegated else _SILENT_FACTORS[-1]
        self.longest_round_trip_ns = round(rarest * self.first_round_trip_ns)
        """The bound of every estimate of a round trip, ns: nothing longer is one."""
        urgent_ns = seconds_to_ns(_URGENT_DELEGATED_S if self.is_delegated else _URGENT_S)
        own_ns = round(_URGENT_FACTOR * _LONGEST_DRAW * self.first_round_trip_ns)
        self.urgent_ns = max(urgent_ns, own_ns)
        """The longest pause between two tries of an emergency, ns."""
        self.frames_each = 1
        """How many frames of the channel one is for which nobody is there."""
        if crosses_within_ns is not None and self.is_delegated:
            self.longest_round_trip_ns = 2 * crosses_within_ns + self.ack_patience_ns
            self.urgent_ns, self.frames_each = urgent_ns, _FRAMES_THROUGH

    def copy_ns(self, size_bytes: int) -> int:
        """Return the duration of one more copy of a record and its gap, ns, at least 1."""
        return max(1, self.airtime_ns(size_bytes) + self.gap_ns)

    def ask_round_trip_ns(self, frame_ns: int) -> int:
        """Return how long a requested frame of this airtime takes to come, ns."""
        return 2 * self.way_ns + self.ack_slot_ns + frame_ns + self.doubt_ns

    def ack_spread_ns(self, receivers: int) -> int:
        """Return the time in which this many receivers acknowledge a repetition at random, ns.

        Most receivers have acknowledged before and repeat it, and one that has not says more. A
        single ACK may collide as well, with the answer to a repetition of another topic; or with
        its publisher's next repetition, if the publisher does not hear the ACK begin.
        """
        least_ns = self.doubt_ns if self.senses_carrier else self.longest_ns
        return least_ns if receivers < 2 else max(least_ns, 2 * receivers * self.ack_slot_ns)


def ack_slots(rank: int, receivers: int) -> int:
    """Return how many slots pass before a receiver acknowledges a sample sent to several.

    They acknowledge in the order of their addresses. The answers of many arrive in another order,
    since their distances differ, and would collide in adjacent slots.

    Args:
        rank: How many acknowledge before it.
        receivers: Number of receivers.
    """
    return rank if receivers <= FEW_RECEIVERS else _SLOTS_OF_MANY * rank


class Pacer:
    """How long one node takes to answer, and so when to repeat something to it."""

    def __init__(self) -> None:
        self.shortest_ns: int | None = None
        """The shortest recent round trip, ns."""
        self.quiet_until = 0
        """Instant until which an answer is awaited and nothing is repeated to it, ns."""
        self.quiet_since = 0
        """Instant since which an answer is awaited, ns."""
        self.allowance = Allowance()
        """How many frames may still go in vain, and the pause before the next one."""
        self._counts_at = 0
        self._smooth_ns: int | None = None
        self._deviation_ns = 0
        self._doubts_guess = False
        """Whether repetitions were in vain before any measurement: the round trip may be longer."""
        self._unanswered = 0
        self._unheard = 0
        self._usually_unheard = 0.0
        """How many repetitions in a row usually go without a sign of it before it answers."""
        self._quiet_from = 0
        self._turn_at = -1
        self._room_bytes = 0

    @property
    def is_silent(self) -> bool:
        """Whether it was unheard for so long that it may be absent."""
        return self._silent_factor > 1 or self.allowance.is_rare

    @property
    def may_have_restarted(self) -> bool:
        """Whether it was unheard for so long that it may have forgotten this node meanwhile."""
        return self._silent_factor > _FORGETTING_FACTOR

    @property
    def _silent_factor(self) -> float:
        place = self._unheard - self._patience
        return _SILENT_FACTORS[max(0, min(place, len(_SILENT_FACTORS) - 1))]

    @property
    def _patience(self) -> int:
        return round(_PATIENCE * self._usually_unheard)

    @property
    def smooth_ns(self) -> int:
        """The usual round trip, ns; 0 before any measurement."""
        return self._smooth_ns or 0

    def least_ns(self, times: LinkTimes) -> int:
        """Return the shortest known time to an answer, ns."""
        if self.shortest_ns is not None:
            return self.shortest_ns
        return times.first_round_trip_ns

    def measured(self, round_trip_ns: int, times: LinkTimes) -> None:
        """Add a round trip, from the end of a frame to its ACK.

        A far shorter one than the link allows answers something else, such as a request from before
        this node's restart. It would let the node repeat without a pause. A far longer one was held
        back there, by silence or the reply budget, or belongs to another transmission. It would let
        this node wait for hours.
        """
        if round_trip_ns < times.first_round_trip_ns // _IMPLAUSIBLE_PARTS:
            return
        if round_trip_ns > times.longest_round_trip_ns:
            if times.is_delegated:
                return
            round_trip_ns = times.longest_round_trip_ns
        self._usually_unheard -= self._usually_unheard / _USUAL_PARTS
        if self._smooth_ns is None or self.shortest_ns is None:
            parts = _FIRST_DEVIATION_DELEGATED if times.is_delegated else _FIRST_DEVIATION
            self._smooth_ns, self._deviation_ns = round_trip_ns, round_trip_ns // parts
            self.shortest_ns = round_trip_ns
            if self._doubts_guess:  # what is awaited now is paced by that guess
                self._doubts_guess = False
                self.release()
            return
        longer_ns = round_trip_ns - self.shortest_ns
        self.shortest_ns += longer_ns if longer_ns < 0 else longer_ns // 8
        error = abs(self._smooth_ns - round_trip_ns)
        self._deviation_ns += (error - self._deviation_ns) // 4
        self._smooth_ns += (round_trip_ns - self._smooth_ns) // 8

    def unanswered(self, now: int, times: LinkTimes) -> None:
        """Count a repetition that became due unanswered; those due together count once."""
        if now >= self._counts_at:
            self._counts_at = now + times.first_round_trip_ns
            self._doubts_guess = self._smooth_ns is None and times.is_delegated
            more = 1
            if self._doubts_guess:
                more = max(0, _LAST_EQUAL - self._unanswered) + _DOUBLING
            self._unanswered = min(self._unanswered + more, len(_FACTORS) - 1)
            if self._silent_factor < _SILENT_FACTORS[-1]:
                self._unheard += 1

    def heard(self, now: int, frames: int = 1) -> bool:
        """Record a frame from the node; return whether it was silent and a turn may follow.

        Args:
            now: The instant.
            frames: `LinkTimes.frames_each`.
        """
        was_silent, was_absent = self.is_silent, self._silent_factor > 1
        is_back = self.allowance.heard(now, self._patience)
        if was_absent:
            self._unheard -= _HEARD_PLACES
            self._unanswered //= 2
        else:
            self._unheard = 0
        return is_back or (was_silent and self.allowance.may_try(now, frames))

    def begin(self, now: int) -> None:
        """Record that something new waits; if nothing else does, repeat at the usual pace.

        Repetitions may have become rare long ago, and the node may be back since.
        """
        self.allowance.grant()
        if self.quiet_until < now:
            self._unheard = 0
            if not self._doubts_guess:
                self._unanswered = 0

    def answered(self, *, in_crowd: bool = True) -> bool:
        """Record that the node has confirmed something; return whether tries had become rare.

        Args:
            in_crowd: Others may be transmitting.
        """
        if self._silent_factor < _SILENT_FACTORS[-1]:  # otherwise it was absent
            unheard = min(float(self._unheard), _MOST_USUAL)
            self._usually_unheard += max(0.0, unheard - self._usually_unheard) / 2
        self._unheard = 0
        # RFC 6298: what was repeated measures nothing; the longer pause stays until something does.
        if not self._doubts_guess:
            self._unanswered = self._unanswered // 2 if in_crowd else 0
        return self.allowance.answered()

    def is_urgent(self, priority: Priority) -> bool:
        """Return whether repetitions of a priority do not become rare now."""
        return priority is Priority.REAL_TIME and self.allowance.is_hasty

    def is_doubtful(self, times: LinkTimes) -> bool:
        """Return whether repetitions stay unanswered, so that more than one would be wasted.

        This also holds where an answer may simply take longer than the guess.
        """
        is_guess = self._smooth_ns is None and times.is_delegated
        return is_guess or self.is_silent or _FACTORS[self._unanswered] > 1

    def pause_ns(
        self,
        times: LinkTimes,
        rank: int,
        rng: random.Random,
        priority: Priority,
        *,
        frames: int = 1,
        spread_ns: int = 0,
        at_most_ns: int | None = None,
    ) -> int:
        """Draw how long to wait for an answer before the next repetition, ns.

        Two ends that repeat in step collide for ever. So the random part is as long as a frame that
        may be under way there, and longer if repetitions have become rare.

        Args:
            times: The link's.
            rank: How many receivers acknowledge before this one; measured round trips include them.
            rng: Draws the random part.
            priority: The priority of what is repeated.
            frames: How many frames are sent in a row.
            spread_ns: Time in which the receivers acknowledge at random, ns.
            at_most_ns: Upper bound, ns, > 0, however rare repetitions have become, unless
                `least_pause_ns` is longer; None: no bound, and so after a long silence.
        """
        round_trip_ns = self.round_trip_ns(times, rank)
        factor = self._factor(times, priority)
        # One slow round trip is no reason to be silent for hours.
        rarest_ns = round(self._rarest * times.first_round_trip_ns)
        pause_ns = round(round_trip_ns * min(factor, _LEAST_FACTOR))
        pause_ns = max(pause_ns, min(round(round_trip_ns * factor), rarest_ns))
        if self.is_urgent(priority):
            longest_ns = times.urgent_ns - self._least_range_ns(times, frames)
            if pause_ns > longest_ns:  # as rare as is allowed: only drawn not to go in step
                return spread_ns + rng.randint(longest_ns, times.urgent_ns)
            round_trip_ns = min(round_trip_ns, pause_ns)
        elif at_most_ns is None or not self.allowance.keeps_deadlines:
            pause_ns, at_most_ns = max(pause_ns, self.allowance.pause_ns(times.frames_each)), None
        range_ns = least_range_ns = self._least_range_ns(times, frames)
        if pause_ns > round_trip_ns or factor > 1:
            range_ns = max(range_ns, round(2 * (_LONGEST_DRAW - 1) * pause_ns))
        earliest_ns = max(round_trip_ns, pause_ns - range_ns // 2)
        drawn_ns = spread_ns + earliest_ns + rng.randrange(range_ns + 1)
        if at_most_ns is None or drawn_ns <= at_most_ns:
            return drawn_ns
        least_ns = self.least_pause_ns(times, rank, priority) + spread_ns
        earliest_ns = max(least_ns, round(_EARLIEST * at_most_ns))
        return rng.randint(earliest_ns, max(at_most_ns, least_ns + least_range_ns))

    def least_pause_ns(self, times: LinkTimes, rank: int, priority: Priority) -> int:
        """Return how long an answer is awaited, in whatever haste, ns.

        Args:
            times: The link's.
            rank: How many receivers acknowledge before this one; measured round trips include them.
            priority: The priority of what is repeated.
        """
        factor = min(self._factor(times, priority), _LEAST_FACTOR)
        least_ns = round(self.round_trip_ns(times, rank) * factor)
        return min(least_ns, times.urgent_ns) if self.is_urgent(priority) else least_ns

    def await_answer(self, since: int, until: int, *, is_repeated: bool = True) -> None:
        """Await an answer from one instant to another, ns.

        Args:
            since: The end of the transmission, ns.
            until: Instant at which it is due again, ns.
            is_repeated: It was sent before. A series of new records must not hold back repetitions
                for ever.
        """
        if is_repeated or since >= self.quiet_until:
            self._quiet_from = since
        longest_at = self._quiet_from + _LONGEST_QUIET * (until - since)
        self.quiet_since = max(self.quiet_since, since)
        self.quiet_until = max(self.quiet_until, min(until, longest_at))

    def await_nothing(self) -> None:
        """Stop awaiting an answer; the next turn may begin at once, even at the same instant.

        Where answers take longer than the guess, one more tells nothing of those still on their
        way.
        """
        if not self._doubts_guess:
            self.release()

    def release(self) -> None:
        """End every pause: the node came back, or the link did."""
        self.quiet_until, self._turn_at = 0, -1

    def may_repeat(
        self, now: int, times: LinkTimes, priority: Priority, *, in_haste: bool = False
    ) -> bool:
        """Return whether something may be repeated to it now, perhaps in the turn under way."""
        return now == self._turn_at or self.ready_at(times, priority, in_haste=in_haste) <= now

    def takes(self, size_bytes: int, now: int, times: LinkTimes) -> bool:
        """Take a record into the present turn; False: no room.

        A turn is what is repeated before an answer is awaited: a few frames, or one frame to a node
        that may be absent.

        Args:
            size_bytes: Its size, bytes.
            now: The instant.
            times: The link's.
        """
        if now != self._turn_at:
            self._turn_at = now
            self._room_bytes = times.batch_bytes
            if self.is_doubtful(times):
                self._room_bytes = times.mtu_bytes - _INTRODUCTION_BYTES * self.may_have_restarted
        elif size_bytes > self._room_bytes:
            return False
        self._room_bytes -= size_bytes
        return True

    def ready_at(self, times: LinkTimes, priority: Priority, *, in_haste: bool = False) -> int:
        """Return the instant from which something may be repeated to it, ns.

        Other mechanisms may have agreed a long pause for the node; that applies neither to an
        emergency nor to what has a deadline (`in_haste`), unless the node was silent for long.
        """
        may_hurry = in_haste and self.allowance.keeps_deadlines
        if not (may_hurry or self.is_urgent(priority)):
            return self.quiet_until
        least_ns = self.least_pause_ns(times, 0, priority)
        return min(self.quiet_until, self.quiet_since + least_ns)

    def _least_range_ns(self, times: LinkTimes, frames: int) -> int:
        if times.senses_carrier and self._unanswered < _SENSED_TRIES:
            return times.doubt_ns
        return frames * times.longest_ns

    @property
    def _rarest(self) -> float:
        return _FACTORS[-1] if self._doubts_guess else _SILENT_FACTORS[-1]

    def _factor(self, times: LinkTimes, priority: Priority) -> float:
        silent_factor = self._silent_factor
        factor = min(max(_FACTORS[self._unanswered], silent_factor), self._rarest)
        if not self.is_urgent(priority):
            return factor
        if self._doubts_guess:
            return min(factor, max(silent_factor, _LEAST_FACTOR))
        urgent_ns = seconds_to_ns(_URGENT_S / _LONGEST_DRAW)
        return min(factor, max(_URGENT_FACTOR, urgent_ns / self.round_trip_ns(times)))

    def round_trip_ns(self, times: LinkTimes, rank: int = 0) -> int:
        """Return the time in which an answer comes, as far as known, ns; within the link's bound.

        Args:
            times: The link's.
            rank: How many receivers acknowledge before this one.
        """
        if self._smooth_ns is None:
            return times.first_round_trip_ns + rank * times.ack_slot_ns
        estimate_ns = self._smooth_ns + max(4 * self._deviation_ns, times.doubt_ns)
        return min(estimate_ns, times.longest_round_trip_ns)
