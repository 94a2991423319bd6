"""AES-128-CCM with the keys of a fleet (RFC 3610, NIST SP 800-38C), from `cryptography`."""

from abc import ABC, abstractmethod
from functools import lru_cache

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from zacoustic.core.linktypes import BROADCAST
from zacoustic.core.wire.seal import STRONG_TAG_BYTES, TAG_BYTES, Way
from zacoustic.errors import LocalError
from zacoustic.seal.deliveredkeys import DeliveredKey, DeliveredKeys
from zacoustic.seal.identities import (
    Identity,
    Members,
    broadcast_key,
    broadcast_secret,
    nobodys_key,
    unicast_key,
    unwrap_from,
    wrap_for,
)
from zacoustic.seal.keys import FleetKey, KeyFileError
from zacoustic.seal.spec import Mode

_ONE_KEY = "the fleet has one key for all nodes; allowed: with identities (`members`)"
_KEYS = 4096
"""Size of the key cache: two keys for each pair of nodes in a fleet."""


class CcmCipher(ABC):
    """A `zacoustic.core.wire.seal.Cipher`; a subclass supplies the keys.

    Args:
        generation: Generation of the key that seals this node's frames.
        mode: How records are protected. `Mode.AUTHENTICATE` leaves them readable, as associated
            data. A frame of the other mode is refused.
    """

    def __init__(self, generation: int, mode: Mode) -> None:
        self.generation = generation
        self._encrypts = mode is Mode.ENCRYPT
        self._opens_former = True

        @lru_cache(maxsize=_KEYS)
        def cipher(source: int, destination: int, strong: bool, former: bool) -> AESCCM | None:
            key = self._key(source, destination, former=former)
            if key is None:
                return None
            return AESCCM(key, tag_length=STRONG_TAG_BYTES if strong else TAG_BYTES)

        self._cipher = cipher

    @abstractmethod
    def _key(self, source: int, destination: int, *, former: bool) -> bytes | None:
        """Return the key for frames from one node to another, or to all; None: there is none."""

    def wrap_key(self, source: int, node: int) -> bytes:
        """Return the secret of a source's broadcasts, wrapped for one node; see `Cipher`."""
        raise LocalError(_ONE_KEY)

    def take_key(self, source: int, sender: int, wrapped: bytes) -> None:
        """Store a secret that another node has wrapped for this one; see `Cipher`."""
        raise LocalError(_ONE_KEY)

    def end_overlap(self) -> None:
        """Stop opening frames of the former generation."""
        self._opens_former = False

    def seal(self, way: Way, nonce: bytes, records: bytes, associated: bytes) -> bytes:
        """Return the records, encrypted in `Mode.ENCRYPT`, and the tag."""
        cipher = self._cipher(way.source, way.destination, way.strong, False)
        assert cipher is not None  # a node has a key for every frame that it sends
        if self._encrypts:
            return cipher.encrypt(nonce, records, associated)
        return records + cipher.encrypt(nonce, b"", _covered(associated, records))

    def open(
        self, generation: int, way: Way, nonce: bytes, body: bytes, associated: bytes
    ) -> bytes | None:
        """Return the records; None if no known key of this generation made the tag."""
        former = generation != self.generation & 1
        if former and not self._opens_former:
            return None
        cipher = self._cipher(way.source, way.destination, way.strong, former)
        if cipher is None:
            return None
        try:
            if self._encrypts:
                return cipher.decrypt(nonce, body, associated)
            tag_bytes = STRONG_TAG_BYTES if way.strong else TAG_BYTES
            records = body[:-tag_bytes]
            cipher.decrypt(nonce, body[-tag_bytes:], _covered(associated, records))
        except InvalidTag:
            return None
        return records


class FleetCipher(CcmCipher):
    """The cipher of a fleet with one secret, from which the key of each node follows.

    Args:
        key: The secret. If it contains a former one, frames of that generation open as well.
        mode: See `CcmCipher`.
    """

    def __init__(self, key: FleetKey, *, mode: Mode = Mode.ENCRYPT) -> None:
        super().__init__(key.generation, mode)
        self._fleet_key = key

    def _key(self, source: int, destination: int, *, former: bool) -> bytes | None:
        return self._fleet_key.node_key(source, former=former)


class MemberCipher(CcmCipher):
    """The cipher of a fleet with identities: keys per pair of nodes, one per source for broadcasts.

    Args:
        identity: The identity of this node.
        members: The list. If it contains a former one, frames of that generation open as well.
        mode: See `CcmCipher`.
        delivered: The keys that other nodes have delivered; None: none yet, and none is stored.

    Raises:
        KeyFileError: This node is not in the list.
    """

    def __init__(
        self,
        identity: Identity,
        members: Members,
        *,
        mode: Mode = Mode.ENCRYPT,
        delivered: DeliveredKeys | None = None,
    ) -> None:
        super().__init__(members.generation, mode)
        if members.public.get(identity.address) != identity.public:
            raise KeyFileError(
                f"{members.network}: node {identity.address} is not in the list of generation "
                f"{members.generation}, or with another identity",
                hint="copy the list from land; a node that was revoked is not in it any more",
            )
        self._identity = identity
        self._members = members
        self._delivered = delivered or DeliveredKeys(members.network, members.generation)

    def wrap_key(self, source: int, node: int) -> bytes:
        """Return the secret of a source's broadcasts, wrapped for one node; see `Cipher`."""
        secret = self._secret(self._members, source)
        if secret is None:
            raise LocalError(f"this node does not open broadcasts of node {source} itself")
        try:
            return wrap_for(self._identity, self._members, source, node, secret)
        except KeyFileError as error:
            raise LocalError(str(error)) from error

    def take_key(self, source: int, sender: int, wrapped: bytes) -> None:
        """Store a secret that another node has wrapped for this one; see `Cipher`."""
        if broadcast_secret(self._identity, self._members, source) is not None:
            raise LocalError(f"the list has a key for broadcasts of node {source}")
        try:
            if unwrap_from(self._identity, self._members, source, sender, wrapped) is None:
                raise LocalError(f"the key was not wrapped by node {sender} for this node")
            self._delivered.keep(source, DeliveredKey(sender=sender, wrapped=wrapped))
        except KeyFileError as error:
            raise LocalError(str(error)) from error
        self._cipher.cache_clear()

    def _key(self, source: int, destination: int, *, former: bool) -> bytes | None:
        members = self._members.former if former else self._members
        if members is None:
            return None
        try:
            if destination == BROADCAST:
                secret = self._secret(members, source)
                return None if secret is None else broadcast_key(members, source, secret)
            if self._identity.address not in (source, destination):
                return None
            return unicast_key(self._identity, members, source, destination)
        except KeyFileError:  # the destination is not in the list: nobody may open its frames
            is_own = source == self._identity.address
            return nobodys_key(self._identity, members, destination) if is_own else None

    def _secret(self, members: Members, source: int) -> bytes | None:
        """Return the secret of a source's broadcasts, from the list or delivered, or None."""
        secret = broadcast_secret(self._identity, members, source)
        delivered = self._delivered.of.get(source)
        if secret is not None or delivered is None or members is not self._members:
            return secret
        return unwrap_from(self._identity, members, source, delivered.sender, delivered.wrapped)


def _covered(associated: bytes, records: bytes) -> bytes:
    """Return both as associated data, with the length of the first: no byte can change sides."""
    return bytes((len(associated),)) + associated + records
