"""The boot epoch of a node: a new one in each life, journalled before the first frame uses it."""

from collections.abc import Callable

from zacoustic.core.base.journal import EPOCH_KEY, JournalPort
from zacoustic.core.base.signals import Signal
from zacoustic.core.peers.handshake import Handshake
from zacoustic.core.peers.sealing import Seal


class BootEpoch:
    """The boot epoch of one node.

    Args:
        handshake: Says it to others.
        journal: Keeps it.
        seal: Has it in its nonces, as the life of the node; None: frames are not sealed.
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
        """The epoch is journalled: no other life of the node has it.

        A store that cannot be written blocks nothing: the next life draws a number after this one.
        That is good enough for agreement, and not for a nonce.
        """
        if self._seal is not None:
            return not self._to_keep and self._seal.may_seal
        return not self._to_keep or bool(self._journal.failure)

    def outlast(self, is_calling: Callable[[], bool]) -> None:
        """Register a check whether a call is under way; `renew` asks it."""
        self._is_calling.append(is_calling)

    def begin(self, now: int) -> None:
        """Begin a new epoch; every confirmation of the old one is void."""
        self._handshake.table_changed(now)
        if self._seal is not None:
            self._seal.begin(self._handshake.epoch)
        self._write()
        self.began(now)

    def renew(self, now: int) -> bool:
        """Begin a new epoch unless a call is under way, which would not survive it.

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
