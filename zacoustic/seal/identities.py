"""A key for each node: identities, the list of members, and the keys that follow from both.

With a *fleet key* every member can speak as any other, and one captured node gives the whole fleet
away. With identities each node has an X25519 key pair. Its private half is in a file of its own,
mode 0600. The public halves of all nodes are in the *members* file, which is not secret but must be
authentic: compare its fingerprint. No handshake crosses the channel.

    pair        HKDF(X25519(own, theirs), network, wire, generation, lower, higher address)
    unicast     expand(pair, "frame", source, destination)
    broadcast   expand(secret of the source, "frame", source)

The secret for a source's broadcasts follows from its identity and the generation. The members file
carries it to the other nodes, wrapped for each of them (AES key wrap, RFC 3394) under a key of the
pair. Each generation has its own keys. To *revoke* a node, make the next generation without it:
nothing that the node has learnt of the former generation opens a frame of the new one.

A node that the list does not name yet, or whose secret is not wrapped in it, can be heard by a
submerged one all the same, if a third node sends that secret across the channel, wrapped for it:

    carried     key wrap of the secret under expand(pair, "carry", source, sender, destination)

Any member can still forge a broadcast of any source, because it holds the secret that opens them.
A frame for one node can be forged only by its two ends.
"""

import hashlib
import hmac
import secrets
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import msgspec
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.keywrap import (
    InvalidUnwrap,
    aes_key_unwrap,
    aes_key_wrap,
)

from zacoustic.seal.keys import (
    KEY_BYTES,
    LAST_GENERATION,
    SECRET_BYTES,
    KeyFileError,
    check_network,
    expand,
    is_network,
    key_info,
    read_private,
    write_private,
)

_FINGERPRINT_BYTES: Final = 4
_FIRST_ADDRESS: Final = 1
_LAST_ADDRESS: Final = 254


