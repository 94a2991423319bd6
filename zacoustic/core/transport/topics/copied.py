"""Urgent best-effort samples are sent several times while another node is in a run.

A best-effort sample is neither acknowledged nor repeated, and most of those for a node that sends
an object would collide with its run. A sample of priority `real_time` is sent eight times, four
copies in each of two pauses (`zacoustic.core.schedule.access.listening`), if a run is heard when
its first frame is composed, or if a node listens for an answer after one. At 40 % loss, one sample
in a thousand is then lost. If only a sound is heard, a run may begin with it, and the sample is
sent three times. SYNC numbers the copies, so that the sample is delivered once. Any other sample is
sent once, without a number; so it is lost if a run that is not heard yet begins just then.

Copies end when a newer sample of the key is published, and half a minute after the publication: a
subscriber that restarts knows no numbers and would take an old sample for new. They take at most a
small share of the time: an emergency is rare, and a busy stream of this priority would fill the
channel with copies.
"""

from collections import deque
from functools import partial
from typing import Final

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import TransmitReport
from zacoustic.core.base.parts import Part
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.base.timers import Due
from zacoustic.core.schedule.airtime import AirtimeAccount
from zacoustic.core.schedule.context import Context
from zacoustic.core.schedule.queue import LaneKey, QueuedRecord
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.keys import Instance
from zacoustic.core.wire.frame import SYNC_BYTES, Sync

_COPIES_IN_ROW: Final = 4
_ROWS: Final = 2
_MOST_IN_THE_DARK: Final = 6
"""How many extra copies are sent while a run is heard whose pauses are not known."""
_COPIES_BESIDE_A_SOUND: Final = 3
"""How often a sample is sent if only a sound is heard, which a run may begin with."""
_COPIES_IN_CROWD: Final = 12
"""How often a sample is sent where a node may be in a run that cannot be heard out."""
_DRAWN_PARTS: Final = (0.3, 1.2)
"""In parts of a round trip, the pauses between these copies."""
_MOST_KEYS: Final = 1024
"""For how many keys, the latest ones, the received numbers are remembered."""
_MOST_NUMBERS: Final = 8
_COPIES_SHARE: Final = 0.05
"""Share of the time that copies may take; that of ten minutes can be saved up."""
COPIED_NS: Final = 30 * NS_PER_S
"""How long after its publication copies of a sample are sent at most, ns."""


class _Copied:
    """A sample and its remaining copies."""

    __slots__ = (
        "copies_left", "due_at", "ends_at", "in_the_dark", "is_on_air", "key", "qos", "record",
        "was_sent",
    )  # fmt: skip

    def __init__(
        self,
        key: LaneKey,
        record: QueuedRecord,
        qos: Qos,
        copies: int,
        in_the_dark: int,
        ends_at: int,
    ) -> None:
        self.key = key
        self.record = record
        self.qos = qos
        self.ends_at = ends_at
        self.copies_left = copies
        self.in_the_dark = in_the_dark
        self.was_sent = False
        self.is_on_air = False
        self.due_at: int | None = None
        """Instant of the next copy, ns; None: the copy waits in the queue or is in transmission."""


