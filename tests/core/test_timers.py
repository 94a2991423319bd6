"""The heap of timers: what is called when, and in which order."""

from collections.abc import Callable
from functools import partial

from hypothesis import given
from hypothesis import strategies as st

from zacoustic.core.base.timers import Due, Key, Timers

CALL = (Due.CALL, 1)
GOAL = (Due.GOAL, 1)
RANGE = (Due.RANGE, 1)


class Called:
    """Timers, and what they have called."""

    def __init__(self) -> None:
        self.timers = Timers()
        self.keys: list[Key] = []

    def at(self, key: Key, instant: int) -> None:
        self.timers.at(key, instant, lambda now: self.keys.append(key))

    def fire(self, now: int) -> list[Key]:
        self.keys.clear()
        self.timers.fire(now)
        return list(self.keys)


def test_nothing_is_armed_at_first() -> None:
    assert Timers().next_at() is None
    assert Called().fire(1 << 62) == []


def test_timer_is_called_once_and_not_before_its_instant() -> None:
    called = Called()
    called.at(CALL, 10)
    assert called.timers.next_at() == 10
    assert called.fire(9) == []
    assert called.fire(10) == [CALL]
    assert called.timers.next_at() is None
    assert called.fire(11) == []


def test_arming_again_replaces_whether_sooner_or_later() -> None:
    called = Called()
    for instant in (20, 5, 30):
        called.at(CALL, instant)
        assert called.timers.next_at() == instant
    assert called.fire(20) == []
    assert called.fire(30) == [CALL]


def test_timer_that_is_cancelled_is_not_called() -> None:
    called = Called()
    called.at(CALL, 10)
    called.at(GOAL, 20)
    called.timers.cancel(CALL)
    called.timers.cancel(RANGE)
    assert called.timers.next_at() == 20
    assert called.fire(20) == [GOAL]


def test_what_is_due_together_is_called_in_the_order_of_components_then_of_arming() -> None:
    called = Called()
    late, soon = (Due.CALL, 2), (Due.CALL, 3)
    called.at(RANGE, 1)
    called.at(late, 9)
    called.at(soon, 2)
    called.at(GOAL, 5)
    assert called.fire(9) == [late, soon, GOAL, RANGE]


def test_component_to_come_is_called_as_well_and_an_earlier_one_at_the_next_call() -> None:
    called = Called()

    def goal(now: int) -> None:
        called.keys.append(GOAL)
        for key in (RANGE, CALL, (Due.GOAL, 2), GOAL):
            called.at(key, now)

    called.timers.at(GOAL, 5, goal)
    assert called.fire(7) == [GOAL, RANGE]
    assert called.timers.next_at() == 7
    assert called.fire(7) == [CALL, (Due.GOAL, 2), GOAL]


def test_timer_that_is_cancelled_by_one_that_is_due_with_it_is_not_called() -> None:
    called = Called()
    called.timers.at(CALL, 5, lambda now: called.timers.cancel(RANGE))
    called.at(RANGE, 5)
    assert called.fire(5) == []
    assert called.timers.next_at() is None


def test_instant_of_what_has_changed_is_found_once_when_it_is_needed() -> None:
    timers, found = Timers(), list[int]()

    def find() -> int:
        found.append(1)
        return 40

    for _ in range(3):
        timers.changed(CALL, find, lambda now: None)
    assert not found
    assert (timers.next_at(), timers.next_at(), len(found)) == (40, 40, 1)
    timers.changed(CALL, lambda: None, lambda now: None)
    assert timers.next_at() is None


def test_timer_that_is_put_off_for_ever_takes_no_memory() -> None:
    called = Called()
    called.at(GOAL, 1 << 60)
    for now in range(10_000):
        called.at(CALL, now + 1000)
        assert called.timers.next_at() == now + 1000
    assert len(called.timers._heap) < 200  # what is over is swept out


KEYS = st.builds(lambda whose, which: (whose, which), st.sampled_from(Due), st.integers(0, 2))
INSTANTS = st.integers(0, 30)
DEED = st.tuples(st.sampled_from(("at", "cancel", "changed")), KEYS, INSTANTS)
STEPS = st.lists(st.one_of(DEED, st.integers(0, 5)), max_size=40)
CHAINS = st.dictionaries(KEYS, st.lists(DEED, max_size=3), max_size=6)


class Naive:
    """The same without a heap: looks through all that is armed each time."""

    def __init__(self) -> None:
        self.armed: dict[Key, tuple[int, int, Callable[[int], None]]] = {}
        self.wanted: dict[Key, tuple[Callable[[], int | None], Callable[[int], None]]] = {}
        self.armings = 0
        self.whose: int | None = None
        self.late: set[Key] = set()

    def at(self, key: Key, instant: int, callback: Callable[[int], None]) -> None:
        self.armings += 1
        self.armed[key] = instant, self.armings, callback
        self.late.discard(key)
        if self.whose is not None and key[0] <= self.whose:
            self.late.add(key)

    def cancel(self, key: Key) -> None:
        self.armed.pop(key, None)

    def changed(
        self, key: Key, find: Callable[[], int | None], callback: Callable[[int], None]
    ) -> None:
        self.wanted[key] = find, callback

    def next_at(self) -> int | None:
        while self.wanted:
            key, (find, callback) = self.wanted.popitem()
            instant = find()
            if instant is None:
                self.cancel(key)
            elif key not in self.armed or self.armed[key][0] != instant:
                self.at(key, instant, callback)
        return min((instant for instant, _, _ in self.armed.values()), default=None)

    def fire(self, now: int) -> None:
        self.next_at()
        while due := [
            key for key, each in self.armed.items() if each[0] <= now and key not in self.late
        ]:
            key = min(due, key=lambda each: (each[0], self.armed[each][1]))
            self.whose = key[0]
            self.armed.pop(key)[2](now)
            self.next_at()
        self.whose = None
        self.late.clear()


class Script:
    """Does the same steps with either of them; what is called does more, twice at most."""

    def __init__(
        self, timers: Timers | Naive, chains: dict[Key, list[tuple[str, Key, int]]]
    ) -> None:
        self.timers = timers
        self.chains = {key: [*deeds] * 2 for key, deeds in chains.items()}
        self.told: list[object] = []

    def called(self, key: Key, now: int) -> None:
        self.told.append((key, now))
        if deeds := self.chains.get(key):
            self.do(*deeds.pop())

    def do(self, deed: str, key: Key, instant: int) -> None:
        callback = partial(self.called, key)
        match deed:
            case "at":
                self.timers.at(key, instant, callback)
            case "cancel":
                self.timers.cancel(key)
            case _:
                found = instant if instant % 3 else None
                self.timers.changed(key, lambda: found, callback)

    def run(self, steps: list[tuple[str, Key, int] | int]) -> list[object]:
        now = 0
        for step in steps:
            if isinstance(step, int):
                now += step
                self.timers.fire(now)
                self.told.append("fired")
            else:
                self.do(*step)
            self.told.append(self.timers.next_at())
        return self.told


@given(STEPS, CHAINS)
def test_timers_do_what_looking_through_all_of_them_does(
    steps: list[tuple[str, Key, int] | int], chains: dict[Key, list[tuple[str, Key, int]]]
) -> None:
    assert Script(Timers(), chains).run(steps) == Script(Naive(), chains).run(steps)
