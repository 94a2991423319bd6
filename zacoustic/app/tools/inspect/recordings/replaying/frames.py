"""The frames of a recording in words: opened, and decoded by the table."""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import TypeVar

import msgspec

from zacoustic.app.tools.inspect.decode.decoded import DecodedItem
from zacoustic.app.tools.inspect.decode.decoder import FrameDecoder
from zacoustic.app.tools.inspect.decode.opening import FrameOpener, said_in
from zacoustic.core.base.linktypes import BROADCAST, LinkCapabilities
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.streams.wireprofile import WireProfile
from zacoustic.core.wire.envelope import Damaged, Envelope
from zacoustic.errors import ConfigError
from zacoustic.link import registry
from zacoustic.run.recording.channels import RECEIVED, SENT, FrameRecord, capabilities_in
from zacoustic.run.recording.epochs import LifeReader
from zacoustic.run.recording.reading import ReadMessage, RecordingReader
from zacoustic.run.recording.samples import TABLE_TOPIC, decode_table

T = TypeVar("T")

_logger = logging.getLogger(__name__)


class DecodedFrame(msgspec.Struct, frozen=True, kw_only=True):
    """A frame of a recording."""

    utc_ns: int | None = None
    """When, ns since 1970; None in a log, which has no times."""
    node: int
    """Node of the link; 0 in a log."""
    direction: str
    """`sent` or `received`."""
    source: int
    """The sender; 0: unknown."""
    destination: int
    """The destination; 255: broadcast."""
    frame: str
    """The frame at the link, in hexadecimal."""
    items: tuple[DecodedItem, ...]
    """Its contents in words."""
    fault: str = ""
    """Why its contents are unknown; empty: they are known."""


class FrameReader:
    """Decodes frames, one recording after the other.

    Args:
        table: The streams, instead of those of the recording.
        wire: Wire profile, instead of the table's.
        opener: Opens sealed frames; None: the key is unknown.
    """

    def __init__(
        self,
        table: StreamTable | None = None,
        *,
        wire: WireProfile | None = None,
        opener: FrameOpener | None = None,
    ) -> None:
        self._given = table
        self._wire = wire
        self._opener = opener
        self._sealed: dict[int, bool] = {}
        self._found: StreamTable | None = None
        self._epochs = LifeReader()
        self._tables: dict[int, StreamTable] = {}
        self._capabilities: dict[int, LinkCapabilities] = {}
        self._decoders: dict[int, FrameDecoder] = {}
        self._envelopes: dict[tuple[int, str, int], Envelope] = {}

    def read(self, message: ReadMessage) -> Iterator[DecodedFrame]:
        """Yield the decoded frame of a message, if it has one."""
        node = message.node
        if message.topic == TABLE_TOPIC and message.encoding == "msgpack":
            self._found = _table(message.data)
        elif node is None:
            return
        elif message.name == "engine":
            self._read_life(message, node)
        elif (capabilities := capabilities_in(message)) is not None:
            if self._capabilities.get(node) != capabilities:
                self._envelopes.clear()
            self._capabilities[node] = capabilities
        if node is not None and message.name == "frames" and message.encoding == "json":
            record = _parsed(message.data, FrameRecord)
            if record is not None:
                yield from self._decode(record, message.utc_ns)

    def _read_life(self, message: ReadMessage, node: int) -> None:
        try:
            life = self._epochs.life_in(message)
        except ConfigError as error:
            _logger.warning(
                "node %d: %s; its frames are explained without its streams", node, error
            )
            return
        if life is not None:
            self._tables[node] = life.table.table()
            self._sealed[node] = life.is_sealed
            self._envelopes.clear()
            self._decoders.pop(node, None)

    def _decode(self, record: FrameRecord, utc_ns: int) -> Iterator[DecodedFrame]:
        node = record.node
        decoder = self._decoders.get(node)
        if decoder is None:
            table = self._given or self._tables.get(node) or self._found
            decoder = self._decoders[node] = FrameDecoder(table, wire=self._wire)
        for source, destination, records, fault in self._open(record):
            items: list[DecodedItem] = []
            if not fault:
                opener = None
                if self._is_sealed(node):
                    opener = self._opener = self._opener or FrameOpener()
                unicast = destination != BROADCAST
                items = said_in(decoder, opener, records, source, destination, unicast=unicast)
            yield DecodedFrame(
                utc_ns=utc_ns,
                node=node,
                direction=record.direction,
                source=source,
                destination=destination,
                frame=record.frame.hex(),
                items=tuple(items),
                fault=fault,
            )

    def _open(self, record: FrameRecord) -> Iterator[tuple[int, int, bytes, str]]:
        """Remove the envelope; return source, destination, records, fault."""
        capabilities = self._capabilities.get(record.node)
        if capabilities is None or self._wire is WireProfile.RMW_DESERT:
            yield record.source, record.destination, record.frame, ""
            return
        table = self._tables.get(record.node) or self._given or self._found
        if table is not None and table.wire is WireProfile.RMW_DESERT:
            yield record.source, record.destination, record.frame, ""
            return
        key = (record.node, record.direction, record.source)
        envelope = self._envelopes.get(key)
        if envelope is None:
            is_sealed = self._is_sealed(record.node)
            envelope = Envelope(capabilities, record.node, sealed=is_sealed)
            self._envelopes[key] = envelope
        for opened in envelope.open(record.received()):
            if isinstance(opened, Damaged):
                yield record.source, record.destination, b"", f"damaged: {opened.reason}"
            else:
                yield opened.source, opened.destination, opened.records, ""

    def _is_sealed(self, node: int) -> bool:
        """Tell whether a node's frames are sealed: by its boot epochs, else by the given key."""
        return self._sealed.get(node, self._opener is not None)


