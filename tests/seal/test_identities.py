"""Identities: which keys two nodes share, who is shut out, and what a list may show."""

import itertools
from pathlib import Path

import msgspec
import pytest

from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.wire.seal import Way
from zacoustic.seal.ccm import MemberCipher
from zacoustic.seal.identities import (
    Identity,
    Members,
    broadcast_secret,
    new_identity,
    read_identity,
    read_members,
    unicast_key,
    write_identity,
    write_members,
)
from zacoustic.seal.keys import KeyFileError

ADDRESSES = (1, 2, 3)
NONCE = bytes(13)


@pytest.fixture
def identities() -> dict[int, Identity]:
    return {each: new_identity("harbour", each) for each in ADDRESSES}


@pytest.fixture
def members(identities: dict[int, Identity]) -> Members:
    made = Members(network="harbour")
    for identity in identities.values():
        made = made.joined(identity)
    for identity in identities.values():
        made = made.wrapped_by(identity)
    return made


def _ciphers(identities: dict[int, Identity], members: Members) -> dict[int, MemberCipher]:
    return {each: MemberCipher(identities[each], members) for each in members.public}


def test_both_ends_of_a_pair_have_its_keys_and_nobody_else_has(
    identities: dict[int, Identity], members: Members
) -> None:
    made: dict[bytes, tuple[int, int]] = {}
    for source, destination in itertools.permutations(ADDRESSES, 2):
        ends = [identities[source], identities[destination]]
        (key,) = {unicast_key(each, members, source, destination) for each in ends}
        assert made.setdefault(key, (source, destination)) == (source, destination)
    later = members.rotated(identities.values())
    assert unicast_key(identities[1], later, 1, 2) not in made
    others = msgspec.structs.replace(members, network="bay")
    assert unicast_key(identities[1], others, 1, 2) not in made


def test_all_have_the_key_of_a_sources_broadcasts(
    identities: dict[int, Identity], members: Members
) -> None:
    for source in ADDRESSES:
        keys = {broadcast_secret(each, members, source) for each in identities.values()}
        assert len(keys) == 1
        assert None not in keys


def test_frames_are_opened_by_those_they_are_for(
    identities: dict[int, Identity], members: Members
) -> None:
    ciphers = _ciphers(identities, members)
    for destination in (2, BROADCAST):
        way = Way(1, destination)
        body = ciphers[1].seal(way, NONCE, b"records", b"head")
        opened = {each: ciphers[each].open(0, way, NONCE, body, b"head") for each in ADDRESSES}
        may = {1, 2} if destination == 2 else {1, 2, 3}
        assert {each for each, records in opened.items() if records == b"records"} == may
        for wrong in (Way(3, destination), Way(1, 3), Way(1, destination, strong=True)):
            assert ciphers[2].open(0, wrong, NONCE, body, b"head") is None


def test_a_revoked_node_opens_nothing_of_the_next_generation_and_nothing_of_it_is_opened(
    identities: dict[int, Identity], members: Members
) -> None:
    old = _ciphers(identities, members)
    left = members.without(2, identities.values())
    assert sorted(left.public) == [1, 3]
    assert left.generation == 1
    assert left.former is None
    new = _ciphers(identities, left)
    with pytest.raises(KeyFileError, match="node 2 is not in the list of generation 1"):
        MemberCipher(identities[2], left)
    for way in (Way(1, BROADCAST), Way(1, 2), Way(1, 3)):
        body = new[1].seal(way, NONCE, b"records", b"head")
        assert old[2].open(1, way, NONCE, body, b"head") is None
        assert old[2].open(0, way, NONCE, body, b"head") is None
    for way in (Way(2, BROADCAST), Way(2, 1)):
        body = old[2].seal(way, NONCE, b"records", b"head")
        assert new[1].open(0, way, NONCE, body, b"head") is None
        assert new[1].open(1, way, NONCE, body, b"head") is None
    # Whatever it puts on the list itself: it has no secret of another one's broadcasts.
    forged = left.joined(identities[2]).wrapped_by(identities[2])
    assert broadcast_secret(identities[2], forged, 1) is None


