"""Which channel of a recording holds what, and the records that are in them in JSON."""

from typing import Final

import msgspec

from zacoustic.core.base.linktypes import (
    ONE_LINK,
    LinkCapabilities,
    LinkMetrics,
    LinkState,
    ReceivedFrame,
    Transmission,
    TransmitReport,
)
from zacoustic.core.streams.table import Stream
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
    """Of the messages, one of MCAP's well-known words, or the Zenoh encoding of raw bytes."""
    schema_name: str = ""
    """Empty: there is none."""
    schema_encoding: str = ""
    """One of MCAP's well-known words."""
    schema: bytes = b""
    """Its contents."""
    metadata: dict[str, str] = {}
    """For people and for readers of ours."""


class FrameRecord(msgspec.Struct, frozen=True, kw_only=True):
    """A frame, as the link had it."""

    direction: str
    """`sent` or `received`."""
    node: int
    """Whose link."""
    source: int
    """Its sender; 0: the link does not report it."""
    destination: int
    """Its destination; 255: everybody, or the link does not report it."""
    size_bytes: int
    """With its envelope."""
    frame: bytes
    """The frame."""
    at: int
    """By the engine's clock: when it was given to the link, or had arrived, ns."""
    transmission_id: int | None = None
    """Of one that is sent."""
    airtime_s: float | None = None
    """Of one that is sent, by the capabilities of the link, s."""
    acknowledge: bool | None = None
    """Of one that is sent: the modem is asked for an acknowledgement."""
    snr_db: float | None = None
    """What the modem measured, as in `LinkMetrics`."""
    received_level_db: float | None = None
    """The same."""
    integrity: float | None = None
    """The same."""
    propagation_s: float | None = None
    """The same."""
    range_rate_m_s: float | None = None
    """The same."""
    link: str = ONE_LINK
    """Name of the link."""


class ReportRecord(msgspec.Struct, frozen=True, kw_only=True):
    """How a transmission ended."""

    node: int
    """Who has transmitted."""
    transmission_id: int
    """Which."""
    outcome: str
    """`sent`, `delivered`, `not_delivered`, `rejected` or `aborted`."""
    started_at: int
    """By the engine's clock, ns."""
    finished_at: int
    """The same."""
    duration_s: float
    """Between the two, s."""
    detail: str = ""
    """The modem's words."""
    link: str = ONE_LINK
    """Name of the link."""


class LinkRecord(msgspec.Struct, frozen=True, kw_only=True):
    """The link went up or down."""

    node: int
    """Whose link."""
    state: str
    """`up`, `down` or `opening`."""
    capabilities: LinkCapabilities | None = None
    """With `up`."""
    link: str = ONE_LINK
    """Name of the link."""


class LedgerRow(msgspec.Struct, frozen=True, kw_only=True):
    """One row of a ledger."""

    stream_id: int
    """0: no stream."""
    stream: str
    """Its name."""
    cause: str
    """Why."""
    transmitted_bytes: int
    """Bytes given to the link since the boot epoch began."""


class LedgerRecord(msgspec.Struct, frozen=True, kw_only=True):
    """What an engine has counted so far."""

    node: int
    """Whose."""
    epoch: int
    """Its boot epoch."""
    frames: int
    """Given to the link."""
    bytes: int
    """The same; the sum of `rows`."""
    airtime_s: float
    """What they last, s."""
    rows: tuple[LedgerRow, ...]
    """By stream and cause."""


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
    """Return the channel of events: `event` is the kind, besides the record's fields."""
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
    airtime_s = None if capabilities is None else capabilities.airtime_ns(size) / 1e9
    return FrameRecord(
        direction=SENT,
        node=node,
        source=node,
        destination=sent.destination,
        size_bytes=size,
        frame=sent.frame_bytes,
        at=at,
        transmission_id=sent.transmission_id,
        airtime_s=airtime_s,
        acknowledge=sent.acknowledge,
    )


def received_frame(node: int, frame: ReceivedFrame) -> FrameRecord:
    """Make the record of a frame that arrived."""
    metrics: LinkMetrics = frame.metrics
    return FrameRecord(
        direction=RECEIVED,
        node=node,
        source=frame.source,
        destination=frame.destination,
        size_bytes=len(frame.frame_bytes),
        frame=frame.frame_bytes,
        at=frame.received_at,
        snr_db=metrics.snr_db,
        received_level_db=metrics.received_level_db,
        integrity=metrics.integrity,
        propagation_s=metrics.propagation_s,
        range_rate_m_s=metrics.range_rate_m_s,
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
