"""Commands about streams, each on the link of its stream."""

from collections.abc import Callable, Collection, Set

from zacoustic.core.engine.linkstack import LinkStack
from zacoustic.core.streams.table import Stream
from zacoustic.core.transport.actions.actions import Actions
from zacoustic.core.transport.subscriptions.subscriptions import Subscriptions
from zacoustic.core.transport.topics.deadlines import Awaited
from zacoustic.core.wire.goals import GoalFailure, GoalKey, GoalStatus
from zacoustic.errors import UnknownStreamError

StackOf = Callable[[int], LinkStack]
"""Returns the stack of the link that a stream uses."""


class GoalCommands:
    """Commands about goals; `Actions` describes each."""

    def __init__(self, stack_of: StackOf) -> None:
        self._stack_of = stack_of

    def send_goal(
        self,
        stream_id: int,
        value: object,
        now: int,
        *,
        timeout_s: float | None = None,
        tag: bytes = b"",
    ) -> GoalKey:
        """Send a goal."""
        return self._of(stream_id).send_goal(stream_id, value, now, timeout_s=timeout_s, tag=tag)

    def cancel_goal(self, goal: GoalKey, now: int) -> bool:
        """Ask for the end of a goal."""
        return self._of(goal.stream_id).cancel_goal(goal, now)

    def accept(self, goal: GoalKey, now: int) -> bool:
        """Accept a goal."""
        return self._of(goal.stream_id).accept(goal, now)

    def reject(
        self,
        goal: GoalKey,
        now: int,
        *,
        text: str = "",
        failure: GoalFailure = GoalFailure.REJECTED,
    ) -> bool:
        """Reject a goal."""
        return self._of(goal.stream_id).reject(goal, now, text=text, failure=failure)

    def publish_feedback(self, goal: GoalKey, value: object, now: int) -> bool:
        """Send feedback on a goal."""
        return self._of(goal.stream_id).publish_feedback(goal, value, now)

    def finish(self, goal: GoalKey, status: GoalStatus, value: object, now: int) -> bool:
        """End a goal."""
        return self._of(goal.stream_id).finish(goal, status, value, now)

    def answer_cancel(self, goal: GoalKey, now: int, *, accepted: bool, text: str = "") -> bool:
        """Answer a `CancelRequested`."""
        return self._of(goal.stream_id).answer_cancel(goal, now, accepted=accepted, text=text)

    def _of(self, stream_id: int) -> Actions:
        actions = self._stack_of(stream_id).protocols.actions
        if actions is None:
            raise UnknownStreamError(f"stream {stream_id} is no action; this wire has none")
        return actions


class SubscriptionCommands:
    """Commands and getters about on-demand topics; `Subscriptions` describes each."""

    def __init__(self, stack_of: StackOf) -> None:
        self._stack_of = stack_of

    def want(self, stream_id: int, now: int, sources: Collection[int] | None = None) -> None:
        """Subscribe to an on-demand topic at some of its publishers, and at no others."""
        self._of(stream_id).want(stream_id, now, sources)

    def publishers(self, stream: Stream) -> frozenset[int]:
        """Return the other nodes that may publish an on-demand topic."""
        return self._of(stream.stream_id).publishers(stream)

    def wanted(self, stream_id: int) -> frozenset[int]:
        """Return the publishers at which this node subscribes to an on-demand topic."""
        return self._of(stream_id).wanted(stream_id)

    def subscribers(self, stream: Stream) -> Set[int] | None:
        """Return the nodes that have subscribed to an on-demand topic; None for any other."""
        return self._of(stream.stream_id).subscribers(stream)

    def _of(self, stream_id: int) -> Subscriptions:
        return self._stack_of(stream_id).protocols.subscriptions


class AwaitedSamples:
    """The awaited samples of all links."""

    def __init__(self, stacks: Collection[LinkStack]) -> None:
        self._stacks = stacks

    def awaited(self) -> list[Awaited]:
        """Return the awaited samples of this node and of others; treat them as read-only."""
        return [each for stack in self._stacks for each in stack.protocols.deadlines.awaited()]
