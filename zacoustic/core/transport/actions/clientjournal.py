"""The client's journal: the goals that it has sent, and its cancels.

Attempt 0 to cancel a goal needs no entry of its own: the goal was journalled before it was sent,
and after a restart the attempts continue at 1. A later attempt is journalled before it is sent.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.streams.specs import ActionSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.clientgoal import ClientGoal, ClientStage
from zacoustic.core.transport.exchanges.journal import ExchangeJournal
from zacoustic.core.transport.exchanges.taken import NEVER
from zacoustic.core.wire.goals import GoalKey

_JOURNAL: Final = "goal/sent"


class ClientJournal:
    """Journals the goals that one node has sent.

    Args:
        address: Address of the node.
        table: Its streams.
        journal: Holds the goals.
    """

    def __init__(self, address: int, table: StreamTable, journal: JournalPort) -> None:
        self._address = address
        self._table = table
        self._journal = ExchangeJournal(_JOURNAL, table, journal)

    @property
    def failure(self) -> str:
        """The reason why the journal cannot be written; empty: it can."""
        return self._journal.failure

    def recover(self, stored: Mapping[str, bytes]) -> Iterator[ClientGoal]:
        """Yield the goals from before the restart; delete the entries of changed streams."""
        for parts, (tag, attempts) in self._journal.recover(stored):
            key = GoalKey(self._address, *parts)
            spec = self._table.by_id(key.stream_id).spec
            assert isinstance(spec, ActionSpec)
            goal = ClientGoal(key, spec.server, ClientStage.FOUND, NEVER, tag)
            goal.attempt = attempts - 1
            goal.attempts_journalled = attempts
            yield goal

    def keep(self, goal: ClientGoal, then: Callable[[int], None], now: int) -> None:
        """Journal a goal and its cancels up to `goal.attempt`; then continue."""
        # How many cancels of it may have been sent.
        goal.attempts_journalled = max(goal.attempt, 0) + 1
        state = (goal.tag, goal.attempts_journalled)
        self._journal.write(_parts(goal.key), state, then, now)

    def forget(self, key: GoalKey, then: Callable[[int], None], now: int) -> None:
        """Delete the entry of a goal whose end was reported; then continue."""
        self._journal.write(_parts(key), None, then, now)


def _parts(key: GoalKey) -> tuple[int, int, int]:
    """Return the key in the names of entries: all are goals of this node."""
    return key.epoch, key.stream_id, key.number
