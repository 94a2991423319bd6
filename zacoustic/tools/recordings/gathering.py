"""What happened, out of one or more recordings: the facts that figures are made of.

Of an engine all of it is known: what was asked for, what arrived, every frame. Of a recorded
network the frames of its gateways are known, and what came off the water there.
"""

import bisect
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import msgspec

from zacoustic.core.envelope import Envelope, Opened
from zacoustic.core.keys import Instance
from zacoustic.core.linktypes import LinkCapabilities, ReceivedFrame
from zacoustic.core.streams import Stream, StreamTable
from zacoustic.core.types import TypeTable
from zacoustic.errors import ZacousticError
from zacoustic.recording.calls import TYPES, Recorded, read_outcome
from zacoustic.recording.channels import (
    RECEIVED,
    FrameRecord,
    LedgerRecord,
    LedgerRow,
    LinkRecord,
    ReportRecord,
)
from zacoustic.recording.life import Table
from zacoustic.recording.reading import ReadMessage, RecordingReader
from zacoustic.recording.samples import SAMPLES_TOPIC, TABLE_TOPIC, SampleRecord
from zacoustic.tools.recordings.lives import LifeReader, NewLife


class Published(msgspec.Struct, kw_only=True):
    """A sample that a node has published."""

    at_ns: int
    """UTC, ns."""
    node: int
    """Who."""
    stream_id: int
    """Which topic."""
    instance: Instance
    """Which of its keys."""
    payload: bytes
    """Its value, in the codec of the stream."""
    value: Any
    """The same as the application gave it, in plain parts."""
    delete: bool = False
    """The key was deleted."""
    encoding: str | None = None
    """Where it is not the stream's."""
    arrived: dict[int, int] = {}
    """Where it has arrived, by node, and when, UTC, ns."""


class Arrived(msgspec.Struct, kw_only=True):
    """A sample that has arrived."""

    at_ns: int
    """UTC, ns."""
    node: int
    """Where."""
    source: int
    """Who has published it."""
    stream_id: int
    """Which topic."""
    instance: Instance = ()
    """Which of its keys."""
    payload: bytes = b""
    """Its value, in the codec of the stream."""
    value: Any = None
    """The same in plain parts."""
    age_s: float | None = None
    """How old it was when its frame was composed, s."""


class Asked(msgspec.Struct, kw_only=True):
    """A call, or a goal."""

    at_ns: int
    """UTC, ns."""
    node: int
    """Who asks."""
    stream_id: int
    """Which service or action."""
    value: Any
    """What is asked, in plain parts."""
    timeout_s: float | None = None
    """For how long, where it is not the stream's, s."""
    ended_at_ns: int | None = None
    """Answered, or the goal ended, UTC, ns."""
    failure: str = ""
    """Why there is no answer; empty: there is one, or none yet."""


class Facts:
    """Everything that was found; made by `gather`."""

    def __init__(self) -> None:
        self.files: list[str] = []
        self.damage: dict[str, str] = {}
        """Why files end early."""
        self.gaps: set[int] = set()
        """Nodes of which something is missing."""
        self.tables: dict[int, StreamTable] = {}
        """Streams of each node whose engine is recorded."""
        self.streams: dict[int, Stream] = {}
        """All streams that are known, by id."""
        self.capabilities: dict[int, LinkCapabilities] = {}
        self.lives: dict[int, int] = {}
        """How many lives of each node were recorded."""
        self.published: list[Published] = []
        self.arrived: list[Arrived] = []
        self.asked: list[Asked] = []
        self.refused: dict[int, int] = {}
        """Commands that the engine has not taken, by stream."""
        self.outcomes: dict[int, dict[str, int]] = {}
        """How reliable samples ended, by stream."""
        self.frames: list[tuple[int, FrameRecord]] = []
        """With their instants, UTC, ns; where they end, for those that arrived."""
        self.reports: list[tuple[int, ReportRecord]] = []
        """With the instants of their ends, UTC, ns."""
        self.ledgers: dict[tuple[int, int], LedgerRecord] = {}
        """The last of each life, by node and epoch."""
        self.began_ns = 0
        self.ended_ns = 0

    @property
    def duration_s(self) -> float:
        """From the first message to the last, s."""
        return (self.ended_ns - self.began_ns) / 1e9

    @property
    def nodes(self) -> list[int]:
        """Nodes whose link was recorded."""
        return sorted({*self.tables, *(frame.node for _, frame in self.frames)})


def gather(paths: Iterable[str | Path]) -> Facts:
    """Read recordings.

    Raises:
        ConfigError: A file is none.
    """
    facts = Facts()
    for path in paths:
        source = RecordingReader(path)
        facts.files.append(str(path))
        add_messages(facts, source)
        if source.damage:
            facts.damage[str(path)] = source.damage
    return facts


