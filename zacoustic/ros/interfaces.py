"""`Interfaces`: all interface definitions of one ROS distribution, and those of user packages."""

from collections.abc import Iterable
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from zacoustic.errors import ConfigError
from zacoustic.ros.hashes import rihs01
from zacoustic.ros.members import UNSUPPORTED, Member, Members
from zacoustic.ros.names import NO_HASH
from zacoustic.ros.shipped import shipped
from zacoustic.ros.tokens import EXTRA_HINT

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

HEADER: Final = "std_msgs/msg/Header"
"""The header: stamp and frame."""
DEFAULT_DISTRO: Final = "jazzy"
"""The default distribution."""

_WITHOUT_HASH: Final = "humble"
# Types have descriptions where they have hashes.
_DESCRIPTIONS: Final = "type_description_interfaces/"
_PREFIX: Final = "ros2_"
# rmw_zenoh exists from Humble on.
_TOO_OLD: Final = ("dashing", "eloquent", "foxy", "galactic")


class Interfaces:
    """The interfaces of one distribution.

    Args:
        distro: Its name, such as ``jazzy``; ``rolling`` is the newest available.
        folder: Folder of user packages, or None.

    Raises:
        ConfigError: `rosbags` is not installed, the distribution is unknown, or a definition
            cannot be read.
    """

    def __init__(self, distro: str = DEFAULT_DISTRO, folder: Path | None = None) -> None:
        self.distro = distro
        self._members = dict(_known(distro))
        self._hashes: dict[str, str] = {}
        self._store: Typestore | None = None
        if folder is not None:
            from zacoustic.ros.parsing import read_folder

            self._members |= read_folder(folder)

    def __contains__(self, name: object) -> bool:
        return name in self._members

    def members(self, name: str) -> Members:
        """Return the members of an interface.

        Raises:
            ConfigError: It or an interface that it uses is unknown.
        """
        found = self._members.get(name)
        if found is None and (kind := name.rpartition("/")[2]) in UNSUPPORTED:
            raise ConfigError(
                f"{name.split('/')[0]}: a member is a {kind}, which cannot cross; "
                "allowed: the types of .msg files, but wstring",
                hint="make it a string, or an integer",
            )
        if found is None:
            close = get_close_matches(name, self._members, 1)
            raise ConfigError(
                f'"{name}" is no interface of {self.distro}',
                hint=f'did you mean "{close[0]}"?'
                if close
                else "name the folder with its package: ros: { packages: FOLDER }",
            )
        return found

    def hash_of(self, name: str) -> str:
        """Return the hash of a message, a service or an action, as in keys.

        Raises:
            ConfigError: It is unknown.
        """
        if self.distro == _WITHOUT_HASH:
            self.members(name)
            return NO_HASH
        if name not in self._hashes:
            self._hashes[name] = rihs01(name, self.members)
        return self._hashes[name]

    def store(self, name: str) -> "Typestore":
        """Return the `rosbags` store that reads and writes an interface in CDR.

        Raises:
            ConfigError: It is unknown.
        """
        from rosbags.typesys import Stores, get_typestore

        if self._store is None:
            self._store = get_typestore(Stores.EMPTY)
        missing = [each for each in self._used(name, []) if each not in self._store.fielddefs]
        if missing:
            entries: Any = {each: ([], list(map(_entry, self._members[each]))) for each in missing}
            self._store.register(entries)
        return self._store

    def _used(self, name: str, found: list[str]) -> Iterable[str]:
        if name not in found:
            found.append(name)
            for member in self.members(name):
                if member.is_nested:
                    self._used(member.type, found)
        return found


def has_header(interfaces: Interfaces, name: str) -> bool:
    """Return whether a message has a header."""
    return any(
        member.name == "header" and member.type == HEADER and not member.is_sequence
        for member in interfaces.members(name)
    )


def stamped_list(interfaces: Interfaces, name: str) -> Member | None:
    """Return the one member of a message that is a list of messages with a header, as of TF.

    None: there is no such member, or there are several.
    """
    found = [
        member
        for member in interfaces.members(name)
        if (member.is_sequence or member.is_array)
        and member.is_nested
        and has_header(interfaces, member.type)
    ]
    return found[0] if len(found) == 1 else None


def distros() -> tuple[str, ...]:
    """Return the names of the known distributions, oldest first.

    Raises:
        ConfigError: `rosbags` is not installed.
    """
    try:
        from rosbags.typesys import Stores
    except ImportError as error:
        raise ConfigError("ROS 2 needs the package rosbags", hint=EXTRA_HINT) from error
    names = [store.value.removeprefix(_PREFIX) for store in Stores if _PREFIX in store.value]
    return tuple(name for name in names if name not in _TOO_OLD)


@cache
def _known(distro: str) -> dict[str, Members]:
    """Return what a distribution ships: messages of `rosbags`, and what it lacks."""
    known = distros()
    if distro not in (*known, "rolling"):
        raise ConfigError(f'"{distro}"; allowed: {", ".join(known)}, rolling')
    from rosbags.typesys import Stores, get_typestore

    from zacoustic.ros.parsing import members_of, parse_definition

    store = get_typestore(Stores(_PREFIX + (known[-1] if distro == "rolling" else distro)))
    found: dict[str, Members] = {}
    for name, text in shipped().items():
        if distro == _WITHOUT_HASH and name.startswith(_DESCRIPTIONS):
            continue
        found |= parse_definition(name, text)
    found |= {name: members_of(entries) for name, (_, entries) in store.fielddefs.items()}
    return found


def _entry(member: Member) -> tuple[str, Any]:
    """Return a member in the form of `rosbags`."""
    from rosbags.interfaces import Nodetype

    described: Any = (
        (Nodetype.NAME, member.type)
        if member.is_nested
        else (Nodetype.BASE, (member.type, member.most_characters))
    )
    if member.is_array:
        described = (Nodetype.ARRAY, (described, member.count))
    elif member.is_sequence:
        described = (Nodetype.SEQUENCE, (described, member.count))
    return member.name, described
