"""`zacoustic replay --check`: engines made again send the same bytes; else the first difference.

Every recorded call is repeated on the same engine in the same state, and the results are compared:
frames, events, writes to the journal, timers, answers to commands. In addition the ledgers are
checked: the engine's ledger must equal the sum of the frames given to its link, and the recorded
ledger must equal the engine's.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from pathlib import Path

import msgspec

from zacoustic.core.base.linktypes import Transmission
from zacoustic.core.engine.events import Event
from zacoustic.core.wire.seal import Cipher
from zacoustic.run.recording.calls import Recorded, read_outcome
from zacoustic.run.recording.channels import LedgerRecord
from zacoustic.run.recording.epochs import (
    Calls,
    LifeReader,
    NewLife,
    make_call,
    must_have_epochs,
)
from zacoustic.run.recording.life import Life
from zacoustic.run.recording.reading import ReadMessage, RecordingReader
from zacoustic.text.digits import whole_number

_LONGEST = 400

CipherOf = Callable[[int], Cipher]
"""Returns the cipher of the node with an address."""


class LifeVerdict(msgspec.Struct, kw_only=True):
    """The result of one boot epoch."""

    node: int
    """Address."""
    epoch: int
    """Of the node's boot epoch."""
    calls: int = 0
    """Number of repeated calls with the same result."""
    frames: int = 0
    """Number of frames composed again, byte for byte."""
    frame_bytes: int = 0
    """Their bytes."""
    ledger_bytes: int = 0
    """Sum of the ledger."""
    events: dict[str, int] = {}
    """Number of repeated events, by kind."""
    deliveries: int = 0
    """Samples, requests, answers and goal messages among the events."""
    duration_s: float = 0.0
    """From the first call to the last, s of the engine's clock."""
    difference: str = ""
    """The first difference; empty: none."""


class Verdict(msgspec.Struct, kw_only=True):
    """The result of a recording."""

    file: str
    """Its name."""
    epochs: list[LifeVerdict]
    """The boot epochs in order of their beginning."""
    damage: str = ""
    """Why the file ends early; empty: it does not."""

    @property
    def is_same(self) -> bool:
        """Whether everything was the same, and there was something."""
        return bool(self.epochs) and not any(life.difference for life in self.epochs)


_DELIVERIES = frozenset(
    {
        "SampleReceived", "RequestReceived", "ResponseReceived", "CallFailed", "GoalReceived",
        "GoalAnswered", "FeedbackReceived", "ResultReceived", "GoalFailed", "GoalRecovered",
        "CancelRequested", "CancelAnswered", "DeliveryEnded",
    }
)  # fmt: skip


class LifeCheck:
    """Replays one boot epoch.

    Args:
        life: The parameters of its engine.
        cipher: The keys of the fleet, or None.

    Raises:
        ConfigError: The engine cannot be made.
    """

    def __init__(self, life: Life, cipher: Cipher | None = None) -> None:
        self.verdict = LifeVerdict(node=life.address, epoch=life.epoch)
        self._engine = life.engine(cipher=cipher)
        self._events: Counter[str] = Counter()
        self._first_at: int | None = None

    def take(self, call: Recorded) -> None:
        """Repeat a call, unless there was a difference before."""
        verdict = self.verdict
        if verdict.difference:
            return
        if call.now is not None:
            self._first_at = call.now if self._first_at is None else self._first_at
            verdict.duration_s = (call.now - self._first_at) / 1e9
        done = make_call(self._engine, call)
        if done.outcome != call.outcome:
            verdict.difference = (
                f"{call.name} at {(call.now or 0) / 1e9:.6f} s: was {_shown(call.outcome)}, "
                f"is {_shown(done.outcome)}"
            )
            return
        verdict.calls += 1
        if isinstance(done.result, Transmission):
            verdict.frames += 1
            verdict.frame_bytes += len(done.result.frame_bytes)
        elif call.name == "poll_event" and isinstance(done.result, Event):
            kind = type(done.result).__name__
            self._events[kind] += 1
            verdict.deliveries += kind in _DELIVERIES

    def compare_ledger(self, recorded: LedgerRecord) -> None:
        """Compare a ledger of the recording with that of the engine."""
        if self.verdict.difference or recorded.epoch != self._engine.epoch:
            return
        rows = {(row.stream_id, row.cause): row.transmitted_bytes for row in recorded.rows}
        found = {
            (entry.stream_id, entry.cause.value): entry.transmitted_bytes
            for entry in self._engine.stats.ledger()
        }
        if rows != found or recorded.bytes != self._engine.stats.bytes_transmitted:
            self.verdict.difference = f"the ledger was {rows}, is {found}"[:_LONGEST]

    def finish(self) -> LifeVerdict:
        """Check the ledger and return the result."""
        verdict = self.verdict
        verdict.events = dict(sorted(self._events.items()))
        verdict.ledger_bytes = sum(entry.transmitted_bytes for entry in self._engine.stats.ledger())
        if verdict.ledger_bytes != verdict.frame_bytes and not verdict.difference:
            verdict.difference = (
                f"the ledger sums to {verdict.ledger_bytes} bytes, "
                f"the frames to {verdict.frame_bytes}"
            )
        return verdict


def check_recording(path: str | Path, cipher_of: CipherOf | None = None) -> Verdict:
    """Replay all boot epochs of a recording.

    Args:
        path: The file.
        cipher_of: Returns the keys of nodes whose frames were sealed.

    Raises:
        ConfigError: The file is not ours, or contains no boot epoch.
    """
    source = RecordingReader(path, tells=False)
    verdict = check_messages(source, str(path), cipher_of)
    verdict.damage = source.damage
    return verdict


def check_messages(
    messages: Iterable[ReadMessage], name: str, cipher_of: CipherOf | None = None
) -> Verdict:
    """Replay all boot epochs in the messages of a recording; see `check_recording`.

    Raises:
        ConfigError: There is no boot epoch, or another program recorded it.
    """
    reader = LifeReader()
    running: dict[int, LifeCheck] = {}
    verdict = Verdict(file=name, epochs=[])
    for message in messages:
        part = reader.read(message)
        if isinstance(part, NewLife):
            node = part.life.address
            if node in running:
                running[node].finish()
            needs_key = part.life.is_sealed
            cipher = cipher_of(node) if cipher_of is not None and needs_key else None
            running[node] = check = LifeCheck(part.life, cipher)
            verdict.epochs.append(check.verdict)
        elif isinstance(part, Calls):
            for call in part.calls:
                running[part.node].take(call)
        else:
            _compare_ledger(message, running)
    for check in running.values():
        check.finish()
    must_have_epochs(reader, name)
    return verdict


def _compare_ledger(message: ReadMessage, running: dict[int, LifeCheck]) -> None:
    node = whole_number(message.metadata.get("node", ""))
    if node in running and message.topic == f"/{node}/ledger":
        record = msgspec.json.decode(message.data, type=LedgerRecord)
        running[node].compare_ledger(record)


def _shown(outcome: bytes) -> str:
    text = repr(read_outcome(outcome))
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