def add_messages(facts: Facts, messages: Iterable[ReadMessage]) -> None:
    """Take in what the messages of one recording say."""
    gatherer = _Gatherer(facts)
    for message in messages:
        gatherer.take(message)


class _Gatherer:
    def __init__(self, facts: Facts) -> None:
        self._facts = facts
        self._lives = LifeReader()
        self._offsets: dict[int, int] = {}
        self._calls: dict[tuple[int, object], Asked] = {}
        self._envelopes: dict[int, Envelope] = {}
        self._table: StreamTable | None = None
        """Of a recording without lives."""

    def take(self, message: ReadMessage) -> None:
        facts = self._facts
        if not facts.began_ns or message.utc_ns < facts.began_ns:
            facts.began_ns = message.utc_ns
        facts.ended_ns = max(facts.ended_ns, message.utc_ns)
        place, _, name = message.topic.rpartition("/")
        node = place.rpartition("/")[2]
        if message.topic == TABLE_TOPIC:
            self._take_table(message)
        elif message.topic == SAMPLES_TOPIC:
            self._take_sample(message)
        elif name == "engine" and message.encoding == "msgpack":
            self._take_engine(message)
        elif node.isdecimal() and message.encoding == "json":
            self._take_record(message, int(node), name, is_network=place.startswith("/@acoustic"))

    # Frames, reports, ledgers

    def _take_record(self, message: ReadMessage, node: int, name: str, *, is_network: bool) -> None:
        facts, data = self._facts, message.data
        match name:
            case "frames":
                frame = msgspec.json.decode(data, type=FrameRecord)
                facts.frames += [(message.utc_ns, each) for each in self._named(frame)]
            case "reports":
                report = msgspec.json.decode(data, type=ReportRecord)
                facts.reports.append((message.utc_ns, report))
            case "links":
                link = msgspec.json.decode(data, type=LinkRecord)
                if link.capabilities is not None:
                    facts.capabilities[node] = link.capabilities
            case "link" if is_network:
                found = msgspec.json.decode(data, type=_LinkDocument)
                if found.capabilities is not None:
                    facts.capabilities[node] = found.capabilities
            case "ledger" if is_network:
                facts.ledgers[node, 0] = msgspec.json.decode(data, type=_LedgerDocument).of(node)
            case "ledger":
                ledger = msgspec.json.decode(data, type=LedgerRecord)
                facts.ledgers[node, ledger.epoch] = ledger
            case _:
                pass

    def _named(self, frame: FrameRecord) -> Iterator[FrameRecord]:
        """Give frames with their senders, also where the link does not tell them."""
        capabilities = self._facts.capabilities.get(frame.node)
        if frame.direction != RECEIVED or frame.source or capabilities is None:
            yield frame
            return
        envelope = self._envelopes.get(frame.node)
        if envelope is None:
            envelope = self._envelopes[frame.node] = Envelope(capabilities, frame.node)
        received = ReceivedFrame(
            frame_bytes=frame.frame, received_at=frame.at, destination=frame.destination
        )
        for opened in envelope.open(received):
            if isinstance(opened, Opened):
                yield msgspec.structs.replace(
                    frame, source=opened.source, destination=opened.destination
                )

    # A recorded network

    def _take_table(self, message: ReadMessage) -> None:
        self._table = msgspec.msgpack.decode(message.data, type=_TableMessage).table.table()
        self._know(self._table)

    def _take_sample(self, message: ReadMessage) -> None:
        record = msgspec.json.decode(message.data, type=SampleRecord)
        if self._table is None or record.source is None or record.deleted:
            return
        found = self._table.find(record.key, record.source)
        if found is not None:
            self._facts.arrived.append(
                Arrived(
                    at_ns=message.utc_ns,
                    node=0,
                    source=record.source,
                    stream_id=found[0].stream_id,
                    instance=found[1],
                    age_s=record.age_s,
                )
            )

    # A recorded engine

    def _take_engine(self, message: ReadMessage) -> None:
        part = self._lives.read(message)
        if isinstance(part, NewLife):
            node = part.life.address
            table = self._facts.tables[node] = part.life.table.table()
            self._know(table)
            self._offsets[node] = part.life.utc_offset_ns
            self._facts.lives[node] = self._facts.lives.get(node, 0) + 1
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
                self._facts.refused[stream_id] = self._facts.refused.get(stream_id, 0) + 1
            elif call.name == "publish":
                self._publish(node, stream, call.arguments, at_ns)
            else:
                asked = Asked(
                    at_ns=at_ns,
                    node=node,
                    stream_id=stream_id,
                    value=call.arguments.get("value"),
                    timeout_s=call.arguments.get("timeout_s"),
                )
                self._facts.asked.append(asked)
                name = outcome if call.name == "call" else str(outcome[1])
                self._calls[node, name] = asked
        elif call.name == "declare":
            self._redeclare(node, call)

    def _redeclare(self, node: int, call: Recorded) -> None:
        table = self._facts.tables[node]
        table.types = TypeTable(call.arguments.get(TYPES, ()))
        try:
            table.declare(call.arguments["spec"])
        except ZacousticError:
            return  # as it was refused then
        self._know(table)

    def _publish(self, node: int, stream: Stream, arguments: dict[str, Any], at_ns: int) -> None:
        instance = arguments.get("instance", ())
        delete = bool(arguments.get("delete"))
        value = arguments.get("value")
        payload = b"" if delete else _payload(stream, value)
        published = Published(
            at_ns=at_ns,
            node=node,
            stream_id=stream.stream_id,
            instance=instance,
            payload=payload,
            value=value,
            delete=delete,
            encoding=arguments.get("encoding"),
        )
        self._facts.published.append(published)

    def _take_event(self, node: int, kind: str, said: dict[str, Any], utc_ns: int) -> None:
        if kind == "SampleReceived" and not said["deleted"]:
            self._arrive(node, said)
        elif kind in ("ResponseReceived", "CallFailed"):
            failure = str(said.get("failure", "")) if kind == "CallFailed" else ""
            self._end(node, said["call_id"], failure, utc_ns)
        elif kind in ("ResultReceived", "GoalFailed"):
            failure = f"goal {said['failure']}" if kind == "GoalFailed" else ""
            self._end(node, str(said["goal"]), failure, utc_ns)
        elif kind == "GoalAnswered" and not said["accepted"]:
            self._end(node, str(said["goal"]), f"goal {said['failure']}", utc_ns)
        elif kind == "DeliveryEnded":
            counts = self._facts.outcomes.setdefault(said["stream_id"], {})
            counts[said["outcome"]] = counts.get(said["outcome"], 0) + 1

    def _end(self, node: int, name: object, failure: str, utc_ns: int) -> None:
        asked = self._calls.pop((node, name), None)
        if asked is not None:
            asked.ended_at_ns, asked.failure = utc_ns, failure

    def _arrive(self, node: int, said: dict[str, Any]) -> None:
        stream = self._facts.tables[node].get(said["stream_id"])
        if stream is None:
            return
        at_ns = said["received_at"] + self._offsets[node]
        instance = tuple(said["instance"])
        payload = _payload(stream, said["value"])
        arrived = Arrived(
            at_ns=at_ns,
            node=node,
            source=said["source"],
            stream_id=stream.stream_id,
            instance=instance,
            payload=payload,
            value=said["value"],
            age_s=said["age_s"],
        )
        self._facts.arrived.append(arrived)


