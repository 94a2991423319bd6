"""`zacoustic replay --through FILE`: recorded inputs into engines of another configuration.

An engine of the new configuration gets the recorded calls: received frames byte for byte, at their
instants, and the requests of the application. No node receives its frames, since the others are a
recording; if it sends the same as before, it gets the recorded answers. So with the configuration
of the recording every frame is the same, and the effect of changed priorities, codecs or rates on
frames and deliveries is visible one by one.

Timers of the new engine run between the calls. A new transmission is reported as sent after its
airtime, a new journal write is committed at once. Peers whose table differs from the new one are
assumed to introduce themselves in every frame and to send the rows of their table, as they would,
so streams that agree still cross and those that differ are refused by name.
"""

import heapq
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec

from zacoustic.config import Config
from zacoustic.core.base.linktypes import (
    LinkCapabilities,
    ReceivedFrame,
    Transmission,
    TransmitOutcome,
    TransmitReport,
)
from zacoustic.core.engine.events import Event, SampleReceived
from zacoustic.core.profiles.native.controls import CONTROLS
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.agreement import WIRE_VERSION, Ask, Confirm, Hello, TableRow, Tag
from zacoustic.core.wire.envelope import Envelope, Opened
from zacoustic.core.wire.frame import parse_frame
from zacoustic.run.recording.calls import Recorded, read_outcome
from zacoustic.run.recording.epochs import NewLife, make_call, read_parts
from zacoustic.run.recording.life import Life

_SPINS = 10_000


class Otherwise(msgspec.Struct, kw_only=True):
    """One boot epoch, as recorded and with the new configuration."""

    node: int
    """Address."""
    epoch: int
    """Of the node's boot epoch."""
    same_table: bool
    """Whether the table has the recorded digest."""
    differing: list[str] = []
    """Streams that are defined otherwise now, or not at all."""
    frames_then: int = 0
    """Frames sent, as recorded."""
    frames_now: int = 0
    """Frames sent by the new engine."""
    same_frames: int = 0
    """Of those, the same bytes at the same poll."""
    bytes_then: int = 0
    """Bytes of the recorded frames."""
    bytes_now: int = 0
    """Bytes of the new engine's frames."""
    samples_then: dict[str, int] = {}
    """Received samples by stream, as recorded."""
    samples_now: dict[str, int] = {}
    """Samples received by the new engine, by stream."""
    refused: dict[str, int] = {}
    """Commands that only the new engine refuses, by error."""
    first_difference: str = ""
    """The first frame that differs; empty: none."""


