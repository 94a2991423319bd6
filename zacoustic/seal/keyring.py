"""From a `SecuritySpec` to the parts that seal frames: key, cipher and life records."""

from typing import TYPE_CHECKING

import msgspec

from zacoustic.errors import ConfigError
from zacoustic.seal.keys import FleetKey, KeyFileError, read_key
from zacoustic.seal.lives import Lives
from zacoustic.seal.spec import SecuritySpec
from zacoustic.text.installing import with_extra

if TYPE_CHECKING:
    from zacoustic.seal.ccm import CcmCipher
    from zacoustic.seal.identities import Members


class Keyring(msgspec.Struct, frozen=True, kw_only=True):
    """What a node needs to seal and open frames; its `repr` shows no secret."""

    key: "FleetKey | Members"
    """Generation, name of the network, fingerprint."""
    cipher: "CcmCipher"
    """A `zacoustic.core.wire.seal.Cipher`."""
    lives: Lives
    """Life records: give the number of this start."""


def open_keyring(spec: SecuritySpec, address: int) -> Keyring:
    """Read the key file and make the cipher; does not begin a life.

    Args:
        spec: The section of the configuration.
        address: The node, 1…254.

    Raises:
        KeyFileError: The key file is missing, damaged, or others may read it. The message begins
            with the place in the configuration.
        ConfigError: The extra `secure` is not installed.
    """
    try:
        from zacoustic.seal.ccm import FleetCipher, MemberCipher
        from zacoustic.seal.deliveredkeys import DeliveredKeys
        from zacoustic.seal.identities import read_identity, read_members
    except ModuleNotFoundError as error:
        package = (error.name or "").partition(".")[0]
        if package == "zacoustic":
            raise
        raise ConfigError(
            f"{spec.source}: needs {package}, which is not installed",
            hint=with_extra("secure"),
        ) from error
    place = "key"
    key: FleetKey | Members
    cipher: CcmCipher
    try:
        if spec.members is None:
            key = read_key(spec.key)
            cipher = FleetCipher(key, mode=spec.mode)
        else:
            identity = read_identity(spec.key)
            if identity.address != address:
                raise KeyFileError(
                    f"{spec.key}: is of node {identity.address}; allowed: of node {address}",
                    hint="each node has an identity of its own",
                )
            place = "members"
            key = read_members(spec.members)
            delivered = DeliveredKeys(
                key.network, key.generation, spec.lives / f"node-{address}.delivered"
            )
            cipher = MemberCipher(identity, key, mode=spec.mode, delivered=delivered)
    except KeyFileError as error:
        raise KeyFileError(f"{spec.source}.{place}: {error.args[0]}", hint=error.hint) from error
    return Keyring(key=key, cipher=cipher, lives=Lives(spec.lives, key, address))
