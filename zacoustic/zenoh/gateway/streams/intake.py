"""Local samples of a gateway until the engine can use them.

A link takes a frame a second, programs put a thousand samples in the same time, and all but the
newest are superseded. Those need not be read. So a sample of a topic that may be superseded waits
here while the engine has something else to send, and is read just before the next frame is made
(`Engine.opening`). It does so for `HELD_NS` at most, however long the link is busy: then its
faults are told, and it waits in the engine.

Samples of reliable and latched topics, none of which may be lost, and of priority `real_time` go to
the engine at once. These come by a callback, and so do the keys of a topic with wildcards, whose
newest samples are kept for each key. All others come by a ring (`RingBox`). A topic that has many
samples, and whose link is busy, is looked at every `LOOK_NS`; a topic with few samples wakes the
loop. An idle gateway has no timer.
"""

import asyncio
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Final

import zenoh

from zacoustic.core.base.clock import Clock, ns_to_seconds
from zacoustic.core.base.qos import Priority, Reliability
from zacoustic.core.engine.engine import Engine
from zacoustic.core.schedule.transmitter import Opening
from zacoustic.core.streams.table import Stream
from zacoustic.zenoh.gateway.dialect.dialects import Declared, TopicDialect
from zacoustic.zenoh.gateway.dialect.mailbox import Mailbox, Parcel
from zacoustic.zenoh.gateway.dialect.ringbox import LOOK_NS, RingBox

HELD_NS: Final = 1_000_000_000
"""The longest time for which a sample waits for a frame here, ns."""
_WINDOW_NS: Final = 1_000_000_000
"""Time over which the samples of a topic are counted, ns."""
_MANY: Final = 8
"""So many samples in a window are too many to wake the loop for each."""
_FEW: Final = 2
"""With so many or fewer, each wakes the loop again."""


class _Window:
    """How many samples of one ring were seen lately, and whether its link was busy meanwhile."""

    def __init__(self) -> None:
        self._begun_at = 0
        self._seen = 0
        self._was_busy = False

    def settle(self, box: RingBox, now: int, *, is_busy: bool) -> bool:
        """Return whether to look at the ring from now on, at the end of a window."""
        self._was_busy |= is_busy
        if now - self._begun_at < _WINDOW_NS:
            return box.is_polled
        is_recent = now - self._begun_at < 2 * _WINDOW_NS
        count = box.seen - self._seen if is_recent else 0
        was_busy, self._was_busy = self._was_busy, False
        self._begun_at, self._seen = now, box.seen
        return was_busy and count > (_FEW if box.is_polled else _MANY)


