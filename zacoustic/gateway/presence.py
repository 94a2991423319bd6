"""Liveliness tokens: which gateways are alive on this island.

Each gateway declares ``@acoustic/ADDRESS/gateway`` and watches the tokens of the others. Tokens are
the session's: they vanish with the process, and come back when a router does. A key that begins
with ``@`` matches no wildcard of an application, and no stream can have one, so nothing of this
ever crosses the water.
"""

import re
import threading
from collections.abc import Callable
from typing import Final

import zenoh

from zacoustic.errors import SessionError
from zacoustic.gateway.island import Island

PREFIX: Final = "@acoustic"
"""First chunk of all keys about gateways."""

# A get of tokens ends when all routers have answered; only a dying one uses up the time.
_LOOK_LIMIT_S: Final = 2.0
_TOKENS: Final = f"{PREFIX}/*/gateway"
_ADDRESS: Final = re.compile(rf"{PREFIX}/(\d{{1,3}})/gateway\Z")


class Presence:
    """The token of one gateway and its view of the others.

    Args:
        address: Acoustic address of this gateway.
        island: Its session.
        ring: Wakes the loop, which then calls `take`.
    """

    def __init__(self, address: int, island: Island, ring: Callable[[], None]) -> None:
        self._address = address
        self._island = island
        self._ring = ring
        self._guard = threading.Lock()
        self._news: dict[int, bool] = {}
        self._declared: list[zenoh.LivelinessToken | zenoh.Subscriber[None]] = []

    async def declare(self) -> list[int]:
        """Become visible; returns the addresses of those that are there already.

        Raises:
            SessionError: A gateway with this address is there.
        """
        return await self._island.worker.run(self._declare)

    def take(self) -> dict[int, bool]:
        """Return what has changed: address → is alive; on the loop."""
        with self._guard:
            news, self._news = self._news, {}
        return news

    def undeclare(self) -> None:
        """Become invisible; in the worker."""
        while self._declared:
            self._declared.pop().undeclare()  # type: ignore[no-untyped-call]

    def _declare(self) -> list[int]:
        if self._address in self._look():
            raise SessionError(
                f"another gateway on this network has the address {self._address}",
                hint="give each gateway an address of its own: --address; after a crash of the "
                "other one wait 10 s",
            )
        session = self._island.session
        token = f"{PREFIX}/{self._address}/gateway"
        self._declared.append(session.liveliness().declare_token(token))
        self._declared.append(
            session.liveliness().declare_subscriber(
                _TOKENS, self._island.callback(self._see), history=True
            )
        )
        return [address for address in self._look() if address != self._address]

    def _look(self) -> list[int]:
        replies = self._island.session.liveliness().get(_TOKENS, timeout=_LOOK_LIMIT_S)
        keys = [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]
        return [address for address in map(_address_in, keys) if address is not None]

    def _see(self, sample: zenoh.Sample) -> None:
        """Note a token that appeared or disappeared; on Zenoh's thread."""
        address = _address_in(str(sample.key_expr))
        if address is None:
            return
        with self._guard:
            self._news[address] = sample.kind == zenoh.SampleKind.PUT
        self._ring()


def _address_in(key: str) -> int | None:
    found = _ADDRESS.search(key)
    return int(found[1]) if found and 1 <= int(found[1]) <= 254 else None
