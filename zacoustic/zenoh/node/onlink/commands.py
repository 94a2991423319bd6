"""Commands of a node on a link: to remote nodes, and to itself."""

import asyncio
import contextlib

from zacoustic.core.engine.engine import Engine
from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.streams.commands import CommandState, RemoteCommand
from zacoustic.errors import LinkClosedError, ServiceError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.carrier import call_error


class LinkCommands:
    """The commands that one node has given.

    Args:
        runner: Whose engine sends them.
    """

    def __init__(self, runner: LinkRunner) -> None:
        self._runner = runner
        self._answers: dict[int, asyncio.Future[CommandState]] = {}

    async def give(self, node: int, command: RemoteCommand, timeout_s: float) -> CommandState:
        """Give a command and wait for the answer; cancelling gives it up.

        Raises:
            LocalError: No such node, or a command to itself makes no sense.
            ServiceError: The node refuses it.
            CallTimeoutError: No answer in time; it may have been executed.
        """
        answer: asyncio.Future[CommandState] = asyncio.get_running_loop().create_future()
        if node == self._runner.engine.address:
            self._runner.apply(
                lambda engine, now: engine.commands.execute(
                    command, now, lambda state: None if answer.done() else answer.set_result(state)
                )
            )
            async with asyncio.timeout(timeout_s):
                return await answer

        def begin(engine: Engine, now: int) -> int:
            call_id = engine.commands.send(node, command, now, timeout_s=timeout_s)
            self._answers[call_id] = answer  # before the events of the engine are polled
            return call_id

        call_id = self._runner.apply(begin)
        try:
            return await answer
        finally:
            if self._answers.pop(call_id, None) is not None:
                with contextlib.suppress(LinkClosedError):
                    self._runner.apply(lambda engine, now: engine.cancel(call_id, now))

    def deliver(self, event: ResponseReceived | CallFailed) -> bool:
        """Take the answer to a command; False if it is something else."""
        answer = self._answers.pop(event.call_id, None)
        if answer is None:
            return False
        if answer.done():
            return True
        if isinstance(event, ResponseReceived):
            answer.set_result(CommandState.from_wire(event.value, event.age_s or 0.0))
        elif event.failure is CallFailure.HANDLER:
            answer.set_exception(ServiceError(f"the command is refused: {event.text}"))
        else:
            answer.set_exception(call_error("the command", event.failure, event.text))
        return True

    def end_all(self, error: Exception) -> None:
        """Inform the waiting callers that no answer will come."""
        for answer in self._answers.values():
            if not answer.done():
                answer.set_exception(error)
        self._answers.clear()
