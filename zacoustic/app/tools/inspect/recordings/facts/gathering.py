"""Reads the events of one or more recordings, from which figures are computed.

A recorded engine gives everything: requests, received samples, every frame. A recorded network
gives the frames of its gateways, and the samples that they received.
"""

import functools
import hashlib
import re
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.facts import (
    METRICS,
    Arrived,
    Asked,
    Command,
    Delivery,
    Facts,
    Frame,
    Handled,
    Number,
    Published,
    Sample,
    Transmitted,
)
from zacoustic.app.tools.inspect.recordings.facts.reactions import REACTIONS
from zacoustic.app.tools.inspect.recordings.facts.rows import Rows
from zacoustic.core.base.linktypes import (
    LinkMetrics,
    Measurement,
    PeerMeasured,
)
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.core.values.types import TypeTable
from zacoustic.core.wire.envelope import Envelope, Opened
from zacoustic.errors import ConfigError, ZacousticError
from zacoustic.run.recording.calls import TYPES, Recorded, read_outcome
from zacoustic.run.recording.channels import (
    RECEIVED,
    SENT,
    FrameRecord,
    LedgerRecord,
    LedgerRow,
    ReportRecord,
    capabilities_in,
)
from zacoustic.run.recording.epochs import LifeReader, NewLife
from zacoustic.run.recording.reading import ReadMessage, RecordingReader
from zacoustic.run.recording.samples import SAMPLES_TOPIC, TABLE_TOPIC, SampleRecord, decode_table


def gather(
    paths: Iterable[str | Path],
    *,
    lean: bool = False,
    progress: Callable[[float], None] | None = None,
) -> Facts:
    """Read recordings.

    Args:
        paths: The files.
        lean: Keep what figures need alone, see `Facts`.
        progress: Called with the share that has been read, 0…1.

    Raises:
        ConfigError: A file is no recording, or contains neither a gateway nor an engine.
    """
    facts = Facts(lean=lean)
    paths = list(paths)
    for number, path in enumerate(paths):
        source = RecordingReader(path, tells=False)
        facts.files.append(str(path))
        gatherer = _Gatherer(facts)
        for count, message in enumerate(source):
            gatherer.take(message)
            if progress is not None and count % _SHOW_EACH == 0:
                progress((number + source.share) / len(paths))
        facts.unread += gatherer.unread
        facts.programs[str(path)] = source.program
        if source.damage:
            facts.damage[str(path)] = source.damage
    if not (facts.tables or facts.frames or facts.sources or facts.ledgers):
        why = "; ".join(f"{path} ends early: {damage}" for path, damage in facts.damage.items())
        raise ConfigError(
            f"{', '.join(facts.files)}: nothing of a gateway or an engine is in it"
            + (f" ({why})" if why else ""),
            hint="record with --record at the gateway, the Node or zacoustic sim, or with "
            "zacoustic record",
        )
    return facts


def add_messages(facts: Facts, messages: Iterable[ReadMessage]) -> None:
    """Take the messages of one recording."""
    gatherer = _Gatherer(facts)
    for message in messages:
        gatherer.take(message)
    facts.unread += gatherer.unread


# The node of a message, and the node that a measurement is about.
_WHOSE: Final = re.compile(r"/(?:@acoustic/)?([0-9]{1,3})/.+")
_PEER: Final = re.compile(r"/@acoustic/([0-9]{1,3})/peer/([0-9]{1,3})/range")

_COMMANDS: Final = (
    "subscriptions.want", "ranging.request", "ranging.repeat", "commands.send", "silence.begin",
    "silence.resume",
)  # fmt: skip


_NEVER: Final = (0, 0)
_DIGEST_BYTES: Final = 12
_SHOW_EACH: Final = 4096
_READ: Final = frozenset(
    {
        "poll_event", "publish", "call", "actions.send_goal", "declare", "handle_measurement",
        *_COMMANDS, *REACTIONS,
    }
)  # fmt: skip
"""The calls of an engine that are facts."""
_FRAMES: Final = msgspec.json.Decoder(FrameRecord)
_REPORTS: Final = msgspec.json.Decoder(ReportRecord)
_HEAD_BYTES: Final = 40
"""The kind of an event is within this many bytes of its record."""


class _CommandEvent(msgspec.Struct):
    commanded_by: int
    kind: str | None = None
    stream_id: int | None = None
    refusal: str = ""


