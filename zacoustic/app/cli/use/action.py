"""The verb `zacoustic action send_goal`: sends a goal, follows it, and cancels it on Ctrl-C."""

import asyncio
from typing import TYPE_CHECKING, Any

from zacoustic.app.cli.support.participant import Participant, class_of, read_request
from zacoustic.app.cli.support.rows import flag, seconds, word
from zacoustic.errors import ConfigError, LocalError
from zacoustic.link.command import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK, EXIT_TIMED_OUT
from zacoustic.link.serving import stopped_by_signals

if TYPE_CHECKING:
    from zacoustic.zenoh.node import GoalHandle, GoalResult, Node

    Handle = GoalHandle[Any, Any, Any]


class SendGoal(Participant):
    """Send a goal, on Zenoh or straight on a link, and wait for its end.

    Ctrl-C cancels the goal, and waits for its end; a second one does not wait.
    Exit codes: 0 succeeded, 1 rejected, aborted, canceled or unknown, 3 no answer, or not ended within
    --timeout (the goal goes on), 130 Ctrl-C.

    Examples:
      zacoustic action send_goal auv1/goto '{ depth: 12 }' --feedback --config router.json5
      zacoustic action send_goal auv1/goto '{ depth: 12 }' --link sim/127.0.0.1:7000 --config fleet.json5
    """  # noqa: E501 (wide on a terminal)

    action: str = word("ACTION", "action of the config, or key")
    value: str = word(
        "VALUE",
        "the goal: JSON5 for a typed action, which needs --config, otherwise a text",
        "?",
        default="",
    )
    feedback: bool = flag("print feedback while the goal runs")
    timeout: float | None = seconds(
        "how long to wait for the end, s (default: until it comes, or is given up)"
    )

    async def work(self) -> int:
        """Send the goal and print its course.

        Raises:
            DeliveryError: Nobody serves the action, or its server was not reached.
        """
        interrupted = asyncio.Event()
        self._held: list[object] | None = []
        with stopped_by_signals(interrupted):
            async with self.make_node() as node:
                goal = asyncio.create_task(self._begin(node))
                await _first(goal, interrupted)
                if not goal.done():  # not answered yet: cancelling this cancels the goal
                    goal.cancel()
                    await asyncio.gather(goal, return_exceptions=True)
                    return EXIT_INTERRUPTED
                handle = goal.result()
                told = {"event": "accepted" if handle.accepted else "rejected", "text": handle.text}
                line = "accepted" if handle.accepted else f"rejected: {handle.text}"
                self.line({"action": handle.name, **told}, line)
                if not handle.accepted:
                    return EXIT_FAILED
                self._release_feedback()
                return await self._follow(handle, interrupted)

    async def _begin(self, node: "Node") -> "Handle":
        """Send the goal, and wait until it is accepted or rejected."""
        stream = node.find_stream(self.action)
        if stream is None and self.value.lstrip().startswith("{"):
            raise ConfigError(
                f"VALUE {self.value}; allowed: a text, where nothing is known of the action",
                hint="give --config FILE, which has its types",
            )
        types: tuple[Any, Any, Any] = (bytes, bytes, bytes)
        goal: Any = self.value.encode()
        if stream is not None:
            specs = (stream.type, stream.feedback_type, stream.response_type)
            types = (class_of(specs[0]), class_of(specs[1]), class_of(specs[2]))
            goal = read_request(stream, self.value, source="VALUE")
        client = node.create_action_client(types, self.action)
        return await client.send_goal(
            goal, feedback_callback=self._take_feedback if self.feedback else None
        )

    def _take_feedback(self, value: object) -> None:
        """Print feedback, after the line about the accepted goal."""
        if self._held is not None:
            self._held.append(value)
            return
        record = {"action": self.action, "event": "feedback"}
        self.print_value(record, value, "feedback: {}")

    def _release_feedback(self) -> None:
        held, self._held = self._held or [], None
        for value in held:
            self._take_feedback(value)

    async def _follow(self, handle: "Handle", interrupted: asyncio.Event) -> int:
        """Wait for the end; the first interrupt cancels the goal, the second one the wait."""
        from zacoustic.core.engine.events import GoalStatus

        end = asyncio.create_task(handle.result(timeout_s=self.timeout))
        await _first(end, interrupted)
        is_canceled = not end.done()
        if is_canceled:
            interrupted.clear()
            cancel = asyncio.create_task(self._cancel(handle))
            await _first(end, interrupted)
            cancel.cancel()
            await asyncio.gather(cancel, return_exceptions=True)
            if not end.done():
                end.cancel()
                await asyncio.gather(end, return_exceptions=True)
                return EXIT_INTERRUPTED
        try:
            result = end.result()
        except TimeoutError as error:
            if str(error):
                raise
            text = f"not ended within {self.timeout:g} s; it goes on"
            record = {"action": handle.name, "event": "result", "status": None, "text": text}
            self.line(record, text)
            return EXIT_TIMED_OUT
        self._print_end(handle.name, result)
        if is_canceled and result.status is GoalStatus.CANCELED:
            return EXIT_INTERRUPTED
        return EXIT_OK if result.status is GoalStatus.SUCCEEDED else EXIT_FAILED

    async def _cancel(self, handle: "Handle") -> None:
        try:
            if not await handle.cancel():
                self.note("the server does not cancel it; Ctrl-C again to leave")
        except LocalError:
            pass  # it had ended

    def _print_end(self, name: str, result: "GoalResult[Any]") -> None:
        from zacoustic.zenoh.node.api.text import line_of, shown_value

        shown = {} if result.result is None else shown_value(result.result, "")
        status = result.status.name.lower()
        words = [
            status,
            *([line_of(shown)] if shown else []),
            *([result.text] if result.text else []),
        ]
        record = {"action": name, "event": "result", "status": status, **shown, "text": result.text}
        self.line(record, ": ".join(words))


async def _first(task: "asyncio.Task[Any]", interrupted: asyncio.Event) -> None:
    """Wait for a task or an interrupt, without ending either."""
    waiting = asyncio.create_task(interrupted.wait())
    await asyncio.wait({task, waiting}, return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)
