"""The receiver of one node: decides the outcome of each arrival by what overlapped it.

An idle receiver locks on the first arrival that it notices and follows it to its end. Sound that
begins meanwhile is not received, even if it is stronger (`Outcome.DEAF`), but it disturbs. A
half-duplex node receives nothing while it transmits, and drops the arrival that it follows when it
begins to. So an arrival passes these questions, in this order:

1. Did the node transmit during any part of it?  ``HALF_DUPLEX``
2. Is it too weak to be noticed?  ``NOISE``
3. Was the receiver following an earlier one?  ``DEAF``
4. Did others overlap it too strongly?  ``COLLISION``, by one of three rules:
   - ``capture`` (the default): the sum of all that overlaps it, at any time, must stay `capture_db`
     below it;
   - ``sinr``: the overlapping power, averaged over the frame, counts as noise, and the draw decides
     (the rule of DESERT's samples, "mean power");
   - ``protocol``: any overlap destroys both, at any levels, without locking: the assumption of the
     throughput formulae of ALOHA.
5. Does noise destroy it, or a named loss of the scenario drop it?  ``NOISE``

Sound of a modem of another kind disturbs if its band overlaps, and is never received.

An arrival gets its outcome at its end. By then all sound that can overlap it is known, because it
was sent before. Entries are stored, sorted by beginning, until they can overlap no arrival without
an outcome; the list holds a handful.
"""

import math
from bisect import insort
from typing import Final

from zacoustic.channel.arrival import Arrival, Outcome, Reception
from zacoustic.channel.formulae.acoustics import combined_snr_db
from zacoustic.channel.formulae.modulation import ratio
from zacoustic.channel.propagation.sea import ChannelModel

_FORGET_AFTER_NS: Final = 600 * 1_000_000_000
"""A closed node's driver asks for no outcome; its arrivals are forgotten after ten minutes, ns."""
_TIDY_ABOVE: Final = 32
"""Number of entries above which old ones are removed even without a call of `judge`."""


class _Entry:
    """One arrival at this node, and whether the receiver followed it."""

    __slots__ = ("arrival", "ends_at", "is_decodable", "is_followed", "is_judged", "starts_at")

    def __init__(self, arrival: Arrival, *, is_decodable: bool) -> None:
        self.arrival = arrival
        self.starts_at = arrival.starts_at
        self.ends_at = arrival.ends_at
        self.is_decodable = is_decodable
        self.is_judged = not is_decodable
        self.is_followed: bool | None = None


