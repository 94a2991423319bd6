"""Remote commands as Zenoh keys: queries, and the JSON of their answers.

A `get` returns the state; with parameters it commands::

    @acoustic/2/silence                           is node 2 silent?
    @acoustic/2/silence?command=begin;for_s=1800    silence for half an hour
    @acoustic/2/silence?command=begin               silence until it is resumed
    @acoustic/2/silence?command=resume              the end of it; quiet windows stay
    @acoustic/2/stream/11                         how does node 2 send topic 11?
    @acoustic/2/stream/11?on=false                not at all
    @acoustic/2/stream/11?on=true;min_interval_s=10;priority=background
    @acoustic/2/stream/11?reset=true              as its configuration says

A local gateway answers for its own node, and sends commands to remote nodes across the channel.
`within_s` limits how long it tries, s.
"""

import math
from collections.abc import Callable, Mapping
from typing import Final

import msgspec

from zacoustic.core.base.qos import PRIORITY_NAMES
from zacoustic.core.streams.commands import (
    COMMANDS_TIMEOUT_S,
    CommandKind,
    CommandState,
    RemoteCommand,
)
from zacoustic.text.digits import real_number, whole_number

PREFIX: Final = "@acoustic"
"""First chunk of all keys of gateways and their nodes."""
ANY_NODE: Final = "*"
"""Chunk in place of an address: each local gateway, for its own node."""
DEFAULT_WITHIN_S: Final = 60.0
"""Default time limit of a command across the channel, s."""

_SILENCE: Final = "silence"
_STREAM: Final = "stream"
SUBJECTS: Final = (_SILENCE, f"{_STREAM}/*")
"""Key expressions of the commands for one node, without their prefix."""
_KINDS: Final = {"begin": CommandKind.SILENCE, "resume": CommandKind.RESUME}
_FLAGS: Final = {"true": True, "false": False}
_TEXTS: Final[dict[str, Callable[[RemoteCommand], str | None]]] = {
    "command": lambda command: {kind: word for word, kind in _KINDS.items()}.get(command.kind),
    "for_s": lambda command: None if command.for_s is None else f"{command.for_s:.10g}",
    "on": lambda command: None if command.on is None else str(command.on).lower(),
    "min_interval_s": lambda command: (
        None if command.min_interval_s is None else f"{command.min_interval_s:.10g}"
    ),
    "priority": lambda command: None if command.priority is None else command.priority.name.lower(),
    "reset": lambda command: "true" if command.kind is CommandKind.RESET else None,
}
_ALLOWED: Final = {
    _SILENCE: ("command", "for_s"),
    _STREAM: ("on", "min_interval_s", "priority", "reset"),
}


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


class StreamState(msgspec.Struct, frozen=True, kw_only=True):
    """The answer about a topic."""

    address: int
    """Address of the node."""
    stream: int
    """Stream id."""
    name: str
    """Its name here; empty: only the other node knows it."""
    on: bool
    """The node sends its samples; otherwise they wait, expire and are superseded."""
    min_interval_s: float
    """Minimum time between two samples of a key, s."""
    priority: str
    """Zenoh's priority."""


class Asked(msgspec.Struct, frozen=True, kw_only=True):
    """A command in a query."""

    node: int | None
    """Address; None: each local gateway, for its own node."""
    command: RemoteCommand
    within_s: float
    """Time limit across the channel, s."""


def selector(
    node: int | None, command: RemoteCommand, within_s: float | None = None
) -> tuple[str, str]:
    """Return key expression and parameters of a query.

    Args:
        node: Address; None: the nodes of all local gateways.
        command: The command.
        within_s: Time limit across the channel, s; None: the gateway's default.
    """
    subject = _SILENCE if command.stream_id is None else f"{_STREAM}/{command.stream_id}"
    key = f"{PREFIX}/{ANY_NODE if node is None else node}/{subject}"
    words = [f"{name}={text}" for name, write in _TEXTS.items() if (text := write(command))]
    words += [] if within_s is None else [f"within_s={within_s:.10g}"]
    return key, ";".join(words)


def node_in(key: str, subject: str) -> int | None:
    """Read the node from a key about a subject; None: the key browses, or is about another."""
    chunks = key.split("/")
    is_about = len(chunks) == 3 and chunks[0] == PREFIX and chunks[2] == subject
    return whole_number(chunks[1]) if is_about else None


def time_limit_s(parameters: Mapping[str, str], default_s: float, most_s: float) -> float:
    """Read the time limit of a query, s.

    Raises:
        ValueError: Names it and the allowed values.
    """
    return _number(parameters, "within_s", most_s) or default_s


