"""What a gateway lends to the engine calls of its requests, and a request that waits there."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Generic, TypeVar

import msgspec

from zacoustic.core.base.clock import Clock
from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.peers.ranging import RangeFailed, RangeMeasured
from zacoustic.run.pending import CallEnd, Pending

if TYPE_CHECKING:  # who asks needs no engine, and a node on a link no Zenoh
    from zacoustic.core.engine.engine import Engine
    from zacoustic.run.runner import LinkRunner
    from zacoustic.zenoh.session.asking.queries import HeldQuery

Q = TypeVar("Q")
A = TypeVar("A", bound=msgspec.Struct)


class RequestContext:
    """The engine of one gateway, its clocks, and who waits for what; for the loop.

    Args:
        runner: Runs the engine.
        ends: The calls of the gateway.
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
        context: The gateway.
        held: The query.
        node: Address of the node that is asked.
        question: The question.
        within_s: Time limit, s.
    """

    def __init__(
        self, context: RequestContext, held: "HeldQuery", node: int, question: Q, within_s: float
    ) -> None:
        self.context = context
        self.node = node
        self.question = question
        self.within_s = within_s
        self._held = held
        self.refuse = held.refuse

    def answer(self, answer: A) -> None:
        """Answer, under the concrete key."""
        prefix, _, *subject = self._held.key.split("/")
        self._held.answer_json("/".join((prefix, str(self.node), *subject)), answer)

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

        self.context.ends.add(call_id, take)

    def fail(self, end: CallFailed, *, maybe: str = "") -> None:
        """Tell the asker that the node has not done it; `maybe` as in `wait`."""
        text = end.text
        if end.failure is CallFailure.TIMED_OUT:
            text = f"node {self.node} has not answered in time{maybe and f', and {maybe}'}"
        self.refuse(end.failure, text)
