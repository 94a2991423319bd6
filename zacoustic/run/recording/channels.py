"""The channels of a recording, and the records in those with JSON."""

import contextlib
from typing import Final

import msgspec

from zacoustic.core.base.linktypes import (
    ONE_LINK,
    LinkCapabilities,
    LinkMetrics,
    LinkState,
    ReceivedFrame,
    Service,
    Transmission,
    TransmitReport,
)
from zacoustic.core.streams.table import Stream
from zacoustic.run.recording.reading import ReadMessage
from zacoustic.run.recording.schemas import (
    OpaqueValue,
    schema_of_anything,
    schema_of_struct,
    schema_of_type,
)

JSON: Final = "json"
CDR: Final = "cdr"
MSGPACK: Final = "msgpack"
JSON_SCHEMA: Final = "jsonschema"
ROS_SCHEMA: Final = "ros2msg"

SENT: Final = "sent"
RECEIVED: Final = "received"


class Channel(msgspec.Struct, frozen=True, kw_only=True):
    """A channel of an MCAP file."""

    topic: str
    """Its name, unique in the file."""
    encoding: str
    """Encoding of the messages: one of MCAP's well-known words, or Zenoh's for raw bytes."""
    schema_name: str = ""
    """Name of the schema; empty: none."""
    schema_encoding: str = ""
    """One of MCAP's well-known words."""
    schema: bytes = b""
    """Contents of the schema."""
    metadata: dict[str, str] = {}
    """Properties for people and for our readers."""


class FrameRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A frame as the link sent or received it."""

    direction: str
    """`sent` or `received`."""
    node: int
    """Node of the link."""
    source: int
    """Its sender; 0: the link does not report it."""
    destination: int
    """Its destination; 255: broadcast, or the link does not report it."""
    size_bytes: int
    """Length with the envelope, bytes."""
    frame: bytes
    """The frame."""
    at: int
    """When it was given to the link or had arrived, on the engine's clock, ns."""
    transmission_id: int | None = None
    """Number of a sent frame's transmission."""
    airtime_s: float | None = None
    """Its airtime by the link's capabilities, s, without repetitions by the device."""
    acknowledge: bool | None = None
    """Of a sent frame: the modem is asked for an acknowledgement."""
    snr_db: float | None = None
    """Measured by the modem, as in `LinkMetrics`."""
    received_level_db: float | None = None
    """The same."""
    integrity: float | None = None
    """The same."""
    propagation_s: float | None = None
    """The same."""

    def received(self) -> ReceivedFrame:
        """Return the frame as a link hands it over."""
        return ReceivedFrame(
            frame_bytes=self.frame,
            received_at=self.at,
            source=self.source,
            destination=self.destination,
            service=Service(self.service),
        )

    range_rate_m_s: float | None = None
    """The same."""
    link: str = ONE_LINK
    """Name of the link."""
    service: str = Service.PLAIN.value
    """The service that carries it: `plain`, or `bulk` for burst data."""


class ReportRecord(msgspec.Struct, frozen=True, kw_only=True):
    """How a transmission ended."""

    node: int
    """The transmitting node."""
    transmission_id: int
    """Number of the transmission."""
    outcome: str
    """`sent`, `delivered`, `not_delivered`, `rejected` or `aborted`."""
    started_at: int
    """On the engine's clock, ns."""
    finished_at: int
    """The same."""
    duration_s: float
    """Time between the two, s."""
    detail: str = ""
    """The modem's message."""
    link: str = ONE_LINK
    """Name of the link."""


class LinkRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A change of the link's state."""

    node: int
    """Node of the link."""
    state: str
    """`up`, `down` or `opening`."""
    capabilities: LinkCapabilities | None = None
    """Its capabilities; only with `up`."""
    link: str = ONE_LINK
    """Name of the link."""


class LedgerRow(msgspec.Struct, frozen=True, kw_only=True):
    """One row of a ledger."""

    stream_id: int
    """0: none."""
    stream: str
    """Name of the stream."""
    cause: str
    """Cause of the bytes."""
    transmitted_bytes: int
    """Bytes given to the link since the boot epoch began."""
    airtime_s: float | None = None
    """Their airtime, s; None: an older recording."""


class LedgerRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The ledger of an engine so far."""

    node: int
    """Node of the engine."""
    epoch: int
    """Its boot epoch."""
    frames: int
    """Number of frames given to the link."""
    bytes: int
    """Their bytes, the sum of `rows`."""
    airtime_s: float
    """Their airtime, s."""
    rows: tuple[LedgerRow, ...]
    """Bytes by stream and cause."""


def engine_channel(node: int) -> Channel:
    """Return the channel of boot epochs and calls."""
    return Channel(topic=f"/{node}/engine", encoding=MSGPACK, metadata={"node": str(node)})


def frames_channel(node: int) -> Channel:
    """Return the channel of `FrameRecord`s."""
    return _records(node, "frames", FrameRecord)


def reports_channel(node: int) -> Channel:
    """Return the channel of `ReportRecord`s."""
    return _records(node, "reports", ReportRecord)


def links_channel(node: int) -> Channel:
    """Return the channel of `LinkRecord`s."""
    return _records(node, "links", LinkRecord)


def ledger_channel(node: int) -> Channel:
    """Return the channel of `LedgerRecord`s."""
    return _records(node, "ledger", LedgerRecord)


def events_channel(node: int) -> Channel:
    """Return the channel of events: `event` is the kind, followed by the record's fields."""
    return Channel(
        topic=f"/{node}/events",
        encoding=JSON,
        schema_name="zacoustic.Event",
        schema_encoding=JSON_SCHEMA,
        schema=schema_of_anything("Event", event="string", stream_id="integer", key="string"),
        metadata={"node": str(node)},
    )


