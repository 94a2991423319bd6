"""Remote commands and their answers; the types of both on the wire."""

import enum
from typing import Any, Final, Self

import msgspec

from zacoustic.core.base.qos import PRIORITY_NAMES, Priority
from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable
from zacoustic.errors import LocalError

COMMANDS_STREAM_ID: Final = 175
"""Stream id of remote commands, in every table that does not give it to another stream."""
COMMANDS_TIMEOUT_S: Final = 600.0
"""A command is repeated, and remembered as a call, for this long at most, s."""
LONGEST_SILENCE_S: Final = 366 * 86400.0
"""Longest time of a silence that is to end by itself, s."""
LONGEST_INTERVAL_S: Final = 86400.0
"""Longest minimum interval that can be commanded, s."""
SERIALS: Final = 1 << 16
"""Serial numbers of commands of one boot epoch."""

_SHORTEST_SILENCE_S: Final = 0.1
_INTERVAL_STEP_S: Final = 0.01


def check_timeout(timeout_s: float) -> None:
    """See that a command can be tried for so long.

    Raises:
        LocalError: It cannot.
    """
    if not timeout_s <= COMMANDS_TIMEOUT_S:
        raise LocalError(
            f"timeout_s is {timeout_s:g}; allowed: at most {COMMANDS_TIMEOUT_S:g}",
            hint="a command is repeated for that long at most: give it again when it has failed",
        )


class CommandKind(enum.Enum):
    """What is wanted."""

    ASK = "ask"
    """Nothing but the answer."""
    SILENCE = "silence"
    """Transmit nothing."""
    RESUME = "resume"
    """The end of the commanded silence."""
    OVERRIDE = "tune"
    """Switch a topic off or on, set its least interval, its priority."""
    RESET = "reset"
    """A topic's settings of the node's own configuration."""


class RemoteCommand(msgspec.Struct, frozen=True, kw_only=True):
    """One command, for a node that is named beside it.

    Raises:
        ValueError: Names field, value and what is allowed.
    """

    kind: CommandKind = CommandKind.ASK
    """What is wanted."""
    for_s: float | None = None
    """Of SILENCE: how long, s, 0.1…31 622 400; None: until it is resumed."""
    stream_id: int | None = None
    """Of TUNE and RESET, and of ASK about a topic: which, 1…175."""
    on: bool | None = None
    """Of TUNE: its samples go; None: as it is."""
    min_interval_s: float | None = None
    """Of TUNE: least time between two samples of a key, s, 0…86400; None: as it is."""
    priority: Priority | None = None
    """Of TUNE: Zenoh's priority; None: as it is."""

    def __post_init__(self) -> None:
        """Check that the fields fit.

        Raises:
            ValueError: Names field, value and what is allowed.
        """
        if self.for_s is not None:
            _check("for_s", self.for_s, _SHORTEST_SILENCE_S, LONGEST_SILENCE_S)
            if self.kind is not CommandKind.SILENCE:
                raise ValueError(f"for_s is {self.for_s:g}; allowed: with silence only")
        if self.stream_id is not None:
            _check("stream_id", self.stream_id, 1, COMMANDS_STREAM_ID)
        elif self.kind in (CommandKind.OVERRIDE, CommandKind.RESET):
            raise ValueError(f"stream_id is missing; allowed: a topic to {self.kind.value}")
        if self.kind in (CommandKind.SILENCE, CommandKind.RESUME) and self.stream_id is not None:
            raise ValueError(f"stream_id is {self.stream_id}; allowed: not with {self.kind.value}")
        if self.min_interval_s is not None:
            _check("min_interval_s", self.min_interval_s, 0, LONGEST_INTERVAL_S)
        overridden = [self.on, self.min_interval_s, self.priority]
        if (self.kind is CommandKind.OVERRIDE) == (overridden == [None, None, None]):
            what = "at least one" if self.kind is CommandKind.OVERRIDE else "with tune only"
            raise ValueError(f"on, min_interval_s, priority; allowed: {what}")

    @property
    def changes(self) -> bool:
        """It is more than a question."""
        return self.kind is not CommandKind.ASK

    @property
    def subject(self) -> int:
        """What it is about: a stream id, or 0 for silence."""
        return self.stream_id or 0

    def to_wire(self, serial: int, heard: int | None = None) -> dict[str, Any]:
        """Return the request.

        Args:
            serial: Number of the command.
            heard: Boot epoch of the node that it is for, if that was heard.
        """
        return {
            "serial": serial,
            "order": self.kind.value,
            "for_s": self.for_s,
            "stream": self.stream_id,
            "on": self.on,
            "min_interval_s": self.min_interval_s,
            "priority": _priority_name(self.priority),
            "heard": heard,
        }

    @classmethod
    def from_wire(cls, request: dict[str, Any]) -> tuple[int, Self]:
        """Return serial and command of a request.

        Raises:
            ValueError: Its fields do not fit.
        """
        return request["serial"], cls(
            kind=CommandKind(request["order"]),
            for_s=request["for_s"],
            stream_id=request["stream"],
            on=request["on"],
            min_interval_s=request["min_interval_s"],
            priority=_priority(request["priority"]),
        )


