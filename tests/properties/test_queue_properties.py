"""The queue as a machine: any order of pushes, takes and waiting."""

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import Bundle, RuleBasedStateMachine, consumes, invariant, rule

from zacoustic.core.base.qos import PATIENCE_NS, Priority, Qos
from zacoustic.core.clock import seconds_to_ns
from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.schedule.queue import QueuedRecord, TransmitQueue

LONGEST_PATIENCE_NS = PATIENCE_NS[Priority.BACKGROUND]


class QueueMachine(RuleBasedStateMachine):
    """Compares the queue with what was pushed into it."""

    lanes = Bundle("lanes")

    def __init__(self) -> None:
        super().__init__()
        self.queue = TransmitQueue()
        self.now = 0
        self.serial = 0
        self.qos: dict[tuple[int, int], Qos] = {}
        self.waiting: dict[tuple[int, int], list[QueuedRecord]] = {}
        self.since: dict[tuple[int, int], int] = {}
        """Since when each waits, whatever has displaced what."""
        self.taken_at: dict[tuple[int, int], int] = {}
        self.pushed = 0
        self.gone = 0

    @rule(
        target=lanes,
        stream_id=st.integers(1, 5),
        instance=st.integers(0, 2),
        priority=st.sampled_from(Priority),
        depth=st.integers(1, 4),
        lifespan_s=st.sampled_from([None, 1.0, 30.0]),
        min_interval_s=st.sampled_from([0.0, 0.0, 5.0]),
        linger_s=st.sampled_from([0.0, 3.0]),
    )
    def declare(
        self,
        stream_id: int,
        instance: int,
        priority: Priority,
        depth: int,
        lifespan_s: float | None,
        min_interval_s: float,
        linger_s: float,
    ) -> tuple[int, int]:
        qos = Qos(
            priority=priority,
            depth=depth,
            lifespan_s=lifespan_s,
            min_interval_s=min_interval_s,
            linger_s=linger_s,
        )
        self.qos.setdefault((stream_id, instance), qos)
        return stream_id, instance

    @rule(key=lanes)
    def push(self, key: tuple[int, int]) -> None:
        qos = self.qos[key]
        self.serial += 1
        life_s = qos.lifespan_s
        item = QueuedRecord(
            stream_id=key[0],
            destination=BROADCAST,
            payload=self.serial.to_bytes(4, "big"),
            queued_at=self.now,
            expires_at=None if life_s is None else self.now + seconds_to_ns(life_s),
        )
        self.queue.push(key, item, qos)
        kept = self.waiting.setdefault(key, [])
        if not kept:
            self.since[key] = self.now
        kept.append(item)
        self.pushed += 1
        if len(kept) > qos.depth:
            kept.pop(0)
            self.gone += 1

    @rule(duration_s=st.sampled_from([0.0, 0.1, 2.0, 20.0, 400.0]))
    def wait(self, duration_s: float) -> None:
        self.now += seconds_to_ns(duration_s)

    @rule(most=st.integers(1, 6), skip=st.integers(0, 2))
    def take(self, most: int, skip: int) -> None:
        self._expire()
        ranks: list[int] = []
        for lane, item in self.queue.candidates(self.now):
            key = (lane.key[0], lane.key[1])
            assert item.expires_at is None or item.expires_at > self.now
            assert self.waiting[key][0] is item, "not the oldest of its key"
            last_at = self.taken_at.get(key)
            interval_ns = seconds_to_ns(self.qos[key].min_interval_s)
            assert last_at is None or self.now - last_at >= interval_ns
            ranks.append(self._rank(key))
            if skip:
                skip -= 1
                continue
            assert self.queue.take(lane, self.now) is item
            self.waiting[key].pop(0)
            self.taken_at[key] = self.now
            if self.waiting[key]:
                self.since[key] = self.waiting[key][0].queued_at
            self.gone += 1
            most -= 1
            if not most:
                break
        assert ranks == sorted(ranks), "a less valuable payload came first"

    @rule(key=consumes(lanes))
    def drop(self, key: tuple[int, int]) -> None:
        self._expire()
        self.queue.drop_lane(key)
        self.gone += len(self.waiting.pop(key, []))

    def _rank(self, key: tuple[int, int]) -> int:
        priority = self.qos[key].priority
        if priority is Priority.REAL_TIME:
            return self.since[key] - 10**18
        return self.since[key] + PATIENCE_NS[priority]

    def _expire(self) -> None:
        """Forget what the queue forgets when it is asked at this instant."""
        self.queue.settle(self.now)
        for kept in self.waiting.values():
            while kept and kept[0].expires_at is not None and kept[0].expires_at <= self.now:
                kept.pop(0)
                self.gone += 1

    @invariant()
    def bounds_hold(self) -> None:
        for stream_id in range(1, 6):
            depth = sum(qos.depth for key, qos in self.qos.items() if key[0] == stream_id)
            assert self.queue.pending(stream_id) <= depth

    @invariant()
    def nothing_appears_and_nothing_vanishes(self) -> None:
        self._expire()
        kept = [item for items in self.waiting.values() for item in items]
        assert len(self.queue) == len(kept) == self.pushed - self.gone

    @invariant()
    def due_instant_is_that_of_the_first_reason_to_send(self) -> None:
        due_at = self.queue.due_at(self.now)
        self._expire()
        reasons = [
            max(
                self.since[key] + self.qos[key].linger_ns,
                self.taken_at.get(key, -(10**18)) + seconds_to_ns(self.qos[key].min_interval_s),
            )
            for key, items in self.waiting.items()
            if items
        ]
        if due_at is None:
            assert not reasons
        else:
            assert max(due_at, self.now) == max(min(reasons), self.now)


TestQueueMachine = QueueMachine.TestCase


@pytest.mark.parametrize("priority", list(Priority))
def test_equals_share_the_channel_fairly(priority: Priority) -> None:
    queue = TransmitQueue()
    qos = Qos(priority=priority)
    sent = dict.fromkeys(range(1, 8), 0)
    for instant in range(7000):
        for stream_id in sent:
            item = QueuedRecord(
                stream_id=stream_id, destination=BROADCAST, payload=b"x", queued_at=instant
            )
            if not queue.pending(stream_id):
                queue.push((stream_id,), item, qos)
        lane, first = next(queue.candidates(instant))
        queue.take(lane, instant)
        sent[first.stream_id] += 1
    assert set(sent.values()) == {1000}
