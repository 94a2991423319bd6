"""The boot epoch of this node: no frame goes before it is written down."""

from collections.abc import Callable

from zacoustic.core.base.journal import EPOCH_KEY, JournalPort
from zacoustic.core.peers.handshake import Handshake


class BootEpoch:
    """The boot epoch of one node.

    Args:
        handshake: Says it to others.
        journal: Keeps it.
    """

    def __init__(self, handshake: Handshake, journal: JournalPort) -> None:
        self._handshake = handshake
        self._journal = journal
        self._to_keep = 0
        self._told: list[Callable[[int], None]] = []
        self._outlasts: list[Callable[[], bool]] = []
        self._write()

    @property
    def may_speak(self) -> bool:
        """It is written down: no other life of the node will have it.

        Nor will one where the store cannot be written: it has drawn this one, and draws the next.
        """
        return not self._to_keep or bool(self._journal.failure)

    def on_begin(
        self, told: Callable[[int], None], outlasts: Callable[[], bool] | None = None
    ) -> None:
        """Tell somebody of each new epoch, after those that have asked before.

        Args:
            told: Takes the instant at which it begins.
            outlasts: Returns whether nothing is under way that would not survive it.
        """
        self._told.append(told)
        if outlasts is not None:
            self._outlasts.append(outlasts)

    def begin(self, now: int) -> None:
        """Begin a new one: what peers have confirmed is over."""
        self._handshake.table_changed(now)
        self._write()
        for told in self._told:
            told(now)

    def renew(self, now: int) -> bool:
        """Begin a new one if everything survives it; returns whether it has begun."""
        if not all(outlasts() for outlasts in self._outlasts):
            return False
        self.begin(now)
        return True

    def _write(self) -> None:
        self._to_keep += 1
        self._journal.write(EPOCH_KEY, self._handshake.epoch.to_bytes(2, "big"), self._kept)

    def _kept(self, now: int) -> None:
        self._to_keep -= 1
