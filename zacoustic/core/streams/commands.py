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
"""The longest time for which a command is repeated, and remembered as a call, s."""
LONGEST_SILENCE_S: Final = 366 * 86400.0
"""The longest silence that ends by itself, s."""
LONGEST_INTERVAL_S: Final = 86400.0
"""The longest minimum interval that can be commanded, s."""
SERIALS: Final = 1 << 16
"""The number of serials of one boot epoch."""

_SHORTEST_SILENCE_S: Final = 0.1
_INTERVAL_STEP_S: Final = 0.01


def check_timeout(timeout_s: float) -> None:
    """Check that a command can be tried for so long.

    Raises:
        LocalError: It cannot.
    """
    if not timeout_s <= COMMANDS_TIMEOUT_S:
        raise LocalError(
            f"timeout_s is {timeout_s:g}; allowed: at most {COMMANDS_TIMEOUT_S:g}",
            hint="a command is repeated for that long at most: give it again when it has failed",
        )


class CommandKind(enum.Enum):
    """What a command asks for."""

    ASK = "ask"
    """Ask for the state only."""
    SILENCE = "silence"
    """Begin transmit silence."""
    RESUME = "resume"
    """End the commanded silence."""
    OVERRIDE = "tune"
    """Switch a topic off or on, or set its minimum interval or its priority."""
    RESET = "reset"
    """Return a topic to the settings of the node's own config."""


class RemoteCommand(msgspec.Struct, frozen=True, kw_only=True):
    """One command; its destination is stated beside it.

    Raises:
        ValueError: States field, value and what is allowed.
    """

    kind: CommandKind = CommandKind.ASK
    """What the command asks for."""
    for_s: float | None = None
    """For SILENCE: its duration, s, 0.1…31 622 400; None: until it is resumed."""
    stream_id: int | None = None
    """For OVERRIDE and RESET, and for ASK about a topic: its stream id, 1…175."""
    on: bool | None = None
    """For OVERRIDE: whether the topic's samples are sent; None: unchanged."""
    min_interval_s: float | None = None
    """For OVERRIDE: minimum time between two samples of a key, s, 0…86400; None: unchanged."""
    priority: Priority | None = None
    """For OVERRIDE: the Zenoh priority; None: unchanged."""

    def __post_init__(self) -> None:
        """Check that the fields fit together.

        Raises:
            ValueError: States field, value and what is allowed.
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
        """Whether it changes anything: every command but ASK."""
        return self.kind is not CommandKind.ASK

    @property
    def subject(self) -> int:
        """Its object: a stream id, or 0 for silence."""
        return self.stream_id or 0

    def to_wire(self, serial: int, heard: int | None = None) -> dict[str, Any]:
        """Return the request.

        Args:
            serial: The command's serial.
            heard: Boot epoch of the destination, if it was heard.
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
            ValueError: Its fields do not fit together.
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
    """Whether it transmits nothing."""
    commanded: bool = False
    """Whether the silence is commanded; otherwise, if silent, it is a quiet window."""
    left_s: float | None = None
    """How long the silence lasts, as far as known, s; None: no known end, or no silence."""
    on: bool | None = None
    """Whether the samples of the command's topic are sent; None: it had no topic."""
    min_interval_s: float | None = None
    """The topic's minimum time between two samples of a key, s."""
    priority: Priority | None = None
    """The topic's Zenoh priority."""

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
    def from_wire(cls, response: dict[str, Any], age_s: float | None) -> Self:
        """Return the state in a response.

        Args:
            response: The response.
            age_s: Its age, s; None: unknown, and so then is how long the silence lasts.
        """
        fields = response | {"priority": _priority(response["priority"])}
        state = cls(commanded=fields.pop("ordered"), **fields)
        if state.left_s is None or age_s is None:
            return msgspec.structs.replace(state, left_s=None)
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