class Intake:
    """The local samples of one gateway; for the loop, unless stated otherwise.

    Args:
        dialects: Local form of each topic, by stream id.
        turn_ns: Returns how long the samples of a stream leave the channel to other gateways, ns.
        clock: Source of instants.
        ring: Wakes the loop, which then calls `due`.
        submit: Runs a step in Zenoh's worker.
    """

    def __init__(
        self,
        dialects: Mapping[int, TopicDialect],
        turn_ns: Callable[[Stream, Engine], int],
        *,
        clock: Clock,
        ring: Callable[[], None],
        submit: Callable[[Callable[[], object]], None],
    ) -> None:
        self._dialects = dialects
        self._turn_ns = turn_ns
        self._clock = clock
        self._ring = ring
        self._submit = submit
        self._rings: dict[int, RingBox] = {}
        self._boxes: dict[int, Mailbox | RingBox] = {}
        for stream_id, dialect in dialects.items():
            depth = dialect.stream.qos.depth
            if _may_wait(dialect) and not dialect.stream.keys.wildcards:
                box = self._rings[stream_id] = RingBox(depth, dialect.is_marked, clock)
                self._boxes[stream_id] = box
            else:
                self._boxes[stream_id] = Mailbox(depth)
        self._may_wait = {each for each, dialect in dialects.items() if _may_wait(dialect)}
        self._windows = {stream_id: _Window() for stream_id in self._rings}
        self._arrived: set[int] = set()
        """Topics of which something has arrived, and was not taken."""
        self._guard = threading.Lock()
        self._polled: set[int] = set()
        self._held: dict[int, int] = {}
        """Topics with samples, and the instants since which they are known, ns."""
        self._woken: set[int] = set()
        """Topics to look at once more: a sample may wake the loop before it is in its ring."""
        self._alarm: asyncio.TimerHandle | None = None

    def subscribe(self, stream_id: int, expression: str) -> Sequence[Declared]:
        """Subscribe to the keys of a topic; in the worker."""
        dialect = self._dialects[stream_id]
        box = self._rings.get(stream_id)
        if box is None:
            return dialect.subscribe(expression, partial(self._post, stream_id))
        box.declare(dialect.zenoh_session, expression, partial(self._note, stream_id))
        return [box]

    def due(self, engine: Engine, now: int) -> Iterator[tuple[Stream, list[Parcel]]]:
        """Take the samples that the engine can use now, by topic, and plan the next look."""
        if self._arrived:
            with self._guard:
                arrived = list(self._arrived)
            for stream_id in arrived:
                self._held.setdefault(stream_id, now)
        openings: dict[str, Opening] = {}
        for stream_id in [*self._held, *(self._polled - self._held.keys())]:
            parcels = self._take(stream_id, openings, engine, now)
            if parcels:
                yield self._dialects[stream_id].stream, parcels
        self._plan()

    def has_waited(self, engine: Engine, now: int) -> bool:
        """Return whether samples wait here for a frame, or may, and a link can take one."""
        if not (self._held or self._polled):
            return False
        links = {engine.link_of(each) for each in self._held.keys() | self._polled}
        return any(engine.opening(link, now) is not Opening.CLOSED for link in links)

    def superseded(self) -> dict[int, int]:
        """Return how many samples newer ones have replaced, by stream; only those with any."""
        counts = {stream_id: box.superseded for stream_id, box in self._boxes.items()}
        return {stream_id: count for stream_id, count in counts.items() if count}

    def oversized(self) -> dict[int, int]:
        """Return how many samples were too large to be read, by stream; only those with any."""
        counts = {stream_id: box.oversized for stream_id, box in self._boxes.items()}
        return {stream_id: count for stream_id, count in counts.items() if count}

    def waiting(self, stream_id: int) -> int:
        """Return how many samples of a topic wait here."""
        box = self._boxes.get(stream_id)
        return 0 if box is None else len(box)

    def close(self) -> None:
        """Look no more."""
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None

    # On Zenoh's threads

    def _post(self, stream_id: int, sample: zenoh.Sample) -> None:
        """Keep a sample."""
        attachment, dialect = sample.attachment, self._dialects[stream_id]
        if attachment is not None and dialect.is_marked(attachment.to_bytes()):
            return  # it came from the channel
        box = self._boxes[stream_id]
        assert isinstance(box, Mailbox)
        box.post(
            Parcel(
                str(sample.key_expr),
                sample.payload.to_bytes(),
                str(sample.encoding),
                sample.kind == zenoh.SampleKind.DELETE,
                self._clock() - dialect.age_ns(sample),
                dialect.publisher_of(sample),
            )
        )
        self._note(stream_id)

    def _note(self, stream_id: int) -> None:
        """Wake the loop, unless it knows of samples of this topic already."""
        if stream_id in self._arrived:
            return
        with self._guard:
            self._arrived.add(stream_id)
        self._ring()

    # On the loop

    def _take(
        self, stream_id: int, openings: dict[str, Opening], engine: Engine, now: int
    ) -> list[Parcel]:
        """Take the samples of a topic, unless they wait here.

        Args:
            stream_id: The topic.
            openings: What is known of the links at this instant; gets what is found out.
            engine: The engine.
            now: The instant.
        """
        stream, box = self._dialects[stream_id].stream, self._boxes[stream_id]
        is_due = True
        if stream_id in self._may_wait:
            link = engine.link_of(stream_id)
            if link not in openings:
                openings[link] = engine.opening(link, now)
                if openings[link] is Opening.CLOSED:
                    engine.handle_waiting(link, now)
            opening = openings[link]
            # If the one before waits, the link is free of it: it lingers, or is thinned out.
            is_due = opening is Opening.DUE or (
                opening is Opening.FREE and not engine.pending(stream_id)
            )
            is_due |= now - self._held.get(stream_id, now) >= HELD_NS
            if is_due:
                self._forget(stream_id)
            if isinstance(box, RingBox):
                box.look(now)
                if is_due:
                    self._woken.add(stream_id)
                self._settle(stream_id, box, now, is_busy=opening is Opening.CLOSED)
        else:
            self._forget(stream_id)
        oldest_at = box.oldest_at
        if oldest_at is None:
            return []
        if is_due and oldest_at + self._turn_ns(stream, engine) <= now:
            return box.take()
        self._held.setdefault(stream_id, now)
        self._arrived.add(stream_id)
        return []

    def _forget(self, stream_id: int) -> None:
        """Let the next sample of a topic wake the loop; what has come is taken after this."""
        self._held.pop(stream_id, None)
        with self._guard:
            self._arrived.discard(stream_id)

    def _settle(self, stream_id: int, box: RingBox, now: int, *, is_busy: bool) -> None:
        """Begin or end to look at a ring, as its samples are many or few."""
        is_polled = self._windows[stream_id].settle(box, now, is_busy=is_busy)
        if is_polled is box.is_polled:
            return
        box.is_polled = is_polled
        if is_polled:
            self._polled.add(stream_id)
            self._submit(box.listen)
        else:
            self._submit(partial(self._listen_again, stream_id, box))

    def _listen_again(self, stream_id: int, box: RingBox) -> None:
        """Let samples wake the loop again, and let it look a last time; in the worker."""
        box.listen()
        self._note(stream_id)

    def _plan(self) -> None:
        """Look again soon if samples wait, or may come without waking the loop."""
        self._polled = {each for each in self._polled if self._rings[each].is_polled}
        if not (self._held or self._polled or self._woken):
            self.close()
        elif self._alarm is None:
            look_s = ns_to_seconds(LOOK_NS)
            self._alarm = asyncio.get_running_loop().call_later(look_s, self._look)

    def _look(self) -> None:
        self._alarm, now = None, self._clock()
        for stream_id in self._woken:
            box = self._rings[stream_id]
            box.look(now)
            if len(box):
                self._held.setdefault(stream_id, now)
        self._woken.clear()
        if self._held or self._polled:
            self._ring()


def _may_wait(dialect: TopicDialect) -> bool:
    """Return whether a newer sample may replace one that the engine does not have yet."""
    qos = dialect.stream.qos
    is_lossless = qos.reliability is not Reliability.BEST_EFFORT or dialect.stream.is_addressed
    return not (is_lossless or dialect.is_latched or qos.priority is Priority.REAL_TIME)
