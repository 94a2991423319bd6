"""Best-effort samples that press go several times where somebody is in a run.

Nobody acknowledges a best-effort sample, so nobody repeats it, and most of those for a node that
sends an object would meet its run. One of priority `real_time` that is published while a run is
heard goes eight times, four copies in each of two pauses
(`zacoustic.core.schedule.access.listening`): at 40 % loss one of a thousand is lost. It is numbered
for that, by SYNC, so that it is handed on once; what is published while nobody is in a run goes
once, without a number.

A newer sample of its key ends the copies of one that was sent; so does half a minute: a subscriber
that restarts knows no numbers, and would take an old one for new.
"""

from collections import deque
from collections.abc import Iterable
from typing import Final

from zacoustic.core.base.clock import NS_PER_S
from zacoustic.core.base.linktypes import TransmitReport
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.base.stats import Cause
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.schedule.queue import LaneKey, TransmitQueue, Waiting
from zacoustic.core.schedule.timing import LinkTimes
from zacoustic.core.streams.keys import Instance
from zacoustic.core.wire.frame import SYNC_BYTES, Sync

_COPIES_IN_ROW: Final = 4
_ROWS: Final = 2
_MOST_IN_THE_DARK: Final = 6
"""So many copies more go where a run is heard and its pauses are not known."""
_MOST_KEYS: Final = 1024
"""Of so many keys the numbers are known that came last."""
_MOST_NUMBERS: Final = 8
COPIED_NS: Final = 30 * NS_PER_S
"""So long after its publication a sample that was sent goes again, at most, ns."""


class _Copied:
    """A sample and what is left to send of it."""

    __slots__ = (
        "copies_left", "due_at", "ends_at", "in_the_dark", "key", "qos", "record", "was_sent"
    )  # fmt: skip

    def __init__(self, key: LaneKey, record: Waiting, qos: Qos, copies: int, ends_at: int) -> None:
        self.key = key
        self.record = record
        self.qos = qos
        self.ends_at = ends_at
        self.copies_left = copies
        self.in_the_dark = _MOST_IN_THE_DARK
        self.was_sent = False
        self.due_at: int | None = None
        """When it goes again, ns; None: it waits in the queue, or is on the air."""

    def is_over(self, now: int) -> bool:
        """Tell whether it is too old to go again."""
        return self.record.expires_at is not None and self.record.expires_at <= now

    def sent(self) -> None:
        """It was sent: from now on it does not go for longer than its copies are to."""
        self.was_sent = True
        expires_at = self.record.expires_at
        self.record.expires_at = (
            self.ends_at if expires_at is None else min(expires_at, self.ends_at)
        )


class CopiedSamples:
    """The samples of one node that go several times, and those of others that came so.

    Args:
        queue: Takes the copies.
        handshake: Knows the boot epoch.
        timers: Send what goes again.
    """

    def __init__(self, queue: TransmitQueue, handshake: Handshake, timers: Timers) -> None:
        self._timers = timers
        self._queue = queue
        self._handshake = handshake
        self._times: LinkTimes | None = None
        self._next_number = 0
        self._copied: dict[int, _Copied] = {}
        self._on_air: list[_Copied] = []
        self._came: dict[tuple[int, ...], deque[Sync]] = {}

    # What this node publishes

    def use_link(self, times: LinkTimes) -> None:
        """Take the airtimes of a link; nothing is under way on the one before."""
        self._times = times
        self._copied.clear()
        self._on_air.clear()
        self._changed()

    def publish(self, key: LaneKey, record: Waiting, qos: Qos, now: int) -> None:
        """Queue a best-effort sample, so that it goes as often as it has to."""
        for each in [each for each in self._copied.values() if each.key == key and each.was_sent]:
            self._end(each)
        copies = self._copies(record, qos, now)
        if copies > 1:
            record.sync = Sync(self._handshake.epoch, self._next_number).encode()
            self._next_number += 1
            record.dense_value = None
            self._copied[id(record)] = _Copied(key, record, qos, copies, now + COPIED_NS)
        self._queue.push(key, record, qos)
        for each in [each for each in self._copied.values() if each.key == key]:
            if not self._queue.holds(key, each.record) and each not in self._on_air:
                self._end(each)  # pushed out
        self._changed()

    def drop_stream(self, stream_id: int) -> None:
        """Send nothing more of a stream: nobody wants it, or others than before."""
        for each in [each for each in self._copied.values() if each.key[0] == stream_id]:
            self._end(each)

    def transmitted(self, records: Iterable[Waiting]) -> None:
        """Note which samples are in the transmission that begins."""
        self._on_air = [self._copied[id(each)] for each in records if id(each) in self._copied]

    def handle_report(self, report: TransmitReport) -> None:
        """A transmission has ended: its samples go again, now or in another pause."""
        on_air, self._on_air = self._on_air, []
        for each in on_air:
            if id(each.record) not in self._copied or self._times is None:
                continue
            record, listening = each.record, self._times.listening
            at = report.finished_at
            invited_at = (
                listening.next_invitation_at(at, at + listening.pause_ns) if listening else None
            )
            each.sent()
            if invited_at is None and each.in_the_dark:
                each.in_the_dark -= 1  # nobody pauses for it, as far as is known
            else:
                each.copies_left -= 1
            if each.copies_left <= 0 or listening is None or at > each.ends_at:
                self._end(each)
                continue
            record.cause = Cause.REPEAT
            record.copies += 1
            detour_ns = listening.detour_ns(record.destination, at)
            in_row = record.copies < _in_row(record, self._times, detour_ns)
            record.is_copy = in_row and listening.is_heard_out(at + self._times.gap_ns)
            if record.is_copy:
                self._queue.push(each.key, record, each.qos)
                continue
            record.copies = 0
            each.due_at = invited_at or at + self._times.first_round_trip_ns
        self._changed()

    # What others publish

    def is_repeated(self, source: int, stream_id: int, instance: Instance, sync: Sync) -> bool:
        """Take the number of a sample that goes several times; True when it came before."""
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
        """Return the earliest instant at which something goes again, ns, or None."""
        due = (each.due_at for each in self._copied.values() if each.due_at is not None)
        return min(due, default=None)

    def _go_on(self, now: int) -> None:
        """Queue what is due, and forget what is too old."""
        for each in list(self._copied.values()):
            if each.due_at is None or each.due_at > now:
                continue
            if each.is_over(now):
                self._end(each)
            else:
                each.due_at = None
                self._queue.push(each.key, each.record, each.qos)
        self._changed()

    def _copies(self, record: Waiting, qos: Qos, now: int) -> int:
        """How often a sample goes."""
        if qos.priority is not Priority.REAL_TIME or self._times is None:
            return 1
        listening, largest_bytes = self._times.listening, self._queue.largest_bytes
        size_bytes = record.size_bytes + SYNC_BYTES
        if listening is None or not listening.hears_run(now):
            return 1
        if largest_bytes is not None and size_bytes > largest_bytes:
            return 1
        detour_ns = listening.detour_ns(record.destination, now)
        return _ROWS * _in_row(record, self._times, detour_ns)

    def _end(self, copied: _Copied) -> None:
        del self._copied[id(copied.record)]
        if copied.was_sent:
            self._queue.discard(copied.key, copied.record)
        self._changed()


def _in_row(record: Waiting, times: LinkTimes, detour_ns: int) -> int:
    """How many copies go in a row, of which some are heard by who is not in the run, too."""
    copy_ns = times.copy_ns(record.size_bytes)
    return _COPIES_IN_ROW + -(-detour_ns // copy_ns)
