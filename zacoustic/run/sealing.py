"""`NodeSeal`: the key, the life and the cipher of one node, from its start to its end.

A node whose life cannot be known seals nothing: it listens, opens what is for it, and says why it
is silent, until somebody has made its record anew (`zacoustic key rejoin`).
"""

import asyncio
import logging
from typing import Final

from zacoustic.core.wire.seal import LAST_LIFE, Cipher
from zacoustic.run.journal.lives import LifeJournal
from zacoustic.run.journal.port import Journal
from zacoustic.seal.keyring import Keyring, open_keyring
from zacoustic.seal.spec import SecuritySpec

_NO_LIFE: Final = LAST_LIFE + 1
"""The epoch of each engine that seals nothing."""
OLD_JOURNAL: Final = "frames that were recorded since then can be opened once more"
"""What that means."""
_logger = logging.getLogger(__name__)


class NodeSeal:
    """What seals the frames of one node.

    Args:
        spec: What the config says.
        address: The node, 1…254.
        ring: The key, and what is made of it.
    """

    def __init__(self, spec: SecuritySpec, address: int, ring: Keyring) -> None:
        self._spec = spec
        self._address = address
        self._ring = ring
        self._lives: LifeJournal | None = None

    @property
    def source(self) -> str:
        """Where it was written that frames are sealed."""
        return self._spec.source

    @property
    def only_opens(self) -> bool:
        """The config wants it to listen only."""
        return self._spec.only_opens

    @property
    def cipher(self) -> Cipher:
        """For the engines."""
        return self._ring.cipher

    @property
    def life(self) -> int | None:
        """The life that has begun; None: none has."""
        return None if self._lives is None else self._lives.life

    @property
    def failure(self) -> str:
        """Why this node seals no frame, one line; empty: it seals them."""
        if self._lives is None:
            return "it only listens, as configured"
        return self._lives.failure

    def epoch(self, journalled: int) -> int:
        """Return the boot epoch of an engine.

        Args:
            journalled: What the journal has for it.
        """
        return _NO_LIFE if self.life is None else journalled

    def keep_lives(self, journal: Journal) -> Journal:
        """Return a journal whose epochs are lives, each written down before it is used."""
        if self._spec.only_opens:
            return journal
        self._lives = LifeJournal(journal, self._ring.lives)
        return self._lives

    def begin(self, loop: asyncio.AbstractEventLoop) -> None:
        """The node starts: the former key is opened for as long as the config says."""
        key, lives = self._ring.key, self._lives
        if lives is not None and lives.failure:
            _logger.error(
                "node %d seals no frame, and transmits none: %s", self._address, lives.failure
            )
        elif lives is not None:
            _logger.info("node %d: sealed with %r, life %s", self._address, key, lives.life)
        if lives is not None and lives.age:
            _logger.error("node %d: %s; %s", self._address, lives.age, OLD_JOURNAL)
        if key.former is not None:
            loop.call_later(self._spec.overlap_s, self._ring.cipher.end_overlap)

    def report(self) -> dict[str, object]:
        """Return what may be known of it, for health and logs: nothing of it is secret."""
        key = self._ring.key
        return {
            "network": key.network,
            "generation": key.generation,
            "fingerprint": key.fingerprint,
            "mode": self._spec.mode.value,
            "life": self.life,
            "failure": self.failure,
        }


def open_seal(spec: SecuritySpec, address: int) -> NodeSeal:
    """Read the key file; a life begins when the journal is recovered.

    Args:
        spec: What the config says.
        address: The node, 1…254.

    Raises:
        ConfigError: The key file cannot be used, or the extra `secure` is missing.
    """
    return NodeSeal(spec, address, open_keyring(spec, address))