class _Through:
    """One boot epoch with an engine of another configuration."""

    def __init__(self, life: Life, config: Config | None) -> None:
        self._life = life
        self._then = then = life.table.table()
        table = then if config is None else config.table
        rules = None if config is None else config.rules
        self._engine = life.engine(table=table, rules=rules)
        differing = [
            stream.name
            for stream in then
            if (other := table.get(stream.stream_id)) is None or other.digest != stream.digest
        ]
        self.found = Otherwise(
            node=life.address,
            epoch=life.epoch,
            same_table=table.digest == life.digest,
            differing=differing,
        )
        self._counts_then: Counter[str] = Counter()
        self._counts_now: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        self._transmissions: dict[int, int] = {}
        """Ids of the new engine's transmissions by the recorded ones."""
        self._writes: dict[int, int] = {}
        self._ends: list[tuple[int, int, int]] = []
        """End, id and beginning of transmissions that were not recorded."""
        self._airtimes: LinkCapabilities | None = None
        self._envelope: Envelope | None = None
        self._epochs: dict[int, int] = {}
        """Epochs of nodes that have sent HELLO with the recording's table."""
        self._now = 0
        # An engine may draw the instant of a timer at random when it is polled. So it is polled
        # where the recorded one was, and after its own additional actions.
        self._due_at: int | None = None
        self._due_then: int | None = None
        """The recorded timer; the recording itself brings what is due then, even if late."""

    def take(self, call: Recorded) -> None:
        """Make a call, after everything that the new engine would have done before it."""
        now = call.now
        if now is not None:
            self._advance(now)
            self._now = now
        match call.name:
            case "poll_transmit":
                assert now is not None
                self._poll_transmit(call, now)
            case "poll_journal":
                self._poll_journal(call)
            case "poll_event":
                self._poll_event(call)
            case "poll_timeout":
                self._due_then = read_outcome(call.outcome)
                self._due_at = self._engine.poll_timeout()
            case "handle_transmit_report":
                self._report(call)
            case "handle_journal_committed":
                self._committed(call)
            case "handle_timeout":
                assert now is not None
                if self._due_at is not None and self._due_at <= now:
                    self._engine.handle_timeout(now)
            case _:
                self._input(call, now)

    def finish(self) -> Otherwise:
        """Return the result."""
        found = self.found
        found.samples_then = dict(sorted(self._counts_then.items()))
        found.samples_now = dict(sorted(self._counts_now.items()))
        found.refused = dict(sorted(self._refused.items()))
        return found

    # Calls

    def _input(self, call: Recorded, now: int | None) -> None:
        frame = call.arguments.get("frame")
        if not self.found.same_table and isinstance(frame, ReceivedFrame) and now is not None:
            for heard in self._introduced(frame):
                self._engine.handle_frame(heard, now)
            return
        if call.name == "handle_link_state":
            capabilities = call.arguments.get("capabilities")
            if isinstance(capabilities, LinkCapabilities):
                self._airtimes = capabilities
                self._envelope = Envelope(capabilities, self._life.address)
        done = make_call(self._engine, call)
        was = read_outcome(call.outcome)
        said = read_outcome(done.outcome)
        if _is_error(said) and not _is_error(was):
            self._refused[said[1]] += 1

    def _poll_transmit(self, call: Recorded, now: int) -> None:
        was = read_outcome(call.outcome)
        made = self._engine.poll_transmit(now)
        found = self.found
        if made is not None:
            found.frames_now += 1
            found.bytes_now += len(made.frame_bytes)
        if was is None:
            if made is not None:
                self._differs(now, "nothing", made.frame_bytes.hex())
                self._end_later(made, now)
            return
        sent = was[1]
        found.frames_then += 1
        found.bytes_then += len(sent["frame_bytes"])
        if made is None:
            self._differs(now, sent["frame_bytes"].hex(), "nothing")
            return
        self._transmissions[sent["transmission_id"]] = made.transmission_id
        if made.frame_bytes == sent["frame_bytes"]:
            found.same_frames += 1
        else:
            self._differs(now, sent["frame_bytes"].hex(), made.frame_bytes.hex())

    def _poll_journal(self, call: Recorded) -> None:
        was, write = read_outcome(call.outcome), self._engine.poll_journal()
        if write is None:
            return
        if was is None:
            self._engine.handle_journal_committed(write.write_id, self._now)
        else:
            self._writes[was[1]] = write.write_id

    def _poll_event(self, call: Recorded) -> None:
        was = read_outcome(call.outcome)
        if was is not None and was[0] == "SampleReceived":
            self._counts_then[_name(self._then, was[1]["stream_id"])] += 1
        self._note(self._engine.poll_event())

    def _report(self, call: Recorded) -> None:
        report = call.arguments["report"]
        own = self._transmissions.pop(report.transmission_id, None)
        if own is not None:
            report = msgspec.structs.replace(report, transmission_id=own)
            self._engine.handle_transmit_report(report, call.arguments["now"])

    def _committed(self, call: Recorded) -> None:
        own = self._writes.pop(call.arguments["write_id"], None)
        if own is not None:
            self._engine.handle_journal_committed(own, call.arguments["now"])

    # Not recorded

    def _advance(self, now: int) -> None:
        """Handle timers and transmissions of the new engine that end before an instant."""
        for _ in range(_SPINS):
            due_at = self._due_at
            end_at = self._ends[0][0] if self._ends else None
            if end_at is not None and end_at < now and (due_at is None or end_at <= due_at):
                _, transmission_id, began_at = heapq.heappop(self._ends)
                report = TransmitReport(
                    transmission_id=transmission_id,
                    outcome=TransmitOutcome.SENT,
                    started_at=began_at,
                    finished_at=end_at,
                )
                self._engine.handle_transmit_report(report, end_at)
                self._serve(end_at)
            elif due_at is not None and due_at < now and due_at != self._due_then:
                self._engine.handle_timeout(due_at)
                self._serve(due_at)
            else:
                return

    def _serve(self, now: int) -> None:
        while (write := self._engine.poll_journal()) is not None:
            self._engine.handle_journal_committed(write.write_id, now)
        while (made := self._engine.poll_transmit(now)) is not None:
            self.found.frames_now += 1
            self.found.bytes_now += len(made.frame_bytes)
            self._differs(now, "nothing", made.frame_bytes.hex())
            self._end_later(made, now)
        while (event := self._engine.poll_event()) is not None:
            self._note(event)
        self._due_at = self._engine.poll_timeout()

    def _end_later(self, made: Transmission, now: int) -> None:
        airtime_ns = (
            self._airtimes.airtime_ns(len(made.frame_bytes), made.service) if self._airtimes else 0
        )
        heapq.heappush(self._ends, (now + airtime_ns, made.transmission_id, now))

    def _note(self, event: Event | None) -> None:
        if isinstance(event, SampleReceived):
            self._counts_now[_name(self._engine.table, event.stream_id)] += 1

    def _differs(self, now: int, then: str, today: str) -> None:
        if not self.found.first_difference:
            self.found.first_difference = f"at {now / 1e9:.3f} s: was {then}, is {today}"

    def _introduced(self, frame: ReceivedFrame) -> Iterator[ReceivedFrame]:
        """Yield a frame as its sender would have sent it to a node with another table.

        It would have introduced itself in every frame, and sent the rows of its table. The engine
        has not asked for them, so they are put into each frame that needs them.
        """
        capabilities = self._airtimes
        if capabilities is None or self._envelope is None or not capabilities.framed:
            yield frame
            return
        for opened in self._envelope.open(frame):
            if not isinstance(opened, Opened):
                yield frame
                continue
            source, rows = opened.source, b""
            first, records = self._unconfirming(opened)
            if isinstance(first, Hello) and first.digest == self._life.digest:
                self._epochs[source] = first.epoch
            elif first is None and source in self._epochs:
                first = Tag(self._epochs[source])
            if source in self._epochs:
                rows = _rows_of(self._then, self._epochs[source])
            said = (first.encode() + rows if first is not None else b"") + records
            if said:
                wrapped = Envelope(capabilities, source).wrap(said, opened.destination)
                yield msgspec.structs.replace(frame, frame_bytes=wrapped)

    def _unconfirming(self, opened: Opened) -> tuple[Hello | Tag | None, bytes]:
        """Return the beginning of a frame whose sender has another table, and the rest.

        Such a sender confirms nothing, and sends HELLO where it has sent TAG and CONFIRM.
        """
        first: Hello | Tag | None = None
        controls, offset = b"", 0
        for item in parse_frame(opened.records, lambda *_: None, CONTROLS):
            if not isinstance(item, Hello | Tag | Confirm | Ask | TableRow):
                break
            said = item.encode()
            offset += len(said)
            if isinstance(item, Hello | Tag):
                first = item
            elif not isinstance(item, Confirm) or item.epoch != self._life.epoch:
                controls += said
            elif isinstance(first, Tag):
                first = Hello(WIRE_VERSION, first.epoch, self._life.digest)
        return first, controls + opened.records[offset:]


def replay_through(path: str | Path, config_of: Mapping[int, Config]) -> list[Otherwise]:
    """Repeat the calls of a recording on engines of other configurations.

    Args:
        path: The file.
        config_of: The configuration of each node, by address; without one, the recorded one.

    Raises:
        ConfigError: The file is not ours, or contains no boot epoch.
    """
    running: dict[int, _Through] = {}
    found: list[_Through] = []
    for part in read_parts(path):
        if isinstance(part, NewLife):
            node = part.life.address
            running[node] = _Through(part.life, config_of.get(node))
            found.append(running[node])
        else:
            for call in part.calls:
                running[part.node].take(call)
    return [each.finish() for each in found]


def _is_error(said: object) -> bool:
    return isinstance(said, list) and bool(said) and said[0] == "raised"


def _name(table: StreamTable, stream_id: int) -> str:
    stream = table.get(stream_id)
    return stream.name if stream is not None else str(stream_id)


def _rows_of(table: StreamTable, epoch: int) -> bytes:
    return b"".join(TableRow(epoch, each.stream_id, each.digest).encode() for each in table)
