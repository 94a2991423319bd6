"""`NodeSeal`: the key, the life and the cipher of one node, from its start to its end.

A node that cannot know its life seals nothing: it listens, opens what is for it, and reports why it
is silent, until an operator makes its record anew (`zacoustic key rejoin`).
"""

import asyncio
import logging
from typing import Final

from zacoustic.core.wire.seal import LAST_LIFE, Cipher
from zacoustic.run.journal.lives import LifeJournal
from zacoustic.run.journal.port import Journal
from zacoustic.seal.keyring import Keyring, open_keyring
from zacoustic.seal.spec import SecuritySpec
from zacoustic.status.node import SealDocument

_NO_LIFE: Final = LAST_LIFE + 1
"""The epoch of every engine that seals nothing."""
OLD_JOURNAL: Final = "frames that were recorded since then can be opened once more"
"""Consequence of an old journal."""
_logger = logging.getLogger(__name__)


class NodeSeal:
    """Seals the frames of one node.

    Args:
        spec: The section of the config.
        address: The node, 1…254.
        ring: The key with its cipher and life records.
    """

    def __init__(self, spec: SecuritySpec, address: int, ring: Keyring) -> None:
        self._spec = spec
        self._address = address
        self._ring = ring
        self._lives: LifeJournal | None = None

    @property
    def source(self) -> str:
        """Place in the configuration that asks for the seal."""
        return self._spec.source

    @property
    def only_opens(self) -> bool:
        """The config asks the node only to listen."""
        return self._spec.only_opens

    @property
    def cipher(self) -> Cipher:
        """The cipher for the engines."""
        return self._ring.cipher

    @property
    def life(self) -> int | None:
        """The present life; None: none has begun."""
        return None if self._lives is None else self._lives.life

    @property
    def failure(self) -> str:
        """Why this node seals no frame, one line; empty: it seals."""
        if self._lives is None:
            return "it only listens, as configured"
        return self._lives.failure

    def epoch(self, journalled: int) -> int:
        """Return the boot epoch of an engine.

        Args:
            journalled: The journal's boot epoch for it.
        """
        return _NO_LIFE if self.life is None else journalled

    def keep_lives(self, journal: Journal) -> Journal:
        """Return a journal whose boot epochs are lives, recorded before their use."""
        if self._spec.only_opens:
            return journal
        self._lives = LifeJournal(journal, self._ring.lives)
        return self._lives

    def begin(self, loop: asyncio.AbstractEventLoop) -> None:
        """Start the overlap: open frames of the former key for as long as the config says."""
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

    def report(self) -> SealDocument:
        """Return its state for the health report; contains no secret."""
        key = self._ring.key
        return SealDocument(
            network=key.network,
            generation=key.generation,
            fingerprint=key.fingerprint,
            mode=self._spec.mode.value,
            life=self.life,
            failure=self.failure,
        )


def open_seal(spec: SecuritySpec, address: int) -> NodeSeal:
    """Read the key file; a life begins when the journal is recovered.

    Args:
        spec: What the config says.
        address: The node, 1…254.

    Raises:
        ConfigError: The key file cannot be used, or the extra `secure` is missing.
    """
    return NodeSeal(spec, address, open_keyring(spec, address))
