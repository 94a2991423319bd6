"""What a configuration says of the seal: the section `security`, checked; no file is read here."""

from enum import Enum
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.core.wire.seal import LONG_HEAD_BYTES, STRONG_TAG_BYTES

LEAST_PAD_BYTES: Final = LONG_HEAD_BYTES + STRONG_TAG_BYTES + 1
"""The shortest length that frames can be padded to: that of a strong frame with one byte in it."""
LARGEST_PAD_BYTES: Final = 65_535
LONGEST_OVERLAP_S: Final = 30 * 86_400.0
DEFAULT_OVERLAP_S: Final = 3600.0


class Mode(Enum):
    """What the seal does to records."""

    ENCRYPT = "encrypt"
    """Nobody without a key can read or make them."""
    AUTHENTICATE = "authenticate"
    """Everybody can read them, nobody without a key can make them."""


class Seals(Enum):
    """Which frames a node seals."""

    ALL = "transmit"
    """Whatever it has to say."""
    NONE = "receive"
    """It transmits nothing, and opens what it hears: so it needs no journal."""


class Strong(Enum):
    """What gets the tag of eight bytes."""

    COMMANDS = "commands"
    """Remote commands."""
    SERVICES = "services"
    """Requests and responses."""
    ACTIONS = "actions"
    """Goals, cancels, results."""


class SecuritySpec(msgspec.Struct, frozen=True, kw_only=True):
    """How the frames of a node are sealed."""

    source: str
    """Where it was written, for errors: ``fleet.json5: plugins.acoustic.security``."""
    key: Path
    """The key file of the fleet, or the identity of this node."""
    lives: Path
    """Folder of the life records."""
    members: Path | None = None
    """The list of members, where nodes have identities; None: the fleet has one key."""
    mode: Mode = Mode.ENCRYPT
    """Encrypted, or readable."""
    strong: frozenset[Strong] = frozenset(Strong)
    """What gets the tag of eight bytes."""
    pad: tuple[int, ...] = ()
    """Lengths of frames, bytes, ascending: each is padded to the next of them; empty: none is."""
    overlap_s: float = DEFAULT_OVERLAP_S
    """How long after its start a node opens frames of the former generation of the key, s."""
    only_opens: bool = False
    """The node opens frames and transmits none."""
    unsealed: frozenset[int] = frozenset()
    """Topics, by stream id, whose samples are also taken from frames without a seal."""