def value_channel(topic: str, stream: Stream, metadata: dict[str, str] | None = None) -> Channel:
    """Return a channel of the values of a topic, in JSON.

    Args:
        topic: Of the channel.
        stream: The stream of the topic.
        metadata: Further properties of it.
    """
    said = {"stream_id": str(stream.stream_id), "stream": stream.name, **(metadata or {})}
    if stream.type is None:
        name, schema = "zacoustic.OpaqueValue", schema_of_struct(OpaqueValue)
    else:
        name, schema = stream.type.name, schema_of_type(stream.type)
    return Channel(
        topic=topic,
        encoding=JSON,
        schema_name=name,
        schema_encoding=JSON_SCHEMA,
        schema=schema,
        metadata=said,
    )


def document_channel(key: str) -> Channel:
    """Return the channel of a health document, JSON under its key."""
    return Channel(
        topic=f"/{key}",
        encoding=JSON,
        schema_name="zacoustic.Document",
        schema_encoding=JSON_SCHEMA,
        schema=schema_of_anything("Document"),
    )


def sent_frame(
    node: int, sent: Transmission, at: int, capabilities: LinkCapabilities | None
) -> FrameRecord:
    """Make the record of a frame that was given to the link."""
    size = len(sent.frame_bytes)
    return FrameRecord(
        direction=SENT,
        node=node,
        source=node,
        destination=sent.destination,
        size_bytes=size,
        frame=sent.frame_bytes,
        at=at,
        transmission_id=sent.transmission_id,
        airtime_s=_airtime_s(size, sent.service, capabilities),
        acknowledge=sent.acknowledge,
        service=sent.service.value,
    )


def _airtime_s(
    size_bytes: int, service: Service, capabilities: LinkCapabilities | None
) -> float | None:
    return None if capabilities is None else capabilities.airtime_ns(size_bytes, service) / 1e9


def received_frame(
    node: int, frame: ReceivedFrame, capabilities: LinkCapabilities | None = None
) -> FrameRecord:
    """Make the record of a frame that arrived."""
    metrics: LinkMetrics = frame.metrics
    size = len(frame.frame_bytes)
    return FrameRecord(
        direction=RECEIVED,
        node=node,
        source=frame.source,
        destination=frame.destination,
        size_bytes=size,
        frame=frame.frame_bytes,
        at=frame.received_at,
        airtime_s=_airtime_s(size, frame.service, capabilities),
        snr_db=metrics.snr_db,
        received_level_db=metrics.received_level_db,
        integrity=metrics.integrity,
        propagation_s=metrics.propagation_s,
        range_rate_m_s=metrics.range_rate_m_s,
        service=frame.service.value,
    )


def report_record(node: int, report: TransmitReport) -> ReportRecord:
    """Make the record of a report."""
    return ReportRecord(
        node=node,
        transmission_id=report.transmission_id,
        outcome=report.outcome.value,
        started_at=report.started_at,
        finished_at=report.finished_at,
        duration_s=(report.finished_at - report.started_at) / 1e9,
        detail=report.detail,
    )


def link_record(node: int, state: LinkState, capabilities: LinkCapabilities | None) -> LinkRecord:
    """Make the record of a change of the link."""
    return LinkRecord(node=node, state=state.value, capabilities=capabilities)


def _records(node: int, name: str, record: type[msgspec.Struct]) -> Channel:
    return records_channel(f"/{node}", name, record)


def records_channel(place: str, name: str, record: type[msgspec.Struct]) -> Channel:
    """Return a channel of records in JSON; the last part of `place` is the node."""
    return Channel(
        topic=f"{place}/{name}",
        encoding=JSON,
        schema_name=f"zacoustic.{record.__name__}",
        schema_encoding=JSON_SCHEMA,
        schema=schema_of_struct(record),
        metadata={"node": place.rpartition("/")[2]},
    )


class _LinkSaid(msgspec.Struct):
    """What a `LinkRecord` and the health document of a link have in common."""

    capabilities: LinkCapabilities | None = None


def capabilities_in(message: ReadMessage) -> LinkCapabilities | None:
    """Return the capabilities of the link that a message is about; None: it tells none."""
    if message.name == "links" or (message.name == "link" and message.is_of_network):
        with contextlib.suppress(msgspec.DecodeError, RecursionError):
            return msgspec.json.decode(message.data, type=_LinkSaid).capabilities
    return None
