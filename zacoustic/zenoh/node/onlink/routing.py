"""Commands about routes of a node on a link: to remote nodes, and to itself."""

import asyncio

import msgspec

from zacoustic.core.base.clock import ns_to_seconds
from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.wire.routing import RoutingAnswer, RoutingRequest
from zacoustic.errors import DeliveryError, ServiceError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.carrier import call_error
from zacoustic.zenoh.node.onlink.answers import Answers
from zacoustic.zenoh.session.asking.routing import RoutingReport


class LinkRouting:
    """The commands about routes that one node has sent.

    Args:
        runner: Drives the engine that sends them.
    """

    def __init__(self, runner: LinkRunner) -> None:
        self._runner = runner
        self._answers: Answers[ResponseReceived] = Answers(runner)
        self.end_all = self._answers.end_all

    async def give(self, node: int, request: RoutingRequest, timeout_s: float) -> RoutingReport:
        """Send a command and wait for the answer; cancelling gives up.

        Raises:
            LocalError: There is no such node, or the command makes no sense here.
            ServiceError: The node refuses the command.
            CallTimeoutError: No answer came in time; the node may have executed the command.
            DeliveryError: The answer cannot be read.
        """
        if node == self._runner.engine.address:
            return self._report(node, await self._execute_here(request, timeout_s))
        event = await self._answers.ask(
            lambda engine, now: engine.routing.send(node, request, now, timeout_s=timeout_s),
            lambda engine, call_id, now: engine.cancel(call_id, now),
        )
        try:
            answer = RoutingAnswer.decode(request.kind, event.value)
        except ValueError as error:
            raise DeliveryError(str(error)) from None
        return self._report(node, answer)

    def deliver(self, event: ResponseReceived | CallFailed) -> bool:
        """Take the answer to a command; False: it is another answer."""
        if not self._answers.awaits(event.call_id):
            return False
        if isinstance(event, ResponseReceived):
            return self._answers.take(event.call_id, event)
        if event.failure is CallFailure.HANDLER:
            return self._answers.take(event.call_id, ServiceError(f"refused: {event.text}"))
        error = call_error("the command", event.failure, event.text)
        return self._answers.take(event.call_id, error)

    # Below the methods above

    async def _execute_here(self, request: RoutingRequest, timeout_s: float) -> RoutingAnswer:
        answer: asyncio.Future[RoutingAnswer] = asyncio.get_running_loop().create_future()

        def take(found: RoutingAnswer, now: int) -> None:
            if not answer.done():
                answer.set_result(found)

        self._runner.apply(lambda engine, now: engine.routing.execute(request, now, take))
        async with asyncio.timeout(timeout_s):
            return await answer

    def _report(self, node: int, answer: RoutingAnswer) -> RoutingReport:
        engine = self._runner.engine
        return RoutingReport(
            address=node,
            by=engine.address,
            sent_s=round(ns_to_seconds(engine.stats.airtime_ns), 3),
            **msgspec.structs.asdict(answer),
        )
