"""Health as plain Zenoh keys: the state of the link, the channel and the streams.

JSON under ``@acoustic/ADDRESS/``, put when it has changed, at most once in `INTERVAL_S`, and
answered to a `get`:

============  =====================================================================================
``node``      name, version, start, locator
``link``      state, capabilities and reports of the device, frames, bytes, airtime
``ledger``    every byte on the link by stream and cause, with its share of the airtime
``peers``     nodes heard: epoch, table, when, outcomes of frames to each, and the modem's newest
              measurements of it
``streams``   digest of the table, nodes that differ; for each stream counters, jobs, when it
              crossed and how often; missed deadlines; outcomes of reliable samples; overrides of
              topics that this node publishes; subscribers and publishers of on-demand topics
``objects``   samples larger than a frame: their progress, the outcomes of the last ones
``water``     the frame being sent, the last ones sent and heard
``journal``   whether anything survives a restart, why it cannot be written now, and why it may
              lack the last writes (a line that ``node`` has as well)
``events``    the last notable events, errors among them
``dropped``   dropped receptions and useless local input
``clock``     the time here; answered to a `get`, and put when the clock has been set
============  =====================================================================================

and the peer status by `soundings`: ``peer/ADDRESS/lost``, ``…/late``, ``…/range``, ``…/position``,
``…/direction``, ``modem``.

The keys begin with ``@``: no wildcard of an application and no stream covers them, so they never
cross the channel. The one timer is armed by a change and not re-armed: an idle gateway has none.
"""

import asyncio
from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.base.qos import Priority, Reliability
from zacoustic.core.base.stats import LedgerEntry
from zacoustic.core.base.trace import TraceRecord
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import (
    DeliveryEnded,
    DeliveryOutcome,
    PeerSeen,
    SampleReceived,
    StreamsDiffer,
)
from zacoustic.core.streams.specs import ActionSpec, ServiceSpec, StreamSpec, TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.core.values.encoding import JSON
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.gateway.commands.objects import ObjectDesk
from zacoustic.zenoh.gateway.status.chronicle import Chronicle
from zacoustic.zenoh.gateway.status.dates import Dates
from zacoustic.zenoh.gateway.status.soundings import Soundings
from zacoustic.zenoh.gateway.status.traffic import Traffic
from zacoustic.zenoh.gateway.status.water import FrameLog
from zacoustic.zenoh.session.asking.orders import PREFIX
from zacoustic.zenoh.session.asking.queries import Answer, HeldQuery
from zacoustic.zenoh.session.session import Island

INTERVAL_S: Final = 1.0
"""Least time between two puts of one document, s."""

_KINDS: Final[dict[type[StreamSpec], str]] = {
    TopicSpec: "topic",
    ServiceSpec: "service",
    ActionSpec: "action",
}

Counts = dict[str, dict[str, int]]
"""How many, by stream and reason."""


