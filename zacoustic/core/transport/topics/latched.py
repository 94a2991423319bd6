"""Latched topics, for a node that begins another boot epoch: it gets the last samples again.

The problem: late joiners on the local network get the last samples of a latched topic from the
gateway there. One that comes back without a journal has none, and the next sample may be hours
away. Its publisher cannot see whether a node has a journal, and anybody can announce a boot epoch
under the address of another node.

The idea: the last samples of each key go to a node once for each of its boot epochs. The epoch must
be proved: by the seal, or by a CONFIRM, which shows that its sender has heard this node
(`zacoustic.core.peers.lives`). A node that has begun an epoch is asked for one, by a HELLO, and
later by a HELLO before one of the samples.

- Reliable samples keep their numbers, so a node that has lost nothing drops them, and says so
  (`zacoustic.core.transport.reliable.sending.latched`).
- Best-effort samples have no numbers: each goes once, and may come twice to its subscribers.

An attacker that listens can forge the proof. A forged epoch costs one such round, in which the node
answers that it has everything; the pauses between rounds double, up to some minutes, and no epoch
gets two.
"""

from collections import deque
from functools import partial
from typing import Final

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.qos import Durability
from zacoustic.core.base.timers import Due
from zacoustic.core.peers.peer import Pause
from zacoustic.core.peers.peers import PerPeer
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import LaneKey, QueuedRecord
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.reliable.sending.latched import LIMIT_BYTES
from zacoustic.core.transport.reliable.sending.sending import ReliableSending

_EPOCHS: Final = 64
"""So many boot epochs of a node are remembered."""
_LONGEST_PAUSE_UNITS: Final = 256
_ANSWER_UNITS: Final = 16
"""The time in which a node proves its boot epoch, before it is asked again; it doubles."""
_MOST_ASKED: Final = 5
_CALM_NS: Final = seconds_to_ns(3600.0)
"""After so long without a round, pauses begin anew, ns."""
_OVERHEAD_BYTES: Final = 64


class _Rounds:
    """The rounds for one node."""

    __slots__ = ("asked", "epochs", "last_at", "pause", "proved")

    def __init__(self) -> None:
        self.epochs: deque[int] = deque(maxlen=_EPOCHS)
        """Boot epochs that had theirs."""
        self.pause = Pause(_LONGEST_PAUSE_UNITS)
        self.last_at = 0
        self.asked = 0
        """How often it was asked for a proof of its present boot epoch."""
        self.proved: int | None = None
        """The boot epoch that was proved last."""