class CommandState(msgspec.Struct, frozen=True, kw_only=True):
    """The state of a node after a command."""

    silent: bool = False
    """It transmits nothing."""
    commanded: bool = False
    """By a command; otherwise, if silent, by a quiet window."""
    left_s: float | None = None
    """How long the silence lasts, as far as that is known, s; None: no end is known, or none."""
    on: bool | None = None
    """Of the topic that was asked for: its samples go; None: none was."""
    min_interval_s: float | None = None
    """Of the topic: least time between two samples of a key, s."""
    priority: Priority | None = None
    """Of the topic: Zenoh's priority."""

    def to_wire(self) -> dict[str, Any]:
        """Return the response."""
        fields = msgspec.structs.asdict(self)
        fields["ordered"] = fields.pop("commanded")  # its name on the wire
        for name, longest in (
            ("left_s", LONGEST_SILENCE_S),
            ("min_interval_s", LONGEST_INTERVAL_S),
        ):
            if fields[name] is not None:
                fields[name] = min(fields[name], longest)
        return fields | {"priority": _priority_name(self.priority)}

    @classmethod
    def from_wire(cls, response: dict[str, Any], age_s: float) -> Self:
        """Return the state in a response.

        Args:
            response: The response.
            age_s: How old it is, s.
        """
        fields = response | {"priority": _priority(response["priority"])}
        state = cls(commanded=fields.pop("ordered"), **fields)
        if state.left_s is None:
            return state
        if state.left_s > age_s:
            return msgspec.structs.replace(state, left_s=state.left_s - age_s)
        return msgspec.structs.replace(state, silent=False, commanded=False, left_s=None)


def command_types() -> TypeTable:
    """Return the types of `REQUEST_TYPE` and `RESPONSE_TYPE`."""
    priorities = tuple(PRIORITY_NAMES)
    of_topic = (
        FieldSpec(name="on", type="bool", optional=True),
        FieldSpec(
            name="min_interval_s",
            type="float64",
            range=(0, LONGEST_INTERVAL_S),
            step=_INTERVAL_STEP_S,
            optional=True,
        ),
        FieldSpec(name="priority", type="enum", values=priorities, optional=True),
    )
    time_s = (0, LONGEST_SILENCE_S)
    return TypeTable(
        [
            TypeSpec(
                name=REQUEST_TYPE,
                fields=(
                    FieldSpec(name="serial", type="uint16"),
                    FieldSpec(
                        name="order", type="enum", values=tuple(each.value for each in CommandKind)
                    ),
                    FieldSpec(
                        name="for_s",
                        type="float64",
                        range=time_s,
                        step=_SHORTEST_SILENCE_S,
                        optional=True,
                    ),
                    FieldSpec(name="stream", type="uint8", optional=True),
                    *of_topic,
                    FieldSpec(name="heard", type="uint16", optional=True),
                ),
            ),
            TypeSpec(
                name=RESPONSE_TYPE,
                fields=(
                    FieldSpec(name="silent", type="bool"),
                    FieldSpec(name="ordered", type="bool"),
                    FieldSpec(
                        name="left_s",
                        type="float64",
                        range=time_s,
                        step=_SHORTEST_SILENCE_S,
                        optional=True,
                    ),
                    *of_topic,
                ),
            ),
        ]
    )


REQUEST_TYPE: Final = "Order"
"""Name of the type of a request."""
RESPONSE_TYPE: Final = "CommandState"
"""Name of the type of a response."""


def _check(name: str, value: float, least: float, most: float) -> None:
    if not least <= value <= most:
        raise ValueError(f"{name} is {value:g}; allowed: {least:.9g}..{most:.9g}")


def _priority(name: str | None) -> Priority | None:
    return None if name is None else PRIORITY_NAMES[name]


def _priority_name(priority: Priority | None) -> str | None:
    return None if priority is None else priority.name.lower()