class _SealEvent(msgspec.Struct):
    address: int
    refusal: str
    frames: int
    stream_id: int | None = None


class _Gatherer:
    def __init__(self, facts: Facts) -> None:
        self._facts = facts
        only = _READ - REACTIONS if facts.is_lean else _READ
        self._epochs = LifeReader(only, skips=True)
        self._places: dict[str, tuple[int | None, int | None, str]] = {}
        """Whose a topic is, the node that its records name, and its last part."""
        self._offsets: dict[int, int] = {}
        self._calls: dict[tuple[int, object], Asked] = {}
        self._envelopes: dict[int, Envelope] = {}
        self._ranges: dict[tuple[int, int], int] = {}
        """When the newest range of each pair was measured, UTC, ns."""
        self._books: dict[int, _Book] = {}
        """The ledgers of gateways on a recorded network."""
        self._table: StreamTable | None = None
        """The table of a recording without boot epochs."""

    @property
    def unread(self) -> int:
        """How many calls could not be read."""
        return self._epochs.skipped

    def take(self, message: ReadMessage) -> None:
        facts = self._facts
        if not facts.began_ns or message.utc_ns < facts.began_ns:
            facts.began_ns = message.utc_ns
        facts.ended_ns = max(facts.ended_ns, message.utc_ns)
        place = self._places.get(message.topic)
        if place is None:
            found = _WHOSE.match(message.topic)
            place = None if found is None else int(found[1]), message.node, message.name
            self._places[message.topic] = place
        whose, node, name = place
        if whose is not None:
            first_ns, last_ns = facts.spans_ns.get(whose, _NEVER)
            if not first_ns <= message.utc_ns <= last_ns:
                first_ns = min(first_ns or message.utc_ns, message.utc_ns)
                facts.spans_ns[whose] = first_ns, max(last_ns, message.utc_ns)
        if message.topic == TABLE_TOPIC:
            self._take_table(message)
        elif message.topic == SAMPLES_TOPIC:
            self._take_sample(message)
        elif name == "engine" and message.encoding == "msgpack":
            self._take_engine(message)
        elif node is not None and message.encoding == "json":
            self._take_record(message, node, name)

    # Frames, reports, ledgers

    def _take_record(self, message: ReadMessage, node: int, name: str) -> None:
        facts, data, is_network = self._facts, message.data, message.is_of_network
        match name:
            case "frames":
                for each in self._named(_FRAMES.decode(data)):
                    self._take_frame(each, message.utc_ns)
            case "reports":
                report = _REPORTS.decode(data)
                counts = facts.report_counts.setdefault(report.node, {})
                counts[report.outcome] = counts.get(report.outcome, 0) + 1
            case "links" | "link":
                capabilities = capabilities_in(message)
                if capabilities is not None:
                    facts.capabilities[node] = capabilities
            case "range" if is_network and (ends := _PEER.fullmatch(message.topic)):
                self._take_range(int(ends[1]), int(ends[2]), message)
            case "events" if not is_network:
                self._take_handled(message, node)
            case "ledger" if is_network:
                told = msgspec.json.decode(data, type=_LedgerDocument)
                book = self._books.setdefault(node, _Book())
                facts.ledgers[node, 0] = book.take(told).of(node)
            case "ledger":
                ledger = msgspec.json.decode(data, type=LedgerRecord)
                facts.ledgers[node, ledger.epoch] = ledger
                sent = facts.transmitted.get(node)
                facts.covered_bytes[node] = 0 if sent is None else sent.size_bytes
            case _:
                pass

    def _take_handled(self, message: ReadMessage, node: int) -> None:
        """Take the relevant events; most events are samples."""
        if b"CommandHandled" in message.data[:_HEAD_BYTES]:
            told = msgspec.json.decode(message.data, type=_CommandEvent)
            handled = Handled(
                at_ns=message.utc_ns,
                node=node,
                by=told.commanded_by,
                what=told.kind or "command",
                stream_id=told.stream_id,
                outcome="refused" if told.refusal else "executed",
                text=told.refusal,
            )
            self._facts.handled.append(handled)
        elif b"SealAlarm" in message.data[:_HEAD_BYTES]:
            alarm = msgspec.json.decode(message.data, type=_SealEvent)
            text = f"{alarm.frames} frames"
            self._facts.handled.append(
                Handled(
                    at_ns=message.utc_ns,
                    node=node,
                    by=alarm.address,
                    what="seal",
                    stream_id=alarm.stream_id,
                    outcome=alarm.refusal,
                    text=text,
                )
            )

    def _take_range(self, node: int, peer: int, message: ReadMessage) -> None:
        found = msgspec.json.decode(message.data, type=_RangeDocument)
        metrics = LinkMetrics(range_m=found.range_m, propagation_s=found.propagation_s)
        at_ns = round((found.measured_at_unix_s or message.utc_ns / 1e9) * 1e9)
        # The document is repeated for late subscribers.
        if self._ranges.get((node, peer)) != at_ns:
            self._ranges[node, peer] = at_ns
            _note_metrics(self._facts.on_peers, metrics, peer, node, at_ns)

    def _take_frame(self, frame: FrameRecord, utc_ns: int) -> None:
        facts, is_sent, airtime_s = self._facts, frame.direction == SENT, frame.airtime_s or 0.0
        ends = frame.node, frame.source, frame.destination
        facts.frames.append(Frame(utc_ns, is_sent, *ends, airtime_s, _digest(frame.frame)))
        facts.frame_nodes.add(frame.node)
        if is_sent:
            sent = facts.transmitted.setdefault(frame.node, Transmitted())
            sent.frames += 1
            sent.size_bytes += frame.size_bytes
            sent.airtime_s += airtime_s
        elif frame.source:
            _note_metrics(facts.on_frames, frame, frame.source, frame.node, utc_ns)

    def _named(self, frame: FrameRecord) -> Iterator[FrameRecord]:
        """Yield frames with their senders, even if the link does not report them."""
        capabilities = self._facts.capabilities.get(frame.node)
        if frame.direction != RECEIVED or frame.source or capabilities is None:
            yield frame
            return
        envelope = self._envelopes.get(frame.node)
        if envelope is None:
            envelope = self._envelopes[frame.node] = Envelope(capabilities, frame.node)
        for opened in envelope.open(frame.received()):
            if isinstance(opened, Opened):
                yield msgspec.structs.replace(
                    frame, source=opened.source, destination=opened.destination
                )

    # A recorded network

    def _take_table(self, message: ReadMessage) -> None:
        self._table = decode_table(message.data)
        self._know(self._table)

    def _take_sample(self, message: ReadMessage) -> None:
        record = msgspec.json.decode(message.data, type=SampleRecord)
        if self._table is None or record.source is None or record.deleted:
            return
        found = self._table.find(record.key, record.source)
        if found is not None:
            arrived = Arrived(
                at_ns=message.utc_ns,
                node=0,
                source=record.source,
                stream_id=found[0].stream_id,
                instance=found[1],
                age_s=record.age_s,
            )
            self._arrive(arrived, b"")

    # A recorded engine

    def _take_engine(self, message: ReadMessage) -> None:
        try:
            part = self._epochs.read(message)
        except ConfigError as error:  # frames and ledgers are read all the same
            if str(error) not in self._facts.faults:
                self._facts.faults.append(str(error))
            return
        if isinstance(part, NewLife):
            node = part.life.address
            table = self._facts.tables[node] = part.life.table.table()
            self._know(table)
            self._offsets[node] = part.life.utc_offset_ns
            if not self._facts.is_lean:
                self._facts.births.append((message.utc_ns, part.life))
            self._facts.epochs[node] = self._facts.epochs.get(node, 0) + 1
            self._calls = {key: asked for key, asked in self._calls.items() if key[0] != node}
        elif part is not None:
            for call in part.calls:
                self._take_call(part.node, call, message.utc_ns)

    def _know(self, table: StreamTable) -> None:
        self._facts.streams.update({stream.stream_id: stream for stream in table})

    def _take_call(self, node: int, call: Recorded, utc_ns: int) -> None:
        if call.name == "poll_event":
            outcome = read_outcome(call.outcome)
            if outcome is not None:
                self._take_event(node, outcome[0], outcome[1], utc_ns)
        elif call.name in ("publish", "call", "actions.send_goal"):
            at_ns = (call.now or 0) + self._offsets[node]
            outcome = read_outcome(call.outcome)
            stream_id = call.arguments["stream_id"]
            stream = self._facts.tables[node].get(stream_id)
            if stream is None or (isinstance(outcome, list) and outcome[0] == "raised"):
                self._facts.counts_of(stream_id).refused += 1
            elif call.name == "publish":
                self._publish(node, stream, call.arguments, at_ns)
            else:
                asked = Asked(
                    number=self._facts.requests,
                    at_ns=at_ns,
                    node=node,
                    stream_id=stream_id,
                    value=None if self._facts.is_lean else call.arguments.get("value"),
                    timeout_s=call.arguments.get("timeout_s"),
                )
                self._facts.requests += 1
                self._facts.counts_of(stream_id).asked += 1
                if not self._facts.is_lean:
                    self._facts.asked.append(asked)
                name = outcome if call.name == "call" else str(outcome[1])
                self._calls[node, name] = asked
        elif call.name == "declare":
            self._redeclare(node, call)
        elif call.name == "handle_measurement":
            self._measure(node, call.arguments["measurement"])
        elif self._facts.is_lean:
            pass
        elif call.name in _COMMANDS and call.now is not None:
            said = {name: each for name, each in call.arguments.items() if name != "now"}
            at_ns = call.now + self._offsets[node]
            self._facts.commands.append(Command(at_ns, node, call.name, said))
        else:
            self._facts.reactions.note_call(node, call, (call.now or 0) + self._offsets[node])

    def _measure(self, node: int, measurement: Measurement) -> None:
        if isinstance(measurement, PeerMeasured):
            at_ns = measurement.measured_at + self._offsets[node]
            _note_metrics(
                self._facts.on_peers, measurement.metrics, measurement.address, node, at_ns
            )

    def _redeclare(self, node: int, call: Recorded) -> None:
        table = self._facts.tables[node]
        table.types = TypeTable(call.arguments.get(TYPES, ()))
        try:
            table.declare(call.arguments["spec"])
        except ZacousticError:
            return  # it was refused then as well
        self._know(table)

    def _publish(self, node: int, stream: Stream, arguments: dict[str, Any], at_ns: int) -> None:
        facts, value = self._facts, arguments.get("value")
        published = Published(
            at_ns=at_ns,
            node=node,
            stream_id=stream.stream_id,
            instance=arguments.get("instance", ()),
            value=value,
            delete=bool(arguments.get("delete")),
            encoding=arguments.get("encoding"),
        )
        counts = facts.counts_of(stream.stream_id)
        counts.published += 1
        if not published.delete:
            counts.samples[node] = counts.samples.get(node, 0) + 1
            self._note_sample(published, node, _payload(stream, value))
        if not facts.is_lean:
            facts.published.append(published)

    def _take_event(self, node: int, kind: str, said: dict[str, Any], utc_ns: int) -> None:
        if kind == "SampleReceived" and not said["deleted"]:
            self._receive(node, said)
        elif kind in ("RequestReceived", "GoalReceived") and self._facts.is_lean:
            pass
        elif kind == "RequestReceived":
            stream_id = said["call"]["stream_id"]
            self._facts.reactions.note_question(
                node, said["call"], stream_id, said["value"], utc_ns
            )
        elif kind == "GoalReceived":
            stream_id = said["goal"]["stream_id"]
            self._facts.reactions.note_question(
                node, said["goal"], stream_id, said["value"], utc_ns
            )
        elif kind in ("ResponseReceived", "CallFailed"):
            self._end(node, said["call_id"], said, utc_ns)
        elif kind in ("ResultReceived", "GoalFailed") or (
            kind == "GoalAnswered" and not said["accepted"]
        ):
            self._end(node, str(said["goal"]), said, utc_ns)
        elif kind == "DeliveryEnded":
            counts = self._facts.counts_of(said["stream_id"]).outcomes
            counts[said["outcome"]] = counts.get(said["outcome"], 0) + 1

    def _end(self, node: int, name: object, said: dict[str, Any], utc_ns: int) -> None:
        asked = self._calls.pop((node, name), None)
        if asked is not None:
            failure = said.get("failure")
            asked.ended_at_ns = utc_ns
            asked.answer = None if self._facts.is_lean else said.get("value")
            asked.failure = "" if failure is None else str(failure)
            if asked.failure:
                self._facts.counts_of(asked.stream_id).failed += 1
            else:
                answer = Delivery(asked.number, utc_ns, 0, asked.stream_id, asked.at_ns, node)
                self._facts.answers.append(answer)

    def _receive(self, node: int, said: dict[str, Any]) -> None:
        stream = self._facts.tables[node].get(said["stream_id"])
        if stream is None:
            return
        arrived = Arrived(
            at_ns=said["received_at"] + self._offsets[node],
            node=node,
            source=said["source"],
            stream_id=stream.stream_id,
            instance=tuple(said["instance"]),
            value=said["value"],
            age_s=said["age_s"],
        )
        self._arrive(arrived, _payload(stream, said["value"]))

    def _arrive(self, arrived: Arrived, payload: bytes) -> None:
        facts = self._facts
        counts = facts.counts_of(arrived.stream_id)
        counts.arrived += 1
        counts.receivers.add(arrived.node)
        facts.sources.add(arrived.source)
        if arrived.age_s is not None:
            facts.ages.append(Number(arrived.stream_id, 0, 0, arrived.age_s, arrived.at_ns))
        self._note_sample(arrived, arrived.source, payload)
        if not facts.is_lean:
            facts.arrived.append(arrived)

    def _note_sample(self, event: Published | Arrived, source: int, payload: bytes) -> None:
        samples, is_arrival = self._facts.samples, isinstance(event, Arrived)
        equal = _place(event.stream_id, source, event.instance), _digest(payload)
        whose = event.stream_id, source, event.node
        samples.append(Sample(*equal, event.at_ns, is_arrival, len(samples), *whose))


