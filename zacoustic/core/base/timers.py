"""The timers of one engine: one heap, and a fixed order among timers that are due together.

A component arms a timer under a key, and arms it again or cancels it when its state changes. The
engine's time-out is the earliest instant in the heap. Timers that are due at one call fire in the
order of `Due`, and within one component in the order of arming. So the engine stays a function of
its inputs when several timers fall on one instant, or are late together.

Some instants follow from much that changes often, such as the pauses of all repetitions to all
nodes. Their components only say that something has `changed`; the instant is found once, when it is
needed next.

The instant of the next *frame* is no timer: `zacoustic.core.schedule.transmitter` computes it.
"""

import enum
from collections.abc import Callable, Hashable
from heapq import heapify, heappop, heappush
from typing import Final

_WORTH_A_SWEEP: Final = 64
"""The heap may hold this many stale entries, and as many again as timers are armed."""


class Due(enum.IntEnum):
    """What a timer is for: the first part of its key. Timers due together fire in this order."""

    SILENCE = enum.auto()
    """An order to be silent ends."""
    CALL = enum.auto()
    """An own call gets no answer."""
    SERVED_CALL = enum.auto()
    """A call that was served is forgotten."""
    GOAL = enum.auto()
    """An own goal is asked after, or given up."""
    SERVED_GOAL = enum.auto()
    """A goal that was served is forgotten."""
    COPY = enum.auto()
    """A best-effort sample goes again."""
    SENDING = enum.auto()
    """Reliable samples go again, or are too old."""
    RECEIVING = enum.auto()
    """Samples that have not come are asked for."""
    REPETITION = enum.auto()
    """Records go again, or no more."""
    OBJECT = enum.auto()
    """An own object is too old."""
    RANGE = enum.auto()
    """A range was not measured in time."""
    CONTACT = enum.auto()
    """A node counts as lost."""
    DEADLINE = enum.auto()
    """No sample of a key came in time."""
    DESERT_SERVED_CALL = enum.auto()
    """A call that was served on the wire of rmw_desert is forgotten."""
    DESERT_CALL = enum.auto()
    """An own call there gets no answer."""
    PACKET = enum.auto()
    """Part of a packet is given up."""
    CLOCK = enum.auto()
    """The host is asked for the time."""
    SUBSCRIBER = enum.auto()
    """A subscription that nobody has proved ends."""
    UNPROVED = enum.auto()
    """What nobody has proved to have commanded ends."""
    TRANSPORT = enum.auto()
    """A transport of somebody else is called back; its name follows in the key."""


Key = tuple[Due, *tuple[Hashable, ...]]
"""Names a timer: what it is for, and which of those it is."""
_Entry = tuple[int, Due, int, Key, Callable[[int], None]]
"""Instant, purpose, count of all armings, key, callback. No two have the same first three."""


class Timers:
    """All timers of one engine."""

    def __init__(self) -> None:
        self._armed: dict[Key, _Entry] = {}
        self._heap: list[_Entry] = []
        """Armed timers, and stale entries of those that were cancelled or armed again."""
        self._changed: dict[Key, tuple[Callable[[], int | None], Callable[[int], None]]] = {}
        self._armings = 0

    def at(self, key: Key, instant: int, callback: Callable[[int], None]) -> None:
        """Call back once, at an instant, ns; replaces the armed timer of this key.

        Args:
            key: Names the timer.
            instant: When, ns; an instant in the past is due at once.
            callback: Takes the instant at which it is called.
        """
        self._armings += 1
        entry = self._armed[key] = (instant, key[0], self._armings, key, callback)
        if len(self._heap) > 2 * len(self._armed) + _WORTH_A_SWEEP:
            self._heap = list(self._armed.values())
            heapify(self._heap)
        else:
            heappush(self._heap, entry)

    def cancel(self, key: Key) -> None:
        """Do not call back; a key that is not armed is no error."""
        self._armed.pop(key, None)

    def changed(
        self, key: Key, find: Callable[[], int | None], callback: Callable[[int], None]
    ) -> None:
        """Find the instant of a timer again, when it is needed next.

        Args:
            key: Names the timer.
            find: Returns when to call back, ns; None cancels the timer.
            callback: Takes the instant at which it is called.
        """
        self._changed[key] = find, callback

    def apart(self, owner: str) -> "Timers":
        """Return these timers for another owner, whose keys are no one else's."""
        return _TimersOf(self, owner)

    def next_at(self) -> int | None:
        """Return the earliest instant, ns, or None: nothing is armed."""
        self._find()
        heap, armed = self._heap, self._armed
        while heap and armed.get(heap[0][3]) is not heap[0]:
            heappop(heap)
        return heap[0][0] if heap else None

    def fire(self, now: int) -> None:
        """Fire the timers that are due, each once.

        A timer that a callback arms for an instant in the past fires in this call if its purpose
        comes later in the order; otherwise in the next call.
        """
        due: list[tuple[Due, int, _Entry]] = []
        later: list[_Entry] = []
        whose = 0
        while True:
            self._find()
            while self._heap and self._heap[0][0] <= now:
                entry = heappop(self._heap)
                if entry[1] > whose:
                    heappush(due, (entry[1], entry[2], entry))
                else:
                    later.append(entry)
            if not due:
                break
            whose, _, entry = heappop(due)
            if self._armed.get(entry[3]) is entry:
                del self._armed[entry[3]]
                entry[4](now)
        for entry in later:
            heappush(self._heap, entry)

    def _find(self) -> None:
        while self._changed:
            key, (find, callback) = self._changed.popitem()
            instant = find()
            armed = self._armed.get(key)
            if instant is None:
                self.cancel(key)
            elif armed is None or armed[0] != instant:
                self.at(key, instant, callback)


class _TimersOf(Timers):
    """The timers of one owner, in the heap of all."""

    def __init__(self, timers: Timers, owner: str) -> None:
        super().__init__()
        self._timers = timers
        self._owner = owner

    def at(self, key: Key, instant: int, callback: Callable[[int], None]) -> None:
        self._timers.at(self._key(key), instant, callback)

    def cancel(self, key: Key) -> None:
        self._timers.cancel(self._key(key))

    def changed(
        self, key: Key, find: Callable[[], int | None], callback: Callable[[int], None]
    ) -> None:
        self._timers.changed(self._key(key), find, callback)

    def next_at(self) -> int | None:
        return self._timers.next_at()

    def fire(self, now: int) -> None:
        self._timers.fire(now)

    def _key(self, key: Key) -> Key:
        return (key[0], self._owner, *key[1:])