def decode_recording(
    path: str | Path,
    table: StreamTable | None = None,
    *,
    wire: WireProfile | None = None,
    opener: FrameOpener | None = None,
) -> Iterator[DecodedFrame]:
    """Decode the frames of a recording.

    Args:
        path: The file.
        table: The streams, instead of those of the recording.
        wire: Wire profile, instead of the table's.
        opener: Opens sealed frames; None: the key is unknown.

    Raises:
        ConfigError: The file is not a recording.
    """
    frames = FrameReader(table, wire=wire, opener=opener)
    for message in RecordingReader(path):
        yield from frames.read(message)


def decode_log(
    path: str | Path,
    link: str,
    table: StreamTable | None = None,
    *,
    wire: WireProfile | None = None,
    opener: FrameOpener | None = None,
) -> Iterator[DecodedFrame]:
    """Decode the frames in a log of a modem's port.

    Args:
        path: The file.
        link: Name of the link to such a modem.
        table: The streams.
        wire: Wire profile, instead of the table's.
        opener: Opens sealed frames; None: they are not sealed.

    Raises:
        ConfigError: It cannot be read.
        LinkUnavailableError: There is no such link.
    """
    kind = registry.load(link)
    try:
        log = Path(path).read_bytes()
    except OSError as error:
        raise ConfigError(f"{path}: {error.strerror}") from error
    decoder = FrameDecoder(table, wire=wire)
    for logged in kind.read_log(log):
        unicast = logged.destination != BROADCAST
        items = said_in(
            decoder, opener, logged.frame_bytes, logged.source, logged.destination, unicast=unicast
        )
        yield DecodedFrame(
            node=0,
            direction=SENT if logged.is_sent else RECEIVED,
            source=logged.source,
            destination=logged.destination,
            frame=logged.frame_bytes.hex(),
            items=tuple(items),
        )


def line_of(frame: DecodedFrame, began_ns: int) -> str:
    """Return the heading of a frame, before its contents."""
    whom = "everybody" if frame.destination == BROADCAST else f"node {frame.destination}"
    who = f"node {frame.source}" if frame.source else "somebody"
    where = f", heard by node {frame.node}" if frame.direction != SENT and frame.node else ""
    size = len(frame.frame) // 2
    when = "" if frame.utc_ns is None else f"{(frame.utc_ns - began_ns) / 1e9:10.3f} s  "
    return f"{when}{who} to {whom}{where}, {size} bytes: {frame.frame}"


def _parsed(data: bytes, kind: type[T]) -> T | None:
    try:
        return msgspec.json.decode(data, type=kind)
    except (msgspec.DecodeError, RecursionError):
        return None


def _table(data: bytes) -> StreamTable | None:
    try:
        return decode_table(data)
    except (msgspec.DecodeError, ConfigError):
        return None