class Identity(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The private half of a node; its `repr` does not show it."""

    network: str
    """Name of the network."""
    address: int
    """The node, 1…254."""
    private: bytes
    """X25519 private key, 32 bytes."""

    def __repr__(self) -> str:
        return f"Identity({self.network!r}, node {self.address}, public {self.public.hex()[:8]})"

    @property
    def public(self) -> bytes:
        """The public half, 32 bytes."""
        return X25519PrivateKey.from_private_bytes(self.private).public_key().public_bytes_raw()

    def shared(self, other: bytes) -> bytes:
        """Return the secret that only this node and the owner of a public half can compute.

        Raises:
            KeyFileError: `other` is not a valid public half.
        """
        try:
            public = X25519PublicKey.from_public_bytes(other)
            return X25519PrivateKey.from_private_bytes(self.private).exchange(public)
        except ValueError:  # wrong length, or a low-order point: the same secret for everybody
            raise KeyFileError(f"{self.network}: {other.hex()[:8]}… is no public key") from None


class Members(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The nodes of a network in one generation of its keys; contains no secret."""

    network: str
    """Its name."""
    generation: int = 0
    """Counted up by each rotation and revocation."""
    public: dict[int, bytes] = {}
    """Public half of each node, by address."""
    wrapped: dict[int, dict[int, bytes]] = {}
    """For each source, its broadcast secret wrapped for each other node: 40 bytes."""
    former: "Members | None" = None
    """The generation before, while its frames are still opened."""

    @property
    def fingerprint(self) -> str:
        """Eight hexadecimal digits, equal if network, generation and members are equal."""
        listed = b"".join(bytes((each,)) + self.public[each] for each in sorted(self.public))
        text = key_info("members", self.network, self.generation) + listed
        return hashlib.sha256(text).digest()[:_FINGERPRINT_BYTES].hex()

    def joined(self, identity: Identity) -> "Members":
        """Return the list with one more node; its broadcast secrets are not wrapped yet.

        Raises:
            KeyFileError: Another identity has the address, or the network differs.
        """
        if identity.network != self.network:
            raise KeyFileError(
                f"node {identity.address} is of network {identity.network}, the list of "
                f"{self.network}"
            )
        known = self.public.get(identity.address)
        if known not in (None, identity.public):
            raise KeyFileError(
                f"{self.network}: node {identity.address} has another identity",
                hint="zacoustic key revoke shuts that one out",
            )
        public = self.public | {identity.address: identity.public}
        return msgspec.structs.replace(self, public=public)

    def wrapped_by(self, identity: Identity) -> "Members":
        """Return the list with one source's broadcast secret wrapped for all other nodes.

        Raises:
            KeyFileError: The node is not in the list.
        """
        if self.public.get(identity.address) != identity.public:
            raise KeyFileError(f"{self.network}: node {identity.address} is not in the list")
        own = {
            member: aes_key_wrap(
                _wrapping_key(identity, self, identity.address, member),
                _broadcast_secret(identity, self.generation),
            )
            for member in self.public
            if member != identity.address
        }
        return msgspec.structs.replace(self, wrapped=self.wrapped | {identity.address: own})

    def rotated(self, identities: Iterable[Identity]) -> "Members":
        """Return the next generation, which still opens frames of this one.

        Args:
            identities: Nodes whose broadcast secrets are wrapped here; others wrap their own.

        Raises:
            KeyFileError: There is no next generation, or an identity is not in the list.
        """
        former = msgspec.structs.replace(self, former=None)
        return msgspec.structs.replace(self._next(self.public, identities), former=former)

    def without(self, address: int, identities: Iterable[Identity]) -> "Members":
        """Return the next generation without a node; it opens no frame of this one.

        Args:
            address: The node to revoke.
            identities: As for `rotated`.

        Raises:
            KeyFileError: The node is not in the list; or as for `rotated`.
        """
        if address not in self.public:
            listed = ", ".join(map(str, sorted(self.public))) or "none"
            raise KeyFileError(
                f"{self.network}: node {address} is not in the list; allowed: {listed}"
            )
        public = {each: half for each, half in self.public.items() if each != address}
        left = [each for each in identities if each.address != address]
        return self._next(public, left)

    def settled(self) -> "Members":
        """Return the list without the generation before."""
        return msgspec.structs.replace(self, former=None)

    def _next(self, public: dict[int, bytes], identities: Iterable[Identity]) -> "Members":
        if self.generation >= LAST_GENERATION:
            raise KeyFileError(
                f"{self.network}: generation {self.generation} is the last one",
                hint="make identities with another network name",
            )
        made = Members(network=self.network, generation=self.generation + 1, public=public)
        for identity in identities:
            made = made.wrapped_by(identity)
        return made


def new_identity(network: str, address: int) -> Identity:
    """Draw an identity.

    Raises:
        KeyFileError: The name or the address is out of range.
    """
    check_network(network)
    if not _FIRST_ADDRESS <= address <= _LAST_ADDRESS:
        raise KeyFileError(f"node {address}; allowed: {_FIRST_ADDRESS}..{_LAST_ADDRESS}")
    return Identity(network=network, address=address, private=secrets.token_bytes(SECRET_BYTES))


def unicast_key(identity: Identity, members: Members, source: int, destination: int) -> bytes:
    """Return the key for frames from one node to another; this node is one of the two.

    Raises:
        KeyFileError: The other node is not in the list.
    """
    info = b"frame" + bytes((source, destination))
    return expand(_pair_secret(identity, members, source, destination), info, KEY_BYTES)


def broadcast_secret(identity: Identity, members: Members, source: int) -> bytes | None:
    """Return the secret of a source's broadcasts; None: it is not wrapped for this node."""
    if source == identity.address:
        return _broadcast_secret(identity, members.generation)
    wrapped = members.wrapped.get(source, {}).get(identity.address)
    if wrapped is None or source not in members.public:
        return None
    return _unwrapped(_wrapping_key(identity, members, source, identity.address), wrapped)


def broadcast_key(members: Members, source: int, secret: bytes) -> bytes:
    """Return the key for a source's broadcasts, which follows from its secret."""
    info = key_info("broadcast frame", members.network, members.generation) + bytes((source,))
    return expand(secret, info, KEY_BYTES)


def wrap_for(identity: Identity, members: Members, source: int, node: int, secret: bytes) -> bytes:
    """Return the secret of a source's broadcasts, wrapped by this node for another one.

    Raises:
        KeyFileError: The other node is not in the list.
    """
    return aes_key_wrap(_carrying_key(identity, members, source, identity.address, node), secret)


def unwrap_from(
    identity: Identity, members: Members, source: int, sender: int, wrapped: bytes
) -> bytes | None:
    """Return the secret that another node has wrapped for this one; None: it did not.

    Raises:
        KeyFileError: The other node is not in the list.
    """
    key = _carrying_key(identity, members, source, sender, identity.address)
    return _unwrapped(key, wrapped)


def nobodys_key(identity: Identity, members: Members, destination: int) -> bytes:
    """Return a key for frames to a node outside of the list; no other node has it."""
    info = key_info("nobody", members.network, members.generation) + bytes((destination,))
    return expand(identity.private, info, KEY_BYTES)


def read_identity(path: Path) -> Identity:
    """Read an identity file.

    Raises:
        KeyFileError: It is missing, damaged, or others may read it. Never shows its content.
    """
    identity = read_private(path, Identity)
    is_address = _FIRST_ADDRESS <= identity.address <= _LAST_ADDRESS
    if not is_address or len(identity.private) != SECRET_BYTES:
        raise KeyFileError(f"{path}: address or key is out of range", hint="put back a copy of it")
    return identity


def write_identity(path: Path, identity: Identity) -> None:
    """Write an identity file that only its owner can read.

    Raises:
        KeyFileError: It exists already, or cannot be written.
    """
    write_private(path, identity)


def read_members(path: Path) -> Members:
    """Read a members file.

    Raises:
        KeyFileError: It is missing or damaged.
    """
    try:
        members = msgspec.json.decode(path.read_bytes(), type=Members)
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}", hint="copy it from land") from error
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise KeyFileError(f"{path}: no list of members: {error}", hint="copy it anew") from None
    for each in (members, members.former):
        if each is not None and not _is_in_range(each):
            raise KeyFileError(
                f"{path}: network, generation, address or key is out of range; allowed: a name, "
                f"0..{LAST_GENERATION}, {_FIRST_ADDRESS}..{_LAST_ADDRESS}, {SECRET_BYTES} bytes",
                hint="copy it anew",
            )
    return members


