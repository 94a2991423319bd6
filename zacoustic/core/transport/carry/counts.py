"""The publisher's counts of carried topics: one for each key, common to all subscribers.

Each start of the publisher begins new counts. So no journal, be it an old copy, can give a number
to two samples; what is left from before a restart keeps its place in its count.
"""

import enum
import random

import msgspec

from zacoustic.core.streams.keys import Instance
from zacoustic.core.wire.carry import LINEAGES, NUMBERS

_Key = tuple[int, Instance]
"""Stream id and instance."""


class Place(msgspec.Struct, frozen=True):
    """A place in a count."""

    lineage: int
    """The count, 0…65535."""
    number: int
    """The place, 0…2²⁴ - 1."""


class Claim(enum.Enum):
    """What a receipt says of the publisher's count."""

    POSSIBLE = "possible"
    IMPOSSIBLE = "impossible"
    """It is ignored."""
    COUNT_IS_WRONG = "count is wrong"
    """Another count must begin."""


class Counts:
    """The counts of one node.

    Args:
        rng: Draws lineages.
    """

    def __init__(self, rng: random.Random) -> None:
        self._rng = rng
        self._next: dict[_Key, Place] = {}
        self._used: dict[_Key, set[int]] = {}
        self._doubted: set[_Key] = set()

    def used(self, stream_id: int, instance: Instance, lineage: int) -> None:
        """Note a count from before the restart."""
        self._used.setdefault((stream_id, instance), set()).add(lineage)

    def take(self, stream_id: int, instance: Instance) -> Place:
        """Return the next place of a key."""
        key = stream_id, instance
        place = self._next.get(key)
        if place is None or place.number >= NUMBERS:
            place = self._begin(key)
        self._next[key] = Place(place.lineage, place.number + 1)
        return place

    def judge(self, stream_id: int, instance: Instance, claim: Place) -> Claim:
        """Judge a receipt.

        If it names a place that was not taken, it is forged, or somebody else has used the count,
        which then is of no use. The second such receipt is believed.
        """
        key = stream_id, instance
        place = self._next.get(key)
        if place is None or place.lineage != claim.lineage or claim.number <= place.number:
            return Claim.POSSIBLE
        is_second = key in self._doubted
        self._doubted.add(key)
        return Claim.COUNT_IS_WRONG if is_second else Claim.IMPOSSIBLE

    def begin_anew(self, stream_id: int, instance: Instance) -> None:
        """Begin another count of a key."""
        self._next[stream_id, instance] = self._begin((stream_id, instance))
        self._doubted.discard((stream_id, instance))

    # Below the methods above

    def _begin(self, key: _Key) -> Place:
        used = self._used.setdefault(key, set())
        lineage = self._rng.randrange(LINEAGES)
        while lineage in used:
            lineage = self._rng.randrange(LINEAGES)
        used.add(lineage)
        return Place(lineage, 0)
