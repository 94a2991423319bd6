"""The exchanges that a server has taken: a request that comes again is not executed again.

The key of an exchange (`zacoustic.core.wire.exchanges`) has the client's boot epoch, so a number of
a former epoch names another exchange. The table is bounded, whoever sends requests. An exchange
leaves it when a later request proves that it has ended at its client, or at an instant from which
no copy of its request can arrive. Until then its answer can be given again. With a journal this
holds across restarts: a request is journalled before it is executed, an answer before it is sent,
and what was being executed when the server died is answered with an unknown outcome.
"""

from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any, Final, Generic, TypeVar

import msgspec

from zacoustic.core.base.sizes import Numbering
from zacoustic.core.base.timers import Due, Timers
from zacoustic.core.transport.exchanges.journal import ExchangeJournal
from zacoustic.core.transport.exchanges.repeating import Repeater, Repetition
from zacoustic.core.wire.exchanges import ExchangeKey

NEVER: Final = 1 << 62
_LIVES: Final = 2

Key = TypeVar("Key", bound=ExchangeKey)
Taken = TypeVar("Taken", bound="TakenExchange[Any]")


class TakenExchange(Generic[Key]):
    """An exchange that this node serves.

    Args:
        key: Identifies the exchange.
    """

    __slots__ = ("deadline_at", "forget_at", "is_journalled", "key", "repetition", "writes")

    def __init__(self, key: Key) -> None:
        self.key = key
        self.deadline_at = NEVER
        """Instant at which the client stops waiting for an answer, ns."""
        self.forget_at: int | None = NEVER
        """Instant at which it is forgotten, ns; None: not before it has ended."""
        self.is_journalled = False
        """Whether the journal has its present state, so that its answer may be sent."""
        self.writes = 0
        """How often its state was given to the journal."""
        self.repetition: Repetition | None = None
        """The transmission of its answer."""


class TakenExchanges(Generic[Taken]):
    """The exchanges of one kind that a node serves: of a client on a stream two epochs' worth.

    Args:
        journal: Their journal.
        timers: Forget them.
        repeater: Repeats their answers.
        due: The purpose of their timers.
        numbering: How their clients number them.
        most: The most of all clients, including those under forged addresses; None: any number.
    """

    def __init__(
        self,
        journal: ExchangeJournal,
        timers: Timers,
        repeater: Repeater,
        due: Due,
        numbering: Numbering,
        most: int | None = None,
    ) -> None:
        self._journal = journal
        self._timers = timers
        self._repeater = repeater
        self._due = due
        self._numbering = numbering
        self._most = most
        self._all: dict[ExchangeKey, Taken] = {}
        self._by_client: dict[int, dict[ExchangeKey, Taken]] = {}

    def get(self, key: ExchangeKey) -> Taken | None:
        """Return a known exchange, or None."""
        return self._all.get(key)

    def of(self, client: int) -> Collection[Taken]:
        """Return the exchanges of a client in all its boot epochs."""
        return [*self._by_client.get(client, {}).values()]

    def take(self, taken: Taken, forget_at: int, now: int) -> bool:
        """Add a new exchange, which closes earlier ones; False: there are too many."""
        key: ExchangeKey = taken.key
        rivals = 0
        for other in self.of(key.client):
            if other.key.stream_id == key.stream_id:
                is_closed = self._numbering.closes(key.number, other.key.number)
                if is_closed and other.key.epoch == key.epoch:
                    self.forget(other, now)
                else:
                    rivals += 1
        if rivals >= _LIVES * self._numbering.count:
            return False
        if self._most is not None and len(self._all) >= self._most:
            return False
        self._add(taken)
        self.forget_at(taken, forget_at)
        return True

    def forget_at(self, taken: Taken, instant: int | None) -> None:
        """Remember an exchange until an instant, ns; None: until another is set."""
        taken.forget_at = instant
        if instant is None:
            self._timers.cancel((self._due, taken.key))
        else:
            self._timers.at((self._due, taken.key), instant, partial(self.forget, taken))

    def forget(self, taken: Taken, now: int) -> None:
        """Forget an exchange and send its answer no more."""
        key: ExchangeKey = taken.key
        if self._all.get(key) is not taken:
            return
        del self._all[key]
        own = self._by_client[key.client]
        del own[key]
        if not own:
            del self._by_client[key.client]
        self._timers.cancel((self._due, key))
        if taken.repetition is not None:
            self._repeater.stop(taken.repetition, now)
        self._journal.write(msgspec.structs.astuple(key), None, None, now)

    def keep(
        self, taken: Taken, state: tuple[object, ...], then: Callable[[int], None], now: int
    ) -> None:
        """Journal the state of an exchange, then continue.

        Args:
            taken: The exchange.
            state: What `recover` is to restore it from.
            then: Called once the journal has the state, unless the exchange has been forgotten or
                given another state meanwhile.
            now: The instant.
        """
        taken.is_journalled = False
        taken.writes += 1
        write = taken.writes

        def kept(at: int) -> None:
            if self._all.get(taken.key) is taken and taken.writes == write:
                taken.is_journalled = True
                then(at)

        self._journal.write(msgspec.structs.astuple(taken.key), state, kept, now)

    def recover(
        self, stored: Mapping[str, bytes], restore: Callable[[list[int], list[Any]], Taken]
    ) -> None:
        """Restore the exchanges from before the restart; their times begin when the link is up."""
        for parts, state in self._journal.recover(stored):
            taken = restore(parts, state)
            taken.is_journalled = True
            self._add(taken)

    def recovered(self) -> list[Taken]:
        """Return the restored exchanges whose times have not begun."""
        return [each for each in self._all.values() if each.forget_at == NEVER]

    # Below the methods above

    def _add(self, taken: Taken) -> None:
        key: ExchangeKey = taken.key
        self._all[key] = taken
        self._by_client.setdefault(key.client, {})[key] = taken