class _RangeDocument(msgspec.Struct):
    range_m: float | None = None
    propagation_s: float | None = None
    measured_at_unix_s: float | None = None


class _LedgerEntry(msgspec.Struct):
    id: int
    stream: str
    cause: str
    bytes: int
    airtime_s: float | None = None


class _LedgerDocument(msgspec.Struct):
    bytes: int
    airtime_s: float
    entries: list[_LedgerEntry]

    def of(self, node: int) -> LedgerRecord:
        rows = tuple(
            LedgerRow(
                stream_id=each.id,
                stream=each.stream,
                cause=each.cause,
                transmitted_bytes=each.bytes,
                airtime_s=each.airtime_s,
            )
            for each in self.entries
        )
        return LedgerRecord(
            node=node, epoch=0, frames=0, bytes=self.bytes, airtime_s=self.airtime_s, rows=rows
        )


class _Book:
    """The part of a gateway's ledger that belongs to the recorded time.

    A gateway publishes its ledger since its start, which may be months ago; after a restart it
    counts from zero.
    """

    def __init__(self) -> None:
        self._last: _LedgerDocument | None = None
        self._sum = _LedgerDocument(0, 0.0, [])

    def take(self, told: _LedgerDocument) -> _LedgerDocument:
        """Take the next document; return what was transmitted since the first one."""
        last, self._last = self._last, told
        if last is None:
            return self._sum
        if told.bytes < last.bytes:
            last = _LedgerDocument(0, 0.0, [])  # another start
        self._sum = _added(self._sum, told, last)
        return self._sum


