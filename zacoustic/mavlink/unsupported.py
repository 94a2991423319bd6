"""What a ground station asks for and does not cross: missions, parameters, files, and the like.

A ground station that gets no answer asks again, and again. Each of these gets one on shore, at no
byte over the water: the refusal that MAVLink has for it, if any, and a text.
"""

from typing import Any, Final

import msgspec

from zacoustic.mavlink.dialect import AUTOPILOT, Message, Received

_UNSUPPORTED: Final = 3  # MAV_MISSION_UNSUPPORTED
_NAK, _UNKNOWN_COMMAND = 129, 7
_FTP_BYTES: Final = 251

_MISSIONS: Final = frozenset(
    {
        "MISSION_COUNT", "MISSION_CLEAR_ALL", "MISSION_REQUEST", "MISSION_REQUEST_INT",
        "MISSION_REQUEST_LIST", "MISSION_REQUEST_PARTIAL_LIST", "MISSION_SET_CURRENT",
        "MISSION_WRITE_PARTIAL_LIST", "MISSION_ITEM", "MISSION_ITEM_INT",
    }
)  # fmt: skip
_PARAMETERS: Final = frozenset({"PARAM_REQUEST_LIST", "PARAM_REQUEST_READ", "PARAM_SET"})
_FILES: Final = frozenset({"FILE_TRANSFER_PROTOCOL"})
_LOGS: Final = frozenset({"LOG_REQUEST_LIST", "LOG_REQUEST_DATA", "LOG_ERASE"})
_STEERING: Final = frozenset(
    {
        "MANUAL_CONTROL", "RC_CHANNELS_OVERRIDE", "SET_ATTITUDE_TARGET",
        "SET_POSITION_TARGET_GLOBAL_INT", "SET_POSITION_TARGET_LOCAL_NED",
    }
)  # fmt: skip
_KINDS: Final = (
    (_MISSIONS, "missions"), (_PARAMETERS, "parameters"), (_FILES, "files"), (_LOGS, "logs"),
    (_STEERING, "steering"),
)  # fmt: skip


class Unsupported(msgspec.Struct, frozen=True, kw_only=True):
    """A request of a ground station that does not cross."""

    target: int
    """System that it is for; 0: all."""
    text: str
    """Why, for people."""
    answer: Message | None
    """What ends it at the ground station; None: MAVLink has nothing for it."""


def read_unsupported(received: Received) -> Unsupported | None:
    """Return what a message asks for in vain; None: nothing, or not of an autopilot."""
    name, fields = received.message.name, received.message.fields
    kind = next((kind for names, kind in _KINDS if name in names), None)
    if kind is None or fields.get("target_component", 0) not in (0, AUTOPILOT):
        return None
    sender = {"target_system": received.system, "target_component": received.component}
    return Unsupported(
        target=int(fields.get("target_system", fields.get("target", 0))),
        text=f"{name}: unsupported ({kind})",
        answer=_answer(name, fields, sender),
    )


def _answer(name: str, fields: dict[str, Any], sender: dict[str, int]) -> Message | None:
    if name in _MISSIONS:
        kind = fields.get("mission_type", 0)
        return Message("MISSION_ACK", {**sender, "type": _UNSUPPORTED, "mission_type": kind})
    if name in _FILES:
        return Message(
            "FILE_TRANSFER_PROTOCOL",
            {"target_network": 0, **sender, "payload": _refused_file(fields["payload"])},
        )
    return None


def _refused_file(request: Any) -> list[int]:  # noqa: ANN401 (a list or bytes of the dialect)
    """Return the payload of a refusal: number, session, opcode, size, request, …, reason."""
    asked = bytes(request).ljust(12, b"\0")
    number = (int.from_bytes(asked[:2], "little") + 1) % 2**16
    head = number.to_bytes(2, "little") + bytes([asked[2], _NAK, 1, asked[3], 0, 0])
    return list((head + asked[8:12] + bytes([_UNKNOWN_COMMAND])).ljust(_FTP_BYTES, b"\0"))
