"""Liveliness tokens: the live gateways on this network.

Each gateway declares two::

    @acoustic/ADDRESS/gateway           a gateway of any fleet uses the address
    @acoustic/ADDRESS/gateway/DIGEST    with the digest of its stream table

and watches the second kind with its own digest: those are redundant gateways. Gateways with other
tables belong to other fleets and share nothing but the network. Tokens belong to the session: they
vanish with the process, and come back with a router. A key that begins with ``@`` matches no
wildcard of an application, and no stream can have one, so tokens never cross the channel.
"""

import re
import threading
from collections.abc import Callable
from typing import Final

import zenoh

from zacoustic.errors import SessionError
from zacoustic.zenoh.requests.request import PREFIX
from zacoustic.zenoh.session.session import ZenohSession

# A get of tokens ends when all routers have answered; only a failing one uses up the time.
_LOOK_LIMIT_S: Final = 2.0
_ADDRESS: Final = re.compile(rf"{PREFIX}/([0-9]{{1,3}})/gateway/")


class Presence:
    """The token of one gateway and its view of the others.

    Args:
        address: Acoustic address of this gateway.
        digest: Digest of its stream table, hexadecimal.
        zenoh_session: Its session.
        ring: Wakes the loop, which then calls `take`.
    """

    def __init__(
        self, address: int, digest: str, zenoh_session: ZenohSession, ring: Callable[[], None]
    ) -> None:
        self._address = address
        self._token = f"{PREFIX}/{address}/gateway"
        self._tokens = f"{PREFIX}/*/gateway/{digest}"
        self._digest = digest
        self._zenoh_session = zenoh_session
        self._ring = ring
        self._guard = threading.Lock()
        self._news: dict[int, bool] = {}
        self._declared: list[zenoh.LivelinessToken | zenoh.Subscriber[None]] = []

    async def declare(self) -> list[int]:
        """Become visible; returns the addresses of redundant gateways already present.

        Raises:
            SessionError: A gateway with this address is already there.
        """
        return await self._zenoh_session.worker.run(self._declare)

    def take(self) -> dict[int, bool]:
        """Return the changes: address → is alive; on the loop."""
        with self._guard:
            news, self._news = self._news, {}
        return news

    def undeclare(self) -> None:
        """Become invisible; in the worker."""
        while self._declared:
            self._declared.pop().undeclare()  # type: ignore[no-untyped-call]

    def _declare(self) -> list[int]:
        if self._look(self._token):
            raise SessionError(
                f"another gateway on this network has the address {self._address}",
                hint="give each gateway an address of its own: --address; after a crash of the "
                "other one wait 10 s",
            )
        liveliness = self._zenoh_session.session.liveliness()
        for token in (self._token, f"{self._token}/{self._digest}"):
            self._declared.append(liveliness.declare_token(token))
        self._declared.append(
            liveliness.declare_subscriber(
                zenoh.KeyExpr(self._tokens), self._zenoh_session.callback(self._see), history=True
            )
        )
        redundant = map(_address_in, self._look(self._tokens))
        return [each for each in redundant if each is not None and each != self._address]

    def _look(self, tokens: str) -> list[str]:
        replies = self._zenoh_session.session.liveliness().get(tokens, timeout=_LOOK_LIMIT_S)
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    def _see(self, sample: zenoh.Sample) -> None:
        """Note a redundant gateway that appeared or disappeared; on Zenoh's thread."""
        address = _address_in(str(sample.key_expr))
        if address is None:
            return
        with self._guard:
            self._news[address] = sample.kind == zenoh.SampleKind.PUT
        self._ring()


def _address_in(key: str) -> int | None:
    found = _ADDRESS.search(key)
    return int(found[1]) if found and 1 <= int(found[1]) <= 254 else None