def _added(whole: _LedgerDocument, told: _LedgerDocument, last: _LedgerDocument) -> _LedgerDocument:
    """Return a ledger with what another one has more than its last state."""
    rows = {(each.id, each.cause): each for each in whole.entries}
    before = {(each.id, each.cause): each for each in last.entries}
    for each in told.entries:
        key = each.id, each.cause
        nothing = msgspec.structs.replace(each, bytes=0, airtime_s=0.0)
        was, so_far = before.get(key, nothing), rows.get(key, nothing)
        rows[key] = msgspec.structs.replace(
            each,
            bytes=so_far.bytes + each.bytes - was.bytes,
            airtime_s=(so_far.airtime_s or 0.0) + (each.airtime_s or 0.0) - (was.airtime_s or 0.0),
        )
    return _LedgerDocument(
        whole.bytes + told.bytes - last.bytes,
        whole.airtime_s + told.airtime_s - last.airtime_s,
        [each for each in rows.values() if each.bytes],
    )


@functools.lru_cache(maxsize=4096)
def _place(stream_id: int, source: int, instance: Instance) -> bytes:
    return _digest(msgspec.msgpack.encode((stream_id, source, instance)))


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=_DIGEST_BYTES).digest()


def _note_metrics(
    rows: Rows[Number], metrics: LinkMetrics | FrameRecord, source: int, node: int, at_ns: int
) -> None:
    for metric, name in enumerate(METRICS):
        number = getattr(metrics, name, None)
        if number is not None:
            rows.append(Number(metric, source, node, number, at_ns))


def _payload(stream: Stream, value: Any) -> bytes:  # noqa: ANN401 (as the application has it)
    try:
        return stream.codec.encode(value)
    except ZacousticError:
        return b""
