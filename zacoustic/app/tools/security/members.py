"""The members file and the identities beside it, as kept on land.

Identities are in the folder of the list, as ``NAME.identity``. Those present wrap their broadcast
secret for all members; the report names the others, whose broadcasts somebody cannot open.
"""

import json
from pathlib import Path
from typing import Final

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


def is_list(path: Path) -> bool:
    """Tell whether a readable file is a members file."""
    try:
        content = json.loads(path.read_bytes())
    except (OSError, ValueError, RecursionError):
        return False
    return isinstance(content, dict) and "public" in content


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
