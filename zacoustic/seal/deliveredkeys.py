"""The keys for broadcasts that other nodes have delivered across the channel.

They stay wrapped as they came, under a key of the pair of nodes, in a file beside the life records
that only its owner can read. They belong to one generation: a new list has its own.

A node starts without them when their file cannot be read: it misses broadcasts of some nodes, but
hears and obeys the others, and the keys can be sent again.
"""

import logging
from collections.abc import Mapping
from pathlib import Path

import msgspec

from zacoustic.seal.keys import KeyFileError, read_private, write_private

_logger = logging.getLogger("zacoustic.seal")


class DeliveredKey(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One key."""

    sender: int
    """The node that wrapped it."""
    wrapped: bytes
    """The wrapped secret, 40 bytes."""


class _File(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    network: str
    generation: int
    of: dict[int, DeliveredKey] = {}


class DeliveredKeys:
    """The delivered keys of one node in one generation.

    Args:
        network: Name of the network.
        generation: Generation of the list of members.
        path: Their file; None: they are forgotten at the end of the process. One that cannot be
            read is logged as an error; the next delivered key replaces it.
    """

    def __init__(self, network: str, generation: int, path: Path | None = None) -> None:
        self._empty = _File(network=network, generation=generation)
        self._path = path
        self._of: dict[int, DeliveredKey] = {}
        if path is not None and path.exists():
            try:
                found = read_private(path, _File)
            except KeyFileError as error:
                _logger.error("%s; the delivered keys are lost: send them again", error.args[0])
                return
            if (found.network, found.generation) == (network, generation):
                self._of = dict(found.of)

    @property
    def of(self) -> Mapping[int, DeliveredKey]:
        """The key for each source."""
        return self._of

    def keep(self, source: int, key: DeliveredKey) -> None:
        """Store a key in place of an earlier one.

        Raises:
            KeyFileError: The file cannot be written; nothing has changed.
        """
        kept = self._of | {source: key}
        if self._path is not None:
            try:
                self._path.parent.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise KeyFileError(f"{self._path.parent}: {error.strerror}") from error
            write_private(self._path, msgspec.structs.replace(self._empty, of=kept), replace=True)
        self._of = kept
