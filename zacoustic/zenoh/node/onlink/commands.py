"""Commands of a node on a link: to remote nodes, and to itself."""

import asyncio

from zacoustic.core.engine.events import CallFailed, CallFailure, ResponseReceived
from zacoustic.core.streams.commands import CommandState, RemoteCommand
from zacoustic.errors import ServiceError, ZacousticError
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.carrier import call_error
from zacoustic.zenoh.node.onlink.answers import Answers


class LinkCommands:
    """The commands that one node has sent.

    Args:
        runner: Drives the engine that sends them.
    """

    def __init__(self, runner: LinkRunner) -> None:
        self._runner = runner
        self._answers: Answers[CommandState] = Answers(runner)
        self.end_all = self._answers.end_all

    async def give(self, node: int, command: RemoteCommand, timeout_s: float) -> CommandState:
        """Send a command and wait for the answer; cancelling gives up.

        Raises:
            LocalError: There is no such node, or a command to itself makes no sense.
            ServiceError: The node refuses the command.
            CallTimeoutError: No answer came in time; the node may have executed the command.
        """
        if node == self._runner.engine.address:
            return await self._execute_here(command, timeout_s)
        return await self._answers.ask(
            lambda engine, now: engine.commands.send(node, command, now, timeout_s=timeout_s),
            lambda engine, call_id, now: engine.cancel(call_id, now),
        )

    async def _execute_here(self, command: RemoteCommand, timeout_s: float) -> CommandState:
        answer: asyncio.Future[CommandState] = asyncio.get_running_loop().create_future()
        self._runner.apply(
            lambda engine, now: engine.commands.execute(
                command, now, lambda state: None if answer.done() else answer.set_result(state)
            )
        )
        async with asyncio.timeout(timeout_s):
            return await answer

    def deliver(self, event: ResponseReceived | CallFailed) -> bool:
        """Take the answer to a command; False: it is another answer."""
        if not self._answers.awaits(event.call_id):
            return False
        outcome: CommandState | ZacousticError
        if isinstance(event, ResponseReceived):
            outcome = CommandState.from_wire(event.value, event.age_s or 0.0)
        elif event.failure is CallFailure.HANDLER:
            outcome = ServiceError(f"the command is refused: {event.text}")
        else:
            outcome = call_error("the command", event.failure, event.text)
        return self._answers.take(event.call_id, outcome)
