"""The exchanges that a server has taken: bounded, closed by later ones, kept across restarts."""

import random
from collections.abc import Callable
from typing import Any

import pytest

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.base.sizes import SIZES
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.peers.peers import Peers
from zacoustic.core.schedule.pacers import Pacers
from zacoustic.core.schedule.queue import TransmitQueue
from zacoustic.core.streams.specs import ServiceSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.exchanges.journal import ExchangeJournal
from zacoustic.core.transport.exchanges.repeating import Repeater
from zacoustic.core.transport.exchanges.taken import NEVER, TakenExchange, TakenExchanges
from zacoustic.core.wire.calls import CallKey
from zacoustic.core.wire.exchanges import ExchangeKey
from zacoustic.core.wire.goals import GoalKey

WINDOW = SIZES.calls.window

Taken = TakenExchange[Any]


class Server:
    """A table of calls with its journal; its streams are 20, which has one, and 21."""

    def __init__(self, most: int | None = None) -> None:
        self.streams = StreamTable(
            [
                ServiceSpec(stream_id=20, name="kept", server=2, timeout_s=10, journal=True),
                ServiceSpec(stream_id=21, name="not", server=2, timeout_s=10, journal=False),
            ]
        )
        self.journal = JournalPort()
        self.timers = Timers()
        self.table = self.new_table(most)
        self.entries: dict[str, bytes] = {}

    def new_table(self, most: int | None = None) -> TakenExchanges[Taken]:
        """Return a table that knows nothing yet, as after a restart."""
        journal = ExchangeJournal("call", self.streams, self.journal)
        peers = Peers()
        queue, pacers, rng = TransmitQueue(), Pacers(peers), random.Random(1)
        repeater = Repeater(queue, peers, pacers, self.timers, rng)
        return TakenExchanges(journal, self.timers, repeater, Due.SERVED_CALL, SIZES.calls, most)

    def take(self, key: ExchangeKey, now: int = 0) -> Taken | None:
        """Take an exchange that is forgotten at 100."""
        taken = Taken(key)
        return taken if self.table.take(taken, 100, now) else None

    def commit(self) -> None:
        """Commit what was written to the journal."""
        while (write := self.journal.poll()) is not None:
            if write.value is None:
                self.entries.pop(write.key, None)
            else:
                self.entries[write.key] = write.value
            self.journal.committed(write.write_id, 7)


def key(number: int = 0, *, client: int = 1, epoch: int = 1, stream_id: int = 20) -> CallKey:
    return CallKey(client=client, epoch=epoch, stream_id=stream_id, number=number)


def known(table: TakenExchanges[Taken], client: int = 1) -> list[ExchangeKey]:
    return [each.key for each in table.of(client)]


def test_it_is_known_until_an_instant_or_as_long_as_it_runs() -> None:
    server = Server()
    first, second = server.take(key()), server.take(key(1))
    assert first is not None
    assert second is not None
    server.table.forget_at(second, None)
    server.timers.fire(99)
    assert server.table.get(key()) is first
    server.timers.fire(100)
    assert server.table.get(key()) is None
    assert known(server.table) == [key(1)]


def test_a_goal_is_no_call_with_the_same_numbers() -> None:
    server = Server()
    assert server.take(key()) is not None
    assert server.table.get(GoalKey(1, 1, 20, 0)) is None
    assert str(GoalKey(1, 1, 20, 0)) == str(key()) == "1/1/20/0"


def test_request_closes_what_is_a_window_behind_it() -> None:
    server = Server()
    others = [key(30, client=2), key(30, stream_id=21), key(30, epoch=2)]
    for each in [*map(key, range(50 - WINDOW, 50)), *others]:
        assert server.take(each) is not None
    assert server.take(key(52)) is not None
    gone = {key(number) for number in range(50 - WINDOW, 52 - WINDOW + 1)}
    left = {*map(key, range(50 - WINDOW, 50)), key(52), *others[1:]} - gone
    assert set(known(server.table)) == left
    assert known(server.table, 2) == others[:1]


def test_one_client_holds_a_bounded_number_whatever_epochs_it_claims() -> None:
    server = Server()
    taken = [server.take(key(epoch % 64, epoch=epoch)) for epoch in range(5000)]
    assert sum(each is not None for each in taken) == 2 * SIZES.calls.count
    assert server.take(key(stream_id=21)) is not None
    assert server.take(key(client=2)) is not None


def test_all_clients_together_hold_a_bounded_number() -> None:
    server = Server(most=3)
    taken = [server.take(key(client=client)) for client in range(1, 6)]
    assert [each is not None for each in taken] == [True] * 3 + [False] * 2
    first = taken[0]
    assert first is not None
    server.table.forget(first, 0)
    assert server.take(key(client=5)) is not None


def test_it_continues_when_the_journal_has_it_and_at_once_without_one() -> None:
    server = Server()
    then: list[int] = []
    for stream_id, expected in ((21, [3]), (20, [3])):
        taken = server.take(key(stream_id=stream_id))
        assert taken is not None
        server.table.keep(taken, (b"state",), then.append, 3)
        assert then == expected
        assert taken.is_journalled is (stream_id == 21)
    server.commit()
    assert then == [3, 7]
    assert [*server.entries] == ["call/1/1/20/0"]


def forgotten(server: Server, taken: Taken) -> None:
    server.table.forget(taken, 0)


def given_another_state(server: Server, taken: Taken) -> None:
    server.table.keep(taken, (b"later",), lambda at: None, 0)


@pytest.mark.parametrize("meanwhile", [forgotten, given_another_state])
def test_it_does_not_continue_with_a_state_that_is_over(
    meanwhile: Callable[[Server, Taken], None],
) -> None:
    server = Server()
    taken = server.take(key())
    assert taken is not None
    then: list[int] = []
    server.table.keep(taken, (b"state",), then.append, 0)
    meanwhile(server, taken)
    server.commit()
    assert then == []
    assert bool(server.entries) is (server.table.get(key()) is taken)


def test_what_is_recovered_has_no_times_before_they_are_set() -> None:
    server = Server()
    taken = server.take(key())
    assert taken is not None
    server.table.keep(taken, (b"state", 5), lambda at: None, 0)
    server.commit()
    states: list[list[Any]] = []

    def restore(parts: list[int], state: list[Any]) -> Taken:
        states.append(state)
        return Taken(CallKey(*parts))

    table = server.new_table()
    table.recover(server.entries | {"calls/1": b"", "goal/taken/1/1/20/0": b""}, restore)
    (recovered,) = table.recovered()
    assert (recovered.key, recovered.deadline_at, states) == (key(), NEVER, [[b"state", 5]])
    assert recovered.is_journalled
    table.forget_at(recovered, 100)
    assert table.recovered() == []


def test_entries_of_changed_streams_are_deleted() -> None:
    server = Server()
    taken = server.take(key())
    assert taken is not None
    server.table.keep(taken, (), lambda at: None, 0)
    server.commit()
    other = ServiceSpec(stream_id=20, name="other", server=2, timeout_s=10, journal=True)
    server.streams = StreamTable([other])
    table = server.new_table()
    table.recover(server.entries, lambda parts, state: Taken(CallKey(*parts)))
    assert known(table) == []
    server.commit()
    assert server.entries == {}
