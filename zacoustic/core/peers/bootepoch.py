"""The boot epoch of a node: new at each start, journalled before the first frame uses it."""

from collections.abc import Callable

from zacoustic.core.base.journal import EPOCH_KEY, JournalPort
from zacoustic.core.base.signals import Signal
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.sealing import Seal


class BootEpoch:
    """The boot epoch of one node.

    Args:
        handshake: Announces it to others.
        journal: Stores it.
        seal: Uses it in nonces, as the life of the node; None: frames are not sealed.
    """

    def __init__(
        self, handshake: Handshake, journal: JournalPort, seal: Seal | None = None
    ) -> None:
        self._handshake = handshake
        self._journal = journal
        self._seal = seal
        self._to_keep = 0
        self.began = Signal[int]()
        """``(now)``: a new epoch has begun."""
        self._is_calling: list[Callable[[], bool]] = []
        self._write()

    @property
    def may_speak(self) -> bool:
        """The epoch is journalled, so no other start of the node uses it.

        A journal that cannot be written blocks nothing: the next start draws a number after this
        one. That is good enough for agreement, but not for a nonce.
        """
        if self._seal is not None:
            return not self._to_keep and self._seal.may_seal
        return not self._to_keep or bool(self._journal.failure)

    def outlast(self, is_calling: Callable[[], bool]) -> None:
        """Register a check whether a call is in progress; `renew` asks it."""
        self._is_calling.append(is_calling)

    def begin(self, now: int) -> None:
        """Begin a new epoch; all confirmations of the old one become void."""
        self._handshake.table_changed(now)
        if self._seal is not None:
            self._seal.begin(self._handshake.epoch)
        self._write()
        self.began(now)

    def renew(self, now: int) -> bool:
        """Begin a new epoch, unless a call is in progress: it would not survive that.

        Returns:
            Whether a new epoch has begun.
        """
        if any(is_calling() for is_calling in self._is_calling):
            return False
        self.begin(now)
        return True

    # Below the methods above

    def _write(self) -> None:
        self._to_keep += 1
        self._journal.write(EPOCH_KEY, self._handshake.epoch.to_bytes(2, "big"), self._kept)

    def _kept(self, now: int) -> None:
        self._to_keep -= 1
