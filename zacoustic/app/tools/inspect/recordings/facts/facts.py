"""Events as records: published and received samples, requests, and every frame."""

import bisect
from typing import Any

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.framecolumns import FrameColumns
from zacoustic.app.tools.inspect.recordings.facts.reactions import Reactions
from zacoustic.core.base.linktypes import LinkCapabilities, PeerMeasured
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.run.recording.channels import FrameRecord, LedgerRecord, ReportRecord
from zacoustic.run.recording.life import Life


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
    payload: bytes
    """Its value, in the codec of the stream."""
    value: Any
    """Its value from the application, in plain parts."""
    delete: bool = False
    """The key was deleted."""
    encoding: str | None = None
    """Its encoding, if not that of the stream."""
    arrived: dict[int, int] = {}
    """Time of its arrival by node, UTC, ns."""


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
    payload: bytes = b""
    """Its value, in the codec of the stream."""
    value: Any = None
    """The value in plain parts."""
    age_s: float | None = None
    """Its age as it arrived, s."""


class Asked(msgspec.Struct, kw_only=True):
    """A call or a goal."""

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
        lean: Keep what figures need alone.
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
        self.gaps: set[int] = set()
        """Nodes whose recordings have gaps."""
        self.tables: dict[int, StreamTable] = {}
        """Streams of each node whose engine is recorded."""
        self.streams: dict[int, Stream] = {}
        """All known streams by id."""
        self.capabilities: dict[int, LinkCapabilities] = {}
        self.epochs: dict[int, int] = {}
        """Number of recorded boot epochs of each node."""
        self.published: list[Published] = []
        self.arrived: list[Arrived] = []
        self.asked: list[Asked] = []
        self.commands: list[Command] = []
        """Other commands of the applications."""
        self.handled: list[Handled] = []
        """Remote commands that nodes have executed or refused."""
        self.reactions = Reactions()
        """The programs' reactions to requests."""
        self.births: list[tuple[int, Life]] = []
        """The boot epochs, each with its beginning, UTC, ns."""
        self.refused: dict[int, int] = {}
        """Commands refused by the engine, by stream."""
        self.outcomes: dict[int, dict[str, int]] = {}
        """Outcomes of reliable samples, by stream."""
        self.frames: list[tuple[int, FrameRecord]] | FrameColumns = FrameColumns() if lean else []
        """Frames with their instants, UTC, ns; received ones with their end."""
        self.reports: list[tuple[int, ReportRecord]] = []
        """Reports with the end of their transmission, UTC, ns; none if lean."""
        self.report_counts: dict[int, dict[str, int]] = {}
        """Number of reports by node and outcome."""
        self.measured: list[tuple[int, int, PeerMeasured]] = []
        """Measurements of modems besides frames: UTC, ns, the modem's node, the values."""
        self.spans_ns: dict[int, tuple[int, int]] = {}
        """First and last message of each node, UTC, ns."""
        self.ledgers: dict[tuple[int, int], LedgerRecord] = {}
        """The last of each boot epoch, by node and epoch."""
        self.sent_bytes: dict[int, int] = {}
        """Bytes of each node's frames."""
        self.covered_bytes: dict[int, int] = {}
        """Bytes of each node's frames before its last ledger."""
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

    def is_recorded(self, node: int, utc_ns: int) -> bool:
        """Tell whether a node was recorded before and after an instant."""
        first_ns, last_ns = self.spans_ns.get(node, (0, 0))
        return first_ns <= utc_ns <= last_ns


def match(facts: Facts) -> None:
    """Find the publication of each received sample, if its publisher is recorded.

    It is the newest publication of the same value that this node has not received yet, which is
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
