"""Reliable samples in the model: repetitions and requests for missing ones.

The lane learns which of its frames have arrived, and queues the next item at a node. So the cost of
losses, and the benefit of items in frames that are sent anyway, follow by themselves. The engine's
own pure parts (`Pacer`, `SendRhythm`, `Watch`) decide when something is repeated, and what a
regular period saves.
"""

import random
from typing import Final

from zacoustic.app.tools.design.plan.clockwork import Clockwork, head_bytes_of
from zacoustic.app.tools.design.plan.items import Item
from zacoustic.app.tools.design.plan.offers import Offer, Saying
from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.linktypes import BROADCAST
from zacoustic.core.base.qos import Priority, Qos
from zacoustic.core.schedule.timing import LinkTimes, Pacer, ack_slots
from zacoustic.core.transport.reliable.receiving.watch import Watch
from zacoustic.core.transport.reliable.rhythm import SendRhythm
from zacoustic.core.wire.frame import SYNC_BYTES
from zacoustic.core.wire.numbers import NUMBER_BYTES

_ACK_BYTES: Final = 3
_HELD_BYTES: Final = 1
_URGENT_COPIES: Final = 4
_TIMES_IN_SYNC: Final = 2
_WINDOW: Final = 64
_ACK_QOS: Final = Qos(priority=Priority.INTERACTIVE_HIGH)


class Sample:
    """A reliable sample under way."""

    __slots__ = (
        "asked", "began_at", "due_at", "expires_at", "frame_ns", "lacking", "marked", "number",
        "payload_bytes", "sent_at", "tries",
    )  # fmt: skip

    def __init__(self, number: int, payload_bytes: int, lacking: set[int], began_at: int) -> None:
        self.number = number
        self.payload_bytes = payload_bytes
        self.lacking = lacking
        self.began_at = began_at
        self.expires_at: int | None = None
        self.tries = 0
        self.due_at = 0
        self.sent_at = 0
        self.frame_ns = 0
        self.marked = False
        self.asked = False


class _Reception:
    """The samples that one receiver has, and those it has acknowledged."""

    def __init__(self) -> None:
        self.got: set[int] = set()
        self.newest = -1
        self.acknowledgements = 0
        """Number of received acknowledgements."""
        self.watch = Watch()

    @property
    def is_in_sync(self) -> bool:
        return self.acknowledgements >= _TIMES_IN_SYNC


