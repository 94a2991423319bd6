"""The tap: records every call of an engine from outside, with its result.

An engine is a function of its inputs. So its constructor's arguments and every later call, in
order, determine everything that it did: a new engine with the same calls transmits the same bytes.
A recording holds the calls, and a replay makes them.

A tap wraps the methods of one engine, so the code that drives or commands the engine need not know
of it. The engine's calls of its own methods are no inputs: only the outermost call is recorded.
Polls are recorded like other calls, since composing a frame draws random numbers and changes
queues, whatever its result. An engine without a tap is unchanged.
"""

import functools
import inspect
from collections.abc import Callable, Collection, Iterator
from typing import Any, Final

from zacoustic.core.engine.commands import GoalCommands, SubscriptionCommands
from zacoustic.core.engine.engine import Engine
from zacoustic.core.peers.lostcontact import LostContact
from zacoustic.core.peers.ranging import Ranging
from zacoustic.core.schedule.silence import Silence
from zacoustic.core.transport.commands.commands import Commands
from zacoustic.core.transport.keydelivery import KeyDelivery
from zacoustic.core.transport.routing import Routing
from zacoustic.core.transport.status import Status

CALLS: Final = (
    "handle_frame", "handle_transmit_report", "handle_link_state", "handle_carrier",
    "handle_clock", "handle_measurement", "handle_timeout", "handle_journal_committed",
    "handle_journal_state", "handle_waiting",
    "poll_transmit", "poll_journal", "poll_event", "poll_timeout",
    "declare", "publish", "cancel_delivery", "refuse_object",
    "call", "cancel", "reply", "reply_error", "expire", "forget",
    "actions.send_goal", "actions.cancel_goal", "actions.accept", "actions.reject",
    "actions.publish_feedback", "actions.finish", "actions.answer_cancel",
    "ranging.request", "ranging.cancel", "ranging.repeat",
    "subscriptions.want", "silence.begin", "silence.resume", "commands.send", "commands.execute",
    "status.ask", "lost_contact.acted", "routing.send", "routing.execute",
)  # fmt: skip
"""Inputs, outputs and commands of an engine; getters are not among them."""


class EngineCall:
    """One call; valid while the sink runs."""

    __slots__ = ("arguments", "error", "name", "result")

    def __init__(self, name: str, arguments: dict[str, Any]) -> None:
        self.name = name
        """One of `CALLS`."""
        self.arguments = arguments
        """The arguments by parameter name, without those left at their defaults."""
        self.result: Any = None
        """The return value."""
        self.error: Exception | None = None
        """The exception, if it raised one."""


PARTS: Final[dict[str, type]] = {
    "": Engine,
    "actions": GoalCommands,
    "subscriptions": SubscriptionCommands,
    "commands": Commands,
    "ranging": Ranging,
    "silence": Silence,
    "status": Status,
    "lost_contact": LostContact,
    "routing": Routing,
    "keys": KeyDelivery,
}
"""Parts of an engine whose calls can be tapped, by the first name of the call. They stay plain
Python in a compiled wheel: methods of a compiled object cannot be replaced."""

TapSink = Callable[[EngineCall], None]
"""Takes each call when it has ended; must neither raise nor call the engine."""


class Tap:
    """Records one engine from now on.

    Args:
        engine: The engine, preferably before its first call.
        sink: Takes the calls.
        calls: Which calls to record.
    """

    def __init__(self, engine: Engine, sink: TapSink, calls: Collection[str] = CALLS) -> None:
        self._sink = sink
        self._is_inside = False
        for name, part, method in _methods(engine, calls):
            setattr(part, name.rpartition(".")[2], self._tapped(name, method))

    def _tapped(self, name: str, method: Callable[..., Any]) -> Callable[..., Any]:
        _, *parameters = inspect.signature(method_of(name)).parameters

        @functools.wraps(method)
        def tapped(*args: Any, **keywords: Any) -> Any:  # noqa: ANN401 (as the method has it)
            if self._is_inside:
                return method(*args, **keywords)
            call = EngineCall(name, dict(zip(parameters, args, strict=False)) | keywords)
            self._is_inside = True
            try:
                call.result = method(*args, **keywords)
            except Exception as error:
                call.error = error
                raise
            finally:
                self._is_inside = False
                self._sink(call)
            return call.result

        return tapped


def call_engine(engine: Engine, name: str, arguments: dict[str, Any]) -> object:
    """Repeat a recorded call.

    Args:
        engine: The engine.
        name: One of `CALLS`.
        arguments: The arguments by parameter name.

    Raises:
        Exception: Whatever the call raises.
    """
    part, method = _part(engine, name)
    return getattr(part, method)(**arguments)


def method_of(name: str) -> Callable[..., Any]:
    """Return the method of a call as its class defines it, for its parameters."""
    path, _, method = name.rpartition(".")
    found: Callable[..., Any] = getattr(PARTS[path], method)
    return found


def _methods(
    engine: Engine, calls: Collection[str]
) -> Iterator[tuple[str, object, Callable[..., Any]]]:
    for name in calls:
        part, method = _part(engine, name)
        yield name, part, getattr(part, method)


def _part(engine: Engine, name: str) -> tuple[object, str]:
    """Return the object with the method of a call, and the method's own name."""
    path, _, method = name.rpartition(".")
    return (getattr(engine, path) if path else engine), method
