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
from zacoustic.seal.lives import LifeError
from zacoustic.seal.spec import SecuritySpec

_NO_LIFE: Final = LAST_LIFE + 1
"""The epoch of an engine that seals nothing."""
_logger = logging.getLogger(__name__)


class NodeSeal:
    """What seals the frames of one node.

    Args:
        spec: What the config says.
        ring: The key, and what is made of it.
        life: The life that has begun; None: none has.
        failure: Why none has, one line.
    """

    def __init__(self, spec: SecuritySpec, ring: Keyring, life: int | None, failure: str) -> None:
        self._spec = spec
        self._ring = ring
        self._life = life
        self.failure = failure
        """Why this node seals no frame, one line; empty: it seals them."""

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
    def epoch(self) -> int:
        """Boot epoch of the first engine."""
        return _NO_LIFE if self._life is None else self._life

    def keep_lives(self, journal: Journal) -> Journal:
        """Return a journal that writes down the lives of further engines first."""
        return LifeJournal(journal, self._ring.lives, self._life)

    def begin(self, loop: asyncio.AbstractEventLoop) -> None:
        """The node starts: the former key is opened for as long as the config says."""
        if self._ring.key.former is not None:
            loop.call_later(self._spec.overlap_s, self._ring.cipher.end_overlap)

    def report(self) -> dict[str, object]:
        """Return what may be known of it, for health and logs: nothing of it is secret."""
        key = self._ring.key
        return {
            "network": key.network,
            "generation": key.generation,
            "fingerprint": key.fingerprint,
            "mode": self._spec.mode.value,
            "life": self._life,
            "failure": self.failure,
        }


def open_seal(spec: SecuritySpec, address: int) -> NodeSeal:
    """Read the key file, and begin a life.

    Args:
        spec: What the config says.
        address: The node, 1…254.

    Raises:
        ConfigError: The key file cannot be used, or the extra `secure` is missing.
    """
    ring = open_keyring(spec, address)
    if spec.only_opens:
        return NodeSeal(spec, ring, None, "it only listens, as the configuration says")
    try:
        life = ring.lives.begin()
    except LifeError as error:
        _logger.error("node %d seals no frame, and transmits none: %s", address, error)
        return NodeSeal(spec, ring, None, str(error))
    _logger.info("node %d: sealed with %r, life %d", address, ring.key, life)
    return NodeSeal(spec, ring, life, "")
