"""`zacoustic record`: records a Zenoh network into a file, from any machine on it.

Local samples are recorded unchanged, and also as values for other tools: typed topics of the
configuration as JSON, topics of ROS as CDR with their definitions, health documents as JSON. A
gateway on that network puts its frames as soon as they have a subscriber, so recording it needs no
restart.
"""

import asyncio
import contextlib
import logging
import re
import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import msgspec
import zenoh

from zacoustic.config import Config
from zacoustic.core.streams.specs import TopicSpec
from zacoustic.core.streams.table import Stream
from zacoustic.errors import PayloadInvalidError
from zacoustic.ros.streams import RosTopic
from zacoustic.run.recording.channels import (
    JSON,
    Channel,
    FrameRecord,
    ReportRecord,
    document_channel,
    records_channel,
    value_channel,
)
from zacoustic.run.recording.foxglove import NOMINAL_M_S, FoxgloveWriter, made_at
from zacoustic.run.recording.life import Table
from zacoustic.run.recording.samples import (
    SampleRecord,
    encode_table,
    samples_channel,
    table_channel,
)
from zacoustic.run.recording.schemas import as_json
from zacoustic.run.recording.values import encode_value, ros_channel
from zacoustic.run.recording.writing import RecordingFile
from zacoustic.status.peers import PositionDocument, RangeDocument
from zacoustic.zenoh.gateway.dialect.translation import from_local
from zacoustic.zenoh.node.onzenoh.session import session_config
from zacoustic.zenoh.requests.request import PREFIX
from zacoustic.zenoh.session.marker import read_marker
from zacoustic.zenoh.session.session import WORDS, ZenohSession

_ASK_S = 2.0
_PEER = re.compile(rf"{PREFIX}/(\d{{1,3}})/peer/(\d{{1,3}})/(range|position)")

_logger = logging.getLogger(__name__)


class RecordedKeys(msgspec.Struct, kw_only=True):
    """The result of a recording."""

    file: str
    """Its name."""
    messages: dict[str, int]
    """Number of samples, by key."""
    dropped: int = 0
    """Number of messages dropped because the disk was too slow."""
    failure: str = ""
    """Why the recording ended early; empty: it did not."""
    gaps: int = 0
    """Number of interruptions of the connection to the router."""


