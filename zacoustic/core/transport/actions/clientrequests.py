"""The repeated requests of an action client: a goal, a claim about it, a cancel."""

from zacoustic.core.streams.table import StreamTable
from zacoustic.core.transport.actions.clientgoal import ClientGoal
from zacoustic.core.transport.actions.outbox import GoalLane, GoalOutbox
from zacoustic.core.transport.exchanges.repeating import Repetition
from zacoustic.core.transport.exchanges.taken import NEVER
from zacoustic.core.values.payload import PayloadCodec
from zacoustic.core.wire.goals import Operation, encode_cancel


class ClientRequests:
    """Sends the requests of one client.

    Args:
        table: Its streams.
        outbox: Queues the records.
    """

    def __init__(self, table: StreamTable, outbox: GoalOutbox) -> None:
        self._table = table
        self._outbox = outbox

    def offer(self, goal: ClientGoal, payload: bytes, now: int) -> None:
        """Send a goal until the server shows that it has it."""
        codec = self._table.by_id(goal.key.stream_id).codec
        goal.offer = self._repeat(goal, Operation.GOAL, GoalLane.GOAL, now, payload, codec)

    def stop_offer(
        self, goal: ClientGoal, now: int, *, answered: bool = False, prompt: bool = False
    ) -> None:
        """Stop sending the goal; see `GoalOutbox.stop`."""
        if goal.offer is not None:
            self._outbox.stop(goal.offer, now, answered=answered, prompt=prompt)
            goal.offer = None

    def claim(self, goal: ClientGoal, now: int) -> None:
        """Ask for the outcome of a goal until the server answers."""
        goal.claim_at = None
        self._outbox.stop(goal.claim, now)
        goal.claim = self._repeat(goal, Operation.CLAIM, GoalLane.CLAIM, now)

    def insist(self, goal: ClientGoal, now: int) -> None:
        """Ask at once for the outcome of a goal: the server sent it, but it did not arrive."""
        if goal.claim is None:
            self.claim(goal, now)
        else:
            self._outbox.again(goal.claim)

    def cancel(self, goal: ClientGoal, now: int) -> None:
        """Ask the server to stop a goal until it has answered this attempt."""
        operation, payload = encode_cancel(goal.attempt)
        goal.cancel = self._repeat(goal, operation, GoalLane.CANCEL, now, payload)

    def _repeat(
        self,
        goal: ClientGoal,
        operation: Operation,
        lane: GoalLane,
        now: int,
        payload: bytes = b"",
        codec: PayloadCodec | None = None,
    ) -> Repetition:
        until = NEVER if lane is GoalLane.CANCEL else goal.deadline_at
        repetition = self._outbox.repeat(
            goal.key,
            self._table.by_id(goal.key.stream_id),
            goal.server,
            operation,
            lane,
            now,
            payload=payload,
            codec=codec,
            until=until,
        )
        goal.repetitions = [each for each in goal.repetitions if each.tries] + [repetition]
        return repetition
