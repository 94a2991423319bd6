"""Engines of a fleet with a key, for networks in virtual time."""

from collections.abc import Callable
from typing import Any

from zacoustic.core.engine.engine import Engine
from zacoustic.core.wire.seal import LAST_LIFE
from zacoustic.seal.ccm import FleetCipher
from zacoustic.seal.keys import FleetKey

KEY = FleetKey(network="tests", generation=3, secret=bytes(range(32)))


class Recorded(FleetCipher):
    """A cipher that sees whether a nonce comes twice.

    Args:
        used: Nonces of all computers with the key of one node.
        key: The key.
    """

    def __init__(self, used: set[tuple[int, bytes]], key: FleetKey = KEY) -> None:
        super().__init__(key)
        self._used = used
        self.frames = 0

    def seal(self, way: Any, nonce: bytes, records: bytes, associated: bytes) -> bytes:
        named = (self.generation, nonce)
        assert named not in self._used, f"{way}: nonce {nonce.hex()} is used twice"
        self._used.add(named)
        self.frames += 1
        return super().seal(way, nonce, records, associated)


class SealedFleet:
    """Makes the engines of a fleet; each start of a node is a life of its own.

    Args:
        key: Of all nodes.
        make: Makes an engine.
    """

    def __init__(self, key: FleetKey = KEY, make: Callable[..., Engine] = Engine) -> None:
        self._key = key
        self._make = make
        self.nonces: set[tuple[int, bytes]] = set()
        """All that were used."""
        self.lives: dict[int, Engine] = {}
        """The present engine of each node."""

    def __call__(self, *, address: int, epoch: int, **settings: Any) -> Engine:
        """Make an engine: the record of lives survives whatever becomes of the journal."""
        former = self.lives.get(address)
        life = former.epoch + 1 if former is not None else epoch
        assert life <= LAST_LIFE
        cipher = Recorded(self.nonces, self._key)
        settings["cipher"] = cipher
        self.lives[address] = self._make(address=address, epoch=life, **settings)
        return self.lives[address]
