"""What comes off the water: taken apart, checked, handed to topics and services.

Nothing here raises, whatever arrives. Each thing that is dropped is counted under one word:

======================  ==========================================================================
``short check stuffing  the envelope could not be opened (`zacoustic.core.envelope`)
overlong address``
``own not_for_us``      a frame of this address, or for another one
``echo``                the same bytes again sooner than the sender can have sent them
``version``             a frame of another wire version
``truncated reserved    the frame cannot be read further (`zacoustic.core.frame`)
unknown_stream``
``unconfirmed differs`` the tables are not known to agree (`zacoustic.core.handshake`)
``not_publisher         the table does not allow this record between these nodes
not_subscriber``
``payload``             the content does not decode, or is out of the bounds of its type
``unexpected_answer     an answer to no call, or too late; a request that came before
repeated_request``
======================  ==========================================================================
"""

from zacoustic.core.envelope import Opened
from zacoustic.core.frame import (
    WIRE_VERSION,
    Ask,
    Confirm,
    Hello,
    Record,
    Stray,
    TableRow,
    Tag,
    parse_frame,
)
from zacoustic.core.handshake import Handshake
from zacoustic.core.linktypes import ReceivedFrame
from zacoustic.core.services import Services
from zacoustic.core.stats import EngineStats
from zacoustic.core.streams import ServiceSpec, StreamTable
from zacoustic.core.topics import Topics


class Receiver:
    """Takes opened frames apart.

    Args:
        table: The streams of this node.
        handshake: Decides what may be decoded.
        topics: Takes samples.
        services: Takes requests and answers.
        stats: Counts what is dropped.
    """

    def __init__(
        self,
        table: StreamTable,
        handshake: Handshake,
        topics: Topics,
        services: Services,
        stats: EngineStats,
    ) -> None:
        self._table = table
        self._handshake = handshake
        self._topics = topics
        self._services = services
        self._stats = stats

    def handle(self, opened: Opened, received: ReceivedFrame, now: int) -> tuple[int, ...]:
        """Take one frame apart; returns the streams of the records that were in it."""
        source = opened.source
        epoch: int | None = None
        streams: list[int] = []
        for item in parse_frame(opened.records, self._measure):
            if isinstance(item, Record):
                streams.append(item.stream_id)
                reason = self._handle_record(source, epoch, item, received, now)
                if reason is not None:
                    self._stats.drop(reason)
            elif isinstance(item, Stray):
                self._stats.drop(item.reason)
            elif isinstance(item, Hello):
                if self._handshake.heard_hello(source, item, now):
                    self._services.client_restarted(source, item.epoch, now)
                if item.version != WIRE_VERSION:
                    self._stats.drop("version")
                    break
                epoch = item.epoch
            elif isinstance(item, Tag):
                self._handshake.heard_tag(source, item.epoch, now)
                epoch = item.epoch
            else:
                self._handle_table_talk(source, item, now)
        if streams and epoch is not None:
            self._handshake.heard_introduced(source, epoch, now)
        return tuple(streams)

    def _handle_record(
        self,
        source: int,
        epoch: int | None,
        record: Record,
        received: ReceivedFrame,
        now: int,
    ) -> str | None:
        reason = self._handshake.verdict(source, epoch, record.stream_id, now)
        if reason is not None:
            return reason
        stream = self._table.get(record.stream_id)
        if stream is None:
            return "unknown_stream"
        if isinstance(stream.spec, ServiceSpec):
            return self._services.receive(source, stream, stream.spec, record.content, now)
        return self._topics.receive(source, stream, record, received)

    def _handle_table_talk(self, source: int, item: Confirm | Ask | TableRow, now: int) -> None:
        if isinstance(item, Confirm):
            self._handshake.heard_confirm(source, item)
        elif isinstance(item, Ask):
            self._handshake.heard_ask(source, item, now)
        else:
            self._handshake.heard_row(source, item, now)
            if self._handshake.differs(source, item.stream_id):
                self._services.stream_differs(source, item.stream_id, now)

    def _measure(self, stream_id: int, buffer: bytes, offset: int, delete: bool) -> int | None:
        stream = self._table.get(stream_id)
        if stream is None:
            raise KeyError(stream_id)
        if isinstance(stream.spec, ServiceSpec):
            return self._services.measure(stream, buffer, offset)
        return self._topics.measure(stream, buffer, offset, delete)
