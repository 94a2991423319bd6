"""Commands about routes of a node on a link: to remote nodes, and to itself."""

from zacoustic.core.engine.events import CallFailed, CallFailure
from zacoustic.core.wire.routing import RoutingAnswer, RoutingRequest
from zacoustic.errors import DeliveryError, ServiceError
from zacoustic.run.pending import CallEnd
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.carrier import call_error
from zacoustic.zenoh.node.onlink.answers import Answers, execute_here
from zacoustic.zenoh.requests.routing import RoutingReport


class LinkRouting:
    """The commands about routes that one node has sent.

    Args:
        runner: Drives the engine that sends them.
        answers: The calls of the node.
    """

    def __init__(self, runner: LinkRunner, answers: Answers[CallEnd]) -> None:
        self._runner = runner
        self._answers = answers

    async def give(self, node: int, request: RoutingRequest, timeout_s: float) -> RoutingReport:
        """Send a command and wait for the answer; cancelling gives up.

        Raises:
            LocalError: There is no such node, or the command makes no sense here.
            ServiceError: The node refuses the command.
            CallTimeoutError: No answer came in time; the node may have executed the command.
            DeliveryError: The answer cannot be read.
        """
        if node == self._runner.engine.address:
            found: RoutingAnswer = await execute_here(
                self._runner,
                lambda engine, now, take: engine.routing.execute(
                    request, now, lambda answer, at: take(answer)
                ),
                timeout_s,
            )
            return RoutingReport.of(self._runner.engine, node, found)
        end = await self._answers.ask(
            lambda engine, now: engine.routing.send(node, request, now, timeout_s=timeout_s),
            lambda engine, call_id, now: engine.cancel(call_id, now),
        )
        if isinstance(end, CallFailed):
            if end.failure is CallFailure.HANDLER:
                raise ServiceError(f"refused: {end.text}")
            raise call_error("the command", end.failure, end.text)
        try:
            answer = RoutingAnswer.decode(request.kind, end.value)
        except ValueError as error:
            raise DeliveryError(str(error)) from None
        return RoutingReport.of(self._runner.engine, node, answer)
