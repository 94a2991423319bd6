"""The node that requests are made to: its engine, what waits for it, and a request that waits."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, TypeVar

import msgspec

from zacoustic.core.base.clock import Clock
from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.errors import CallTimeoutError, DeliveryError, ServiceError, ZacousticError
from zacoustic.run.pending import CallEnd, Pending

if TYPE_CHECKING:  # who asks needs no engine
    from zacoustic.core.engine.engine import Engine
    from zacoustic.run.runner import LinkRunner

Q = TypeVar("Q")
A = TypeVar("A", bound=msgspec.Struct)


class RequestContext:
    """The engine of one node, its clocks, and who waits for what; for the loop.

    Args:
        runner: Runs the engine.
        ends: The calls of the node.
        clock: Source of instants.
        utc_ns: Returns UTC, ns since 1970.
    """

    def __init__(
        self,
        runner: "LinkRunner",
        ends: Pending[CallEnd],
        *,
        clock: Clock,
        utc_ns: Callable[[], int],
    ) -> None:
        self.runner = runner
        self.ends = ends
        self.ranges: Pending[RangeMeasured | RangeFailed] = Pending()
        self.clock = clock
        self.utc_ns = utc_ns

    @property
    def engine(self) -> "Engine":
        """The engine; after a fault it is another one."""
        return self.runner.engine


class Asking(Generic[Q, A]):
    """A request that waits for its answer; `answer` or `refuse` ends it.

    Args:
        context: The node that asks.
        node: Address of the node that is asked.
        question: The question.
        within_s: Time limit, s.
        answer: Takes the answer.
        refuse: Takes the reason why there is none, and one line of text.
    """

    def __init__(
        self,
        context: RequestContext,
        node: int,
        question: Q,
        within_s: float,
        *,
        answer: Callable[[A], None],
        refuse: Callable[[CallFailure, str], object],
    ) -> None:
        self.context = context
        self.node = node
        self.question = question
        self.within_s = within_s
        self.answer = answer
        self.refuse = refuse
        self._call_id: int | None = None

    def wait(self, call_id: int, read: Callable[[ResponseReceived], A], *, maybe: str = "") -> None:
        """Answer when the node has answered.

        Args:
            call_id: The call.
            read: Makes the answer from the node's; raises `ValueError` if it cannot be read.
            maybe: What may have happened there although no answer came in time.
        """

        def take(end: CallEnd) -> None:
            if isinstance(end, CallFailed):
                self.fail(end, maybe=maybe)
                return
            try:
                answer = read(end)
            except ValueError as error:
                self.refuse(CallFailure.BAD_RESPONSE, str(error))
            else:
                self.answer(answer)

        self._call_id = call_id
        self.context.ends.add(call_id, take)

    def give_up(self) -> None:
        """Cancel the call of `wait`, if it has not ended: the asker has gone."""
        call_id = self._call_id
        if call_id is not None and self.context.ends.drop(call_id):
            self.context.runner.try_apply(lambda engine, now: engine.cancel(call_id, now))

    def fail(self, end: CallFailed, *, maybe: str = "") -> None:
        """Tell the asker that the node has not done it; `maybe` as in `wait`."""
        text = end.text
        if end.failure is CallFailure.TIMED_OUT:
            text = f"node {self.node} has not answered in time{maybe and f', and {maybe}'}"
        self.refuse(end.failure, text)


def request_error(node: int | None, failure: CallFailure, text: str) -> ZacousticError:
    """Return the exception for a request without an answer.

    Args:
        node: Address of the node that was asked; None: those of all local gateways.
        failure: The reason.
        text: One line.

    Returns:
        `ServiceError` if the node refuses it; `CallTimeoutError` if no answer came in time;
        otherwise `DeliveryError`.
    """
    if failure is CallFailure.HANDLER:
        return ServiceError(f"refused by node {node}: {text}")
    return (CallTimeoutError if failure is CallFailure.TIMED_OUT else DeliveryError)(text)