class CopiedSamples:
    """The copied samples of one node, and the copies that it receives.

    Args:
        context: What the components of its engine share.
    """

    def __init__(self, context: Context) -> None:
        self._timers = context.timers
        self._queue = context.queue
        self._handshake = context.handshake
        context.peers.forgotten.connect(self.peer_forgotten)
        self._rng = context.generators.of("copies")
        self._times: LinkTimes | None = None
        self._account = AirtimeAccount(_COPIES_SHARE)
        self._next_number = 0
        self._copied: dict[int, _Copied] = {}
        self._waiting: list[tuple[LaneKey, QueuedRecord, Qos]] = []
        """Samples to be sent once unless a run begins; some have been sent."""
        self._came: dict[tuple[int, ...], deque[Sync]] = {}

    # Transmission

    def use_link(self, times: LinkTimes) -> None:
        """Set the airtimes of a link, and drop the copies for the link before."""
        self._times = times
        self._copied.clear()
        self._waiting.clear()
        self._changed()

    def publish(self, key: LaneKey, record: QueuedRecord, qos: Qos, now: int) -> None:
        """Queue a best-effort sample, with as many copies as it needs."""
        for each in [each for each in self._copied.values() if each.key == key and each.was_sent]:
            self._end(each)
        if qos.priority is Priority.REAL_TIME and not self._copy(key, record, qos, now):
            self._waiting = [*self._still_waiting(), (key, record, qos)]
        self._queue.push(key, record, qos)

    def begin_frame(self, now: int) -> None:
        """Prepare for a frame that is about to be composed.

        If a run began while a sample waited, that sample is copied as well.
        """
        self._waiting = [each for each in self._still_waiting() if not self._copy(*each, now)]

    def peer_forgotten(self, source: int, now: int) -> None:
        """Forget a node and the copies that came from it."""
        for key in [key for key in self._came if key[0] == source]:
            del self._came[key]

    def drop_stream(self, stream_id: int) -> None:
        """Drop the copies of a stream: it has no subscribers, or new ones."""
        for each in [each for each in self._copied.values() if each.key[0] == stream_id]:
            self._end(each)

    def sweep(self, now: int) -> None:
        """Drop copies that are too old or have left the queue; called while the node is awake."""
        for each in list(self._copied.values()):
            expires_at = each.record.expires_at
            is_over = each.was_sent and each.ends_at <= now
            is_over |= expires_at is not None and expires_at <= now
            waits = each.due_at is not None or each.is_on_air
            if is_over or not (waits or self._queue.holds(each.key, each.record)):
                self._end(each)

    # Reception

    def is_repeated(self, source: int, stream_id: int, instance: Instance, sync: Sync) -> bool:
        """Record the number of a copied sample; return whether it came before."""
        key = (source, stream_id, *instance)
        numbers = self._came.pop(key, None) or deque(maxlen=_MOST_NUMBERS)
        self._came[key] = numbers
        while len(self._came) > _MOST_KEYS:
            del self._came[next(iter(self._came))]
        if sync in numbers:
            return True
        numbers.append(sync)
        return False

    # Below the methods above

    def _changed(self) -> None:
        self._timers.changed((Due.COPY,), self._due_at, self._go_on)

    def _due_at(self) -> int | None:
        """Return the earliest instant of a further copy, ns, or None."""
        due = (each.due_at for each in self._copied.values() if each.due_at is not None)
        return min(due, default=None)

    def _go_on(self, now: int) -> None:
        """Queue the copies that are due."""
        for each in self._copied.values():
            if each.due_at is not None and each.due_at <= now:
                each.due_at = None
                self._queue.push(each.key, each.record, each.qos)
        self._changed()

    def _still_waiting(self) -> list[tuple[LaneKey, QueuedRecord, Qos]]:
        return [each for each in self._waiting if self._queue.holds(each[0], each[1])]

    def _copy(self, key: LaneKey, record: QueuedRecord, qos: Qos, now: int) -> bool:
        """Copy a sample that has not been sent yet; False: it is sent once."""
        copies, in_the_dark = self._copies(record, now)
        if copies == 1:
            return False
        record.sync = Sync(self._handshake.epoch, self._next_number).encode()
        self._next_number += 1
        record.dense_value = None
        each = _Copied(key, record, qos, copies, in_the_dark, record.queued_at + COPIED_NS)
        self._copied[id(record)] = each
        record.part = Part(
            transmitted=partial(self._transmitted, each),
            reported=partial(self._reported, each),
        )
        return True

    def _copies(self, record: QueuedRecord, now: int) -> tuple[int, int]:
        """Return how often a sample of priority `real_time` is sent.

        Returns:
            How often in all, and how often more while a run is heard whose pauses are not known.
        """
        if self._times is None:
            return 1, 0
        listening, largest_bytes = self._times.listening, self._queue.largest_bytes
        size_bytes = record.size_bytes + SYNC_BYTES
        if listening is None or self._account.even_at(now) > now:
            return 1, 0
        if largest_bytes is not None and size_bytes > largest_bytes:
            return 1, 0
        if listening.is_beside_others(now):
            return _COPIES_IN_CROWD, 0
        if listening.hears_run(now):
            detour_ns = listening.detour_ns(record.destination, now)
            return _ROWS * _in_row(record, self._times, detour_ns), _MOST_IN_THE_DARK
        return (_COPIES_BESIDE_A_SOUND if listening.hears_sound else 1), 0

    def _transmitted(self, each: _Copied, now: int) -> None:
        each.is_on_air = True

    def _reported(self, each: _Copied, report: TransmitReport, now: int) -> None:
        """Plan the next copy of a sample after a transmission, at once or in another pause."""
        each.is_on_air = False
        self._changed()
        if id(each.record) not in self._copied or self._times is None:
            return
        record, listening = each.record, self._times.listening
        at = report.finished_at
        if each.was_sent:
            self._account.spend(at - report.started_at, at)
        invited_at = (
            listening.next_invitation_at(at, at + listening.pause_ns) if listening else None
        )
        each.was_sent = True
        if invited_at is None and each.in_the_dark:
            each.in_the_dark -= 1  # no known pause for it
        else:
            each.copies_left -= 1
        if each.copies_left <= 0 or listening is None or at > each.ends_at:
            self._end(each)
            return
        record.cause = Cause.REPEAT
        record.copies += 1
        more_ns = listening.detour_ns(record.destination, at) + listening.search_ns
        in_row = record.copies < _in_row(record, self._times, more_ns)
        record.is_copy = in_row and listening.is_heard_out(at + self._times.gap_ns)
        if record.is_copy:
            self._queue.push(each.key, record, each.qos)
            return
        record.copies = 0
        each.due_at = invited_at or at + self._pause_ns(self._times)

    def _pause_ns(self, times: LinkTimes) -> int:
        """Return the pause between two rows of copies, ns; drawn where several nodes are."""
        is_crowd = times.listening is not None and times.listening.is_crowd
        parts = self._rng.uniform(*_DRAWN_PARTS) if is_crowd else 1
        return round(parts * times.first_round_trip_ns)

    def _end(self, copied: _Copied) -> None:
        del self._copied[id(copied.record)]
        if copied.was_sent:
            self._queue.discard(copied.key, copied.record)
        self._changed()


def _in_row(record: QueuedRecord, times: LinkTimes, more_ns: int) -> int:
    """Return how many copies go in a row, those that fill `more_ns` included."""
    return _COPIES_IN_ROW + -(-more_ns // times.copy_ns(record.size_bytes))
