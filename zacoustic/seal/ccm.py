"""AES-128-CCM with the key of a fleet (RFC 3610, NIST SP 800-38C), from `cryptography`."""

from functools import cache

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from zacoustic.core.wire.seal import STRONG_TAG_BYTES, TAG_BYTES, Way
from zacoustic.seal.keys import FleetKey


class FleetCipher:
    """A `zacoustic.core.wire.seal.Cipher` whose keys follow from the key of a fleet.

    Args:
        key: The key; where it has a former secret, frames of that generation are opened too.
    """

    def __init__(self, key: FleetKey) -> None:
        self.generation = key.generation

        @cache
        def cipher(address: int, strong: bool, former: bool) -> AESCCM | None:
            node_key = key.node_key(address, former=former)
            if node_key is None:
                return None
            return AESCCM(node_key, tag_length=STRONG_TAG_BYTES if strong else TAG_BYTES)

        self._cipher = cipher

    def seal(self, way: Way, nonce: bytes, records: bytes, associated: bytes) -> bytes:
        """Return the encrypted records and the tag."""
        cipher = self._cipher(way.source, way.strong, False)
        assert cipher is not None  # there is a secret of the present generation
        return cipher.encrypt(nonce, records, associated)

    def open(
        self, generation: int, way: Way, nonce: bytes, body: bytes, associated: bytes
    ) -> bytes | None:
        """Return the records; None where no known key of this generation made the tag."""
        former = generation != self.generation & 1
        cipher = self._cipher(way.source, way.strong, former)
        if cipher is None:
            return None
        try:
            return cipher.decrypt(nonce, body, associated)
        except InvalidTag:
            return None
