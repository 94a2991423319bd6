"""The section `security` of a configuration, checked; reads no key file."""

from enum import Enum
from pathlib import Path
from typing import Final

import msgspec

from zacoustic.core.schedule.replybudget import REPLY_SHARE
from zacoustic.core.wire.seal import LONG_HEAD_BYTES, STRONG_TAG_BYTES

LEAST_PAD_BYTES: Final = LONG_HEAD_BYTES + STRONG_TAG_BYTES + 1
"""The shortest length that frames can be padded to: a strong frame with one byte of records."""
LARGEST_PAD_BYTES: Final = 65_535
LONGEST_OVERLAP_S: Final = 30 * 86_400.0
DEFAULT_OVERLAP_S: Final = 3600.0


class Mode(Enum):
    """How the seal protects records."""

    ENCRYPT = "encrypt"
    """Nobody without a key can read or forge them."""
    AUTHENTICATE = "authenticate"
    """Everybody can read them; nobody without a key can forge them."""


class Seals(Enum):
    """Which frames a node seals."""

    ALL = "transmit"
    """All that it transmits."""
    NONE = "receive"
    """None: it only listens and opens what it hears, so it needs no journal."""


class Strong(Enum):
    """Which records get the tag of eight bytes."""

    COMMANDS = "commands"
    """Remote commands."""
    SERVICES = "services"
    """Requests and responses."""
    ACTIONS = "actions"
    """Goals, cancel requests, results."""


class SecuritySpec(msgspec.Struct, frozen=True, kw_only=True):
    """How the frames of a node are sealed."""

    source: str
    """Where it is written, for errors: ``fleet.json5: plugins.acoustic.security``."""
    key: Path
    """The key file of the fleet, or the identity of this node."""
    lives: Path
    """Folder of the life records."""
    members: Path | None = None
    """The members file, if nodes have identities; None: the fleet has one key."""
    mode: Mode = Mode.ENCRYPT
    """Encrypted, or readable."""
    strong: frozenset[Strong] = frozenset(Strong)
    """Which records get the tag of eight bytes."""
    pad: tuple[int, ...] = ()
    """Lengths to pad frames to, bytes, ascending: each is padded to the next; empty: no padding."""
    overlap_s: float = DEFAULT_OVERLAP_S
    """How long after its start a node opens frames of the former generation, s."""
    reply_share: float = REPLY_SHARE
    """Share of the time that each other node can make this one transmit, above 0, at most 1."""
    only_opens: bool = False
    """The node opens frames and transmits none."""
    unsealed: frozenset[int] = frozenset()
    """Topics, by stream id, whose samples are also accepted in frames without a seal."""