class ReliableLane:
    """The samples of one key of a reliable topic, and the acknowledging receivers.

    Args:
        offer: The publisher and its topic.
        receivers: Addresses of the acknowledging nodes.
        walk: Clock and nodes.
        times: Times of the link.
        rng: Draws pauses.
    """

    def __init__(
        self, offer: Offer, receivers: tuple[int, ...], walk: Clockwork, times: LinkTimes,
        rng: random.Random,
    ) -> None:  # fmt: skip
        self._offer = offer
        self._receptions = {each: _Reception() for each in sorted(receivers)}
        self._walk = walk
        self._times = times
        self._rng = rng
        self._samples: dict[int, Sample] = {}
        self._next = 0
        self._quiet_until = 0
        self._qos = offer.stream.qos
        alone = len(receivers) == 1 and self._qos.priority is not Priority.REAL_TIME
        self._rhythm = SendRhythm(self._qos) if alone else None
        self._destination = receivers[0] if len(receivers) == 1 else BROADCAST
        self._spread_ns = times.ack_spread_ns(len(receivers))

    def publish(self, saying: Saying) -> None:
        """Publish a sample."""
        now = self._walk.now
        sample = Sample(self._next, saying.payload_bytes, set(self._receptions), now)
        if self._qos.lifespan_s is not None:
            sample.expires_at = now + seconds_to_ns(self._qos.lifespan_s)
        self._next += 1
        self._samples[sample.number] = sample
        for number in [each for each in self._samples if each <= sample.number - self._qos.depth]:
            self._forget(number)
        self._send(sample)

    # The publisher

    @property
    def _expected(self) -> int:
        return min(self._samples, default=self._next)

    def _forget(self, number: int) -> None:
        del self._samples[number]
        self._walk.speaker(self._offer.node).take_back(self._key(number))

    def _key(self, number: int) -> tuple[object, ...]:
        return (
            "reliable",
            self._offer.stream.stream_id,
            self._offer.instance,
            self._offer.voice,
            number,
        )

    def _timing(self, node: int) -> Pacer:
        return self._walk.timing(self._offer.node, node)

    def _is_known(self, sample: Sample) -> bool:
        """Tell whether the receiver knows the period, and would ask for a missing sample."""
        return self._rhythm is not None and self._rhythm.is_known(sample.number, self._expected)

    def _send(self, sample: Sample) -> None:
        now, stream = self._walk.now, self._offer.stream
        speaker = self._walk.speaker(self._offer.node)
        if sample.number not in self._samples or speaker.waits(self._key(sample.number)):
            return
        if sample.expires_at is not None and sample.expires_at < now:
            self._forget(sample.number)
            return
        in_sync = all(self._receptions[each].is_in_sync for each in sample.lacking)
        size_bytes = head_bytes_of(self._offer) + NUMBER_BYTES + sample.payload_bytes
        size_bytes += 0 if in_sync else SYNC_BYTES
        item = Item(stream.stream_id, self._destination, size_bytes, now)
        item.voice = self._offer.voice
        item.open_ended = not stream.codec.delimits_itself
        item.wait_ns = self._qos.linger_ns if not sample.tries else 0
        item.begins = lambda at: self._begins(sample, at, in_sync=in_sync)
        item.ends = lambda at: self._sent(sample, at)
        item.heard = lambda node, at: self._heard(node, sample, at, in_sync=in_sync)
        speaker.push(self._key(sample.number), item, Qos(priority=self._qos.priority), depth=1)
        self._walk.serve(self._offer.node)

    def _begins(self, sample: Sample, at: int, *, in_sync: bool) -> None:
        sample.sent_at, sample.marked = at, False
        if self._rhythm is not None:
            if in_sync:
                asked = sample.asked and self._is_known(sample)
                sample.marked = (
                    asked if sample.tries else self._rhythm.marks(sample.number, self._expected, at)
                )
            if not sample.tries:
                self._rhythm.first_sent(sample.number, self._expected, at, self._times)
            if not in_sync or (sample.tries and not sample.marked):
                self._rhythm.end()
        if not sample.tries:
            self._walk.went(self._offer)
        sample.tries += 1
        sample.asked = False

    def _sent(self, sample: Sample, at: int) -> None:
        """Schedule its repetition, in case no answer comes."""
        sample.frame_ns, sample.sent_at = at - sample.sent_at, at
        if self._is_known(sample):
            assert self._rhythm is not None
            later_at = at + self._rhythm.period_ns + 2 * self._times.first_round_trip_ns
            for each in self._samples.values():
                if each.tries and not each.asked:
                    each.due_at = max(each.due_at, later_at)
            self._walk.later(later_at, lambda: self._repeat(sample))
            return
        copies = self._qos.priority is Priority.REAL_TIME and len(self._samples) <= 2
        pause_ns = 0
        if not (copies and sample.tries < _URGENT_COPIES):
            pause_ns = self._pause_ns(sample, at)
        sample.due_at = at + pause_ns
        self._quiet_until = max(self._quiet_until, sample.due_at)
        self._walk.later(sample.due_at, lambda: self._repeat(sample))

    def _pause_ns(self, sample: Sample, at: int) -> int:
        again = sample.tries > 1
        for node in sample.lacking:
            if again:
                self._timing(node).unanswered(at, self._times)
        return min(
            self._timing(each).pause_ns(
                self._times,
                0 if again else len(self._receptions) - 1,
                self._rng,
                self._qos.priority,
                spread_ns=self._spread_ns if again else 0,
            )
            for each in sample.lacking or self._receptions
        )

    def _repeat(self, sample: Sample) -> None:
        now = self._walk.now
        if sample.number not in self._samples:
            return
        # While an answer is awaited nothing else is repeated.
        due_at = sample.due_at
        if not self._is_known(sample):
            due_at = max(due_at, self._quiet_until)
        if now < due_at:
            sample.due_at = due_at
            self._walk.later(due_at, lambda: self._repeat(sample))
            return
        self._send(sample)

    def _answered(self, node: int, told: set[int], now: int) -> None:
        self._receptions[node].acknowledgements += 1
        timing = self._timing(node)
        timing.heard()
        for sample in list(self._samples.values()):
            if sample.number in told:
                if node in sample.lacking:
                    timing.answered(in_crowd=len(self._receptions) > 1)
                    if sample.tries == 1 and not sample.marked:
                        timing.measured(now - sample.sent_at, self._times)
                sample.lacking.discard(node)
                if not sample.lacking:
                    self._forget(sample.number)
        least_ns = (timing.shortest_ns or 0) - self._times.ack_linger_ns
        for sample in list(self._samples.values()):
            is_late = sample.tries and now - sample.sent_at >= least_ns
            if is_late and node in sample.lacking and self._is_known(sample):
                sample.asked = True
                self._send(sample)

    # A receiver

    def _heard(self, node: int, sample: Sample, at: int, *, in_sync: bool) -> None:
        reception = self._receptions.get(node)
        if reception is None:
            return
        is_new = sample.number not in reception.got
        is_newest = sample.number > reception.newest
        answers = True
        if not in_sync:
            reception.watch.forget()
        elif self._rhythm is not None:
            answers = not reception.watch.take(
                sample.number, at=at - sample.frame_ns, frame_ns=sample.frame_ns,
                newest=is_newest, marked=sample.marked, times=self._times,
            )  # fmt: skip
        if is_new:
            reception.got.add(sample.number)
            reception.newest = max(reception.newest, sample.number)
            self._walk.delivered(self._offer, sample.began_at)
        is_first = is_new and in_sync
        wait_ns = self._times.ack_linger_ns
        if not is_first:
            wait_ns += self._rng.randrange(self._spread_ns + 1)
        elif len(self._receptions) > 1:
            rank = list(self._receptions).index(node)
            wait_ns += ack_slots(rank, len(self._receptions)) * self._times.ack_slot_ns
        if is_first and self._rhythm is not None:
            is_whole = all(each in reception.got for each in self._samples if each <= sample.number)
            reception.watch.plan(
                reception.newest, is_whole=is_whole, soon_at=at + wait_ns, times=self._times
            )
            ask_at = reception.watch.ask_at
            if ask_at is not None:
                self._walk.later(ask_at, lambda: self._ask(node, reception))
                if not answers:
                    self._acknowledge(node, at, ask_at - at)
                    return
        self._acknowledge(node, at, wait_ns)

    def _ask(self, node: int, reception: _Reception) -> None:
        """Let the receiver, which misses something, report what it has."""
        now, ask_at = self._walk.now, reception.watch.ask_at
        if ask_at is None or ask_at > now:
            return
        reception.watch.asks(now, self._times)
        if reception.watch.ask_at is not None:
            self._walk.later(reception.watch.ask_at, lambda: self._ask(node, reception))
        self._acknowledge(node, now, 0)

    def _acknowledge(self, node: int, at: int, wait_ns: int) -> None:
        reception = self._receptions[node]
        size_bytes = _ACK_BYTES + len(self._offer.instance)
        if not reception.is_in_sync:
            size_bytes += SYNC_BYTES
        if any(
            number not in reception.got for number in self._samples if number < reception.newest
        ):
            size_bytes += _HELD_BYTES
        item = Item(self._offer.stream.stream_id, self._offer.node, size_bytes, at)
        item.is_control = True
        item.wait_ns = wait_ns
        told: set[int] = set()
        item.begins = lambda _: told.update(reception.got)
        source = self._offer.node
        item.heard = lambda by, now: self._answered(node, told, now) if by == source else None
        key = ("ack", self._offer.voice, self._offer.stream.stream_id, self._offer.instance)
        self._walk.speaker(node).push(key, item, _ACK_QOS, depth=1)
        self._walk.serve(node)
        oldest = self._expected - _WINDOW
        reception.got.difference_update([each for each in reception.got if each < oldest])
