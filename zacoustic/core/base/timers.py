"""The timers of one engine: one heap, and a fixed order among timers that are due together.

A component arms a timer under a key, and arms it again or cancels it when its state changes. The
engine's time-out is the earliest instant in the heap. Timers that are due at one call fire in the
order of `Due`, and within one purpose in the order of arming. So the engine stays a function of its
inputs when several timers fall on one instant, or are late together.

Some instants depend on much that changes often, such as the pauses of all repetitions to all nodes.
Their components only report that something has `changed`; the instant is computed once, when it is
next needed.

The instant of the next *frame* is no timer: `zacoustic.core.schedule.gate` computes it.
"""

import enum
from collections.abc import Callable, Hashable, Iterator, Set
from heapq import heapify, heappop, heappush
from typing import Final

_WORTH_A_SWEEP: Final = 64
"""The heap may hold this many stale entries, plus as many as timers are armed."""


class Due(enum.IntEnum):
    """The purpose of a timer: the first part of its key. Timers due together fire in this order."""

    SILENCE = enum.auto()
    """A commanded silence ends."""
    CALL = enum.auto()
    """An own call times out."""
    SERVED_CALL = enum.auto()
    """A served call is forgotten."""
    GOAL = enum.auto()
    """An own goal is claimed or given up."""
    SERVED_GOAL = enum.auto()
    """A served goal is forgotten."""
    COPY = enum.auto()
    """A best-effort sample is sent again."""
    SENDING = enum.auto()
    """Reliable samples are sent again or expire."""
    SUCCESSOR = enum.auto()
    """A sample that has waited for a large one of its key goes, or expires."""
    RECEIVING = enum.auto()
    """A receiver asks for overdue samples."""
    CARRY = enum.auto()
    """Carried samples are offered to other nodes, or expire."""
    REPETITION = enum.auto()
    """Records are sent again or given up."""
    OBJECT = enum.auto()
    """An outgoing object expires."""
    RELAY = enum.auto()
    """A frame of a route is transmitted again or given up."""
    CUSTODY = enum.auto()
    """A frame of a route has waited for too long."""
    BOND = enum.auto()
    """A frame of a bond has no answer, or a better link is tried again."""
    RANGE = enum.auto()
    """A range was not measured in time."""
    CONTACT = enum.auto()
    """A node counts as lost."""
    LOST_CONTACT = enum.auto()
    """This node has heard nobody for too long, or notes how long."""
    DEADLINE = enum.auto()
    """No sample of a key came in time."""
    DESERT_SERVED_CALL = enum.auto()
    """A served call on the wire of rmw_desert is forgotten."""
    DESERT_CALL = enum.auto()
    """An own call on that wire times out."""
    PACKET = enum.auto()
    """An incomplete packet is given up."""
    CLOCK = enum.auto()
    """The host is asked for the time."""
    SUBSCRIBER = enum.auto()
    """An unproved subscription ends."""
    ANNOUNCEMENT = enum.auto()
    """A node that may lack samples shows its boot epoch again."""
    LATCHED = enum.auto()
    """A node gets the last samples of latched topics again."""
    UNPROVED = enum.auto()
    """The effect of an unproved command ends."""
    TRANSPORT = enum.auto()
    """A third-party transport is called back; its name follows in the key."""


Key = tuple[Due, *tuple[Hashable, ...]]
"""Identifies a timer: its purpose, and which timer of that purpose."""
_Entry = tuple[int, Due, int, Key, Callable[[int], None]]
"""Instant, purpose, count of all armings, key, callback. No two have the same first three."""


class Timers:
    """All timers of one engine."""

    def __init__(self) -> None:
        self._armed: dict[Key, _Entry] = {}
        self._heap: list[_Entry] = []
        """Armed timers, and stale entries of timers that were cancelled or armed again."""
        self._changed: dict[Key, tuple[Callable[[], int | None], Callable[[int], None]]] = {}
        self._armings = 0

    def at(self, key: Key, instant: int, callback: Callable[[int], None]) -> None:
        """Call back once at an instant; this replaces the armed timer of the key.

        Args:
            key: Identifies the timer.
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
        """Cancel a timer; a key that is not armed is no error."""
        self._armed.pop(key, None)

    def changed(
        self, key: Key, find: Callable[[], int | None], callback: Callable[[int], None]
    ) -> None:
        """Compute the instant of a timer again when it is next needed.

        Args:
            key: Identifies the timer.
            find: Returns when to call back, ns; None cancels the timer.
            callback: Takes the instant at which it is called.
        """
        self._changed[key] = find, callback

    def apart(self, owner: str) -> "Timers":
        """Return these timers for a separate owner with keys of its own."""
        return _TimersOf(self, owner)

    def is_armed(self, purposes: Set[Due]) -> bool:
        """Return whether a timer of one of these purposes is armed."""
        return any(True for _ in self.armed(purposes))

    def armed(self, purposes: Set[Due]) -> Iterator[Key]:
        """Yield the keys of the armed timers of these purposes, of all owners."""
        self._find()
        return (key for key in self._armed if key[0] in purposes)

    def next_at(self) -> int | None:
        """Return the earliest instant, ns; None: no timer is armed."""
        self._find()
        heap, armed = self._heap, self._armed
        while heap:
            instant, _, arming, key, _ = heap[0]
            entry = armed.get(key)
            if entry is not None and entry[2] == arming:
                return instant
            heappop(heap)
        return None

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
            armed = self._armed.get(entry[3])
            if armed is not None and armed[2] == entry[2]:
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

    def is_armed(self, purposes: Set[Due]) -> bool:
        return any(self._owner in key for key in self._timers.armed(purposes))

    def next_at(self) -> int | None:
        return self._timers.next_at()

    def fire(self, now: int) -> None:
        self._timers.fire(now)

    def _key(self, key: Key) -> Key:
        return (key[0], self._owner, *key[1:])
