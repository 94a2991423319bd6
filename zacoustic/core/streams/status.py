"""The status of a node, as another one asks for it: the service's id, and its type on the wire."""

import enum
from typing import Any, Final, Self

import msgspec

from zacoustic.core.values.types import FieldSpec, TypeSpec, TypeTable

STATUS_STREAM_ID: Final = 174
"""Stream id of the status, in every table that does not give it to another stream."""
STATUS_TIMEOUT_S: Final = 60.0
"""A question is repeated, and remembered as a call, for this long at most, s."""
STATUS_TYPE: Final = "NodeStatus"
"""Name of the type of a response."""

_LONGEST_ERROR_S: Final = 3600.0
_LATEST_UTC_S: Final = (1 << 32) - 1
_LONGEST_RANGE_M: Final = 65_535
_MOST_STARTS: Final = 65_535


class JournalStatus(enum.Enum):
    """What a node has of its former lives."""

    NONE = "none"
    """It has no journal."""
    KEPT = "kept"
    """Its journal is in order."""
    DOUBTED = "doubted"
    """It was damaged, or an old copy of it was put back."""
    FAILING = "failing"
    """It cannot be written now."""


class NodeStatus(msgspec.Struct, frozen=True, kw_only=True):
    """What a node says of itself."""

    journal: JournalStatus
    """What it has of its former lives."""
    starts: int
    """Starts of the node that its journal has seen, this one included, at most 65 535; 0: none."""
    utc_s: int | None = None
    """What its clock shows, s since 1970; None: nobody has told it."""
    clock_error_s: float | None = None
    """How wrong that is at most, s, at most 3600; None: nothing keeps it right."""
    range_m: int | None = None
    """How far away the asking node is, as its modem has measured, m; None: it has not."""
    schedule: int = 0
    """A digest of the slots or turns of its first link; 0: it has none."""

    def to_wire(self) -> dict[str, Any]:
        """Return the response."""
        fields = msgspec.structs.asdict(self)
        fields["journal"] = self.journal.value
        fields["starts"] = min(self.starts, _MOST_STARTS)
        if self.utc_s is not None:
            fields["utc_s"] = min(max(0, self.utc_s), _LATEST_UTC_S)
        if self.clock_error_s is not None:
            fields["clock_error_s"] = min(self.clock_error_s, _LONGEST_ERROR_S)
        if self.range_m is not None:
            fields["range_m"] = min(self.range_m, _LONGEST_RANGE_M)
        return fields

    @classmethod
    def from_wire(cls, response: dict[str, Any]) -> Self:
        """Return the status in a response."""
        return cls(**response | {"journal": JournalStatus(response["journal"])})


def status_types() -> TypeTable:
    """Return the type of `STATUS_TYPE`."""
    fields = (
        FieldSpec(name="journal", type="enum", values=tuple(each.value for each in JournalStatus)),
        FieldSpec(name="starts", type="uint16"),
        FieldSpec(name="utc_s", type="uint32", optional=True),
        FieldSpec(
            name="clock_error_s", type="float64", range=(0, _LONGEST_ERROR_S), step=0.01,
            optional=True,
        ),
        FieldSpec(name="range_m", type="uint16", optional=True),
        FieldSpec(name="schedule", type="uint16"),
    )  # fmt: skip
    return TypeTable([TypeSpec(name=STATUS_TYPE, fields=fields)])