def read_target(key: str) -> tuple[int | None, int | None] | None:
    """Read the target of a command from its key: node and stream.

    Returns:
        Both, None for all nodes or no stream; or None: the key browses, it is no command.
    """
    chunks = key.split("/")
    if len(chunks) < 3 or chunks[0] != PREFIX:
        return None
    node = whole_number(chunks[1])
    if node is None and chunks[1] != ANY_NODE:
        return None
    if len(chunks) == 3 and chunks[2] == _SILENCE:
        return node, None
    stream_id = whole_number(chunks[3]) if len(chunks) == 4 and chunks[2] == _STREAM else None
    return None if stream_id is None else (node, stream_id)


def read_query(key: str, parameters: Mapping[str, str]) -> Asked | None:
    """Read a command.

    Args:
        key: Key expression of the query.
        parameters: Its parameters.

    Returns:
        The command, or None: the key browses, it is no command.

    Raises:
        ValueError: Names a parameter, its value and the allowed values.
    """
    target = read_target(key)
    if target is None:
        return None
    node, stream_id = target
    said = {name: text for name, text in parameters.items() if not name.startswith("_")}
    within_s = time_limit_s(said, DEFAULT_WITHIN_S, COMMANDS_TIMEOUT_S)
    said.pop("within_s", None)
    subject = _SILENCE if stream_id is None else _STREAM
    for name in said:
        if name not in _ALLOWED[subject]:
            allowed = ", ".join((*_ALLOWED[subject], "within_s"))
            raise ValueError(f"{name} is no parameter of {key}; allowed: {allowed}")
    read = _read_silence if stream_id is None else _read_override
    return Asked(node=node, command=read(said, stream_id), within_s=within_s)


def read_state(payload: bytes, command: RemoteCommand) -> CommandState:
    """Read an answer."""
    if command.stream_id is not None:
        found = msgspec.json.decode(payload, type=StreamState)
        return CommandState(
            on=found.on,
            min_interval_s=found.min_interval_s,
            priority=PRIORITY_NAMES[found.priority],
        )
    state = msgspec.json.decode(payload, type=SilenceState)
    return CommandState(silent=state.silent, commanded=state.commanded, left_s=state.left_s)


def _read_silence(said: Mapping[str, str], stream_id: int | None) -> RemoteCommand:
    word, written = said.get("command"), said.get("for_s")
    if word is not None and word not in _KINDS:
        raise ValueError(f"command is {word}; allowed: {', '.join(_KINDS)}")
    for_s = _number(said, "for_s", math.inf) if word == "begin" else None
    if written is not None and for_s is None:
        raise ValueError(f"for_s is {written}; allowed: with command=begin, seconds above 0")
    return RemoteCommand(kind=CommandKind.ASK if word is None else _KINDS[word], for_s=for_s)


def _read_override(said: Mapping[str, str], stream_id: int | None) -> RemoteCommand:
    if "reset" in said:
        if said != {"reset": "true"}:
            raise ValueError(f"reset is {said['reset']}; allowed: true, and nothing beside it")
        return RemoteCommand(kind=CommandKind.RESET, stream_id=stream_id)
    if not said:
        return RemoteCommand(stream_id=stream_id)
    on, written, name = said.get("on"), said.get("min_interval_s"), said.get("priority")
    if on is not None and on not in _FLAGS:
        raise ValueError(f"on is {on}; allowed: {', '.join(_FLAGS)}")
    if name is not None and name not in PRIORITY_NAMES:
        raise ValueError(f"priority is {name}; allowed: {', '.join(PRIORITY_NAMES)}")
    interval_s = None if written is None else real_number(written)
    if written is not None and interval_s is None:
        raise ValueError(f"min_interval_s is {written}; allowed: seconds, 0 or more")
    return RemoteCommand(
        kind=CommandKind.OVERRIDE,
        stream_id=stream_id,
        on=None if on is None else _FLAGS[on],
        min_interval_s=interval_s,
        priority=None if name is None else PRIORITY_NAMES[name],
    )


def _number(said: Mapping[str, str], name: str, most: float) -> float | None:
    """Read a time above 0; None: it is absent or invalid."""
    written = said.get(name)
    value = None if written is None else real_number(written)
    if value is not None and 0 < value < math.inf and value <= most:
        return value
    if written is not None and name == "within_s":
        raise ValueError(f"within_s is {written}; allowed: seconds above 0, at most {most:g}")
    return None
