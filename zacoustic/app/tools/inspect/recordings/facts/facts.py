"""Events: rows of numbers, from which figures come; and records of the load, to repeat it.

Rows are of samples, frames, answers and measurements. Records contain values as well, and exist
unless the reading is lean.
"""

import struct
from typing import Any, Final

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.reactions import Reactions
from zacoustic.app.tools.inspect.recordings.facts.rows import Row, Rows
from zacoustic.core.base.linktypes import LinkCapabilities
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.run.recording.channels import LedgerRecord
from zacoustic.run.recording.life import Life

METRICS: Final = (
    "snr_db",
    "received_level_db",
    "integrity",
    "propagation_s",
    "range_m",
    "range_rate_m_s",
)
"""Quantities that a modem may measure, as in `LinkMetrics`, in the order of the table."""


class Sample(Row, frozen=True):
    """A published or received sample; equal ones stand together, by time."""

    layout = struct.Struct("<12s12sq?QIBB")
    place: bytes
    """Digest of stream, publisher and key."""
    content: bytes
    """Digest of the value in the codec of the stream."""
    at_ns: int
    """UTC, ns."""
    is_arrival: bool
    """It was received."""
    number: int
    """Its number among all samples, in the order of reading."""
    stream_id: int
    """Its topic."""
    source: int
    """The publisher; 0: unknown."""
    node: int
    """The publisher, or the receiver."""


class Delivery(Row, frozen=True):
    """A published sample that arrived, or an answered call or goal; in the order of `number`."""

    layout = struct.Struct("<QqQIqB12s")
    number: int
    """Number of the publication among the samples, or of the request among the requests."""
    at_ns: int
    """Time of the arrival, of the answer or of the goal's end, UTC, ns."""
    arrival: int
    """Number of the arrival among the samples, or 0."""
    stream_id: int
    """Its topic, service or action."""
    begun_ns: int
    """Time of the publication or the request, UTC, ns."""
    source: int
    """The publisher, or the client."""
    place: bytes = b""
    """As in `Sample`."""


class Frame(Row, frozen=True):
    """A sent or received frame."""

    layout = struct.Struct("<q?BBBd12s")
    at_ns: int
    """UTC, ns; the end of a received one."""
    is_sent: bool
    """The node sent it."""
    node: int
    """Node of the link."""
    source: int
    """Its sender; 0: unknown."""
    destination: int
    """Its destination, or broadcast."""
    airtime_s: float
    """Its airtime, s; 0: unknown."""
    content: bytes
    """Digest of its bytes."""


class Number(Row, frozen=True):
    """A measurement of a modem, an age or a latency."""

    layout = struct.Struct("<IBBdq")
    what: int
    """Index in `METRICS`; of an age or a latency the stream."""
    source: int
    """The measured node; of an age or a latency 0."""
    node: int
    """The measuring node; of an age or a latency 0."""
    number: float
    """The value; of an age or a latency s."""
    at_ns: int
    """UTC, ns."""


class Counts(msgspec.Struct):
    """Numbers of events of one stream."""

    published: int = 0
    """Samples and deletions."""
    samples: dict[int, int] = {}
    """Samples, by publisher."""
    arrived: int = 0
    """Received samples."""
    receivers: set[int] = set()
    """The nodes that received them."""
    asked: int = 0
    """Calls and goals."""
    failed: int = 0
    """Those that ended without an answer."""
    refused: int = 0
    """Commands refused by the engine."""
    outcomes: dict[str, int] = {}
    """Outcomes of reliable samples."""


class Transmitted(msgspec.Struct):
    """Sums of the frames sent by one node."""

    frames: int = 0
    """Their number."""
    size_bytes: int = 0
    """Their bytes."""
    airtime_s: float = 0.0
    """Their airtime, s."""


class Published(msgspec.Struct, kw_only=True):
    """A sample published by a node."""

    at_ns: int
    """UTC, ns."""
    node: int
    """The publisher."""
    stream_id: int
    """Its topic."""
    instance: Instance
    """Its key in the topic."""
    value: Any
    """Its value from the application, in plain parts."""
    delete: bool = False
    """The key was deleted."""
    encoding: str | None = None
    """Its encoding, if not that of the stream."""


class Arrived(msgspec.Struct, kw_only=True):
    """A received sample."""

    at_ns: int
    """UTC, ns."""
    node: int
    """The receiver."""
    source: int
    """The publisher."""
    stream_id: int
    """Its topic."""
    instance: Instance = ()
    """Its key in the topic."""
    value: Any = None
    """The value in plain parts."""
    age_s: float | None = None
    """Its age as it arrived, s."""


