"""Reads definitions from the text of ``.msg``, ``.srv``, ``.action`` and ``.idl`` files.

`rosbags` reads messages. A service consists of two messages and an action of three, separated by
lines of ``---``. This module adds what ROS derives from them: the event of a service, and the two
services and the feedback message of an action. An ``.idl`` file has one struct for each part. If a
file of the older kinds has the same name, the ``.idl`` file was generated from it and is ignored.

Members of types that cannot cross (`UNSUPPORTED`) get a nested type of that name, so a package may
have them; using one is an error.
"""

import re
from pathlib import Path
from typing import Any, Final

import msgspec
from rosbags.interfaces import Nodetype
from rosbags.typesys import TypesysError, get_types_from_idl, get_types_from_msg

from zacoustic.errors import ConfigError
from zacoustic.ros.members import PLACEHOLDER, UNSUPPORTED, Member, Members
from zacoustic.ros.names import is_interface

SUFFIXES: Final = (".msg", ".srv", ".action")
"""Suffixes of files with definitions; without its dot it is the kind of the interface."""
IDL: Final = ".idl"
"""Suffix of files whose kind is the name of their folder."""

_PARTS: Final = {
    "msg": ("",),
    "srv": ("_Request", "_Response"),
    "action": ("_Goal", "_Result", "_Feedback"),
}
_WIDE: Final = re.compile(r"^(\s*wstring)<=\d+", re.MULTILINE)
_PREPROCESSED: Final = re.compile(r"^\s*#.*$", re.MULTILINE)
_DASHES: Final = re.compile(r"^---\s*(?:#.*)?$", re.MULTILINE)
_UUID: Final = "unique_identifier_msgs/msg/UUID"
_TIME: Final = "builtin_interfaces/msg/Time"


def parse_definition(name: str, text: str) -> dict[str, Members]:
    """Read the definition of an interface.

    Args:
        name: ``PACKAGE/msg|srv|action/Name``.
        text: The content of its file.

    Returns:
        The members of the interface and of all that is derived from it, by name.

    Raises:
        ConfigError: It is not a valid definition.
    """
    package, kind, _ = name.split("/")
    parts = _DASHES.split(_WIDE.sub(r"\1", text))
    suffixes = _PARTS[kind]
    if len(parts) != len(suffixes):
        raise ConfigError(
            f"{name}: {len(parts) - 1} lines of ---; allowed: {len(suffixes) - 1} in a .{kind} file"
        )
    found: dict[str, Members] = {}
    for suffix, part in zip(suffixes, parts, strict=True):
        found[name + suffix] = _parse_message(package, name + suffix, part)
    return found | _made_of(name)


def parse_idl(name: str, text: str) -> dict[str, Members]:
    """Read an interface definition in OMG IDL as used by ROS; see `parse_definition`.

    Raises:
        ConfigError: It is not a valid definition, or not of this interface.
    """
    package, kind, _ = name.split("/")
    try:
        types = get_types_from_idl(_PREPROCESSED.sub("", text))
    except (TypesysError, ValueError) as error:
        raise _no_definition(name, error) from error
    found: dict[str, Members] = {}
    for suffix in _PARTS[kind]:
        if name + suffix not in types:
            raise ConfigError(f"{name}: the file has no struct {(name + suffix).split('/')[2]}")
        found[name + suffix] = tuple(
            msgspec.structs.replace(member, type=f"{package}/msg/{member.type}")
            if member.type in UNSUPPORTED
            else member
            for member in members_of(types[name + suffix][1])
        )
    return found | _made_of(name)


def read_folder(folder: Path) -> dict[str, Members]:
    """Read all definitions below a folder: files ``PACKAGE/msg/Name.msg`` and so on.

    Raises:
        ConfigError: There is none, or one cannot be read; names the file.
    """
    found: dict[str, Members] = {}
    for path in sorted(each for each in folder.rglob("*") if each.suffix in (*SUFFIXES, IDL)):
        kind, is_idl = path.parent.name, path.suffix == IDL
        if is_idl and path.with_suffix(f".{kind}").exists():
            continue
        name = "/".join((path.parent.parent.name, kind, path.stem))
        if f".{kind}" not in (SUFFIXES if is_idl else (path.suffix,)) or not is_interface(name):
            raise ConfigError(f"{path} stands elsewhere; allowed: PACKAGE/msg/Name.msg and so on")
        read = parse_idl if is_idl else parse_definition
        try:
            found |= read(name, path.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise ConfigError(f"{path} cannot be read: {error}") from error
        except ConfigError as error:
            raise ConfigError(f"{path}: {error.args[0]}", hint=error.hint) from error
    if not found:
        raise ConfigError(f"{folder} has no .msg, .srv, .action or .idl file")
    return found


def members_of(entries: Any) -> Members:  # noqa: ANN401 (rosbags' own form)
    """Return the members of a definition that `rosbags` has read."""
    return tuple(_member(name, described) for name, described in entries) or PLACEHOLDER


def with_event(service: str) -> dict[str, Members]:
    """Return a service and its event, which the service's hash covers."""
    request, response = f"{service}_Request", f"{service}_Response"
    return {
        f"{service}_Event": (
            Member(name="info", type="service_msgs/msg/ServiceEventInfo"),
            Member(name="request", type=request, is_sequence=True, count=1),
            Member(name="response", type=response, is_sequence=True, count=1),
        ),
        service: (
            Member(name="request_message", type=request),
            Member(name="response_message", type=response),
            Member(name="event_message", type=f"{service}_Event"),
        ),
    }


def _made_of(name: str) -> dict[str, Members]:
    """Return the interfaces that ROS derives from the parts of one."""
    kind = name.split("/")[1]
    if kind == "srv":
        return with_event(name)
    return _of_action(name) if kind == "action" else {}


def _of_action(action: str) -> dict[str, Members]:
    goal_id = Member(name="goal_id", type=_UUID)
    send, get = f"{action}_SendGoal", f"{action}_GetResult"
    return {
        f"{send}_Request": (goal_id, Member(name="goal", type=f"{action}_Goal")),
        f"{send}_Response": (
            Member(name="accepted", type="bool"),
            Member(name="stamp", type=_TIME),
        ),
        f"{get}_Request": (goal_id,),
        f"{get}_Response": (
            Member(name="status", type="int8"),
            Member(name="result", type=f"{action}_Result"),
        ),
        f"{action}_FeedbackMessage": (
            goal_id,
            Member(name="feedback", type=f"{action}_Feedback"),
        ),
        **with_event(send),
        **with_event(get),
    }


def _parse_message(package: str, name: str, text: str) -> Members:
    # Named like a message of the package, since members may omit the package of its other types.
    stand_in = f"{package}/msg/StandIn"
    try:
        types = get_types_from_msg(text, stand_in)
    except (TypesysError, ValueError) as error:
        raise _no_definition(name, error) from error
    return members_of(types[stand_in][1])


def _no_definition(name: str, error: Exception) -> ConfigError:
    return ConfigError(f"{name}: no definition: {' '.join(str(error).split())}")


def _member(name: str, described: Any) -> Member:  # noqa: ANN401
    node, rest = described
    count, is_array, is_sequence = 0, False, False
    if node in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        is_array, is_sequence = node == Nodetype.ARRAY, node == Nodetype.SEQUENCE
        (node, rest), count = rest
    if node == Nodetype.NAME:
        return Member(name=name, type=rest, is_array=is_array, is_sequence=is_sequence, count=count)
    return Member(
        name=name,
        type=rest[0],
        most_characters=rest[1],
        is_array=is_array,
        is_sequence=is_sequence,
        count=count,
    )
