"""The publisher's counts of carried topics: one for each key, common to all subscribers."""

import random
from collections.abc import Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.streams.keys import Instance
from zacoustic.core.wire.carry import LINEAGES, NUMBERS

_COUNT: Final = "carrying"


class Place(msgspec.Struct, frozen=True, array_like=True):
    """A place in a count."""

    lineage: int
    """The count, 0…65535."""
    number: int
    """The place, 0…2²⁴ - 1."""


class Counts:
    """The counts of one node.

    Args:
        journal: Holds them.
        rng: Draws lineages.
    """

    def __init__(self, journal: JournalPort, rng: random.Random) -> None:
        self._journal = journal
        self._rng = rng
        self._next: dict[tuple[int, Instance], Place] = {}

    def recover(self, stored: Mapping[str, bytes], *, is_doubtful: bool) -> None:
        """Restore the counts; where the journal is in doubt, new ones begin."""
        for key, value in stored.items():
            kind, _, rest = key.partition("/")
            if kind == _COUNT and not is_doubtful:
                stream_id, instance = rest.split("/")
                place = msgspec.msgpack.decode(value, type=Place)
                self._next[int(stream_id), tuple(bytes.fromhex(instance))] = place

    def take(self, stream_id: int, instance: Instance) -> Place:
        """Return the next place of a key."""
        place = self._next.get((stream_id, instance))
        if place is None or place.number >= NUMBERS:
            place = self._drawn(stream_id, instance)
        self._write(stream_id, instance, Place(place.lineage, place.number + 1))
        return place

    def claims_too_much(self, stream_id: int, instance: Instance, claim: Place) -> bool:
        """Return whether a receipt names a place of the present count that was not taken."""
        place = self._next.get((stream_id, instance))
        return place is not None and place.lineage == claim.lineage and claim.number > place.number

    def begin_anew(self, stream_id: int, instance: Instance) -> None:
        """Begin another count of a key."""
        self._write(stream_id, instance, self._drawn(stream_id, instance))

    # Below the methods above

    def _drawn(self, stream_id: int, instance: Instance) -> Place:
        before = self._next.get((stream_id, instance))
        lineage = self._rng.randrange(LINEAGES)
        while before is not None and lineage == before.lineage:
            lineage = self._rng.randrange(LINEAGES)
        return Place(lineage, 0)

    def _write(self, stream_id: int, instance: Instance, place: Place) -> None:
        self._next[stream_id, instance] = place
        key = f"{_COUNT}/{stream_id}/{bytes(instance).hex()}"
        self._journal.write(key, msgspec.msgpack.encode(place))
