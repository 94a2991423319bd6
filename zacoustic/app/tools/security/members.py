"""The members file and the identities beside it, as kept on land.

Identities are in the folder of the list, as ``NAME.identity``. Those present wrap their broadcast
secret for all members; the report names the others, whose broadcasts somebody cannot open.
"""

import json
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.seal.identities import (
    Identity,
    Members,
    new_identity,
    read_identity,
    read_members,
    write_identity,
    write_members,
)
from zacoustic.seal.keys import KeyFileError

PATTERN: Final = "*.identity"
"""Names of identities beside a list."""


class MembersReport(msgspec.Struct, frozen=True, kw_only=True):
    """The public facts about a members file."""

    file: str
    """Its name."""
    network: str
    """Name of the network."""
    generation: int
    """Generation of the keys, counted from 0."""
    fingerprint: str
    """Eight hexadecimal digits, equal if network, generation and members are."""
    members: tuple[int, ...]
    """Addresses of the members."""
    unheard: tuple[int, ...]
    """Nodes whose broadcast key some member lacks."""
    opens_former: bool
    """Frames of the generation before are opened as well."""


def is_list(path: Path) -> bool:
    """Tell whether a readable file is a members file."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and "public" in content


def report_on(path: Path, members: Members) -> MembersReport:
    """Return the public facts about a members file."""
    listed = sorted(members.public)
    unheard = [
        source
        for source in listed
        if any(each not in members.wrapped.get(source, {}) for each in listed if each != source)
    ]
    return MembersReport(
        file=str(path),
        network=members.network,
        generation=members.generation,
        fingerprint=members.fingerprint,
        members=tuple(listed),
        unheard=tuple(unheard),
        opens_former=members.former is not None,
    )


def as_text(report: MembersReport) -> str:
    """Return the report as lines."""
    former = f", opens generation {report.generation - 1} too" if report.opens_former else ""
    lines = [
        f"{report.file}: network {report.network}, generation {report.generation}, fingerprint "
        f"{report.fingerprint}{former}",
        f"members: {', '.join(map(str, report.members)) or 'none'}",
    ]
    if report.unheard:
        nodes = ", ".join(map(str, report.unheard))
        lines.append(f"not everybody opens broadcasts of node {nodes}: its identity is not here")
    return "\n".join(lines)


def enrol(identity_path: Path, list_path: Path, network: str, address: int) -> Members:
    """Make an identity and add it to a list, which is made if it is missing.

    Raises:
        KeyFileError: The identity exists already, or the node is on the list with another one.
    """
    members = Members(network=network)
    if list_path.exists():
        members = read_members(list_path)
    identity = new_identity(network, address)
    members = members.joined(identity)
    write_identity(identity_path, identity)
    for each in {*_beside(list_path), identity_path.resolve()}:
        members = _wrapped(members, read_identity(each))
    write_members(list_path, members)
    return members


def rotate(list_path: Path, *, end_overlap: bool) -> Members:
    """Make the next generation, or remove the former one.

    Raises:
        KeyFileError: A file cannot be used, or there is no next generation.
    """
    members = read_members(list_path)
    members = members.settled() if end_overlap else members.rotated(_identities(list_path, members))
    write_members(list_path, members)
    return members


def revoke(list_path: Path, address: int) -> Members:
    """Make the next generation without a node, and without the former generation.

    Raises:
        KeyFileError: A file cannot be used, or the node is not on the list.
    """
    members = read_members(list_path)
    members = members.without(address, _identities(list_path, members))
    write_members(list_path, members)
    return members


def _beside(list_path: Path) -> list[Path]:
    return sorted(each.resolve() for each in list_path.resolve().parent.glob(PATTERN))


def _identities(list_path: Path, members: Members) -> list[Identity]:
    """Return the identities beside a list whose nodes are on it."""
    found = [read_identity(each) for each in _beside(list_path)]
    return [each for each in found if members.public.get(each.address) == each.public]


def _wrapped(members: Members, identity: Identity) -> Members:
    try:
        return members.wrapped_by(identity)
    except KeyFileError:  # not on the list: outdated, or of another network
        return members