class Asked(msgspec.Struct, kw_only=True):
    """A call or a goal."""

    number: int
    """Its number among all requests, in the order of reading."""
    at_ns: int
    """UTC, ns."""
    node: int
    """The client."""
    stream_id: int
    """Its service or action."""
    value: Any
    """Request or goal, in plain parts."""
    timeout_s: float | None = None
    """Time-out, if not that of the stream, s."""
    answer: Any = None
    """Answer, in plain parts."""
    ended_at_ns: int | None = None
    """Time of the answer or of the goal's end, UTC, ns."""
    failure: str = ""
    """Why there is no answer; empty: there is one, or none yet."""


class Command(msgspec.Struct, frozen=True):
    """A command without a result of its own."""

    at_ns: int
    """UTC, ns."""
    node: int
    """Node of the application."""
    name: str
    """The call of the engine."""
    arguments: dict[str, Any]
    """Its arguments, without the instant."""


class Handled(msgspec.Struct, frozen=True, kw_only=True):
    """A remote command at the commanded node, or refused frames."""

    at_ns: int
    """UTC, ns."""
    node: int
    """The commanded node."""
    by: int
    """Address that the command, or the frames, came from."""
    what: str
    """Kind of the command; ``command`` if it was refused, ``seal`` for frames."""
    stream_id: int | None = None
    """Its topic, or None."""
    outcome: str
    """``executed``, ``refused``, or why frames did not open."""
    text: str = ""
    """One line."""


class Facts:
    """All events; made by `gather`.

    Args:
        lean: Keep what figures need alone, in rows and sums: no published, arrived and asked
            values, no commands, boot epochs and reactions.
    """

    def __init__(self, *, lean: bool = False) -> None:
        self.is_lean = lean
        self.files: list[str] = []
        self.damage: dict[str, str] = {}
        """Why files end early."""
        self.programs: dict[str, str] = {}
        """Versions of the programs that made the files."""
        self.faults: list[str] = []
        """Why boot epochs of engines could not be read."""
        self.unread = 0
        """Calls of engines that this program cannot read."""
        self.tables: dict[int, StreamTable] = {}
        """Streams of each node whose engine is recorded."""
        self.streams: dict[int, Stream] = {}
        """All known streams by id."""
        self.capabilities: dict[int, LinkCapabilities] = {}
        self.epochs: dict[int, int] = {}
        """Number of recorded boot epochs of each node."""
        self.counts: dict[int, Counts] = {}
        """Numbers of events by stream."""
        self.samples: Rows[Sample] = Rows(Sample)
        self.sources: set[int] = set()
        """The publishers of received samples; 0: unknown."""
        self.ages: Rows[Number] = Rows(Number)
        """Ages of received samples, as far as they are known, s."""
        self.deliveries: Rows[Delivery] = Rows(Delivery)
        """Samples that arrived at recorded nodes; found by `match`."""
        self.requests = 0
        """Number of calls and goals."""
        self.answers: Rows[Delivery] = Rows(Delivery)
        """Answered calls and goals."""
        self.frames: Rows[Frame] = Rows(Frame)
        self.frame_nodes: set[int] = set()
        """Nodes with frames."""
        self.transmitted: dict[int, Transmitted] = {}
        """Sums of the frames sent by each node."""
        self.on_frames: Rows[Number] = Rows(Number)
        """Measurements on received frames."""
        self.on_peers: Rows[Number] = Rows(Number)
        """Measurements of modems besides frames."""
        self.handled: list[Handled] = []
        """Remote commands that nodes have executed or refused."""
        self.report_counts: dict[int, dict[str, int]] = {}
        """Number of reports by node and outcome."""
        self.published: list[Published] = []
        self.arrived: list[Arrived] = []
        self.asked: list[Asked] = []
        self.commands: list[Command] = []
        """Other commands of the applications."""
        self.reactions = Reactions()
        """The programs' reactions to requests."""
        self.births: list[tuple[int, Life]] = []
        """The boot epochs, each with its beginning, UTC, ns."""
        self.spans_ns: dict[int, tuple[int, int]] = {}
        """First and last message of each node, UTC, ns."""
        self.ledgers: dict[tuple[int, int], LedgerRecord] = {}
        """The last of each boot epoch, by node and epoch."""
        self.covered_bytes: dict[int, int] = {}
        """Bytes of each node's frames before its last ledger."""
        self.began_ns = 0
        self.ended_ns = 0

    @property
    def duration_s(self) -> float:
        """From the first message to the last, s."""
        return (self.ended_ns - self.began_ns) / 1e9

    def counts_of(self, stream_id: int) -> Counts:
        """Return the numbers of a stream, to count further."""
        return self.counts.setdefault(stream_id, Counts())

    @property
    def nodes(self) -> list[int]:
        """Nodes whose link was recorded."""
        return sorted({*self.tables, *self.frame_nodes})

    def is_recorded(self, node: int, utc_ns: int) -> bool:
        """Tell whether a node was recorded before and after an instant."""
        first_ns, last_ns = self.spans_ns.get(node, (0, 0))
        return first_ns <= utc_ns <= last_ns
