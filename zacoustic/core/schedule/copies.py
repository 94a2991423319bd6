"""How often a record is sent in a row before an answer is awaited, and how long that takes.

An answer takes a round trip, longer than a few short frames. So an emergency is sent four times at
once. A node in a run hears only in its pauses, four seconds apart, and listens longer if it hears
something there that it does not understand (`zacoustic.core.schedule.access.listening`). So
commands go twice into such a pause, and an unanswered one goes again into a later pause: arriving
just after a pause would cost four seconds.

Several nodes may have something urgent for the same node at the same time, such as a stop of two
vehicles. All aim at the same pause, and all their copies collide there. So after the first row the
number of copies is random, except for those that come too early, and a node that sends one more
copy than the others is understood. Later the pause is random as well, among more pauses the more
attempts were in vain.
"""

import random
from typing import Final

from zacoustic.core.base.qos import Priority
from zacoustic.core.schedule.queue import QueuedRecord
from zacoustic.core.schedule.timing import LinkTimes

MOST_COPIES: Final = {Priority.REAL_TIME: 4, Priority.INTERACTIVE_HIGH: 2}
"""Copies in a row. At 40 % loss one of four arrives in 97 of 100 cases, at 20 % one of two in
96."""

_ANOTHER_COPY: Final = 0.75
"""Probability of another copy after the first row."""
_LEAST_PART: Final = 0.25
"""An emergency beside several nodes waits for at least this part of its pause."""
_MOST_PAUSES: Final = 4
"""The next attempt goes into one of at most this many pauses of another node."""


def follow(
    record: QueuedRecord,
    priority: Priority,
    tries: int,
    times: LinkTimes,
    at: int,
    rng: random.Random,
) -> bool:
    """Return whether a record that was just sent is sent again at once, and mark it.

    Args:
        record: The record.
        priority: The priority of its lane.
        tries: How often it was sent, copies included.
        times: The link's airtimes.
        at: End of its last transmission, ns.
        rng: Draws the number of copies.
    """
    record.copies += 1
    most, too_early = MOST_COPIES.get(priority, 1), 0
    if most > 1 and times.listening is not None:
        more_ns = times.listening.detour_ns(record.destination, at)
        if priority is Priority.REAL_TIME:
            more_ns += times.listening.search_ns
        too_early = -(-more_ns // times.copy_ns(record.size_bytes))
        most += too_early
    is_heard_out = times.listening is not None and times.listening.is_heard_out(at + times.gap_ns)
    record.is_copy = is_heard_out and record.copies < most
    if record.is_copy and tries > most and record.copies > too_early:
        record.is_copy = rng.random() < _ANOTHER_COPY
    if not record.is_copy:
        record.copies = 0
    return record.is_copy


def is_emergency(priority: Priority, tries: int) -> bool:
    """Return whether a sample that was sent that often is sent again, wherever its answer may be.

    This is not for requests: the answer would come while the copies deafen the node that awaits it.
    """
    return priority is Priority.REAL_TIME and tries < MOST_COPIES[priority]


def is_doubled(priority: Priority, tries: int) -> bool:
    """Return whether a sample with that many tries is sent twice, since it was not answered before.

    Frames are lost, or collide with frames of the other end. The acknowledging node waits until the
    second copy would have begun; so this is not for requests either.
    """
    return priority in MOST_COPIES and tries > 1


def row_frames(priority: Priority) -> int:
    """Return how many frames, sent at once, a repetition of a sample has."""
    return 2 if priority in MOST_COPIES else 1


def spread(pause_ns: int, priority: Priority, times: LinkTimes, rng: random.Random) -> int:
    """Return the pause before an emergency is repeated, ns, drawn where others may be in runs.

    A node that talks has about the same period as an emergency that awaits its answer each time:
    all repetitions would meet its runs. The last one may not have been answered yet.

    Args:
        pause_ns: The pause as it was drawn, ns.
        priority: The record's priority.
        times: The link's airtimes.
        rng: Draws the part of it.
    """
    is_crowd = times.listening is not None and times.listening.is_crowd
    if priority is not Priority.REAL_TIME or not is_crowd:
        return pause_ns
    return round(rng.uniform(_LEAST_PART, 1.0) * pause_ns)


def aimed_pause(
    pause_ns: int, priority: Priority, tries: int, times: LinkTimes, at: int, rng: random.Random
) -> int:
    """Return the pause before a repetition, ns, which may lead to a pause of the other nodes.

    Args:
        pause_ns: The pause as it was drawn, ns.
        priority: The record's priority.
        tries: How often it was sent, copies included.
        times: The link's airtimes.
        at: Instant from which an answer is awaited, ns.
        rng: Draws which pause of the other nodes it is.
    """
    if priority not in MOST_COPIES or times.listening is None:
        return pause_ns
    # The outcome of the first copy can be known by then, that of the last perhaps not.
    since = times.listening.row_began_at(at)
    invited_at = times.listening.next_invitation_at(at, since + times.first_round_trip_ns)
    if invited_at is None:
        return pause_ns
    rounds = -(-tries // MOST_COPIES[priority])
    later = rng.randrange(min(rounds, _MOST_PAUSES))
    return invited_at - at + later * times.listening.period_ns
