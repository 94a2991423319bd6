"""The key of a fleet: 32 random bytes in a file, from which the keys of its nodes are derived.

The file is JSON with four entries: `network`, a name; `generation`, 0…65535, which each rotation
increments; `secret`, of this generation; and `former`, the secret of the one before, while its
frames are still opened. A reader of the file can read and command the fleet, so a file that others
may read is refused.

HKDF-Expand (RFC 5869, SHA-256) derives the key of a node from the secret with network, wire
version, generation and address. No two nodes share a key, so their counters cannot collide.
"""

import hashlib
import hmac
import os
import re
import secrets
import stat
from pathlib import Path
from typing import Final, TypeVar

import msgspec

from zacoustic.core.wire.agreement import WIRE_VERSION
from zacoustic.errors import ConfigError

SECRET_BYTES: Final = 32
KEY_BYTES: Final = 16
LAST_GENERATION: Final = 0xFFFF
_FINGERPRINT_BYTES: Final = 4
_NAME_BYTES: Final = 64
_NAMES: Final = f"1..{_NAME_BYTES} bytes of text that can be printed"

Record = TypeVar("Record", bound=msgspec.Struct)


class KeyFileError(ConfigError):
    """A key file that cannot be used."""


class FleetKey(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The content of a key file; its `repr` shows no secret."""

    network: str
    """Name of the network; fleets with different names cannot open each other's frames."""
    generation: int
    """0…65535."""
    secret: bytes
    """32 random bytes."""
    former: bytes | None = None
    """The secret of the generation before, while its frames are still opened."""

    def __repr__(self) -> str:
        return f"FleetKey({self.network!r}, generation {self.generation}, {self.fingerprint})"

    @property
    def fingerprint(self) -> str:
        """Eight hexadecimal digits that identify the key and reveal nothing of it."""
        return expand(self.secret, self._info("fingerprint"), _FINGERPRINT_BYTES).hex()

    def node_key(self, address: int, *, former: bool = False) -> bytes | None:
        """Return the key that a node seals with; None: there is no former secret.

        Args:
            address: The node, 1…254.
            former: Return the key of the generation before.
        """
        secret = self.former if former else self.secret
        if secret is None:
            return None
        generation = self.generation - 1 if former else self.generation
        return expand(secret, self._info("frame", generation) + bytes((address,)), KEY_BYTES)

    def rotated(self) -> "FleetKey":
        """Return the key of the next generation, which still opens frames of this one.

        Raises:
            KeyFileError: There is no next generation.
        """
        return msgspec.structs.replace(
            new_key(self.network, after=self.generation), former=self.secret
        )

    def settled(self) -> "FleetKey":
        """Return the key without the generation before."""
        return msgspec.structs.replace(self, former=None)

    def _info(self, use: str, generation: int | None = None) -> bytes:
        return key_info(use, self.network, self.generation if generation is None else generation)


def new_key(network: str, *, after: int = -1) -> FleetKey:
    """Draw a key.

    Args:
        network: Name of the network, 1…64 bytes.
        after: The last generation that this network has used; −1: none.

    Raises:
        KeyFileError: The name is too long, or there is no next generation.
    """
    check_network(network)
    if after >= LAST_GENERATION:
        raise KeyFileError(
            f"{network}: generation {after} is the last one",
            hint="make a key with another network name: zacoustic key new",
        )
    return FleetKey(network=network, generation=after + 1, secret=secrets.token_bytes(SECRET_BYTES))


def check_network(network: str) -> None:
    """Check the name of a network.

    Raises:
        KeyFileError: It is not a valid name.
    """
    if not is_network(network):
        raise KeyFileError(f'network "{network}"; allowed: {_NAMES}')


def key_info(use: str, network: str, generation: int) -> bytes:
    """Return the HKDF info that separates uses, networks, generations and wire versions."""
    name = network.encode()
    numbers = bytes((WIRE_VERSION,)) + generation.to_bytes(4, "big")
    return f"zacoustic {use}".encode() + bytes((0, len(name))) + name + numbers


def is_fingerprint(text: str) -> bool:
    """Tell whether a text has the form of a fingerprint."""
    return re.fullmatch(r"[0-9a-f]{8}", text) is not None


def expand(secret: bytes, info: bytes, size_bytes: int) -> bytes:
    """Derive bytes from a random secret: HKDF-Expand with SHA-256 (RFC 5869, 2.3)."""
    found, block, place = b"", b"", 1
    while len(found) < size_bytes:
        block = hmac.digest(secret, block + info + bytes((place,)), hashlib.sha256)
        found, place = found + block, place + 1
    return found[:size_bytes]


def read_key(path: Path) -> FleetKey:
    """Read a key file.

    Raises:
        KeyFileError: It is missing, damaged, or others may read it. Never shows its content.
    """
    key = read_private(path, FleetKey)
    for name, secret in (("secret", key.secret), ("former", key.former)):
        if secret is not None and len(secret) != SECRET_BYTES:
            raise KeyFileError(
                f"{path}: {name} has {len(secret)} bytes; allowed: {SECRET_BYTES}",
                hint="put back a copy of it",
            )
    if not 0 <= key.generation <= LAST_GENERATION or not is_network(key.network):
        raise KeyFileError(
            f"{path}: generation or network is out of range; allowed: 0..{LAST_GENERATION}, "
            f"{_NAMES}",
            hint="put back a copy of it",
        )
    return key


def read_private(path: Path, record: type[Record]) -> Record:
    """Read a record from a file that only its owner may read.

    Raises:
        KeyFileError: It is missing, damaged, or others may read it. Never shows its content.
    """
    try:
        with path.open("rb") as file:
            mode = stat.S_IMODE(os.fstat(file.fileno()).st_mode)
            content = file.read()
    except OSError as error:
        raise KeyFileError(
            f"{path}: {error.strerror}", hint="make one with `zacoustic key new`"
        ) from error
    if os.name == "posix" and mode & (stat.S_IRWXG | stat.S_IRWXO):
        raise KeyFileError(
            f"{path}: others may read it, mode {mode:04o}; allowed: 0600",
            hint=f"chmod 600 {path}, and rotate the key if somebody may have read it",
        )
    try:
        return msgspec.json.decode(content, type=record)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        # The message of msgspec names places and types, never values.
        raise KeyFileError(f"{path}: no key file: {error}", hint="put back a copy of it") from None


def write_key(path: Path, key: FleetKey, *, replace: bool = False) -> None:
    """Write a key file that only its owner can read, atomically.

    Raises:
        KeyFileError: It exists already, or cannot be written.
    """
    write_private(path, key, replace=replace)


def write_private(path: Path, record: msgspec.Struct, *, replace: bool = False) -> None:
    """Write a record into a file that only its owner can read, atomically.

    Raises:
        KeyFileError: It exists already, or cannot be written.
    """
    beside = path.with_name(f".{path.name}.{secrets.token_hex(4)}")
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    try:
        with os.fdopen(os.open(beside, flags, 0o600), "wb") as file:
            file.write(msgspec.json.format(msgspec.json.encode(record), indent=2) + b"\n")
            file.flush()
            os.fsync(file.fileno())
        if replace:
            beside.replace(path)
        else:
            os.link(beside, path)  # fails if the file exists, even if it was made just now
    except FileExistsError as error:
        raise KeyFileError(
            f"{path}: there is a key already", hint="`zacoustic key rotate` makes the next one"
        ) from error
    except OSError as error:
        raise KeyFileError(f"{path}: {error.strerror}", hint="choose another folder") from error
    finally:
        beside.unlink(missing_ok=True)


def is_network(network: str) -> bool:
    """Tell whether a text can be the name of a network."""
    return network.isprintable() and 1 <= len(network.encode()) <= _NAME_BYTES
