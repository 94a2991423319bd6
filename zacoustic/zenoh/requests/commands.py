"""Remote commands: silence, and how a node sends a topic.

A `get` returns the state; with parameters it commands::

    @acoustic/2/silence                           is node 2 silent?
    @acoustic/2/silence?command=begin;for_s=1800    silence for half an hour
    @acoustic/2/silence?command=begin               silence until it is resumed
    @acoustic/2/silence?command=resume              the end of it; quiet windows stay
    @acoustic/2/stream/11                         how does node 2 send topic 11?
    @acoustic/2/stream/11?on=false                not at all
    @acoustic/2/stream/11?on=true;min_interval_s=10;priority=background
    @acoustic/2/stream/11?reset=true              as its configuration says

The answer goes out when the executing node has journalled the command.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, Final, TypeVar

import msgspec

from zacoustic.core.base.clock import seconds_to_ns
from zacoustic.core.base.qos import PRIORITY_NAMES
from zacoustic.core.streams.commands import (
    COMMANDS_TIMEOUT_S,
    CommandKind,
    CommandState,
    RemoteCommand,
)
from zacoustic.run.permitlog import utc_text
from zacoustic.text.digits import real_number
from zacoustic.zenoh.requests.context import Asking, RequestContext
from zacoustic.zenoh.requests.request import FLAG, Parameter, Request, one_of, seconds

if TYPE_CHECKING:
    from zacoustic.core.engine.engine import Engine

A = TypeVar("A", bound=msgspec.Struct)

_FOR_S: Final = seconds(math.inf, "with command=begin, seconds above 0")
_WORDS: Final = {CommandKind.SILENCE: "begin", CommandKind.RESUME: "resume"}


class SilenceState(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """The answer about silence."""

    address: int
    """Address of the node."""
    silent: bool
    """Whether it transmits nothing now."""
    commanded: bool
    """Whether a command began the silence; if not, and it is silent, a quiet window did."""
    until_utc: str | None
    """End of the silence, if known."""
    left_s: float | None = None
    """Remaining time, s, if known."""
    why: str = ""
    """For a local node: why it is silent without knowing the time, or maybe for too long."""

    @classmethod
    def of(
        cls, context: RequestContext, node: int, stream_id: int | None, state: CommandState
    ) -> "SilenceState":
        """Return the answer that a node's state is."""
        until_utc, why = None, ""
        if state.left_s is not None:
            until_utc = utc_text(context.utc_ns() + seconds_to_ns(state.left_s))
        if node == context.engine.address:
            why = context.engine.clock.doubt or context.engine.silence.state(context.clock()).doubt
        return cls(
            address=node,
            silent=state.silent or bool(why),
            commanded=state.commanded,
            until_utc=until_utc,
            left_s=state.left_s,
            why=why,
        )

    def state(self) -> CommandState:
        """Return the node's state."""
        return CommandState(silent=self.silent, commanded=self.commanded, left_s=self.left_s)

    def text(self) -> str:
        """Return it in words."""
        if not self.silent:
            return f"node {self.address}: transmits"
        if self.why and not self.commanded:
            return f"node {self.address}: silent: {self.why}"
        why = "commanded" if self.commanded else "a quiet window"
        until = f"until {self.until_utc}" if self.until_utc else "until it is resumed"
        doubt = f" ({self.why})" if self.why else ""
        return f"node {self.address}: silent, {why}, {until}{doubt}"