class _TableMessage(msgspec.Struct):
    table: Table


class _LinkDocument(msgspec.Struct):
    capabilities: LinkCapabilities | None = None


class _LedgerEntry(msgspec.Struct):
    id: int
    stream: str
    cause: str
    bytes: int


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
            )
            for each in self.entries
        )
        return LedgerRecord(
            node=node, epoch=0, frames=0, bytes=self.bytes, airtime_s=self.airtime_s, rows=rows
        )


def match(facts: Facts) -> None:
    """Find of each sample that has arrived what was published, if its publisher is recorded.

    It belongs to the newest publication of the same value that this node has not got yet; that is
    exact as long as values differ.
    """
    waiting: dict[tuple[int, int, Instance, bytes], list[Published]] = {}
    for published in facts.published:
        published.arrived.clear()
        if not published.delete:
            key = (published.stream_id, published.node, published.instance, published.payload)
            bisect.insort(waiting.setdefault(key, []), published, key=lambda each: each.at_ns)
    for arrived in sorted(facts.arrived, key=lambda each: each.at_ns):
        key = (arrived.stream_id, arrived.source, arrived.instance, arrived.payload)
        known = waiting.get(key, [])
        place = bisect.bisect_right(known, arrived.at_ns, key=lambda each: each.at_ns)
        for published in reversed(known[:place]):
            if arrived.node not in published.arrived:
                published.arrived[arrived.node] = arrived.at_ns
                break


def _payload(stream: Stream, value: Any) -> bytes:  # noqa: ANN401 (as the application has it)
    try:
        return stream.codec.encode(value)
    except ZacousticError:
        return b""