def write_members(path: Path, members: Members) -> None:
    """Write a members file, atomically.

    Raises:
        KeyFileError: It cannot be written.
    """
    write_private(path, members, replace=True)


def _is_in_range(members: Members) -> bool:
    listed = [*members.public, *members.wrapped]
    return (
        is_network(members.network)
        and 0 <= members.generation <= LAST_GENERATION
        and all(_FIRST_ADDRESS <= each <= _LAST_ADDRESS for each in listed)
        and all(len(half) == SECRET_BYTES for half in members.public.values())
    )


def _pair_secret(identity: Identity, members: Members, one: int, other: int) -> bytes:
    theirs = other if one == identity.address else one
    public = members.public.get(theirs)
    if public is None:
        raise KeyFileError(f"{members.network}: node {theirs} is not in the list")
    salt = key_info("pair", members.network, members.generation)
    random_secret = hmac.digest(salt, identity.shared(public), hashlib.sha256)  # HKDF-Extract
    return expand(random_secret, bytes(sorted((one, other))), SECRET_BYTES)


def _wrapping_key(identity: Identity, members: Members, source: int, member: int) -> bytes:
    info = b"wrap" + bytes((source, member))
    return expand(_pair_secret(identity, members, source, member), info, SECRET_BYTES)


def _carrying_key(
    identity: Identity, members: Members, source: int, sender: int, node: int
) -> bytes:
    info = b"carry" + bytes((source, sender, node))
    return expand(_pair_secret(identity, members, sender, node), info, SECRET_BYTES)


def _unwrapped(key: bytes, wrapped: bytes) -> bytes | None:
    try:
        return aes_key_unwrap(key, wrapped)
    except (InvalidUnwrap, ValueError):
        return None


def _broadcast_secret(identity: Identity, generation: int) -> bytes:
    info = key_info("broadcast", identity.network, generation) + bytes((identity.address,))
    return expand(identity.private, info, SECRET_BYTES)
