"""Commands of a node on a link: to remote nodes, and to itself."""

from zacoustic.core.engine.events import CallFailure, ResponseReceived
from zacoustic.core.streams.commands import CommandState, RemoteCommand
from zacoustic.errors import ServiceError
from zacoustic.run.pending import CallEnd
from zacoustic.run.runner import LinkRunner
from zacoustic.zenoh.node.carrier import call_error
from zacoustic.zenoh.node.onlink.answers import Answers, execute_here


class LinkCommands:
    """The commands that one node has sent.

    Args:
        runner: Drives the engine that sends them.
        answers: The calls of the node.
    """

    def __init__(self, runner: LinkRunner, answers: Answers[CallEnd]) -> None:
        self._runner = runner
        self._answers = answers

    async def give(self, node: int, command: RemoteCommand, timeout_s: float) -> CommandState:
        """Send a command and wait for the answer; cancelling gives up.

        Raises:
            LocalError: There is no such node, or a command to itself makes no sense.
            ServiceError: The node refuses the command.
            CallTimeoutError: No answer came in time; the node may have executed the command.
        """
        if node == self._runner.engine.address:
            return await execute_here(
                self._runner,
                lambda engine, now, take: engine.commands.execute(command, now, take),
                timeout_s,
            )
        end = await self._answers.ask(
            lambda engine, now: engine.commands.send(node, command, now, timeout_s=timeout_s),
            lambda engine, call_id, now: engine.cancel(call_id, now),
        )
        if isinstance(end, ResponseReceived):
            return CommandState.from_wire(end.value, end.age_s)
        if end.failure is CallFailure.HANDLER:
            raise ServiceError(f"the command is refused: {end.text}")
        raise call_error("the command", end.failure, end.text)