class NetworkRecorder:
    """Records the samples that a session receives.

    Args:
        file: Takes the messages.
        config: The topics; None: only the keys of `record_network`.
        heard: Takes the key of each recorded sample, on a thread of Zenoh's; or None.
    """

    def __init__(
        self,
        file: RecordingFile,
        config: Config | None,
        heard: Callable[[str], None] | None = None,
    ) -> None:
        self._file = file
        self._heard = heard
        self._config = config
        self._guard = threading.Lock()
        self._channels: dict[str, Channel] = {}
        self._samples = samples_channel()
        self._panels = FoxgloveWriter(file.put)
        self.counts: dict[str, int] = {}
        """Number of samples, by key."""
        self.gaps = 0
        """Number of interruptions of the connection to the router."""
        self._is_up = True
        self._has_ended = False
        if config is not None:
            table = encode_table(Table.of(config.table))
            file.put(table_channel(), time.time_ns(), table)

    def topics(self) -> dict[str, Stream | None]:
        """Return the key expressions of the topics of the config."""
        if self._config is None:
            return {}
        found: dict[str, Stream | None] = {}
        for stream in self._config.table:
            if isinstance(stream.spec, TopicSpec):
                found[self._key(stream, stream.keys.expression(None))] = stream
        return found

    def take(self, stream: Stream | None, sample: zenoh.Sample) -> None:
        """Record a sample; on a thread of Zenoh's."""
        key, now_ns = str(sample.key_expr), time.time_ns()
        payload, attachment = sample.payload.to_bytes(), sample.attachment
        mark = read_marker(attachment)
        record = SampleRecord(
            key=key,
            payload=payload,
            encoding=str(sample.encoding),
            attachment=None if attachment is None else attachment.to_bytes(),
            deleted=sample.kind == zenoh.SampleKind.DELETE,
            source=None if mark is None else mark.acoustic,
            age_s=None if mark is None else mark.age_s,
        )
        with self._guard:  # callbacks of several subscribers come on several threads
            self.counts[key] = self.counts.get(key, 0) + 1
            self._file.put(self._samples, now_ns, as_json(record))
            if not record.deleted:
                self._show(stream, key, record, now_ns)
        self._tell(key)

    def take_document(self, sample: zenoh.Sample) -> None:
        """Record a health document, a frame or a report; on a thread of Zenoh's."""
        key = str(sample.key_expr)
        with self._guard:
            self.counts[key] = self.counts.get(key, 0) + 1
            now_ns, document = time.time_ns(), sample.payload.to_bytes()
            self._file.put(self._document(key), now_ns, document)
            self._show_measured(key, document, now_ns)
        self._tell(key)

    def note_connection(self, is_up: bool) -> None:
        """Note the loss or return of the router; on a thread of Zenoh's."""
        with self._guard:
            if self._has_ended or is_up == self._is_up:
                return
            self._is_up = is_up
            self.gaps += not is_up
        _logger.warning("%s", WORDS[is_up])

    def end(self) -> None:
        """Note that the session is about to close, which is no gap."""
        with self._guard:
            self._has_ended = True

    def _tell(self, key: str) -> None:
        if self._heard is not None:
            self._heard(key)

    def _show(self, stream: Stream | None, key: str, record: SampleRecord, now_ns: int) -> None:
        """Write a sample in a form for other tools."""
        topic = f"/{key}"
        ros = None
        if stream is not None and self._config is not None and self._config.ros is not None:
            ros = self._config.ros.streams.get(stream.stream_id)
        if stream is not None and isinstance(ros, RosTopic):
            make = partial(ros_channel, topic, stream, ros)
            self._file.put(self._channel(topic, make), now_ns, record.payload)
        elif stream is not None:
            try:
                value, _ = from_local(record.payload, record.encoding, stream.type, stream.encoding)
            except PayloadInvalidError:
                return  # the unchanged sample is recorded
            channel = self._channel(topic, partial(value_channel, topic, stream))
            self._file.put(channel, now_ns, encode_value(stream, value, record.encoding))
            self._show_on_panels(topic, stream, value, record, now_ns)
        elif record.encoding.startswith(("application/json", "text/json")) and _is_object(
            record.payload
        ):
            channel = self._channel(topic, partial(document_channel, key))
            self._file.put(channel, now_ns, record.payload)
            self._show_on_panels(topic, None, msgspec.json.decode(record.payload), record, now_ns)

    def _show_on_panels(
        self, topic: str, stream: Stream | None, value: object, record: SampleRecord, now_ns: int
    ) -> None:
        """Write what Foxglove's panels show of a sample."""
        node = record.source
        if node is None and stream is not None and isinstance(stream.spec, TopicSpec):
            publishers = stream.spec.publishers or ()
            node = next(iter(publishers)) if len(publishers) == 1 else None
        made_ns = made_at(now_ns, record.age_s)
        spec = None if stream is None else stream.type
        self._panels.value(topic, value, now_ns, made_ns=made_ns, node=node, spec=spec)

    def _show_measured(self, key: str, document: bytes, now_ns: int) -> None:
        """Write where a range or a position of a peer is, if the document has one."""
        found = _PEER.fullmatch(key)
        if found is None:
            return
        node, peer, what = int(found[1]), int(found[2]), found[3]
        with contextlib.suppress(msgspec.DecodeError, msgspec.ValidationError):
            if what == "range":
                told = msgspec.json.decode(document, type=RangeDocument)
                range_m = told.range_m
                if range_m is None and told.propagation_s is not None:
                    range_m = told.propagation_s * NOMINAL_M_S
                if range_m is not None:
                    self._panels.measured_range(node, peer, range_m, now_ns)
                return
            at = msgspec.json.decode(document, type=PositionDocument)
            if at.east_m is not None and at.north_m is not None and at.up_m is not None:
                self._panels.measured_position(node, peer, at.east_m, at.north_m, at.up_m, now_ns)

    def _channel(self, topic: str, make: Callable[[], Channel]) -> Channel:
        known = self._channels.get(topic)
        if known is None:
            known = self._channels[topic] = make()
        return known

    def _document(self, key: str) -> Channel:
        kinds: dict[str, type[FrameRecord] | type[ReportRecord]]
        kinds = {"frames": FrameRecord, "reports": ReportRecord}
        place, _, name = key.rpartition("/")
        if name in kinds:
            return self._channel(key, partial(records_channel, f"/{place}", name, kinds[name]))
        return self._channel(key, partial(document_channel, key))

    def _key(self, stream: Stream, key: str) -> str:
        ros = None if self._config is None else self._config.ros
        found = None if ros is None else ros.streams.get(stream.stream_id)
        if ros is None or not isinstance(found, RosTopic):
            return key
        return str(found.key(ros.domain, key))


