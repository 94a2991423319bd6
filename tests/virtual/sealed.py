"""Engines of a fleet with a key, for networks in virtual time, and what their seals take."""

from collections.abc import Callable
from typing import Any, Final

from zacoustic.core.base.stats import Cause
from zacoustic.core.engine.engine import Engine
from zacoustic.core.wire.seal import LAST_LIFE
from zacoustic.seal.ccm import FleetCipher
from zacoustic.seal.keys import FleetKey
from zacoustic.seal.spec import Mode
from zacoustic.testing.virtual import VirtualNetwork

IN_STEP_BYTES: Final = 5.25
"""A seal in a frame that is not strong: a head of one byte, in one of sixteen of five; a tag of
four."""
STRONG_BYTES: Final = 7.75
"""What a strong frame has more: a head of five bytes, and a tag of eight."""
KEY = FleetKey(network="tests", generation=3, secret=bytes(range(32)))


class Recorded(FleetCipher):
    """A cipher that sees whether a nonce comes twice.

    Args:
        used: Nonces of all computers with the key of one node.
        key: The key.
        mode: As that of `FleetCipher`.
    """

    def __init__(
        self, used: set[tuple[int, bytes]], key: FleetKey = KEY, mode: Mode = Mode.ENCRYPT
    ) -> None:
        super().__init__(key, mode=mode)
        self._used = used
        self.frames = 0
        self.strong = 0
        """Those of the frames that have the long tag."""

    def seal(self, way: Any, nonce: bytes, records: bytes, associated: bytes) -> bytes:
        named = (self.generation, nonce)
        assert named not in self._used, f"{way}: nonce {nonce.hex()} is used twice"
        self._used.add(named)
        self.frames += 1
        self.strong += way.strong
        return super().seal(way, nonce, records, associated)


class SealedFleet:
    """Makes the engines of a fleet; each start of a node is a life of its own.

    Args:
        key: Of all nodes.
        make: Makes an engine.
        mode: As that of `FleetCipher`.
    """

    def __init__(
        self,
        key: FleetKey = KEY,
        make: Callable[..., Engine] = Engine,
        *,
        mode: Mode = Mode.ENCRYPT,
    ) -> None:
        self._key = key
        self._make = make
        self._mode = mode
        self._ciphers: list[Recorded] = []
        self.nonces: set[tuple[int, bytes]] = set()
        """All that were used."""
        self.lives: dict[int, Engine] = {}
        """The present engine of each node."""

    def __call__(self, *, address: int, epoch: int, **settings: Any) -> Engine:
        """Make an engine: the record of lives survives whatever becomes of the journal."""
        former = self.lives.get(address)
        life = former.epoch + 1 if former is not None else epoch
        assert life <= LAST_LIFE
        cipher = Recorded(self.nonces, self._key, self._mode)
        self._ciphers.append(cipher)
        settings["cipher"] = cipher
        self.lives[address] = self._make(address=address, epoch=life, **settings)
        return self.lives[address]

    @property
    def strong_share(self) -> float:
        """Share of all frames so far that have the long tag."""
        frames = sum(each.frames for each in self._ciphers)
        return sum(each.strong for each in self._ciphers) / frames if frames else 0.0

    @property
    def expected_bytes(self) -> float:
        """What the seal of a frame takes on average, if none is repeated or urgent."""
        return IN_STEP_BYTES + STRONG_BYTES * self.strong_share


def seal_bytes(network: VirtualNetwork) -> tuple[int, int]:
    """Return the frames of a run, and what their seals took, bytes."""
    frames, seals = 0, 0
    for stats in network.stats():
        frames += stats.frames_transmitted
        seals += sum(row.transmitted_bytes for row in stats.ledger() if row.cause is Cause.SEAL)
    return frames, seals
