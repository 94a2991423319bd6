import pytest

from zacoustic.channel.agenda import Agenda


def test_late_agenda_does_each_action_at_its_own_instant_in_order_of_request() -> None:
    agenda, seen = Agenda(), list[tuple[str, int]]()

    def note(what: str) -> None:
        seen.append((what, agenda.now))
        if what == "first":
            agenda.push(agenda.now + 5, note, "caused")

    agenda.push(20, note, "second")
    agenda.push(10, note, "first")
    agenda.push(20, note, "third")
    agenda.push(101, note, "not yet")
    agenda.run(100)
    assert seen == [("first", 10), ("caused", 15), ("second", 20), ("third", 20)]
    assert (agenda.now, agenda.next_at(), len(agenda)) == (100, 101, 1)


def test_what_is_cancelled_or_cleared_does_not_happen_and_leaves_nothing() -> None:
    agenda, seen = Agenda(), list[int]()
    kept = [agenda.push(number, seen.append, number) for number in range(1000)]
    for entry in kept[:-1]:
        agenda.cancel(entry)
        agenda.cancel(entry)
    assert (len(agenda), agenda.next_at()) == (1, 999)
    agenda.run()
    assert seen == [999]
    for entry in kept:
        agenda.cancel(entry)
    forgotten = agenda.push(2000, seen.append, 2000)
    agenda.clear()
    agenda.cancel(forgotten)
    assert (len(agenda), agenda.next_at()) == (0, None)
    agenda.push(3000, seen.append, 3000)
    agenda.run()
    assert seen == [999, 3000]


def test_period_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="period_s is 0"):
        Agenda().every(0.0, lambda: None)