class LatchedTopics:
    """The latched topics of one node, for nodes that have forgotten them.

    Args:
        context: What the components of its engine share.
        sending: Has the reliable samples.
    """

    def __init__(self, context: Context, sending: ReliableSending) -> None:
        self._address = context.address
        self._table = context.table
        self._handshake = context.handshake
        self._timers = context.timers
        self._sending = sending
        self._unnumbered = _UnnumberedSamples(context)
        self._rounds = PerPeer(context.peers, _Rounds)
        context.peers.restarted.connect(self._restarted)
        context.peers.proved.connect(self._proved)
        context.peers.forgotten.connect(self._forget)

    def published(self, stream: Stream, lane: LaneKey, record: QueuedRecord) -> None:
        """Note a best-effort sample."""
        if stream.qos.durability is Durability.TRANSIENT_LOCAL:
            self._unnumbered.keep(stream, lane, record)

    # Below the methods above

    def _restarted(self, address: int, epoch: int, now: int) -> None:
        rounds = self._rounds[address]
        if not rounds.epochs:
            rounds.epochs.append(epoch)  # the first one that is known has forgotten nothing
        elif self._handshake.is_sealed:
            self._proved(address, epoch, now)
        elif epoch not in rounds.epochs and self._has_for(address):
            rounds.asked = 0
            self._ask(address, now)

    def _ask(self, address: int, now: int) -> None:
        """Ask a node for a proof of its boot epoch, and again if none comes."""
        rounds = self._rounds[address]
        self._handshake.ask_for_proof(address, now)
        if rounds.asked:
            # A node that knows this one does not answer a HELLO alone, but one before a record.
            self._sending.give_one_again(address, now)
        rounds.asked += 1
        if rounds.asked < _MOST_ASKED:
            pause_ns = (_ANSWER_UNITS << rounds.asked) * self._handshake.owing.unit_ns
            self._arm(address, now + pause_ns)

    def _proved(self, address: int, epoch: int, now: int) -> None:
        rounds = self._rounds[address]
        if epoch in rounds.epochs:
            return
        rounds.proved = epoch
        if not self._has_for(address):
            rounds.epochs.append(epoch)
        elif now >= rounds.pause.not_before:
            self._give(address, epoch, now)
        else:
            self._arm(address, rounds.pause.not_before)

    def _arm(self, address: int, at: int) -> None:
        self._timers.at((Due.LATCHED, address), at, partial(self._go_on, address))

    def _go_on(self, address: int, now: int) -> None:
        """Begin a round that had to wait, or ask again for a proof, for the present boot epoch."""
        rounds, epoch = self._rounds[address], self._handshake.peer(address).epoch
        if epoch is None or epoch in rounds.epochs:
            return
        if rounds.proved == epoch:
            self._give(address, epoch, now)
        else:
            self._ask(address, now)

    def _give(self, address: int, epoch: int, now: int) -> None:
        rounds = self._rounds[address]
        rounds.epochs.append(epoch)
        if now >= rounds.last_at + _CALM_NS:
            rounds.pause.reset()
        rounds.pause.use(now, self._handshake.owing.unit_ns)
        rounds.last_at = now
        self._sending.give_again(address, now)
        self._unnumbered.give_again(address, now)

    def _has_for(self, address: int) -> bool:
        return self._sending.has_for(address) or self._unnumbered.has_for(address)

    def _forget(self, address: int, now: int) -> None:
        self._timers.cancel((Due.LATCHED, address))


class _UnnumberedSamples:
    """The last best-effort samples of each key of latched topics.

    Args:
        context: What the components of its engine share.
    """

    def __init__(self, context: Context) -> None:
        self._table = context.table
        self._queue = context.queue
        self._of: dict[LaneKey, deque[QueuedRecord]] = {}
        self._bytes = 0

    def keep(self, stream: Stream, lane: LaneKey, record: QueuedRecord) -> None:
        """Keep a sample; keep nothing of a key that it deletes."""
        kept = self._of.pop(lane, deque())
        if not record.payload and record.prefix:
            self._drop(kept)
            return
        kept.append(record)
        self._bytes += _size_bytes(record)
        while len(kept) > stream.qos.depth:
            self._bytes -= _size_bytes(kept.popleft())
        self._of[lane] = kept
        while self._bytes > LIMIT_BYTES:
            self._drop(self._of.pop(next(iter(self._of))))

    def has_for(self, address: int) -> bool:
        """Return whether a node may have forgotten some."""
        return any(self._table.by_id(lane[0]).may_subscribe(address) for lane in self._of)

    def give_again(self, address: int, now: int) -> None:
        """Queue them for one node, but for keys of which a sample waits anyway."""
        for lane, kept in self._of.items():
            stream = self._table.by_id(lane[0])
            if not stream.may_subscribe(address) or self._queue.first(lane) is not None:
                continue
            for each in kept:
                if each.expires_at is None or each.expires_at > now:
                    self._queue.push(lane, _copy(each, address), stream.qos)

    def _drop(self, kept: deque[QueuedRecord]) -> None:
        self._bytes -= sum(map(_size_bytes, kept))


def _size_bytes(record: QueuedRecord) -> int:
    return len(record.payload) + _OVERHEAD_BYTES


def _copy(record: QueuedRecord, address: int) -> QueuedRecord:
    return QueuedRecord(
        stream_id=record.stream_id,
        destination=address,
        prefix=record.prefix,
        head=record.head,
        payload=record.payload,
        stamped=record.stamped,
        delimits_itself=record.delimits_itself,
        queued_at=record.queued_at,
        expires_at=record.expires_at,
    )