async def record_network(
    path: str | Path,
    *,
    config: Config | None,
    connect: Sequence[str] | None,
    keys: Sequence[str],
    stop: asyncio.Event,
    ready: Callable[[Path, Sequence[str]], None],
    heard: Callable[[str], None] | None = None,
) -> RecordedKeys:
    """Record until stopped.

    Args:
        path: The file; an existing one is not touched.
        config: Names topics and router; or None.
        connect: Endpoints of the router; override the config.
        keys: Key expressions besides the topics of the config.
        stop: Set to end it.
        ready: Takes the file and the key expressions when all are subscribed to.
        heard: Takes the key of each recorded sample, on a thread of Zenoh's; or None.

    Raises:
        ConfigError: The file cannot be made.
        SessionError: No router can be reached.
    """
    file = await asyncio.to_thread(RecordingFile, path)
    try:
        recorder = NetworkRecorder(file, config, heard)
        zenoh_session = await ZenohSession.open(session_config(config, connect))
        try:
            zenoh_session.watch(recorder.note_connection)
            wanted: dict[str, Stream | None] = {**dict.fromkeys(keys), **recorder.topics()}
            await zenoh_session.worker.run(partial(_declare, zenoh_session, recorder, wanted))
            ready(file.path, [*wanted, f"{PREFIX}/**"])
            await stop.wait()
        finally:
            recorder.end()
            await zenoh_session.close()
    finally:
        await asyncio.to_thread(file.close)
    return RecordedKeys(
        file=str(file.path),
        messages=dict(sorted(recorder.counts.items())),
        dropped=file.dropped,
        failure=file.failure,
        gaps=recorder.gaps,
    )


def _declare(
    zenoh_session: ZenohSession, recorder: NetworkRecorder, wanted: dict[str, Stream | None]
) -> None:
    for expression, stream in wanted.items():
        zenoh_session.session.declare_subscriber(
            zenoh.KeyExpr(expression), zenoh_session.callback(partial(recorder.take, stream))
        )
    zenoh_session.session.declare_subscriber(
        zenoh.KeyExpr(f"{PREFIX}/**"), zenoh_session.callback(recorder.take_document)
    )
    # Fetch earlier documents as well, above all the capabilities of the link.
    for reply in zenoh_session.session.get(f"{PREFIX}/*/*", timeout=_ASK_S):
        if reply.ok is not None and str(reply.ok.encoding).startswith(f"application/{JSON}"):
            recorder.take_document(reply.ok)


def _is_object(payload: bytes) -> bool:
    try:
        return isinstance(msgspec.json.decode(payload), dict)
    except (msgspec.DecodeError, RecursionError):
        return False