def test_a_rotation_opens_frames_of_the_generation_before(
    identities: dict[int, Identity], members: Members
) -> None:
    old = _ciphers(identities, members)
    new = _ciphers(identities, members.rotated(identities.values()))
    for way in (Way(2, BROADCAST), Way(2, 1)):
        body = old[2].seal(way, NONCE, b"records", b"head")
        assert new[1].open(0, way, NONCE, body, b"head") == b"records"
    new[1].end_overlap()
    assert new[1].open(0, Way(2, 1), NONCE, body, b"head") is None
    settled = members.rotated(identities.values()).rotated(identities.values()).settled()
    assert settled.generation == 2
    assert settled.former is None


def test_whose_identity_is_not_there_is_not_heard_by_all_until_it_wraps(
    identities: dict[int, Identity], members: Members
) -> None:
    later = members.rotated([identities[1]])
    assert broadcast_secret(identities[3], later, 1) is not None
    assert broadcast_secret(identities[3], later, 2) is None
    assert broadcast_secret(identities[3], later.wrapped_by(identities[2]), 2) is not None


def test_a_key_that_gives_the_same_to_everybody_is_refused(
    identities: dict[int, Identity], members: Members
) -> None:
    for half in (bytes(32), b"\1" + bytes(31), b"short"):
        public = members.public | {2: half}
        false = msgspec.structs.replace(members, public=public)
        with pytest.raises(KeyFileError, match="is no public key"):
            unicast_key(identities[1], false, 1, 2)
        cipher = MemberCipher(identities[1], false)
        body = cipher.seal(Way(1, 2), NONCE, b"records", b"head")
        assert cipher.open(0, Way(2, 1), NONCE, body, b"head") is None


def test_files_come_back_and_only_the_list_may_be_read(
    tmp_path: Path, identities: dict[int, Identity], members: Members
) -> None:
    path, listed = tmp_path / "auv1.identity", tmp_path / "fleet.members"
    write_identity(path, identities[2])
    write_members(listed, members)
    assert read_identity(path) == identities[2]
    assert read_members(listed) == members
    for identity in identities.values():
        assert identity.private.hex() not in repr(identity)
        assert identity.private not in listed.read_bytes()
    with pytest.raises(KeyFileError, match="there is a key already"):
        write_identity(path, identities[1])
    path.chmod(0o644)
    with pytest.raises(KeyFileError, match="others may read it"):
        read_identity(path)
    listed.write_bytes(b'{"network":"harbour","public":{"1":3}}')
    with pytest.raises(KeyFileError, match="no list of members"):
        read_members(listed)


@pytest.mark.parametrize(
    "content",
    [
        b'{"network":"n","public":{"300":"' + b"A" * 43 + b'="}}',
        b'{"network":"n","public":{"0":"' + b"A" * 43 + b'="}}',
        b'{"network":"n","public":{"1":"AAAA"}}',
        b'{"network":"n","wrapped":{"255":{}}}',
        b'{"network":"n","generation":70000}',
        b'{"network":"","generation":0}',
        b'{"network":"n","former":{"network":"n","generation":-1}}',
        b'{"network":"n","former":' * 100_000,
        b"\xff",
    ],
    ids=range(9),
)
def test_a_list_that_is_none_is_refused_by_name(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "fleet.members"
    path.write_bytes(content)
    with pytest.raises(KeyFileError, match=r"fleet\.members: "):
        read_members(path)


def test_a_fingerprint_tells_lists_apart(identities: dict[int, Identity], members: Members) -> None:
    others = [
        members.rotated(identities.values()),
        members.without(3, identities.values()),
        msgspec.structs.replace(members, network="bay"),
        members.joined(new_identity("harbour", 4)),
    ]
    assert len({members.fingerprint, *(each.fingerprint for each in others)}) == 5
    with pytest.raises(KeyFileError, match="node 2 has another identity"):
        members.joined(new_identity("harbour", 2))
    with pytest.raises(KeyFileError, match="is of network bay"):
        members.joined(new_identity("bay", 4))
