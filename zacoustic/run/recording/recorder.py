"""Makes engines whose every call goes into a recording, with values and events for people."""

import random
from collections.abc import Callable, Mapping
from typing import Any, Final

import msgspec
from msgspec.structs import replace

from zacoustic.core.base.linktypes import LinkState, ReceivedFrame, Transmission, TransmitReport
from zacoustic.core.base.trace import TraceSink
from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import SampleReceived
from zacoustic.core.engine.tap import EngineCall, Tap
from zacoustic.core.profiles.rules import TransmitRules
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.wire.seal import Cipher
from zacoustic.ros.streams import RosStream
from zacoustic.run.recording.calls import encode_call, plain
from zacoustic.run.recording.channels import (
    Channel,
    LedgerRecord,
    LedgerRow,
    engine_channel,
    events_channel,
    frames_channel,
    ledger_channel,
    link_record,
    links_channel,
    received_frame,
    report_record,
    reports_channel,
    sent_frame,
)
from zacoustic.run.recording.foxglove import NOMINAL_M_S
from zacoustic.run.recording.life import encode_life
from zacoustic.run.recording.schemas import as_json
from zacoustic.run.recording.values import ValueWriter, key_of
from zacoustic.run.recording.version import program
from zacoustic.run.recording.writing import MessageSink

LEDGER_NS: Final = 10_000_000_000
"""Time between two ledgers, ns, while the engine is called."""
_BATCH_BYTES: Final = 32 << 10

UtcOffset = Callable[[int], int]
"""Takes an address; returns UTC less the clock of the engine about to be made there, ns."""


class EngineRecorder:
    """Makes recorded engines; its method `make` is a `MakeEngine`.

    Args:
        sink: Takes the messages.
        utc_offset: Returns UTC less an engine's clock.
        ros: The ROS types of streams by id; their values are recorded in CDR.
    """

    def __init__(
        self,
        sink: MessageSink,
        utc_offset: UtcOffset,
        *,
        ros: Mapping[int, RosStream] | None = None,
    ) -> None:
        self._sink = sink
        self._utc_offset = utc_offset
        self.ros: Mapping[int, RosStream] = ros or {}
        """The ROS types of streams by id, for engines made from now on."""
        self._lives: dict[int, _LifeRecorder] = {}

    def make(
        self,
        *,
        address: int,
        table: StreamTable,
        epoch: int,
        rng: random.Random,
        rules: TransmitRules,
        stored: Mapping[str, bytes],
        trace: TraceSink | None,
        cipher: Cipher | None = None,
    ) -> Engine:
        """Return a new recorded engine."""
        offset_ns = self._utc_offset(address)
        life = encode_life(
            address=address,
            table=table,
            epoch=epoch,
            rng=rng,
            rules=rules,
            stored=stored,
            utc_offset_ns=offset_ns,
            program=program(),
            is_sealed=cipher is not None,
        )
        engine = Engine(
            address=address, table=table, epoch=epoch, rng=rng, rules=rules, stored=stored,
            trace=trace, cipher=cipher,
        )  # fmt: skip
        values = ValueWriter(self._sink, address, table, self.ros)
        recorder = _LifeRecorder(self._sink, engine, life, offset_ns, values)
        former = self._lives.pop(address, None)
        if former is not None:
            former.finish()
        self._lives[address] = recorder
        Tap(engine, recorder.take)
        return engine

    def finish(self) -> None:
        """Record the engines' last ledgers; the opener of the sink closes it."""
        for each in self._lives.values():
            each.finish()
        self._lives.clear()