class Receiver:
    """The receiver of one node.

    Args:
        channel: Channel model of the node's modem.
        collisions: ``capture``, ``sinr`` or ``protocol``.
    """

    def __init__(self, channel: ChannelModel, collisions: str) -> None:
        self._channel = channel
        self.profile = channel.profile
        self._collisions = collisions
        # Sorted by beginning; sender and counter make the order of equal beginnings independent of
        # the order of calls.
        self._entries: list[tuple[int, int, int, _Entry]] = []
        self._emissions: list[tuple[int, int]] = []
        self._following: _Entry | None = None

    @property
    def remembered(self) -> int:
        """Number of stored arrivals and emissions."""
        return len(self._entries) + len(self._emissions)

    def expect(self, arrival: Arrival, now: int, *, is_decodable: bool) -> None:
        """Note an arrival that is under way.

        Args:
            arrival: The arrival, not yet begun or just beginning.
            now: Instant of its departure, ns.
            is_decodable: Whether it comes from a modem of the same kind; only then `judge` is
                called for it.
        """
        if len(self._entries) >= _TIDY_ABOVE:
            self._forget(now)
        entry = _Entry(arrival, is_decodable=is_decodable)
        insort(self._entries, (arrival.starts_at, arrival.source, arrival.sequence, entry))

    def transmits(self, started_at: int, ends_at: int) -> None:
        """Note a transmission of this node, from one instant to another, ns."""
        if self.profile.half_duplex:
            if len(self._emissions) >= _TIDY_ABOVE:
                self._forget(started_at)
            self._emissions.append((started_at, ends_at))

    def judge(self, arrival: Arrival) -> Reception:
        """Return the outcome of an arrival that has ended.

        Raises:
            ValueError: The arrival has an outcome already, or is unknown here.
        """
        entry = self._entry_of(arrival)
        overlaps: list[_Entry] = []
        if not self.profile.separates_senders:
            self._follow_until(entry.starts_at)
            start, end = entry.starts_at, entry.ends_at
            for other_start, _, _, other in self._entries:
                if other_start >= end:
                    break
                if other.ends_at > start and other is not entry:
                    overlaps.append(other)
        outcome, sinr_db = self._outcome(entry, overlaps)
        entry.is_judged = True
        self._forget(arrival.ends_at)
        if outcome is not Outcome.RECEIVED:
            return Reception(arrival=arrival, outcome=outcome, sinr_db=sinr_db)
        return Reception(
            arrival=arrival,
            outcome=outcome,
            sinr_db=sinr_db,
            corrupt_seed=arrival.corrupt_seed,
            delay_s=arrival.delay_s,
            duplicates_after_s=arrival.duplicates_after_s,
        )

    def _entry_of(self, arrival: Arrival) -> _Entry:
        for _, source, sequence, entry in self._entries:
            if sequence == arrival.sequence and source == arrival.source and not entry.is_judged:
                return entry
        raise ValueError(
            f"arrival {arrival.sequence} from {arrival.source} at {arrival.node} "
            "is not expected; it was judged, or its end was missed by ten minutes"
        )

    def _follow_until(self, instant: int) -> None:
        """Lock on noticed arrivals, in order of their beginnings, up to an instant."""
        for starts_at, _, _, entry in self._entries:
            if starts_at > instant:
                return
            if entry.is_followed is None:
                entry.is_followed = self._can_follow(entry)
                if entry.is_followed:
                    self._following = entry

    def _can_follow(self, entry: _Entry) -> bool:
        if not entry.is_decodable or entry.arrival.snr_db < self._channel.detection_snr_db:
            return False
        start = entry.starts_at
        if any(began <= start < ended for began, ended in self._emissions):
            return False
        before = self._following
        if before is None or before.ends_at <= start:
            return True
        # Following another one: deaf, unless an own transmission made the receiver drop it.
        return any(before.starts_at < began <= start for began, _ in self._emissions)

    def _outcome(self, entry: _Entry, overlaps: list[_Entry]) -> tuple[Outcome, float]:
        arrival = entry.arrival
        snr_db = arrival.snr_db
        start, end = entry.starts_at, entry.ends_at
        if any(began < end and ended > start for began, ended in self._emissions):
            return Outcome.HALF_DUPLEX, snr_db
        if snr_db < self._channel.detection_snr_db:
            return Outcome.NOISE, snr_db
        if overlaps:
            return self._outcome_of_overlap(entry, overlaps)
        error_rate = self._channel.frame_error_rate(arrival.effective_snr_db, arrival.frame_bytes)
        if arrival.dropped or arrival.chance < error_rate:
            return Outcome.NOISE, snr_db
        return Outcome.RECEIVED, snr_db

    def _outcome_of_overlap(self, entry: _Entry, overlaps: list[_Entry]) -> tuple[Outcome, float]:
        arrival = entry.arrival
        mean_sir_db = arrival.received_level_db - _mean_level_db(entry, overlaps)
        sinr_db = combined_snr_db(arrival.snr_db, mean_sir_db)
        if self._collisions == "protocol":
            return Outcome.COLLISION, sinr_db
        if not entry.is_followed:
            return Outcome.DEAF, sinr_db
        error_rate = self._channel.frame_error_rate(arrival.effective_snr_db, arrival.frame_bytes)
        if self._collisions == "capture":
            sum_db = _level_db(sum(ratio(other.arrival.received_level_db) for other in overlaps))
            is_collision = arrival.received_level_db - sum_db < self.profile.capture_db
        else:
            disturbed_db = combined_snr_db(arrival.effective_snr_db, mean_sir_db)
            disturbed_rate = self._channel.frame_error_rate(disturbed_db, arrival.frame_bytes)
            is_collision = error_rate <= arrival.chance < disturbed_rate
        if is_collision:
            return Outcome.COLLISION, sinr_db
        if arrival.dropped or arrival.chance < error_rate:
            return Outcome.NOISE, sinr_db
        return Outcome.RECEIVED, sinr_db

    def _forget(self, now: int) -> None:
        """Drop arrivals that overlap no arrival without an outcome."""
        stale_at = now - _FORGET_AFTER_NS
        oldest = now
        for starts_at, _, _, entry in self._entries:
            if not entry.is_judged and entry.ends_at > stale_at:
                oldest = min(oldest, starts_at)
                break
        entries = self._entries
        # Usually only the first one can go: look before copying.
        if (entries and entries[0][3].ends_at <= oldest) or len(entries) >= _TIDY_ABOVE:
            self._entries = [item for item in entries if item[3].ends_at > oldest]
        if self._following is not None and self._following.ends_at <= oldest:
            self._following = None
        if self._emissions and self._emissions[0][1] <= oldest:
            self._emissions = [pair for pair in self._emissions if pair[1] > oldest]


def _mean_level_db(entry: _Entry, overlaps: list[_Entry]) -> float:
    """Level of the overlapping power, averaged over the frame, dB re 1 µPa."""
    duration = max(entry.ends_at - entry.starts_at, 1)
    total = 0.0
    for other in overlaps:
        shared = min(entry.ends_at, other.ends_at) - max(entry.starts_at, other.starts_at)
        total += ratio(other.arrival.received_level_db) * shared / duration
    return _level_db(total)


def _level_db(power: float) -> float:
    return 10.0 * math.log10(power) if power > 0.0 else float("-inf")
