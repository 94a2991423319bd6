"""How often a record is sent in a row, before an answer to it is awaited; and for how long it is.

An answer takes a round trip, longer than a few short frames. So an emergency is sent four times at
once. A node in a run hears only in its pauses, four seconds apart, and listens longer if it hears
something there that it does not understand (`zacoustic.core.schedule.access.listening`). So
commands go twice into such a pause, and what was not answered goes again into a later one: being a
little late for a pause would cost four seconds.

Several nodes may have something urgent for the same node at the same time, such as a stop of two
vehicles: all aim at the same pause, and all their copies collide there. So after the first row the
number of copies is drawn, but for those that come too early, and a node that sends one more than
the others is understood. Later on the pause is drawn as well, among the more pauses the more
attempts were in vain.
"""

import random
from typing import Final

from zacoustic.core.base.qos import Priority
from zacoustic.core.schedule.queue import Waiting
from zacoustic.core.schedule.timing import LinkTimes

MOST_COPIES: Final = {Priority.REAL_TIME: 4, Priority.INTERACTIVE_HIGH: 2}
"""In a row. At 40 % loss one of four arrives in 97 of 100 cases, at 20 % one of two in 96."""

_ANOTHER_COPY: Final = 0.75
"""Probability of another copy, after the first row."""
_MOST_PAUSES: Final = 4
"""The next attempt goes into one of this many pauses of another node at most."""


def follow(
    record: Waiting, priority: Priority, tries: int, times: LinkTimes, at: int, rng: random.Random
) -> bool:
    """Tell whether a record that was just sent follows itself into a pause, and note it there.

    Args:
        record: The record.
        priority: Of its lane.
        tries: How often it was sent, copies included.
        times: Of the link.
        at: End of its last transmission, ns.
        rng: Draws how many copies there are.
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
    """Tell whether a sample that was sent so often goes again, wherever its answer may be.

    Not so a request: its answer would come while its copies deafen the one that waits for it.
    """
    return priority is Priority.REAL_TIME and tries < MOST_COPIES[priority]


def is_doubled(priority: Priority, tries: int) -> bool:
    """Tell whether a sample with that many attempts goes twice: it was not answered before.

    Frames are lost, or collide with frames of the other end. The acknowledging node waits until the
    second copy would have begun; so again this is not for requests.
    """
    return priority in MOST_COPIES and tries > 1


def row_frames(priority: Priority) -> int:
    """Return how many frames a repetition of a sample is, one at once behind the other."""
    return 2 if priority in MOST_COPIES else 1


def aimed_pause(
    pause_ns: int, priority: Priority, tries: int, times: LinkTimes, at: int, rng: random.Random
) -> int:
    """Return a pause before a repetition, or how long it is to a pause of the others, ns.

    Args:
        pause_ns: As it was drawn.
        priority: Of the record.
        tries: How often it was sent, copies included.
        times: Of the link.
        at: Since when an answer is awaited, ns.
        rng: Draws which of the pauses of the others it is.
    """
    if priority not in MOST_COPIES or times.listening is None:
        return pause_ns
    # What has come of the first copy can be known by then, of the last maybe not.
    since = times.listening.row_began_at(at)
    invited_at = times.listening.next_invitation_at(at, since + times.first_round_trip_ns)
    if invited_at is None:
        return pause_ns
    rounds = -(-tries // MOST_COPIES[priority])
    later = rng.randrange(min(rounds, _MOST_PAUSES))
    return invited_at - at + later * times.listening.period_ns
