"""The client's journal: the goals that it has sent, and its cancels.

Attempt 0 to cancel a goal needs no entry of its own: the goal was journalled before it was sent,
and after a restart the attempts continue at 1. A later attempt is journalled before it is sent.
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.journal import JournalPort
from zacoustic.core.streams.specs import ActionSpec
from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.clientgoal import ClientGoal, ClientStage
from zacoustic.core.wire.goals import GoalKey

_JOURNAL: Final = "goal/sent"
_NEVER: Final = 1 << 62


class _Journalled(msgspec.Struct, frozen=True, array_like=True):
    """A goal in its client's journal."""

    digest: bytes
    tag: bytes
    attempts: int = 1
    """How many cancels of it may have been sent."""


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
        self._journal = journal

    @property
    def failure(self) -> str:
        """The reason why the journal cannot be written; empty: it can."""
        return self._journal.failure

    def recover(self, stored: Mapping[str, bytes]) -> Iterator[ClientGoal]:
        """Yield the goals from before the restart; delete the entries of changed streams."""
        for name, value in stored.items():
            if not name.startswith(f"{_JOURNAL}/"):
                continue
            epoch, stream_id, number = map(int, name.split("/")[2:])
            kept = msgspec.msgpack.decode(value, type=_Journalled)
            stream = self._table.get(stream_id)
            if stream is None or stream.digest != kept.digest:
                self._journal.write(name, None)
                continue
            assert isinstance(stream.spec, ActionSpec)
            key = GoalKey(self._address, epoch, stream_id, number)
            goal = ClientGoal(key, stream.spec.server, ClientStage.FOUND, _NEVER, kept.tag)
            goal.attempt = kept.attempts - 1
            goal.attempts_journalled = kept.attempts
            yield goal

    def keep(self, goal: ClientGoal, then: Callable[[int], None], now: int) -> None:
        """Journal a goal and its cancels up to `goal.attempt`; then continue."""
        stream = self._table.by_id(goal.key.stream_id)
        goal.attempts_journalled = max(goal.attempt, 0) + 1
        kept = _Journalled(stream.digest, goal.tag, goal.attempts_journalled)
        self._write(goal.key, msgspec.msgpack.encode(kept), then, now)

    def forget(self, key: GoalKey, then: Callable[[int], None], now: int) -> None:
        """Delete the entry of a goal whose end was reported; then continue."""
        self._write(key, None, then, now)

    def _write(
        self, key: GoalKey, value: bytes | None, then: Callable[[int], None], now: int
    ) -> None:
        if not self._table.by_id(key.stream_id).spec.journal:
            then(now)
            return
        self._journal.write(f"{_JOURNAL}/{key.epoch}/{key.stream_id}/{key.number}", value, then)