class _LifeRecorder:
    """Records one engine."""

    def __init__(
        self,
        sink: MessageSink,
        engine: Engine,
        life: bytes,
        offset_ns: int,
        values: ValueWriter,
    ) -> None:
        self._node = address = engine.address
        self._sink = sink
        self._engine = engine
        self._life: bytes | None = life
        self._offset_ns = offset_ns
        self._values = values
        self._channel = engine_channel(address)
        self._frames = frames_channel(address)
        self._reports = reports_channel(address)
        self._links = links_channel(address)
        self._events = events_channel(address)
        self._ledger = ledger_channel(address)
        self._now = 0
        self._ledger_at = 0
        self._batch: list[bytes] = []
        self._batch_bytes = 0
        self._is_whole = True
        self._measured: dict[int, tuple[int | None, int | None]] = {}

    def take(self, call: EngineCall) -> None:
        """Record a call."""
        now = call.arguments.get("now")
        if isinstance(now, int):
            self._now = now
        if self._is_whole:
            types = tuple(self._engine.table.types) if call.name == "declare" else ()
            written = encode_call(call, types)
            self._batch.append(written)
            self._batch_bytes += len(written)
        self._show(call)
        # The last call of each service ends the calls that belong to one input.
        if call.name == "poll_timeout" or self._batch_bytes > _BATCH_BYTES:
            self._flush()

    def finish(self) -> None:
        """Record the waiting calls and the last ledger."""
        self._flush()
        self._put_ledger()

    def _flush(self) -> None:
        if self._batch:
            self._put_calls(self._batch)
            self._batch, self._batch_bytes = [], 0
        if self._now - self._ledger_at >= LEDGER_NS:
            self._put_ledger()

    def _put_calls(self, batch: list[bytes]) -> None:
        if self._life is not None:
            life = msgspec.msgpack.encode({"life": msgspec.Raw(self._life)})
            self._is_whole = self._put(self._channel, life)
            self._life = None
        if self._is_whole:
            calls = {"calls": [msgspec.Raw(each) for each in batch]}
            self._is_whole = self._put(self._channel, msgspec.msgpack.encode(calls))

    def _show(self, call: EngineCall) -> None:
        """Record what people look at: values, frames, events, reports."""
        if call.error is not None:
            return
        node, arguments, result = self._node, call.arguments, call.result
        link = arguments.get("link") or self._engine.links[0]
        match call.name, arguments:
            case "poll_transmit", _ if isinstance(result, Transmission):
                link, capabilities = result.link, self._engine.capabilities_of(result.link)
                sent = sent_frame(node, result, self._now, capabilities)
                self._put_record(self._frames, replace(sent, link=link))
            case "handle_frame", {"frame": ReceivedFrame() as frame}:
                heard = received_frame(node, frame, self._engine.capabilities_of(link))
                self._put_record(self._frames, replace(heard, link=link))
                if frame.metrics.propagation_s is not None:
                    self._show_measured()
            case "handle_measurement", _:
                self._show_measured()
            case "handle_transmit_report", {"report": TransmitReport() as report}:
                self._put_record(self._reports, replace(report_record(node, report), link=link))
            case "handle_link_state", {"state": LinkState() as state}:
                capabilities = arguments.get("capabilities")
                told = link_record(node, state, capabilities)
                self._put_record(self._links, replace(told, link=link))
            case "poll_event", _ if result is not None:
                self._put_record(self._events, _event(result, self._key_of(result)))
                if isinstance(result, SampleReceived) and not result.deleted:
                    self._values.received(result.aged(self._now), self._utc_ns)
            case "publish", _ if not arguments.get("delete"):
                self._values.published(arguments, self._utc_ns, self._now)

    def _show_measured(self) -> None:
        """Show ranges and positions of peers that are new."""
        known, panels = self._engine.measurements, self._values.panels
        for address in known.addresses():
            distance, position = known.range(address), known.position(address)
            newest = (
                None if distance is None else distance.measured_at,
                None if position is None else position.measured_at,
            )
            if self._measured.get(address) == newest:
                continue
            was = self._measured.get(address, (None, None))
            self._measured[address] = newest
            if distance is not None and was[0] != newest[0]:
                range_m = distance.range_m or distance.propagation_s * NOMINAL_M_S
                panels.measured_range(self._node, address, range_m, self._utc_ns)
            if position is not None and was[1] != newest[1]:
                at = (position.east_m, position.north_m, position.up_m)
                panels.measured_position(self._node, address, *at, self._utc_ns)

    def _key_of(self, event: object) -> str:
        stream_id, instance = getattr(event, "stream_id", None), getattr(event, "instance", ())
        stream = self._engine.table.get(stream_id) if isinstance(stream_id, int) else None
        if stream is None:
            return ""
        return key_of(stream, getattr(event, "source", self._node), instance)

    def _put_ledger(self) -> None:
        stats, table = self._engine.stats, self._engine.table
        self._ledger_at = self._now
        rows = []
        for entry in stats.ledger():
            stream = table.get(entry.stream_id)
            rows.append(
                LedgerRow(
                    stream_id=entry.stream_id,
                    stream=stream.name if stream is not None else "",
                    cause=entry.cause.value,
                    transmitted_bytes=entry.transmitted_bytes,
                    airtime_s=entry.airtime_ns / 1e9,
                )
            )
        record = LedgerRecord(
            node=self._node,
            epoch=self._engine.epoch,
            frames=stats.frames_transmitted,
            bytes=stats.bytes_transmitted,
            airtime_s=stats.airtime_ns / 1e9,
            rows=tuple(rows),
        )
        self._put_record(self._ledger, record)

    def _put_record(self, channel: Channel, record: object) -> None:
        self._put(channel, as_json(record))

    def _put(self, channel: Channel, data: bytes) -> bool:
        return self._sink.put(channel, self._utc_ns, data)

    @property
    def _utc_ns(self) -> int:
        return self._now + self._offset_ns


def _event(event: msgspec.Struct, key: str) -> dict[str, Any]:
    fields = {name: plain(getattr(event, name)) for name in event.__struct_fields__}
    return {"event": type(event).__name__, **({"key": key} if key else {}), **fields}