class StreamState(msgspec.Struct, frozen=True, kw_only=True):
    """The answer about a topic."""

    address: int
    """Address of the node."""
    stream: int
    """Stream id."""
    name: str
    """Its name here; empty: only the other node knows it."""
    on: bool
    """Whether the node sends its samples; if not, they wait, expire and are superseded."""
    min_interval_s: float
    """Minimum time between two samples of a key, s."""
    priority: str
    """Zenoh's priority."""

    @classmethod
    def of(
        cls, context: RequestContext, node: int, stream_id: int | None, state: CommandState
    ) -> "StreamState":
        """Return the answer that a node's state of a topic is."""
        assert stream_id is not None
        stream = context.engine.table.get(stream_id)
        return cls(
            address=node,
            stream=stream_id,
            name="" if stream is None else stream.name,
            on=bool(state.on),
            min_interval_s=state.min_interval_s or 0.0,
            priority=state.priority.name.lower() if state.priority else "",
        )

    def state(self) -> CommandState:
        """Return the node's state."""
        return CommandState(
            on=self.on,
            min_interval_s=self.min_interval_s,
            priority=PRIORITY_NAMES[self.priority],
        )

    def text(self) -> str:
        """Return it in words."""
        name = f"{self.stream} {self.name}".rstrip()
        rate = f", every {self.min_interval_s:g} s at most" if self.min_interval_s else ""
        switch = "on" if self.on else "off"
        return f"node {self.address}, stream {name}: {switch}{rate}, priority {self.priority}"


def _begin(
    answer_of: Callable[[RequestContext, int, int | None, CommandState], A],
    asking: Asking[RemoteCommand, A],
    engine: "Engine",
    now: int,
) -> None:
    """Execute a command for this node, or send it to another one."""
    command, node = asking.question, asking.node
    answer = partial(answer_of, asking.context, node, command.stream_id)
    if node == engine.address:
        engine.commands.execute(command, now, lambda state: asking.answer(answer(state)))
        return
    call_id = engine.commands.send(node, command, now, timeout_s=asking.within_s)
    maybe = "may have executed it" if command.changes else ""
    asking.wait(
        call_id, lambda end: answer(CommandState.from_wire(end.value, end.age_s)), maybe=maybe
    )


def _silence(command: CommandKind = CommandKind.ASK, for_s: float | None = None) -> RemoteCommand:
    if for_s is not None and command is not CommandKind.SILENCE:
        raise ValueError(f"for_s is {for_s:g}; allowed: {_FOR_S.allowed}")
    return RemoteCommand(kind=command, for_s=for_s)


def _override(stream_id: int, reset: str | None = None, **fields: Any) -> RemoteCommand:  # noqa: ANN401 (fields of a command)
    if reset is not None:
        if reset != "true" or fields:
            raise ValueError(f"reset is {reset}; allowed: true, and nothing beside it")
        return RemoteCommand(kind=CommandKind.RESET, stream_id=stream_id)
    kind = CommandKind.OVERRIDE if fields else CommandKind.ASK
    return RemoteCommand(kind=kind, stream_id=stream_id, **fields)


def _overridden(command: RemoteCommand) -> dict[str, object]:
    return {
        "stream_id": command.stream_id,
        "on": command.on,
        "min_interval_s": command.min_interval_s,
        "priority": command.priority and command.priority.name.lower(),
        "reset": True if command.kind is CommandKind.RESET else None,
    }


SILENCE: Final = Request(
    subject="silence",
    parameters={
        "command": one_of({word: kind for kind, word in _WORDS.items()}),
        "for_s": _FOR_S,
    },
    make=_silence,
    tell=lambda command: {"command": _WORDS.get(command.kind), "for_s": command.for_s},
    answer=SilenceState,
    begin=partial(_begin, SilenceState.of),
    within_s=60.0,
    most_s=COMMANDS_TIMEOUT_S,
)
"""Asks whether a node is silent, begins a silence, or ends it."""

STREAM: Final = Request(
    subject="stream/{stream_id}",
    parameters={
        "on": FLAG,
        "min_interval_s": Parameter(real_number, "seconds, 0 or more"),
        "priority": one_of(PRIORITY_NAMES),
        "reset": Parameter(str, "true, and nothing beside it"),
    },
    make=_override,
    tell=_overridden,
    answer=StreamState,
    begin=partial(_begin, StreamState.of),
    within_s=60.0,
    most_s=COMMANDS_TIMEOUT_S,
)
"""Asks how a node sends a topic, overrides it, or ends the override."""


def row_of(command: RemoteCommand) -> Request[RemoteCommand, Any]:
    """Return the request that has a command."""
    return SILENCE if command.stream_id is None else STREAM
