"""What happened, as records: what was published, what arrived, what was asked, every frame."""

import bisect
from typing import Any

import msgspec

from zacoustic.app.tools.inspect.recordings.facts.reactions import Reactions
from zacoustic.core.base.linktypes import LinkCapabilities, PeerMeasured
from zacoustic.core.streams.keys import Instance
from zacoustic.core.streams.table import Stream, StreamTable
from zacoustic.run.recording.channels import FrameRecord, LedgerRecord, ReportRecord
from zacoustic.run.recording.life import Life


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
    answer: Any = None
    """What came back, in plain parts."""
    ended_at_ns: int | None = None
    """Answered, or the goal ended, UTC, ns."""
    failure: str = ""
    """Why there is no answer; empty: there is one, or none yet."""


class Command(msgspec.Struct, frozen=True):
    """A command without a result of its own."""

    at_ns: int
    """UTC, ns."""
    node: int
    """Whose application."""
    name: str
    """The call of the engine."""
    arguments: dict[str, Any]
    """Its arguments, without the instant."""


class Handled(msgspec.Struct, frozen=True, kw_only=True):
    """A remote command as the node had it that was commanded, or frames that it refused."""

    at_ns: int
    """UTC, ns."""
    node: int
    """Who was commanded."""
    by: int
    """Address that the command, or the frames, came from."""
    what: str
    """Kind of the command; ``command`` where it was refused, ``seal`` for frames."""
    stream_id: int | None = None
    """The topic that it was about, or None."""
    outcome: str
    """``executed``, ``refused``, or why frames did not open."""
    text: str = ""
    """One line."""


class Facts:
    """Everything that was found; made by `gather`."""

    def __init__(self) -> None:
        self.files: list[str] = []
        self.damage: dict[str, str] = {}
        """Why files end early."""
        self.gaps: set[int] = set()
        """Nodes with gaps."""
        self.tables: dict[int, StreamTable] = {}
        """Streams of each node whose engine is recorded."""
        self.streams: dict[int, Stream] = {}
        """All streams that are known, by id."""
        self.capabilities: dict[int, LinkCapabilities] = {}
        self.epochs: dict[int, int] = {}
        """How many boot epochs of each node were recorded."""
        self.published: list[Published] = []
        self.arrived: list[Arrived] = []
        self.asked: list[Asked] = []
        self.commands: list[Command] = []
        """What else the applications have asked of their engines."""
        self.handled: list[Handled] = []
        """Remote commands that nodes have executed or refused."""
        self.reactions = Reactions()
        """What they did when they were asked."""
        self.births: list[tuple[int, Life]] = []
        """The boot epochs, each with its beginning, UTC, ns."""
        self.refused: dict[int, int] = {}
        """Commands that the engine has not taken, by stream."""
        self.outcomes: dict[int, dict[str, int]] = {}
        """How reliable samples ended, by stream."""
        self.frames: list[tuple[int, FrameRecord]] = []
        """With their instants, UTC, ns; where they end, for those that arrived."""
        self.reports: list[tuple[int, ReportRecord]] = []
        """With the instants of their ends, UTC, ns."""
        self.measured: list[tuple[int, int, PeerMeasured]] = []
        """Measurements of modems besides frames: UTC, ns, the modem's node, the values."""
        self.spans_ns: dict[int, tuple[int, int]] = {}
        """First and last message of each node, UTC, ns."""
        self.ledgers: dict[tuple[int, int], LedgerRecord] = {}
        """The last of each boot epoch, by node and epoch."""
        self.sent_bytes: dict[int, int] = {}
        """Of the frames of each node."""
        self.covered_bytes: dict[int, int] = {}
        """Of the frames before its last ledger."""
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
        """Tell whether something of a node was recorded before and after an instant."""
        first_ns, last_ns = self.spans_ns.get(node, (0, 0))
        return first_ns <= utc_ns <= last_ns


def match(facts: Facts) -> None:
    """Find the publication of each arrived sample, if its publisher is recorded.

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
