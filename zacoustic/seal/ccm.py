"""AES-128-CCM with the key of a fleet (RFC 3610, NIST SP 800-38C), from `cryptography`."""

from functools import cache

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from zacoustic.core.wire.seal import STRONG_TAG_BYTES, TAG_BYTES, Way
from zacoustic.seal.keys import FleetKey
from zacoustic.seal.spec import Mode


class FleetCipher:
    """A `zacoustic.core.wire.seal.Cipher` whose keys follow from the key of a fleet.

    Args:
        key: The key; where it has a former secret, frames of that generation are opened too.
        mode: What happens to records. In `Mode.AUTHENTICATE` they are associated data and stay as
            they are; a frame of the other mode is refused.
    """

    def __init__(self, key: FleetKey, *, mode: Mode = Mode.ENCRYPT) -> None:
        self.generation = key.generation
        self._encrypts = mode is Mode.ENCRYPT
        self._opens_former = True

        @cache
        def cipher(address: int, strong: bool, former: bool) -> AESCCM | None:
            node_key = key.node_key(address, former=former)
            if node_key is None:
                return None
            return AESCCM(node_key, tag_length=STRONG_TAG_BYTES if strong else TAG_BYTES)

        self._cipher = cipher

    def end_overlap(self) -> None:
        """Open no frame of the former generation any more."""
        self._opens_former = False

    def seal(self, way: Way, nonce: bytes, records: bytes, associated: bytes) -> bytes:
        """Return the records, encrypted in `Mode.ENCRYPT`, and the tag."""
        cipher = self._cipher(way.source, way.strong, False)
        assert cipher is not None  # there is a secret of the present generation
        if self._encrypts:
            return cipher.encrypt(nonce, records, associated)
        return records + cipher.encrypt(nonce, b"", _covered(associated, records))

    def open(
        self, generation: int, way: Way, nonce: bytes, body: bytes, associated: bytes
    ) -> bytes | None:
        """Return the records; None where no known key of this generation made the tag."""
        former = generation != self.generation & 1
        if former and not self._opens_former:
            return None
        cipher = self._cipher(way.source, way.strong, former)
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


def _covered(associated: bytes, records: bytes) -> bytes:
    """Return both as associated data; the length parts them, so no byte can change sides."""
    return bytes((len(associated),)) + associated + records
