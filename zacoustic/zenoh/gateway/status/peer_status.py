"""Peer status beside samples, as documents of the health report.

===========================  ======================================================================
``peer/ADDRESS/range``       range, propagation delay, signal quality
``peer/ADDRESS/position``    by an ultra-short baseline head: east, north, up
``peer/ADDRESS/direction``   of its last frame: bearing, elevation
``peer/ADDRESS/lost``        whether no frame of it came for the configured time
``peer/ADDRESS/late``        topics with a deadline of which a sample of that node is overdue
``modem``                    firmware, supply, source level, of the first link that reports them
``modem/NAME``               the same of each of several links
===========================  ======================================================================

A document of a measurement exists from the first measurement on. All have the instant by the wall
clock, since the monotonic clock means nothing to another computer.
"""

import time
from collections.abc import Callable

import msgspec

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.engine.engine import Engine
from zacoustic.run.runner import LinkRunner
from zacoustic.status.node import ModemDocument
from zacoustic.status.peers import (
    DirectionDocument,
    LateDocument,
    LostDocument,
    PositionDocument,
    RangeDocument,
)


class PeerStatus:
    """What one engine knows of other nodes; for the loop.

    Args:
        runner: Runs the engine.
        clock: Source of its instants.
        unix_s: The wall clock, s.
    """

    def __init__(
        self,
        runner: LinkRunner,
        *,
        clock: Clock,
        unix_s: Callable[[], float] = time.time,
    ) -> None:
        self._runner = runner
        self._clock = clock
        self._unix_s = unix_s
        self._dated: dict[str, tuple[int, float]] = {}

    def documents(self) -> dict[str, object]:
        """Return the documents, by the end of their keys."""
        engine = self._runner.engine
        known = engine.measurements
        found: dict[str, object] = {}
        for address in known.addresses():
            kind: type[msgspec.Struct]
            for name, kind, each in (
                ("range", RangeDocument, known.range(address)),
                ("position", PositionDocument, known.position(address)),
                ("direction", DirectionDocument, known.direction(address)),
            ):
                if each is not None:
                    key = f"peer/{address}/{name}"
                    fields = msgspec.structs.asdict(each)
                    del fields["address"]
                    at = self._date(key, fields.pop("measured_at"))
                    found[key] = kind(**fields, measured_at_unix_s=at)
        for address, sighting in engine.contact.sightings().items():
            key = f"peer/{address}/lost"
            heard_at = sighting.heard_at if sighting.is_lost else None
            found[key] = LostDocument(
                lost=sighting.is_lost,
                since_unix_s=self._date(f"{key}/since", sighting.since),
                heard_at_unix_s=heard_at and self._date(f"{key}/heard", heard_at),
            )
        found |= self._late(engine)
        return found | self._modems(engine)

    def _modems(self, engine: Engine) -> dict[str, object]:
        """Return the modems' reports: that of the first link with one, and each."""
        found: dict[str, object] = {}
        for link in engine.links:
            read = engine.measurements.modems.get(link)
            if read is None:
                continue
            fields = msgspec.structs.asdict(read)
            at = self._date(f"modem/{link}", fields.pop("read_at"))
            document = ModemDocument(**fields, read_at_unix_s=at)
            found.setdefault("modem", document)
            if len(engine.links) > 1:
                found[f"modem/{link}"] = document
        return found

    def _late(self, engine: Engine) -> dict[str, object]:
        """Return the overdue samples of each node with topics that have a deadline."""
        found: dict[str, object] = {}
        awaited = [each for each in engine.deadlines.awaited() if each.source != engine.address]
        for address in sorted({each.source for each in awaited}):
            keys = [each for each in awaited if each.source == address]
            found[f"peer/{address}/late"] = LateDocument(
                late=[each.key for each in keys if each.is_late],
                missed={each.key: each.missed for each in keys},
            )
        return found

    def _date(self, key: str, at: int) -> float:
        """Return an instant by the wall clock, s; computed once, so that it stays the same."""
        known_at, date_s = self._dated.get(key, (None, 0.0))
        if known_at != at:
            date_s = round(self._unix_s() - ns_to_seconds(self._clock() - at), 3)
            self._dated[key] = at, date_s
        return date_s
