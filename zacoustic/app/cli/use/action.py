"""The verb `zacoustic action send_goal`: sends a goal, follows it, and cancels it on Ctrl-C."""

import argparse
import asyncio
from typing import TYPE_CHECKING, Any

from zacoustic.app.cli.support.arguments import check_positive
from zacoustic.app.cli.support.participant import (
    add_node_arguments,
    class_of,
    make_node,
    print_value,
    read_request,
)
from zacoustic.app.cli.support.printing import print_line, print_note
from zacoustic.errors import ConfigError, LocalError
from zacoustic.link.command import EXIT_FAILED, EXIT_INTERRUPTED, EXIT_OK, EXIT_TIMED_OUT, Command
from zacoustic.link.serving import stopped_by_signals

if TYPE_CHECKING:
    from collections.abc import Callable

    from zacoustic.zenoh.node import GoalHandle, GoalResult, Node

    Handle = GoalHandle[Any, Any, Any]

_EXAMPLE = """Ctrl-C cancels the goal, and waits for its end; a second one does not wait.
Exit codes: 0 succeeded, 1 rejected, aborted, canceled or unknown, 3 no answer, or not ended within
--timeout (the goal goes on), 130 Ctrl-C.

examples:
  zacoustic action send_goal auv1/goto '{ depth: 12 }' --feedback --config router.json5
  zacoustic action send_goal auv1/goto '{ depth: 12 }' --link sim/127.0.0.1:7000 --config fleet.json5
"""  # noqa: E501 (wide on a terminal)


class ActionCommand(Command):
    """Sends a goal."""

    name = "send_goal"
    summary = "send a goal, on Zenoh or straight on a link, and wait for its end"
    prints_late = True

    def add_arguments(self, parser: argparse.ArgumentParser) -> None:
        """Declare action, goal, place, and how long to wait."""
        parser.epilog = _EXAMPLE
        parser.add_argument("action", metavar="ACTION", help="action of the config, or key")
        parser.add_argument(
            "value", metavar="VALUE", nargs="?", default="",
            help="the goal: JSON5 for a typed action, which needs --config, otherwise a text",
        )  # fmt: skip
        add_node_arguments(parser)
        parser.add_argument(
            "--feedback", action="store_true", help="print feedback while the goal runs"
        )
        parser.add_argument(
            "--timeout", type=float, metavar="S",
            help="how long to wait for the end, s (default: until it comes, or is given up)",
        )  # fmt: skip

    def run(self, arguments: argparse.Namespace) -> int:
        """Send the goal and print its course.

        Raises:
            DeliveryError: Nobody serves the action, or its server was not reached.
        """
        check_positive(arguments, "timeout")
        return asyncio.run(_send(arguments))


async def _send(arguments: argparse.Namespace) -> int:
    interrupted = asyncio.Event()
    feedback = _Feedback(arguments)
    with stopped_by_signals(interrupted):
        async with make_node(arguments) as node:
            goal = asyncio.create_task(_begin(node, arguments, feedback.take))
            await _first(goal, interrupted)
            if not goal.done():  # not answered yet: cancelling this cancels the goal
                goal.cancel()
                await asyncio.gather(goal, return_exceptions=True)
                return EXIT_INTERRUPTED
            handle = goal.result()
            told = {"event": "accepted" if handle.accepted else "rejected", "text": handle.text}
            line = "accepted" if handle.accepted else f"rejected: {handle.text}"
            print_line({"action": handle.name, **told}, line, as_json=arguments.json)
            if not handle.accepted:
                return EXIT_FAILED
            feedback.release()
            return await _follow(handle, arguments, interrupted)


class _Feedback:
    """Prints feedback, after the line about the accepted goal."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._arguments = arguments
        self._held: list[object] | None = []

    def take(self, value: object) -> None:
        if self._held is not None:
            self._held.append(value)
            return
        record = {"action": self._arguments.action, "event": "feedback"}
        print_value(record, value, as_json=self._arguments.json, told="feedback: {}")

    def release(self) -> None:
        held, self._held = self._held or [], None
        for value in held:
            self.take(value)


async def _begin(
    node: "Node", arguments: argparse.Namespace, take: "Callable[[object], None]"
) -> "Handle":
    """Send the goal, and wait until it is accepted or rejected."""
    stream = node.find_stream(arguments.action)
    if stream is None and arguments.value.lstrip().startswith("{"):
        raise ConfigError(
            f"VALUE {arguments.value}; allowed: a text, where nothing is known of the action",
            hint="give --config FILE, which has its types",
        )
    types: tuple[Any, Any, Any] = (bytes, bytes, bytes)
    goal: Any = arguments.value.encode()
    if stream is not None:
        specs = (stream.type, stream.feedback_type, stream.response_type)
        types = (class_of(specs[0]), class_of(specs[1]), class_of(specs[2]))
        goal = read_request(stream, arguments.value, source="VALUE")
    client = node.create_action_client(types, arguments.action)
    return await client.send_goal(goal, feedback_callback=take if arguments.feedback else None)


async def _follow(
    handle: "Handle", arguments: argparse.Namespace, interrupted: asyncio.Event
) -> int:
    """Wait for the end; the first interrupt cancels the goal, the second one the wait."""
    from zacoustic.core.engine.events import GoalStatus

    end = asyncio.create_task(handle.result(timeout_s=arguments.timeout))
    await _first(end, interrupted)
    is_canceled = not end.done()
    if is_canceled:
        interrupted.clear()
        cancel = asyncio.create_task(_cancel(handle))
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
        text = f"not ended within {arguments.timeout:g} s; it goes on"
        record = {"action": handle.name, "event": "result", "status": None, "text": text}
        print_line(record, text, as_json=arguments.json)
        return EXIT_TIMED_OUT
    _print_result(handle.name, result, as_json=arguments.json)
    if is_canceled and result.status is GoalStatus.CANCELED:
        return EXIT_INTERRUPTED
    return EXIT_OK if result.status is GoalStatus.SUCCEEDED else EXIT_FAILED


def _print_result(name: str, result: "GoalResult[Any]", *, as_json: bool) -> None:
    from zacoustic.zenoh.node.api.text import line_of, shown_value

    shown = {} if result.result is None else shown_value(result.result, "")
    status = result.status.name.lower()
    words = [status, *([line_of(shown)] if shown else []), *([result.text] if result.text else [])]
    record = {"action": name, "event": "result", "status": status, **shown, "text": result.text}
    print_line(record, ": ".join(words), as_json=as_json)


async def _cancel(handle: "Handle") -> None:
    try:
        if not await handle.cancel():
            text = "the server does not cancel it; Ctrl-C again to leave"
            print_note(f"zacoustic action: {text}")
    except LocalError:
        pass  # it had ended


async def _first(task: "asyncio.Task[Any]", interrupted: asyncio.Event) -> None:
    """Wait for a task or an interrupt, without ending either."""
    waiting = asyncio.create_task(interrupted.wait())
    await asyncio.wait({task, waiting}, return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()
    await asyncio.gather(waiting, return_exceptions=True)