class Health:
    """The health report of one gateway; for the loop.

    Args:
        runner: Whose engine and link.
        island: Where it is put.
        objects: Knows how far large samples are.
        chronicle: Keeps the recent events.
        about: What does not change: the document ``node``.
        jobs: What this gateway does: job and stream id.
        losses: Useless local input.
        is_journal_kept: The journal outlives the process.
        dates: Dates of the documents.
        clock: Where the instants of the engine come from.
        interval_s: Least time between two puts of one document, s.
    """

    def __init__(
        self,
        runner: LinkRunner,
        island: Island,
        *,
        objects: ObjectDesk,
        chronicle: Chronicle,
        about: Mapping[str, object],
        jobs: Callable[[], frozenset[tuple[str, int]]],
        losses: Callable[[], Counts],
        is_journal_kept: bool,
        dates: Dates,
        clock: Clock,
        interval_s: float = INTERVAL_S,
    ) -> None:
        self._runner = runner
        self._island = island
        self._objects = objects
        self._chronicle = chronicle
        self._about = {**about, "started_at_unix_s": round(dates.unix_s(), 3)}
        self._jobs = jobs
        self._losses = losses
        self._is_journal_kept = is_journal_kept
        self._dates = dates
        self._times_set = 0
        self._clock = clock
        self._interval_s = interval_s
        self._loop = asyncio.get_running_loop()
        self._prefix = f"{PREFIX}/{runner.engine.address}"
        self._timer: asyncio.TimerHandle | None = None
        self._is_closed = False
        self._last_at_s = float("-inf")
        self._published: dict[str, bytes] = {}
        self._seen: dict[int, PeerSeen] = {}
        self._traffic = Traffic(dates.unix_s)
        engine = runner.engine
        self._frames = FrameLog(engine, unix_s=dates.unix_s)
        self._soundings = Soundings(
            engine.measurements,
            engine.contact,
            engine.deadlines,
            address=engine.address,
            clock=clock,
            unix_s=dates.unix_s,
        )
        self._differing: dict[int, set[int]] = {}
        self._outcomes: dict[int, dict[str, int]] = {}

    @property
    def expression(self) -> str:
        """Key expression of all documents."""
        return f"{self._prefix}/**"

    def trace(self, record: TraceRecord) -> None:
        """Note every action of the engine; its trace sink."""
        self._traffic.note(record)
        self._frames.note(record)
        self.touch()

    def note_sample(self, event: SampleReceived) -> None:
        """Keep how old a sample was when it was sent."""
        self._traffic.note_age(event.stream_id, event.age_s)

    def note_peer(self, event: PeerSeen) -> None:
        """Keep a peer's introduction; streams that differed may agree in its new boot epoch."""
        self._seen[event.address] = event
        for peers in self._differing.values():
            peers.discard(event.address)

    def note_difference(self, event: StreamsDiffer) -> None:
        """Keep that a stream is stopped."""
        self._differing.setdefault(event.stream_id, set()).add(event.address)

    def note_delivery(self, event: DeliveryEnded) -> None:
        """Count how a reliable sample ended."""
        counts = self._outcomes.setdefault(event.stream_id, {})
        counts[event.outcome.value] = counts.get(event.outcome.value, 0) + 1

    def touch(self) -> None:
        """Something has changed: publish soon."""
        if self._timer is None and not self._is_closed:
            due_at_s = max(self._loop.time(), self._last_at_s + self._interval_s)
            self._timer = self._loop.call_at(due_at_s, self._publish)

    def answer(self, held: HeldQuery) -> None:
        """Answer a `get`."""
        asked = held.query.key_expr
        # Monitors ask for the clock every second, to know that this gateway runs.
        is_pulse = str(asked).endswith("/clock")
        documents = {**({} if is_pulse else self._encoded()), **self._clock_document()}
        held.answer(
            [
                Answer(key=key, payload=payload, encoding=JSON)
                for key, payload in documents.items()
                if asked.intersects(key)
            ]
        )

    def close(self) -> None:
        """Publish no more."""
        self._is_closed = True
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _publish(self) -> None:
        self._timer = None
        self._last_at_s = self._loop.time()
        documents = self._encoded()
        if self._times_set != self._dates.times_set:
            self._times_set = self._dates.times_set
            documents = {**self._clock_document(), **documents}  # before those that it dates
        for key, payload in documents.items():
            if self._published.get(key) != payload:
                self._published[key] = payload
                self._island.put(key, payload, encoding=JSON, priority=Priority.DATA_LOW)

    def _clock_document(self) -> dict[str, bytes]:
        """Shows a client how far the wall clocks are apart."""
        self._dates.look()
        now = {"now_unix_s": self._dates.now_unix_s()}
        return {f"{self._prefix}/clock": msgspec.json.encode(now)}

    def _encoded(self) -> dict[str, bytes]:
        return {
            f"{self._prefix}/{name}": msgspec.json.encode(document, order="deterministic")
            for name, document in self.documents().items()
        }

    def documents(self) -> dict[str, object]:
        """Return all documents as they are now, by the end of their keys."""
        self._dates.look()
        documents = {
            "node": self._about | {"doubt": self._engine.doubt.reason},
            "link": self._link(),
            "ledger": self._ledger(),
            "peers": self._peers(),
            "streams": self._streams(),
            "objects": self._objects.document(),
            "water": self._frames.document(),
            "journal": {
                "kept": self._is_journal_kept,
                "failure": self._engine.journal_failure,
                "doubt": self._engine.doubt.reason,
            },
            "dropped": self._dropped(),
            "events": self._chronicle.document(),
            **self._soundings.documents(),
        }
        return {name: self._dates.told(each) for name, each in documents.items()}

    @property
    def _engine(self) -> Engine:
        return self._runner.engine

    def _link(self) -> dict[str, object]:
        stats, why_silent = self._engine.stats, self._why_silent()
        return {
            "state": self._runner.link_state.value,
            "detail": self._runner.link_detail,
            "silent": bool(why_silent),
            "why_silent": why_silent,
            "capabilities": self._engine.capabilities,
            "diagnostics": self._runner.link.diagnostics(),
            "frames_transmitted": stats.frames_transmitted,
            "bytes_transmitted": stats.bytes_transmitted,
            "airtime_s": ns_to_seconds(stats.airtime_ns),
            "frames_received": stats.frames_received,
            "bytes_received": stats.bytes_received,
            "reports": stats.reports,
        }

    def _why_silent(self) -> str:
        """Return why nothing is transmitted; empty: no such command, and the time is known."""
        engine = self._engine
        state = engine.silence.state(self._clock())
        if state.is_ordered:
            return f"ordered; {state.doubt}" if state.doubt else "ordered"
        return engine.clock.doubt or ("a quiet window" if state.is_silent else "")

    def _ledger(self) -> dict[str, object]:
        stats = self._engine.stats
        airtime_s = ns_to_seconds(stats.airtime_ns)
        per_byte_s = airtime_s / stats.bytes_transmitted if stats.bytes_transmitted else 0.0
        return {
            "bytes": stats.bytes_transmitted,
            "airtime_s": airtime_s,
            "entries": [self._entry(entry, per_byte_s) for entry in stats.ledger()],
        }

    def _entry(self, entry: LedgerEntry, per_byte_s: float) -> dict[str, object]:
        return {
            "id": entry.stream_id,
            "stream": self._name(entry.stream_id),
            "cause": entry.cause.value,
            "bytes": entry.transmitted_bytes,
            "airtime_s": round(entry.transmitted_bytes * per_byte_s, 6),
        }

    def _peers(self) -> dict[str, object]:
        confirmed = self._engine.peers()
        measured = self._engine.measurements.addresses()
        heard_at_unix_s = self._traffic.heard_at_unix_s()
        addresses = sorted({*confirmed, *self._seen, *heard_at_unix_s, *measured})
        return {
            str(address): self._peer(address, confirmed, heard_at_unix_s.get(address))
            for address in addresses
        }

    def _peer(
        self, address: int, confirmed: dict[int, bool], heard_at_unix_s: float | None
    ) -> dict[str, object]:
        seen = self._seen.get(address)
        round_trip_ns = self._engine.stats.round_trips_ns.get(address)
        return {
            "name": self._engine.table.nodes.get(address, ""),
            "epoch": seen.epoch if seen else None,
            "same_table": seen.same_table if seen else None,
            "wire_version": seen.wire_version if seen else None,
            "confirmed_us": confirmed.get(address, False),
            "heard_at_unix_s": heard_at_unix_s,
            **self._traffic.of_peer(address),
            "round_trip_s": ns_to_seconds(round_trip_ns) if round_trip_ns else None,
            "metrics": self._engine.measurements.metrics(address),
        }

    def _streams(self) -> dict[str, object]:
        engine, stats = self._engine, self._engine.stats
        jobs = self._jobs()
        return {
            "digest": engine.table.digest.hex(),
            "streams": [
                {
                    "id": stream.stream_id,
                    "name": stream.name,
                    "kind": _KINDS[type(stream.spec)],
                    "jobs": sorted(job for job, of in jobs if of == stream.stream_id),
                    "published": stats.published.get(stream.stream_id, 0),
                    "transmitted": stats.transmitted.get(stream.stream_id, 0),
                    "received": stats.received.get(stream.stream_id, 0),
                    "waiting": engine.pending(stream.stream_id),
                    **self._traffic.of_stream(stream.stream_id),
                    **self._missed(stream),
                    **self._deliveries(stream),
                    **self._tuning(stream),
                    **self._demands(stream),
                }
                for stream in engine.table
            ],
            "differ": [
                {"id": stream_id, "name": self._name(stream_id), "peers": sorted(peers)}
                for stream_id, peers in sorted(self._differing.items())
                if peers
            ],
        }

    def _missed(self, stream: Stream) -> dict[str, int]:
        """Return how often no sample of a topic with a deadline came in time."""
        if stream.qos.deadline_s is None:
            return {}
        missed = self._engine.stats.deadlines_missed
        return {"deadline_missed": missed.get(stream.stream_id, 0)}

    def _deliveries(self, stream: Stream) -> dict[str, int]:
        """Return what became of the samples of a reliable topic."""
        if stream.qos.reliability is not Reliability.RELIABLE:
            return {}
        counts = self._outcomes.get(stream.stream_id, {})
        return {outcome.value: counts.get(outcome.value, 0) for outcome in DeliveryOutcome} | {
            "delivering": self._engine.delivering(stream.stream_id)
        }

    def _tuning(self, stream: Stream) -> dict[str, object]:
        """Return how the samples of a topic of this node are sent, with its overrides."""
        if not (isinstance(stream.spec, TopicSpec) and stream.may_publish(self._engine.address)):
            return {}
        on, qos = self._engine.orders.tunings.effective(stream)
        priority = qos.priority.name.lower()
        return {"tuning": {"on": on, "min_interval_s": qos.min_interval_s, "priority": priority}}

    def _demands(self, stream: Stream) -> dict[str, list[int]]:
        """Return subscribers and publishers of an on-demand topic."""
        demand = self._engine.demand
        audience = demand.audience(stream)
        if audience is None:
            return {}
        asked = demand.wanted(stream.stream_id)
        return {"subscribers": sorted(audience), "subscribed_to": sorted(asked)}

    def _dropped(self) -> dict[str, object]:
        engine = self._engine
        return {
            "water": engine.stats.dropped,
            "island": self._losses(),
            "expired": {self._name(each): count for each, count in engine.expired.items()},
            "superseded": {self._name(each): count for each, count in engine.superseded.items()},
            "unsubscribed": {
                self._name(each): count for each, count in engine.stats.unsubscribed.items()
            },
        }

    def _name(self, stream_id: int) -> str:
        stream = self._engine.table.get(stream_id)
        return stream.name if stream is not None else ""
